"""The result files and figures that a folder holds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

KINDS = (
    "experiment",
    "closure",
    "ranking",
    "model",
    "reproduction",
    "prediction",
)  # in the order in which a report answers
OF_CONTENT = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError)
"""What a value of another kind than a command writes may raise where it is shown."""
_FORMAT = "boltlaw-"
_HIDDEN = ("truth", "campaign")  # the rig's truth belongs to no report
_LARGEST_FIGURE = 20_000_000


class ResultError(ValueError):
    """A folder without results; the message says what was expected."""


@dataclass(frozen=True)
class Result:
    """One result file: its kind ("model", "closure", ...), name, content, and the digest of its bytes."""

    kind: str
    file: str
    data: Mapping[str, Any]
    digest: str


@dataclass(frozen=True)
class Results:
    """All that a folder holds: results in order, figures, a line for every file that could not be read."""

    results: tuple[Result, ...]
    figures: tuple[Path, ...]
    faults: tuple[str, ...]


def read_results(directory: Path) -> Results:
    """Read the result files of a folder.

    Raises
    ------
    ResultError
        If there is no such folder, or no result file that can be read in it.
    """
    if not directory.is_dir():
        found = f"a file; its folder is {directory.parent}" if directory.is_file() else "no such folder"
        raise ResultError(f"{directory}: expected a folder with result files, found {found}")
    results, faults = [], []
    for path in sorted(directory.glob("*.json")):
        try:
            result = _read(path)
        except (OSError, ValueError, RecursionError) as error:
            cause = error.strerror if isinstance(error, OSError) else error
            faults.append(f"{path.name}: could not be read as a result file ({cause})")
            continue
        if result is not None:
            results.append(result)
    if not results:
        raise _nothing(directory, faults)
    results.sort(
        key=lambda result: (KINDS.index(result.kind) if result.kind in KINDS else len(KINDS), result.file)
    )
    figures = [path for path in sorted(directory.glob("*.svg")) if path.stat().st_size <= _LARGEST_FIGURE]
    return Results(tuple(results), tuple(figures), tuple(faults))


def without_odd_content(found: Results, shown: Callable[[Results], object], directory: Path) -> Results:
    """Return the results without those that cannot be shown by themselves, a line for each of these.

    Parameters
    ----------
    found : Results
        Of a folder.
    shown : callable
        Shows results; raises one of `OF_CONTENT` where it cannot.
    directory : Path
        The folder.

    Returns
    -------
    Results
        The others.

    Raises
    ------
    ResultError
        If none is left.
    Exception
        That of `shown`, if every result can be shown by itself.
    """
    kept, faults = [], list(found.faults)
    for result in found.results:
        try:
            shown(replace(found, results=(result,)))
            kept.append(result)
        except OF_CONTENT:
            cause = "found a value of another kind than a command writes"
            faults.append(f"{result.file}: could not be read as a result file ({cause})")
    if not kept:
        raise _nothing(directory, faults)
    return replace(found, results=tuple(kept), faults=tuple(faults))


def _nothing(directory: Path, faults: Sequence[str]) -> ResultError:
    expected = ", ".join(f"{kind}.json" for kind in KINDS)
    beside = directory.with_name(f"{directory.name}-results")
    hint = f"; the nearest is {beside}" if beside.is_dir() else ""
    message = f"{directory}: expected one result file at least ({expected}), found none{hint}"
    return ResultError("\n".join([message, *faults]))


def _read(path: Path) -> Result | None:
    """Return a result file; None for a JSON file that is none."""
    content = path.read_bytes()
    data = json.loads(content)
    kind = _kind(data)
    if kind is None:
        if path.stem in KINDS:
            raise ValueError(f'expected format "{_FORMAT}{path.stem}/1", found another content')
        return None
    return Result(kind, path.name, data, hashlib.sha256(content).hexdigest())


def _kind(data: object) -> str | None:
    named = data.get("format") if isinstance(data, dict) else None
    if not isinstance(named, str) or not named.startswith(_FORMAT):
        return None
    kind = named.removeprefix(_FORMAT).partition("/")[0]
    return None if kind in _HIDDEN else kind
