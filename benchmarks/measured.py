"""The closed loop on the field's public benchmarks, with their official test records.

    python -m benchmarks.measured --data FOLDER

FOLDER holds the files as they were published, each set anywhere below it: DATA_EMPS.mat and
DATA_EMPS_PULSES.mat, SNLS80mV.mat, uval_multisine.mat and its fellows, dataBenchmark.mat,
F16Data_FullMSine_Level1.mat and its fellows. With --download those that are not there are fetched by their
official loader, the package nonlinear-benchmarks. A set without files is skipped with a line; Bouc-Wen alone
is then regenerated from its published equation, and called so.

Each set becomes a campaign as `boltlaw import` would have it, goes through the closed loop with the criteria
of every other campaign, and the refined model is simulated on the test records from their force. No number is
fitted to these; as held-out records of any campaign they have a say in whether an effect is accepted.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from benchmarks.measured_sets import BENCHMARKS, SOURCES, Benchmark, Scored
from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from experiments.datasets.collected import SourceError
from rom.campaign.campaign import Campaign, read_campaign, write_campaign
from rom.evaluation.replay import replay
from rom.identification.modal_sensors import as_sensors_show
from rom.model.model import Model
from rom.signals.measured_records import measured_record, with_stored_records

SKIPPED = "{name}: skipped: found no {file}; give its folder with --data, or --download to have it fetched"
REGENERATED = "{name}: regenerated from its published equation: found no {file}"
HEAD = ("benchmark", "test", "unit", "declared", "ours", "best published", "by", "verdict", "wall s", "CPU s")


@dataclass(frozen=True)
class Outcome:
    """What the loop made of a benchmark: errors of its tests by the declared and the refined model, times."""

    benchmark: str
    campaign: str
    closure: Closure
    errors: tuple[tuple[Scored, float, float], ...]
    wall_s: float
    cpu_s: float


def error_of(model: Model, campaign: Campaign, test: Scored) -> float:
    """Return the RMS of simulated minus measured motion over a test's samples, in the records' unit.

    Parameters
    ----------
    model : Model
        The model; infinite where its simulation does not finish.
    campaign : Campaign
        With the test's records.
    test : Scored
        Which samples of which records count.
    """
    squares, settings = list[float](), {record.file: record for record in campaign.settings.record}
    for file, part in test.parts:
        run = replay(model, measured_record(campaign, settings[file]).measurement)
        if run.response.status != "ok":
            return np.inf
        shown = as_sensors_show(run.model, run.response, run.measurement)
        for body, motion in run.measurement.motion.items():
            squares += ((shown[motion.kind][body] - motion.samples)[part] ** 2).tolist()
    return float(np.sqrt(np.mean(squares)))


@with_stored_records
def outcome(campaign: Campaign, name: str, tests: Sequence[Scored], jobs: int, progress: Progress) -> Outcome:
    """Close the loop on a campaign and simulate its tests.

    Parameters
    ----------
    campaign : Campaign
        Of the benchmark.
    name : str
        Of the benchmark.
    tests : sequence of Scored
        Its tests.
    jobs : int
        Processes.
    progress : rich.progress.Progress
        Shows the stages.
    """
    task = progress.add_task(name, total=None)

    def stage(words: str) -> None:
        progress.update(task, description=f"{name}: {words}")

    wall, cpu = time.perf_counter(), sum(os.times()[:4])
    closure = close_loop(campaign, jobs, stage)
    wall, cpu = time.perf_counter() - wall, sum(os.times()[:4]) - cpu
    stage("simulating the tests")
    assert closure.declared is not None
    errors = tuple(
        (test, error_of(closure.declared, campaign, test), error_of(closure.model, campaign, test))
        for test in tests
    )
    progress.remove_task(task)
    return Outcome(name, campaign.settings.name, closure, errors, wall, cpu)


def outcome_of(
    name: str, benchmark: Benchmark, source: Path | None, seed: int, jobs: int, progress: Progress
) -> Outcome:
    """Make a benchmark's campaign in a temporary folder and close it.

    Parameters
    ----------
    name : str
        Of the benchmark.
    benchmark : Benchmark
        What it is.
    source : Path or None
        Folder of its files.
    seed : int
        Of what is regenerated.
    jobs : int
        Processes.
    progress : rich.progress.Progress
        Shows the stages.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        collected = benchmark.collect(source, seed)
        write_campaign(folder, collected.settings, collected.records)
        return outcome(read_campaign(folder), name, benchmark.tests(source), jobs, progress)


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return lines of the table, a row for each test, in Markdown."""
    rows = [HEAD, ("---",) * len(HEAD)]
    for one in outcomes:
        benchmark = BENCHMARKS[one.benchmark]
        once = (one.closure.verdict, f"{one.wall_s:.0f}", f"{one.cpu_s:.0f}")
        for test, before, after in one.errors:
            ours = (f"{error * benchmark.per_si:.3g}" for error in (before, after))
            known = test.published
            best = ("–", "–") if known is None else (f"{known.error:g}", f"{known.model}, in {known.source}")
            rows.append((one.benchmark, test.name, benchmark.unit, *ours, *best, *once))
            once = ("", "", "")
    return ["| " + " | ".join(row) + " |" for row in rows]


def cited(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line for each source of the table."""
    named = {test.published.source for one in outcomes for test, *_ in one.errors if test.published}
    return [f"{name}: {full}." for name, full in SOURCES.items() if name in named]


def equation(one: Outcome) -> str:
    """Return the model that the loop ended with: masses, laws and effects with their numbers."""
    title, remark = BENCHMARKS[one.benchmark].title, BENCHMARKS[one.benchmark].remark
    head = f"{title}\ncampaign: {one.campaign}" + (f"\n{remark}" if remark else "")
    return f"{head}\n{one.closure.model.summary()}"


def sources(
    names: Sequence[str], folders: Sequence[Path], downloads: Path | None
) -> tuple[dict[str, Path | None], list[str]]:
    """Return the folder of each benchmark's files, and a line for every benchmark that has none.

    Parameters
    ----------
    names : sequence of str
        Benchmarks.
    folders : sequence of Path
        Where their files may be.
    downloads : Path or None
        Where files are fetched to that are in none of these; nothing is fetched if not given.
    """
    found, lines = dict[str, Path | None](), list[str]()
    for name in names:
        benchmark, fault = BENCHMARKS[name], ""
        source = benchmark.source(folders)
        if source is None and downloads is not None:
            try:
                source = benchmark.fetched(downloads / name)
            except SourceError as cause:
                fault = f" ({cause})"
        if source is not None or not benchmark.needs_files:
            found[name] = source
        if source is None:
            without = SKIPPED if benchmark.needs_files else REGENERATED
            lines.append(without.format(name=name, file=benchmark.missing(folders)) + fault)
    return found, lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and under it the equation of each benchmark."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.measured", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=tuple(BENCHMARKS), metavar="NAME",
                        help=", ".join(BENCHMARKS))  # fmt: skip
    parser.add_argument(
        "--data", nargs="+", type=Path, default=(), metavar="FOLDER", help="files of the sets"
    )
    parser.add_argument("--download", action="store_true", help="fetch what no folder has")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of what is regenerated")
    options = parser.parse_args(arguments)
    if missing := [folder for folder in options.data if not folder.is_dir()]:
        parser.error(f"--data: found no folder {missing[0]}")
    outcomes = list[Outcome]()
    with tempfile.TemporaryDirectory() as scratch, Progress(console=Console(stderr=True)) as progress:
        found, lines = sources(options.only, options.data, Path(scratch) if options.download else None)
        _tell(lines, progress)
        for name, source in found.items():
            try:
                one = outcome_of(name, BENCHMARKS[name], source, options.seed, options.jobs, progress)
            except SourceError as fault:
                _tell([f"{name}: skipped: {fault}"], progress)
                continue
            outcomes.append(one)
            _tell(table([one])[2:], progress)
    print("\n".join([*table(outcomes), "", *cited(outcomes)]))
    for one in outcomes:
        print(f"\n{equation(one)}")


def _tell(lines: Sequence[str], progress: Progress) -> None:
    """Print lines on standard error, above the stages."""
    for line in lines:
        progress.console.print(line, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
