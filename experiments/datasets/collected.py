"""What an importer hands over: settings and records of a campaign that is not written yet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from rom.campaign.campaign import CampaignSettings, terminal_line
from rom.campaign.channels import Channel
from rom.campaign.record import in_a_line

Records = Iterable[tuple[str, Mapping[str, Channel]]]


class SourceError(ValueError):
    """A source that cannot become a campaign; `faults` holds one line for each fault."""

    def __init__(self, *faults: str) -> None:
        self.faults = tuple(terminal_line(fault) for fault in faults)
        super().__init__("\n".join(self.faults))


@dataclass(frozen=True, eq=False)
class Collected:
    """A campaign to be: its settings, its records one at a time, and afterwards what people should know."""

    settings: CampaignSettings
    records: Records
    notes: Callable[[], tuple[str, ...]] = tuple


def optional(package: str, extra: str) -> Any:
    """Import a package that only one kind of source needs.

    Raises
    ------
    SourceError
        If it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as missing:
        if missing.name != package:
            raise
        raise SourceError(
            f"{package}: found no such package, expected it for this source; "
            f"install it with `pip install '.[{extra}]'` in the project's folder"
        ) from None


def unreadable(path: Path, kind: str, cause: Exception) -> SourceError:
    """Return the fault of a file that its parser gave up on, in whatever way.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        What it was expected to be.
    cause : Exception
        What its parser raised.

    Returns
    -------
    SourceError
        To be raised.
    """
    return SourceError(f"{path.name}: found it unreadable, expected a sound {kind} ({in_a_line(cause)})")


def file_of(source: Path, name: str) -> Path:
    """Return the file that is `source`, or the one of this name anywhere below it.

    Raises
    ------
    SourceError
        If there is none.
    """
    if source.is_file():
        return source
    found = sorted(path for path in source.rglob("*") if path.name.lower() == name.lower() and path.is_file())
    if not found:
        raise SourceError(f"{source}: found no file {name}, expected it in this folder")
    return found[0]
