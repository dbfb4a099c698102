"""All cells of an experiment: those without a result are run, then their numbers are gathered."""

from __future__ import annotations

import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from experiments.results import plain, writable, write_result
from experiments.run.execution import execution, on_this_machine
from experiments.run.processes import each_in_a_process
from experiments.run.publication import results_into
from experiments.studies.experiment.cell import (
    CAMPAIGNS,
    CELLS,
    MAKING,
    RESULT,
    lost_cell,
    remove_campaign,
    run_cell,
)
from experiments.studies.experiment.cells import Cell, Experiment, Measure, read_experiment
from experiments.studies.experiment.table import TABLE, ExperimentTable, as_csv, read_rows
from experiments.studies.figure_files import save_figures
from rom.jobs import processes
from rom.progress import Progress
from rom.provenance import program_version

NAME = "experiment.json"
_USED = ("elapsed_s", "cpu_s", "peak_mb")


def run_experiment(
    path: Path | str,
    out: Path | str | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Callable[[str], Progress | None] | None = None,
    measure: Measure | None = None,
) -> ExperimentTable:
    """Run every cell of an experiment's file that has no result yet, and return the table of all.

    Parameters
    ----------
    path : Path or str
        The file.
    out : Path or str, optional
        Folder for results; ``<file>-results`` beside the file if not given.
    jobs : int
        Cells at the same time, on which the numbers do not depend; all cores if not given.
    cluster : str, optional
        Address of a Dask scheduler whose workers run the cells; they must see file and folder under the same
        path.
    progress : callable, optional
        Takes the name of a stage and returns what takes steps done and steps in all.
    measure : callable, optional
        An importable function of a cell's ranking or closure and of the folder of its campaign, which returns
        further columns of the table by name, in place of the one that the file names. A cell is known by its
        name, not by what it does.

    Returns
    -------
    ExperimentTable
        A row for each cell; a cell that failed has its message.

    Raises
    ------
    ValueError
        If the file or a campaign cannot be used, or the folder holds results of another experiment or of
        another version of the program.

    Examples
    --------
    >>> import experiments
    >>> table = experiments.run_experiment("experiment.toml", jobs=2)  # doctest: +SKIP
    >>> table.to_frame().groupby("campaign")["error"].median()  # doctest: +SKIP
    """
    with execution(cluster):
        return run(Path(path), None if out is None else Path(out), processes(jobs), progress, measure=measure)


def run(
    path: Path,
    out: Path | None = None,
    jobs: int = 1,
    progress: Callable[[str], Progress | None] | None = None,
    command: str = "",
    measure: Measure | None = None,
) -> ExperimentTable:
    """Do the work of `run_experiment` with whatever carries out parallel work here.

    Parameters
    ----------
    path, out, jobs, progress, measure
        As for `run_experiment`.
    command : str
        The command line, kept in the result file.

    Returns
    -------
    ExperimentTable
        Of all cells.

    Raises
    ------
    ValueError
        As `run_experiment`.
    """
    from experiments.figures.experiment import experiment_figures

    started = time.perf_counter()
    report = progress or (lambda _: None)
    folder = writable(path.with_name(f"{path.stem}-results") if out is None else out).absolute()
    experiment = read_experiment(path, jobs, report("checking campaigns"), measure)
    with results_into(folder) as new:
        _check_folder(experiment, folder)
        _clear(folder, experiment.cells)
        _run_missing(experiment, folder, jobs, report("running cells"))
        rows = read_rows(experiment.cells, folder)
        content = {
            "name": experiment.name,
            "command": command,
            "settings": experiment.content,
            "campaigns": _campaigns(experiment, folder),
            "cells": [
                {**row, "settings": cell.settings, "folder": f"{CELLS}/{cell.digest}"}
                | {key: _result(folder, cell).get(key) for key in _USED}
                for row, cell in zip(rows, experiment.cells, strict=True)
            ],
        }
        elapsed_s = time.perf_counter() - started
        write_result(new / NAME, "experiment", content, campaign=None, seed=None, elapsed_s=elapsed_s)
        (new / TABLE).write_text(as_csv(rows), encoding="utf-8")
        save_figures(experiment_figures(plain(content)), new)
    return ExperimentTable(experiment.name, folder / NAME, rows)


def _check_folder(experiment: Experiment, folder: Path) -> None:
    """Refuse a folder in which it is not clear what belongs to this experiment."""
    earlier = folder / NAME
    if earlier.exists():
        name = json.loads(earlier.read_text(encoding="utf-8")).get("name")
        if name != experiment.name:
            raise ValueError(
                f"{folder}: found results of the experiment {name!r}, expected those of {experiment.name!r} "
                "or none: name another folder with --out"
            )
    done = [found for cell in experiment.cells if (found := _result(folder, cell))["status"] == "ok"]
    others = [v for found in done if (v := found["program_version"]) != program_version()]
    if others:
        raise ValueError(
            f"{folder}: found {len(others)} cells of version {others[0]} of the program, expected cells of "
            f"version {program_version()} or none: name another folder with --out, or remove {folder / CELLS}"
        )


def _result(folder: Path, cell: Cell) -> dict[str, Any]:
    """What a cell left behind; a status of none where there is nothing."""
    path = folder / CELLS / cell.digest / RESULT
    if not path.exists():
        return {"status": "none"}
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _clear(folder: Path, cells: Iterable[Cell]) -> None:
    """Remove what a killed run left half made, and the cells that failed: they are tried again."""
    for place in (*folder.glob(f"*/{MAKING}*"), *(folder / CAMPAIGNS).glob("*.lock")):
        shutil.rmtree(place) if place.is_dir() else place.unlink()
    for cell in cells:
        if _result(folder, cell)["status"] == "failed":
            shutil.rmtree(folder / CELLS / cell.digest)


def _run_missing(experiment: Experiment, folder: Path, jobs: int, progress: Progress | None) -> None:
    due = [cell for cell in experiment.cells if not (folder / CELLS / cell.digest).is_dir()]
    total = len(experiment.cells)
    if progress is not None:
        progress(total - len(due), total)
    left = Counter(cell.source.digest for cell in due)
    apart = experiment.own_process and on_this_machine()
    finished = _apart(due, folder, jobs) if apart else _finished(due, folder, jobs, experiment.own_process)
    for number, cell in enumerate(finished, total - len(due) + 1):
        left[cell.source.digest] -= 1
        if not left[cell.source.digest] and not experiment.keeps_campaigns:
            remove_campaign(cell.source, folder)
        if progress is not None:
            progress(number, total)


def _finished(due: Sequence[Cell], folder: Path, jobs: int, own_process: bool) -> Iterable[Cell]:
    """Yield cells as they are done; a single one has all processes for itself, or else one of its own."""
    if len(due) == 1 and not own_process:
        run_cell(due[0], folder, jobs)
        yield due[0]
        return
    many = Parallel(n_jobs=min(jobs, max(len(due), 1)), return_as="generator_unordered", batch_size=1)
    tasks = (delayed(_numbered)(place, cell, folder, own_process) for place, cell in enumerate(due))
    for place in many(tasks):
        yield due[place]


def _apart(due: Sequence[Cell], folder: Path, jobs: int) -> Iterable[Cell]:
    """Yield cells as they are done, each by a process of its own, whose end fails that cell alone."""
    tasks = [partial(run_cell, cell, folder) for cell in due]
    for place, error in each_in_a_process(tasks, jobs):
        if error is not None:
            lost_cell(due[place], folder, error)
        yield due[place]


def _numbered(place: int, cell: Cell, folder: Path, own_process: bool) -> int:
    """Run a cell where the task is carried out; on a cluster it may have a process of its own there."""
    if own_process:
        list(_apart([cell], folder, jobs=1))
    else:
        run_cell(cell, folder)
    return place


def _campaigns(experiment: Experiment, folder: Path) -> list[dict[str, object]]:
    """Every campaign with the digest of its records; None where no cell came to read them."""
    digests = {cell.source.digest: _result(folder, cell).get("campaign_digest") for cell in experiment.cells}
    return [
        {
            "name": source.name,
            "folder": "; ".join(map(str, source.folders)) or None,
            "rig": source.options or None,
            "digest": digests.get(source.digest),
        }
        for source in experiment.sources
    ]
