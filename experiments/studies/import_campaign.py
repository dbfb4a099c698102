"""A measured data set or a laboratory's files as a campaign folder, checked before it appears."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from experiments.datasets import EXPORTS, Collected, SourceError, collect
from experiments.datasets.download import fetch
from experiments.errors import existing
from experiments.results import writable
from experiments.text.records import counted as counted_records
from rom.campaign.campaign import read_campaign, read_settings, write_campaign
from rom.campaign.channels import Channel
from rom.campaign.record import replacing
from rom.progress import Progress, counted


def run(
    name: str,
    source: Path | None,
    new_dir: Path,
    channel_map: Path | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write the campaign folder and return what people should know about it; without source, fetch the set.

    Parameters
    ----------
    name : str
        A public set or a format of files.
    source : Path or None
        A file or a folder.
    new_dir : Path
        The campaign folder; must not exist.
    channel_map : Path, optional
        Which column is which channel; of formats only.
    jobs : int
        Processes.
    progress : callable, optional
        Takes records done and records in all.

    Returns
    -------
    tuple of str
        Notes.

    Raises
    ------
    ValueError
        If the source is not what it should be or the campaign would be refused; nothing is written then.
    """
    if new_dir.exists() or new_dir.is_symlink():
        raise SourceError(f"{new_dir}: found an existing path, expected a new folder")
    writable(new_dir.parent)
    with tempfile.TemporaryDirectory() as fetched:
        collected = collect(name, source or fetch(name, Path(fetched)), channel_map)
        with _appearing(new_dir) as folder:
            write_campaign(folder, collected.settings, _with_progress(collected, progress))
            read_campaign(folder, jobs)
    return collected.notes()


def summary(new_dir: Path) -> str:
    """Return what was written, and what looks at it."""
    records = read_settings(new_dir).record
    found = counted_records((record.test, record.hold_out) for record in records)
    return f"wrote {new_dir}: {found}; next: boltlaw check {new_dir}"


def draft(name: str, source: Path, out: Path | None = None) -> Path:
    """Write a first ``import.toml`` for a laboratory's files and return its path.

    Parameters
    ----------
    name : str
        A format of files.
    source : Path
        A file or a folder.
    out : Path, optional
        Folder of the map; that of the files if not given.

    Returns
    -------
    Path
        Of the map.

    Raises
    ------
    SourceError
        If the set has no map, or there is one already.
    """
    from experiments.datasets import map_draft
    from experiments.datasets.channel_map import FILE

    if name not in EXPORTS:
        raise SourceError(f"NEW_DIR: found nothing after {source}, expected SOURCE and NEW_DIR")
    folder = source if source.is_dir() else source.parent
    path = (folder if out is None else writable(out)) / FILE
    if path.exists():
        raise SourceError(f"NEW_DIR: found nothing, expected SOURCE and NEW_DIR: the map {path} is there")
    text = map_draft.draft(source, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def command(
    name: str,
    first: Path,
    second: Path | None,
    out: Path | None,
    channel_map: Path | None,
    download: bool,
    jobs: int,
    progress: Progress | None,
) -> str:
    """Import, or draft a map where neither it nor a new folder is named; return what people should know.

    Parameters
    ----------
    name : str
        A public set or a format of files.
    first : Path
        Source, or new folder where that is fetched.
    second : Path or None
        New folder.
    out : Path or None
        Where the new folder, or the map, is created.
    channel_map : Path or None
        Which column is which channel.
    download : bool
        Whether the source is fetched.
    jobs : int
        Processes.
    progress : callable or None
        Takes records done and records in all.

    Returns
    -------
    str
        What was written, and what is next.

    Raises
    ------
    ValueError
        If there is a path too many or too few, the source does not exist, or is not what it should be.
    """
    if download and second is not None:
        raise SourceError(f"--download: found the source {first} as well, expected NEW_DIR alone")
    source, new_dir = (None, first) if download else (existing(first), second)
    maps = None if channel_map is None else existing(channel_map)
    if new_dir is None:
        path = draft(name, first, out)
        return f"wrote {path}; complete the lines with NEEDED, then: boltlaw import {name} {first} NEW_DIR"
    folder = new_dir if out is None else out / new_dir
    notes = run(name, source, folder, maps, jobs, progress)
    return "\n".join([*(f"note: {note}" for note in notes), summary(folder)])


def _with_progress(
    collected: Collected, progress: Progress | None
) -> Iterator[tuple[str, Mapping[str, Channel]]]:
    yield from counted(collected.records, len(collected.settings.record), progress)


@contextmanager
def _appearing(folder: Path) -> Iterator[Path]:
    """Give a path beside `folder` that becomes it if all goes well, and vanishes otherwise."""
    missing = [parent for parent in folder.absolute().parents if not parent.exists()]
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}-{secrets.token_hex(4)}")
    try:
        yield temporary
        temporary.rename(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        for parent in missing:
            with suppress(OSError):
                parent.rmdir()
        raise
