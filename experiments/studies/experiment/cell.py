"""One cell of an experiment: its campaign, its command, its numbers, all in a folder that appears whole."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, TypeAlias

from experiments.errors import in_words, of_the_input
from experiments.results import plain, write_result
from experiments.run.execution import execution
from experiments.run.memory import peak_memory_mb
from experiments.studies import close, discover, drawn, rig
from experiments.studies.experiment.cells import Cell, Source
from experiments.studies.figure_files import without_figures

CELLS, CAMPAIGNS, CAMPAIGN, MAKING = "cells", "campaigns", "campaign", ".making-"
RESULT = "cell.json"
Places: TypeAlias = Path | tuple[Path, ...]
Then = Callable[[Any], None]
"""Takes the ranking or the closure itself, before its files are there."""
_MEASURES = (
    ("motion_nrmse", "motion", 100.0),
    ("link_force_nrmse", "link force", 100.0),
    ("tension_loss_error_percent_median", "tension loss", 1.0),
)
"""Errors of a closure: the first one that is there counts; [%] times a factor."""


def run_cell(cell: Cell, out: Path, jobs: int = 1) -> None:
    """Run one cell and leave its results and ``cell.json`` in a folder of its own; a fault is a result too.

    Parameters
    ----------
    cell : Cell
        What is done.
    out : Path
        Folder of the experiment's results.
    jobs : int
        Processes; of 1, all is done here whatever carries out the cells.
    """
    alone = execution(local="sequential") if jobs == 1 else nullcontext()
    with alone, _appearing(out / CELLS / cell.digest) as folder:
        started = time.perf_counter()
        used: dict[str, float] = {}
        try:
            campaign = campaign_of(cell.source, out)
            started = time.perf_counter()
            content = _examined(cell, campaign, folder, jobs, used)
        except Exception as error:  # the other cells go on
            if not folder.is_dir():  # a later run of the experiment has swept this one away
                raise
            content = {"status": "failed", "message": _message(error, cell.source, out)}
        write_result(
            folder / RESULT, "cell", {**_settings(cell), **content, **used}, campaign=cell.source.name,
            seed=cell.seed, elapsed_s=time.perf_counter() - started,
        )  # fmt: skip


def lost_cell(cell: Cell, out: Path, error: Exception) -> None:
    """Leave what is told of a cell whose process ended before it: others go on.

    Parameters
    ----------
    cell, out
        As for `run_cell`.
    error : Exception
        What became of the process.
    """
    with _appearing(out / CELLS / cell.digest) as folder:
        content = {**_settings(cell), "status": "failed", "message": str(error)}
        write_result(
            folder / RESULT, "cell", content, campaign=cell.source.name, seed=cell.seed, elapsed_s=0.0
        )


def _settings(cell: Cell) -> dict[str, Any]:
    return {"cell": cell.digest, "command": cell.command, "settings": cell.settings}


def _message(error: Exception, source: Source, out: Path) -> str:
    """A line about an error, the same wherever results go; of a fault of the program, where it was."""
    if of_the_input(error):
        text = "; ".join(in_words(error).splitlines())
        made = _place(source, out)
        bolts = [made.with_name(f"bolt-{n}") for n in range(source.bolts, 0, -1)] if source.bolts > 1 else []
        for place in (*source.folders, *bolts, made):
            text = text.replace(str(place), place.name if source.bolts > 1 else source.name)
        return text
    raised = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(raised.filename).name}, line {raised.lineno})"


def _examined(
    cell: Cell, campaign: Places, folder: Path, jobs: int, used: dict[str, float]
) -> dict[str, Any]:
    measured: dict[str, Any] = {}
    started = time.process_time()

    def measure(result: Any) -> None:
        used.update(cpu_s=time.process_time() - started, peak_mb=peak_memory_mb())
        if cell.measure is not None:
            measured.update(plain(cell.measure(result, campaign)))

    with nullcontext() if cell.figures else without_figures():
        path = COMMANDS[cell.command](cell, campaign, folder, jobs, measure)
    found = json.loads(path.read_text(encoding="utf-8"))
    if cell.source.folders and found["campaign_digest"] != cell.source.digest:
        raise ValueError("found another content of the campaign than when the experiment began")
    numbers = _of_closure(found) if cell.command == "close" else _of_ranking(found)
    status = {"status": "ok" if numbers else "failed", "message": found.get("unfit") or ""}
    return {**status, "campaign_digest": found["campaign_digest"], "numbers": {**numbers, **measured}}


def _ranked(cell: Cell, campaign: Places, folder: Path, jobs: int, then: Then) -> Path:
    from discovery.laws.law_file import FORMAT, laws_from

    options = dict(cell.options)
    criteria = _criteria(options.pop("criteria", {}))
    laws = laws_from({"format": FORMAT, "law": list(cell.laws)}, "laws") if cell.laws else None
    only = cell.command == "compare"
    return discover.run(
        campaign, folder, cell.seed, jobs, laws=laws, given_only=only, criteria=criteria, then=then, **options
    )


def _closed(cell: Cell, campaign: Places, folder: Path, jobs: int, then: Then) -> Path:
    assert isinstance(campaign, Path)  # several were refused when the file was read
    criteria = _criteria(cell.options.get("criteria", {}))
    return close.run(campaign, folder, cell.seed, jobs, criteria=criteria, then=then)


def _criteria(changes: Mapping[str, Mapping[str, float]]) -> Any:
    from discovery.criteria.criteria import CRITERIA

    return CRITERIA.changed(**changes)


COMMANDS: Mapping[str, Callable[[Cell, Places, Path, int, Then], Path]] = {
    "discover": _ranked,
    "compare": _ranked,
    "close": _closed,
}


def _of_ranking(found: Mapping[str, Any]) -> dict[str, Any]:
    """Main numbers of a ranking; none where no record was left."""
    from discovery.laws.candidate import BASELINE
    from discovery.views.ranking_plot import is_law

    if not found["laws"]:
        return {}
    first = found["laws"][0]
    error = "cross_validated_loss_error_percent_median"
    population = found.get("population")
    return {
        "first": first["name"],
        "error": first[error],
        "error_of": f"tension loss, {'bolts left out' if population else 'cross-validated'}",
        "error_before": next(law[error] for law in found["laws"] if is_law(law, BASELINE)),
        "hold_out_error": first["errors"]["hold_out"].get("tension_loss_error_percent_median"),
        "probability": first["probability"],
        "p_value_against_baseline": first["p_value_against_baseline"],
        "free_numbers": first["free_numbers"],
        "equation": first["equation"],
        "indistinguishable": "; ".join(first["indistinguishable"]),
        **(_of_population(population, first) if population else {}),
    }


def _of_population(population: Mapping[str, Any], first: Mapping[str, Any]) -> dict[str, Any]:
    """Standard deviations of ln rate with limits, between bolts and tests; the error at a bolt's own rate."""
    found = {"known_bolt_error": first["known_bolt_loss_error_percent_median"]}
    for key in ("between_bolts", "between_tests"):
        limited = population[key]
        found |= {key: limited["value"], f"{key}_low": limited["low"], f"{key}_high": limited["high"]}
    return found


def _of_closure(found: Mapping[str, Any]) -> dict[str, Any]:
    """Main numbers of a closure; none where no record was left."""
    for kind in ("hold_out", "training"):
        before, after = (found["errors"][kind][when] for when in ("before", "after"))
        for key, what, factor in _MEASURES:
            if after[key] is not None and before[key] is not None:
                return {
                    "first": " + ".join(f"{e['name']}@{e['enters']}" for e in found["effects"]),
                    "error": factor * after[key],
                    "error_of": f"{what}, {kind.replace('_', '-')}",
                    "error_before": factor * before[key],
                    "verdict": found["verdict"],
                }
    return {}


def campaign_of(source: Source, out: Path) -> Places:
    """Return the folder of a campaign, or those of several bolts; the first cell that needs ones of the rig
    measures them.
    """
    from filelock import FileLock

    if source.folders:
        return source.folders if source.bolts > 1 else source.folders[0]
    place = _place(source, out).parent
    place.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(place.with_suffix(".lock")):
        if not place.exists():
            options = dict(source.options)
            options["strengths"] = tuple(options.get("strengths", (1.0,)))
            hidden = tuple(rig.undeclared_from_text(text) for text in options.pop("undeclared", ()))
            with _appearing(place) as folder:
                _measure(folder, hidden, **options)
    if source.bolts > 1:
        return tuple(place / f"bolt-{number}" for number in range(1, source.bolts + 1))
    return _place(source, out)


def _measure(
    folder: Path,
    hidden: tuple[rig.Undeclared, ...],
    influence_percent: Sequence[float] = (),
    bolts: int = 1,
    between_bolts: float = 0.0,
    **options: Any,
) -> None:
    new = folder / CAMPAIGN
    if bolts > 1:
        drawn.run_bolts(folder, bolts, between_bolts, jobs=1, undeclared=hidden, **options)
    elif influence_percent:
        smallest, largest = influence_percent
        drawn.run_drawn(new, hidden, (smallest, largest), jobs=1, **options)
    else:
        rig.run(new, jobs=1, undeclared=hidden, **options)


def _place(source: Source, out: Path) -> Path:
    return out / CAMPAIGNS / source.digest / CAMPAIGN


def remove_campaign(source: Source, out: Path) -> None:
    """Remove a campaign of the rig that no cell needs any more: its options make it again."""
    if not source.folders:
        place = _place(source, out).parent
        shutil.rmtree(place, ignore_errors=True)
        place.with_suffix(".lock").unlink(missing_ok=True)
        with suppress(OSError):  # where others are
            place.parent.rmdir()


@contextmanager
def _appearing(place: Path) -> Iterator[Path]:
    """Give a new folder that takes its place if all goes well, unless another process came first."""
    place.parent.mkdir(parents=True, exist_ok=True)
    making = Path(tempfile.mkdtemp(dir=place.parent, prefix=MAKING))
    try:
        making.chmod(0o755)  # as any other folder
        yield making
        with suppress(OSError):
            making.rename(place)
        if not place.is_dir():
            raise OSError(f"{place}: found that it cannot be made, expected a folder for results")
    finally:
        shutil.rmtree(making, ignore_errors=True)
