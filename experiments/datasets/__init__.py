"""Measurements of others as campaign folders: public benchmark sets, and the exports of a laboratory."""

from __future__ import annotations

from pathlib import Path

from experiments.datasets.collected import Collected, SourceError

PUBLIC = ("emps", "silverbox", "tribometer")
EXPORTS = ("catman", "matlab", "uff", "tdms", "csv", "xlsx", "json")
SETS = (*PUBLIC, *EXPORTS)

__all__ = ["EXPORTS", "PUBLIC", "SETS", "Collected", "SourceError", "collect"]


def collect(name: str, source: Path, channel_map: Path | None = None) -> Collected:
    """Return the campaign that a source becomes: one of the public sets, or files of one format and a map.

    Parameters
    ----------
    name : str
        A public set or a format of files.
    source : Path
        A file or a folder.
    channel_map : Path, optional
        Which column is which channel; of formats only.

    Returns
    -------
    Collected
        Settings, records and notes.

    Raises
    ------
    SourceError
        If there is no such set, or the source is not what it should be.
    """
    from experiments.datasets import emps, laboratory, silverbox, tribometer
    from rom.campaign.channels import one_of

    if name in EXPORTS:
        return laboratory.collect(source, name, channel_map)
    if channel_map is not None:
        raise SourceError(f"--map: found {channel_map} for {name}, expected it for {', '.join(EXPORTS)} only")
    public = {"emps": emps.collect, "silverbox": silverbox.collect, "tribometer": tribometer.collect}
    if name not in public:
        raise SourceError(f'SET: found "{name}", expected {one_of(name, SETS)}')
    return public[name](source)
