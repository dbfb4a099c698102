"""How often discovery finds the tension law that the virtual rig hid, and how well.

``python -m benchmarks.discovery --seeds 10 --laws eq13 power-2 --noise 1 --scatter 1`` makes a campaign per
law and seed (20 preloads, hits of 100, 80 and 60 % of full strength), discovers on the folder alone, and
scores the ranking against the truth beside it, read only then. A table per noise level, a row per law;
``--peers`` adds a table of other programs on the same records. All this is an experiment's file, which
``--out`` keeps. ``--forms`` is quick: a race of given forms, all started alike, in place of the search, and
one identification for all laws of a seed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from joblib import Parallel, delayed

from benchmarks.discovery_peers import SYMBOLIC, missing
from benchmarks.discovery_scores import SURE, Trial, measured, measured_with_peers, score, trial_of
from benchmarks.discovery_specimens import (
    HOLD_OUT_EVERY,
    PRELOADS,
    Setting,
    Specimen,
    measure,
    specimen_of,
)
from benchmarks.discovery_truth import LAWS, PAPER, read_truth
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import (
    displacement_power,
    dissipated_power,
    tension_logistic,
    tension_power,
    velocity_displacement,
    velocity_power,
    velocity_threshold,
)
from discovery.ranking.confidence_sets import exponent_profile
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.race import race
from discovery.ranking.result import Ranking
from experiments import run_experiment
from experiments.run.progress import progress_bars
from experiments.studies import rig
from experiments.studies.experiment.settings import FORMAT
from rom.identification.identify import Identification


def _forms() -> dict[str, tuple[Term, ...]]:
    gamma, n, q = tension_logistic(), velocity_power(3.5), displacement_power(3.0)
    both = Term(velocity_power(4.0).held(n=4.0), gamma), Term(displacement_power(2.0).held(q=2.0), gamma)
    return {
        "velocity": (Term(n, gamma),),
        "velocity-constant-gamma": (Term(n, tension_power()),),
        "displacement": (Term(q, gamma),),
        "displacement-constant-gamma": (Term(q, tension_power()),),
        "velocity-times-displacement": (Term(velocity_displacement(2.0, 1.0), gamma),),
        "velocity-threshold": (Term(velocity_threshold(0.01, 0.1, 3.0), gamma),),
        "dissipated-power": (Term(dissipated_power(1.5), gamma),),
        "velocity-and-displacement": both,
    }


FORMS = tuple(_forms())


def contenders(names: Sequence[str] = FORMS) -> list[Candidate]:
    """Forms that a race without search is between, beside those that are always in it."""
    forms = _forms()
    return [Candidate(name, forms[name], (1.0,) * len(forms[name]), "contender") for name in names]


def race_of_forms(
    found: Specimen, seed: int, names: Sequence[str] = FORMS, *, profiled: bool = True
) -> Ranking:
    """Rank the contenders, with the profile of the exponent in the first one where that is asked for."""
    laws = race(contenders(names), found.training, seed=seed)
    compared = laws[:6]
    fits = [replace(law.fit, candidate=law.candidate) for law in compared]
    pairs = compare_laws(fits, found.training, {law.name: law.scores for law in compared})
    return Ranking(
        laws=laws,
        considered=len(laws),
        identified=found.training.model,
        inclusion={},
        profile=exponent_profile(found.training, laws[0].candidate) if profiled else None,
        indistinguishable=not_told_apart(pairs, laws[0].name),
        courses=(*found.training.courses, *found.hold_out.courses),
    )


def run_seed(seed: int, laws: Sequence[str], setting: Setting, forms: Sequence[str]) -> list[Trial]:
    """Make a campaign for every law and score a race of forms; the plant is identified once."""
    trials: list[Trial] = []
    known: Identification | None = None
    for law in laws:
        with tempfile.TemporaryDirectory() as scratch:
            campaign = measure(Path(scratch) / "campaign", law, seed, setting)
            started = time.perf_counter()
            found = specimen_of(campaign, known)
            known = found.identified
            ranking = race_of_forms(found, seed, forms)
            truth, seconds = read_truth(rig.truth_path(campaign.path)), time.perf_counter() - started
            trials.append(score(ranking, truth, seconds))
        print(f"noise {setting.noise:g}, {law}, seed {seed}: {trials[-1]}", file=sys.stderr, flush=True)
    return trials


def searched(options: argparse.Namespace, out: Path) -> list[dict[str, Any]]:
    """Run the search on a campaign for every law, seed and level of noise, and return the cells."""
    rig_options = {
        "cases": PRELOADS, "hold_out_every": HOLD_OUT_EVERY, "duration_s": options.duration,
        "strengths": list(rig.strengths_from_text(options.strengths)), "scatter": options.scatter,
        "noise": options.noise, "seed": list(range(options.first, options.first + options.seeds)),
    }  # fmt: skip
    rivals = [law for law in options.laws if law != PAPER]
    tables = [{"name": PAPER, **rig_options}] if PAPER in options.laws else []
    tables += [{"name": "rival", "law": rivals, **rig_options}] if rivals else []
    content = {"format": FORMAT, "name": "hidden laws", "command": "discover", "rig": tables}
    file = out / "experiment.toml"
    out.mkdir(parents=True, exist_ok=True)
    file.write_text(tomli_w.dumps(content), encoding="utf-8")
    measure = measured_with_peers if options.peers else measured
    with progress_bars(quiet=False) as report:
        table = run_experiment(file, out, options.jobs, progress=report, measure=measure)
    for row in table.failed:
        print(f"{row['campaign']}: {row['message']}", file=sys.stderr)
    cells: list[dict[str, Any]] = json.loads(table.path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["status"] == "ok"]


def trials_by_law(
    cells: Sequence[Mapping[str, Any]], laws: Sequence[str], noise: float
) -> dict[str, list[Trial]]:
    """Return the scores of the cells of one level of noise."""
    found: dict[str, list[Trial]] = {law: [] for law in laws}
    for cell in cells:
        if cell["settings"]["rig.noise"] == noise:
            found[cell["settings"].get("rig.law", PAPER)].append(trial_of(cell))
    return {law: trials for law, trials in found.items() if trials}


COLUMNS = (
    "seeds",
    "exponent of v",
    "95 % set holds it",
    "its width",
    "form true / listed / other",
    "driven as the truth",
    "gamma(T) curve of the true form, largest error [%]",
    "held-out loss error [%]",
    "over true law's, refitted",
    "over baseline's",
    "called better than the baseline",
    "time [s]",
)


def row(law: str, trials: Sequence[Trial]) -> str:
    """Return the line of a law: medians, smallest to largest in brackets, counts."""
    count = len(trials)

    def spread(value: Callable[[Trial], float], digits: int = 2) -> str:
        values = np.array([value(trial) for trial in trials])
        values = values[~np.isnan(values)]
        if not values.size:
            return "-"
        return f"{np.median(values):.{digits}f} ({values.min():.{digits}f}-{values.max():.{digits}f})"

    held = [trial.holds for trial in trials if not np.isnan(trial.holds)]
    forms = [trial.form for trial in trials]
    cells = [
        spread(lambda t: t.exponent),
        f"{sum(held):.0f} of {len(held)}" if held else "-",
        spread(lambda t: t.high - t.low),
        " / ".join(str(forms.count(name)) for name in ("true", "listed", "other")),
        f"{sum(t.motion for t in trials)} of {count}",
        spread(lambda t: t.curve, 0),
        spread(lambda t: t.winner_error, 1),
        spread(lambda t: t.winner_error / t.truth_error),
        spread(lambda t: t.winner_error / t.baseline_error),
        f"{sum(t.smallest_p < SURE for t in trials)} of {count}",
        spread(lambda t: t.seconds, 0),
    ]
    return "| " + " | ".join([law, str(count), *cells]) + " |"


PEER_COLUMNS = ("held-out loss error over ours", "driven as the truth (ours)", "time [s] (ours)")


def peer_rows(law: str, trials: Sequence[Trial]) -> list[str]:
    """Return a line for every peer: medians, smallest to largest in brackets, counts."""
    lines = []
    ours = sum(t.motion for t in trials), float(np.median([t.seconds for t in trials]))
    for name in trials[0].peers:
        of = [trial.peers[name] for trial in trials]
        ratios = np.array([peer.ratio for peer in of])
        seconds = float(np.median([peer.seconds for peer in of]))
        cells = [
            f"{np.median(ratios):.3g} ({ratios.min():.3g}-{ratios.max():.3g})",
            f"{sum(peer.motion for peer in of)} of {len(of)} ({ours[0]})",
            f"{seconds:.0f} ({ours[1]:.0f})",
        ]
        lines.append(f"| {law}: {name} | {' | '.join(cells)} |")
    return [*lines, *(f"| {law}: {name} | not installed | - | - |" for name in missing())]


def header(columns: Sequence[str], first: str = "truth") -> str:
    """Return the two lines that open a table."""
    return "\n".join([f"| {' | '.join([first, *columns])} |", "|---" * (len(columns) + 1) + "|"])


def options_given() -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--laws", nargs="+", choices=list(LAWS), default=list(LAWS))
    parser.add_argument("--noise", type=float, nargs="+", default=[1.0])
    parser.add_argument("--scatter", type=float, default=1.0)
    parser.add_argument("--duration", type=float, default=8.5, help="length of a record [s]")
    parser.add_argument("--strengths", default="1,0.8,0.6", help="hits per preload, shares of full strength")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--forms", nargs="*", choices=FORMS, help="race of these (none named: all) in place of the search"
    )
    parser.add_argument("--peers", action="store_true", help=f"pysindy alone, and {', '.join(SYMBOLIC)}")
    parser.add_argument("--out", type=Path, help="keep experiment and results; a second call goes on there")
    options = parser.parse_args()
    if options.forms is not None and (options.peers or options.out):
        parser.error("--forms: a race has no --peers and no --out")
    return options


def main() -> None:
    """Print a table for every level of noise."""
    options = options_given()
    with tempfile.TemporaryDirectory() as scratch:
        cells = searched(options, options.out or Path(scratch)) if options.forms is None else []
        for noise in options.noise:
            raced = options.forms is not None
            by_law = _raced(options, noise) if raced else trials_by_law(cells, options.laws, noise)
            print(
                f"\n### Noise x {noise:g}, scatter x {options.scatter:g}, hits {options.strengths}, records "
                f"of {options.duration:g} s, {options.seeds} seeds\n"
            )
            rows = [row(law, trials) for law, trials in by_law.items()]
            print("\n".join([header(COLUMNS), *rows]), flush=True)
            if options.peers:
                lines = [line for law, trials in by_law.items() for line in peer_rows(law, trials)]
                print("\n".join(["", header(PEER_COLUMNS, "truth: program"), *lines]), flush=True)


def _raced(options: argparse.Namespace, noise: float) -> dict[str, list[Trial]]:
    """Scores of the race of forms of every law."""
    setting = Setting(noise, options.scatter, options.duration, rig.strengths_from_text(options.strengths))
    seeds = range(options.first, options.first + options.seeds)
    given = options.laws, setting, options.forms or FORMS
    by_seed = Parallel(n_jobs=options.jobs)(delayed(run_seed)(seed, *given) for seed in seeds)
    return {law: [trials[k] for trials in by_seed] for k, law in enumerate(options.laws)}


if __name__ == "__main__":
    main()
