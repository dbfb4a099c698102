"""``python -m experiments.studies.blind --out DIR``: run a blind test, or show the tables of its results.

The test is the experiment DIR/blind.toml, which is written first; what has no result in DIR is run. The
tables are those of all results in DIR.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import tomli_w

from experiments import run_experiment
from experiments.results import writable
from experiments.run.progress import progress_bars
from experiments.studies.blind.results import read_results, write_table
from experiments.studies.blind.tables import tables
from experiments.studies.blind.trials import Trial, experiment_of, planned


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing, then print the tables and keep them in ``tables.md``."""
    options = _parser().parse_args(arguments)
    try:
        trials = planned(
            options.clean, options.each, options.outside, options.two, options.effects, options.noise,
            options.first,
        )  # fmt: skip
    except ValueError as fault:
        sys.exit(str(fault))
    if not options.table_only:
        _run(trials, options.out, options.jobs)
    results = read_results(options.out)
    if options.gather:
        write_table(results, options.gather)
    text = tables(results)
    (options.out / "tables.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def _run(trials: Sequence[Trial], out: Path, jobs: int) -> None:
    file = writable(out) / "blind.toml"
    out.mkdir(parents=True, exist_ok=True)
    file.write_text(tomli_w.dumps(experiment_of(trials)), encoding="utf-8")
    with progress_bars(quiet=False) as report:
        run_experiment(file, out, jobs, progress=report)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m experiments.studies.blind", description=__doc__)
    parser.add_argument("--clean", type=int, default=20, metavar="N", help="campaigns without effect")
    parser.add_argument("--each", type=int, default=5, metavar="N", help="seeds per core effect")
    parser.add_argument("--outside", type=int, default=2, metavar="N", help="seeds per effect outside")
    parser.add_argument("--two", type=int, default=20, metavar="N", help="campaigns with a random pair")
    parser.add_argument("--effects", nargs="+", default=(), metavar="NAME[@PLACE]", help="only these")
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0], metavar="X",
                        help="factors on noise, one drawn for every campaign")  # fmt: skip
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="campaigns at the same time")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for results")
    parser.add_argument("--table-only", action="store_true", help="run nothing, print the tables of DIR")
    parser.add_argument("--gather", type=Path, metavar="FILE",
                        help="write all results of DIR as one table, a line of JSON each")  # fmt: skip
    return parser


if __name__ == "__main__":
    main()
