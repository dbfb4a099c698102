"""Cells of an experiment: the product of what its file lists, each known by a digest of what it rests on."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

from experiments.studies import rig
from experiments.studies.experiment.settings import ExperimentSettings, RigSettings, read_settings
from rom.campaign.campaign import read_campaign
from rom.plug_ins import packages
from rom.progress import Progress, counted

Measure = Callable[[Any, Any], Mapping[str, Any]]
"""Of a ranking or closure and the campaign's folder; of several bolts, their folders."""
_DIGITS = 16


@dataclass(frozen=True)
class NamedMeasure:
    """The function MODULE:FUNCTION, imported where it is called: another machine has a path of its own.

    Attributes
    ----------
    text : str
        ``"MODULE:FUNCTION"``.
    folder : str
        Of the experiment's file; a module in it is found where no other has its name.
    """

    text: str
    folder: str

    def __call__(self, result: Any, campaign: Any) -> Mapping[str, Any]:
        """Return the function's columns."""
        return self.function(result, campaign)

    @property
    def function(self) -> Measure:
        """The function itself.

        Raises
        ------
        ValueError
            If it cannot be imported, or a module of its name from elsewhere is in its place.
        """
        if self.folder not in sys.path:
            sys.path.append(self.folder)
        name, _, function = self.text.partition(":")
        try:
            module = import_module(name)
            found: Measure = getattr(module, function)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(
                f"measure: found {self.text!r} ({error}), expected MODULE:FUNCTION that can be imported"
            ) from error
        beside = Path(self.folder, *name.split(".")).with_suffix(".py")
        if beside.exists() and Path(module.__file__ or "").resolve() != beside.resolve():
            raise ValueError(
                f"measure: found the module {name!r} in {module.__file__}, expected {beside}: give it a name "
                "that no other has"
            )
        return found


@dataclass(frozen=True)
class Source:
    """Where a campaign, or those of several bolts, come from: folders, or options of the rig that measures.

    Attributes
    ----------
    name : str
        As the file has it; of the rig, with the options in which its campaigns differ.
    digest : str
        Of the records in the folder, or of the options.
    folders : tuple of Path
        One, or one for each bolt; none for campaigns of the rig.
    options : mapping
        Of the rig.
    """

    name: str
    digest: str
    folders: tuple[Path, ...]
    options: Mapping[str, Any]

    @property
    def bolts(self) -> int:
        """How many campaigns there are."""
        return len(self.folders) or int(self.options.get("bolts", 1))


@dataclass(frozen=True)
class Cell:
    """One command on one campaign.

    Attributes
    ----------
    command : str
        discover, compare or close.
    source : Source
        The campaign.
    seed : int
        Of the command.
    laws : tuple of mapping
        Laws of one's own as `laws.toml` has them.
    options : mapping
        ``libraries``, ``optimizers``, ``max_terms`` and ``criteria``, as far as the file says.
    measure : callable, optional
        Takes the ranking or closure and the campaign's folder, and returns further numbers.
    plug_ins : mapping
        Versions of the packages that add effects or laws.
    figures : bool
        Whether they are drawn; with or without, it is the same cell.
    """

    command: str
    source: Source
    seed: int
    laws: tuple[Mapping[str, Any], ...]
    options: Mapping[str, Any]
    measure: Measure | None = None
    plug_ins: Mapping[str, str] = field(default_factory=dict)
    figures: bool = True

    @cached_property
    def digest(self) -> str:
        """Of settings, plug-ins and the campaign's contents: what has the same is the same cell."""
        own = [self.command, self.source.digest, self.seed, self.laws, self.options]
        own_columns = self.measure.function if isinstance(self.measure, NamedMeasure) else self.measure
        measured = own_columns and f"{own_columns.__module__}.{own_columns.__qualname__}"
        return _digest([*own, self.plug_ins, measured])

    @property
    def settings(self) -> dict[str, Any]:
        """All that may differ between cells, as columns of a table."""
        laws = {"laws": "; ".join(law["name"] for law in self.laws)} if self.laws else {}
        of_rig = {f"rig.{key}": value for key, value in self.source.options.items()}
        return {**of_rig, **laws, **_flat(self.options), "seed": self.seed}


@dataclass(frozen=True)
class Experiment:
    """An experiment's file: its path, name and content, its campaigns, its cells in order."""

    path: Path
    name: str
    content: Mapping[str, Any]
    sources: tuple[Source, ...]
    cells: tuple[Cell, ...]
    keeps_campaigns: bool
    own_process: bool


def read_experiment(
    path: Path, jobs: int = 1, progress: Progress | None = None, measure: Measure | None = None
) -> Experiment:
    """Read an experiment's file and the records of the campaigns that it names.

    Parameters
    ----------
    path : Path
        The file; folders and files that it names are relative to it.
    jobs : int
        Processes that check records.
    progress : callable, optional
        Called with (campaigns checked, campaigns in all).
    measure : callable, optional
        Of every cell, in place of the one that the file names.

    Returns
    -------
    Experiment
        With at least one cell.

    Raises
    ------
    ValueError
        A line for every fault of the file, or of a campaign.
    """
    settings, content = read_settings(path)
    check_options(path, settings)
    law_sets = _law_sets(path, settings)
    measure = measure or _named_function(path, settings.measure)
    sources = _sources(path, settings, jobs, progress)
    cells = {cell.digest: cell for cell in _cells(settings, sources, law_sets, measure)}
    return Experiment(
        path, settings.name, content, sources, tuple(cells.values()), settings.keep_campaigns,
        settings.own_process,
    )  # fmt: skip


def _named_function(path: Path, text: str | None) -> Measure | None:
    """The function that a file names, once it was imported here."""
    if text is None:
        return None
    found = NamedMeasure(text, str(path.parent.absolute()))
    with _naming(str(path)):
        _ = found.function
    return found


def check_options(path: Path, settings: ExperimentSettings) -> None:
    """Refuse what no cell could use: an unknown library, optimizer or criterion, laws that are missing.

    Raises
    ------
    ValueError
        With the key.
    """
    from discovery.criteria.criteria import CRITERIA

    with _naming(str(path)):
        if "compare" in settings.command and not (settings.laws or settings.law):
            raise ValueError('laws: found nothing, expected files of laws or [[law]] for "compare"')
        if not (settings.campaigns or settings.rig):
            raise ValueError("campaigns: found nothing, expected folders of campaigns, or a [[rig]]")
        for changes in variants_of_criteria(settings.criteria):
            CRITERIA.changed(**changes)
        for options in _variants(settings.search):
            if options.keys() - {"max_terms"}:
                from discovery.search.selection import select

                select(options.get("libraries"), options.get("optimizers"))


@contextmanager
def _naming(place: str) -> Iterator[None]:
    """Name the place in every line of a `ValueError` of the block."""
    try:
        yield
    except ValueError as error:
        raise ValueError("\n".join(f"{place}: {line}" for line in str(error).splitlines())) from error


def variants_of_criteria(groups: Mapping[str, Mapping[str, Sequence[float]]]) -> Iterator[dict[str, Any]]:
    """Yield the criteria of every cell: each number of each group once with every other."""
    keys = [(group, name) for group, numbers in groups.items() for name in numbers]
    for values in product(*(groups[group][name] for group, name in keys)):
        changes: dict[str, Any] = {}
        for (group, name), value in zip(keys, values, strict=True):
            changes.setdefault(group, {})[name] = value
        yield changes


def _variants(table: Any, *without: str) -> Iterator[dict[str, Any]]:
    """Every combination of the values that a table lists, in the order of its keys."""
    keys = [key for key in type(table).model_fields if key in table.model_fields_set and key not in without]
    for values in product(*(getattr(table, key) for key in keys)):
        yield dict(zip(keys, values, strict=True))


def _law_sets(path: Path, settings: ExperimentSettings) -> list[tuple[Mapping[str, Any], ...]]:
    """The laws of every cell as tables; read once here so that a fault is told before the work."""
    from discovery.laws.law_file import FORMAT, laws_from

    if settings.law:
        laws_from({"format": FORMAT, "law": settings.law}, str(path))
    sets = []
    for files in settings.laws or [[]]:
        tables = [table for file in files for table in _tables(path.parent / file)]
        if every := [*tables, *settings.law]:
            laws_from({"format": FORMAT, "law": every}, f"{path}: laws")
        sets.append(tuple(every))
    return sets


def _tables(path: Path) -> list[Mapping[str, Any]]:
    from discovery.laws.law_file import laws_from, read_tables

    content = read_tables(path)
    laws_from(content, str(path))
    return list(content["law"])


def _sources(
    path: Path, settings: ExperimentSettings, jobs: int, progress: Progress | None
) -> tuple[Source, ...]:
    from discovery.ranking.specimens import check_one_kind
    from experiments.studies.discover import digest_of

    sources: list[Source] = []
    for place, name in enumerate(counted(settings.campaigns, len(settings.campaigns), progress)):
        names = [name] if isinstance(name, str) else name
        with _naming(f"{path}: campaigns[{place}]"):
            read = [read_campaign(path.parent / one, jobs) for one in names]
            check_one_kind(read)
        folders = tuple(one.path for one in read)
        sources.append(Source(" + ".join(names), digest_of(read), folders, {}))
    for place, table in enumerate(settings.rig):
        with _naming(f"{path}: rig[{place}]"):
            sources += _of_rig(table)
    for place, source in enumerate(sources):
        for other in sources[:place]:
            if source.name == other.name or source.digest == other.digest:
                raise ValueError(
                    f"{path}: found one campaign twice, {other.name!r} and {source.name!r}, expected "
                    "campaigns that differ in name and content"
                )
        if source.bolts > 1 and "close" in settings.command:
            raise ValueError(
                f'{path}: command: found "close" with the several bolts of {source.name!r}, expected '
                '"discover" or "compare"'
            )
    return tuple(sources)


def _of_rig(table: RigSettings) -> Iterable[Source]:
    varied = [key for key in table.model_fields_set - {"name"} if len(getattr(table, key)) > 1]
    for options in _variants(table, "name"):
        rig.check_options(**options)
        told = [f"{key} {_text(options[key])}" for key in options if key in varied]
        yield Source(", ".join([table.name, *told]), _digest(options), (), options)


def _cells(
    settings: ExperimentSettings,
    sources: Sequence[Source],
    law_sets: Sequence[tuple[Mapping[str, Any], ...]],
    measure: Measure | None,
) -> Iterator[Cell]:
    """The product, campaign by campaign; what a command does not use is no part of its cells."""
    plug_ins = packages()
    criteria = [{"criteria": one} if one else {} for one in variants_of_criteria(settings.criteria)]
    for source, command in product(sources, settings.command):
        searches = list(_variants(settings.search)) if command == "discover" else [{}]
        laws = law_sets if command != "close" else [()]
        seeds = settings.seeds or [source.options.get("seed", 0)]
        for own, search, changes, seed in product(laws, searches, criteria, seeds):
            yield Cell(command, source, seed, own, {**search, **changes}, measure, plug_ins, settings.figures)


def _digest(value: Any) -> str:
    text = json.dumps(value, sort_keys=True, default=dict)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _flat(options: Mapping[str, Any], head: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in options.items():
        found |= _flat(value, f"{head}{key}.") if isinstance(value, Mapping) else {f"{head}{key}": value}
    return found


def _text(value: Any) -> str:
    return "+".join(map(str, value)) or "none" if isinstance(value, list) else str(value)
