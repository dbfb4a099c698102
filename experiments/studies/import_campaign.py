"""A measured data set or a laboratory's files as a campaign folder, checked before it appears."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from experiments.datasets import Collected, SourceError, collect
from experiments.datasets.download import fetch
from experiments.errors import existing
from experiments.results import writable
from experiments.text.records import counted as counted_records
from rom.campaign.campaign import read_campaign, read_settings, write_campaign
from rom.campaign.channels import Channel
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


def places(first: Path, second: Path | None, download: bool) -> tuple[Path | None, Path]:
    """Return source, None where it is to be fetched, and new folder from the command's one or two paths.

    Parameters
    ----------
    first : Path
        Source, or new folder where that is fetched.
    second : Path or None
        New folder.
    download : bool
        Whether the source is fetched.

    Returns
    -------
    tuple of (Path or None, Path)
        Source and new folder.

    Raises
    ------
    ValueError
        If there is one too many or too few, or the source does not exist.
    """
    if download:
        if second is not None:
            raise SourceError(f"--download: found the source {first} as well, expected NEW_DIR alone")
        return None, first
    if second is None:
        raise SourceError(
            f"NEW_DIR: found nothing after {first}, expected SOURCE and NEW_DIR (or --download)"
        )
    return existing(first), second


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
