"""Results that belong together: several files that appear all at once or not at all, by one run at a time.

Files are written to a folder inside that of the results. When all are there it is renamed: from that moment
they count. Then they are moved to their places; a run that finds such a renamed folder moves the rest first.
So a run that is killed at any time leaves its predecessor's results or all of its own.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCK, MAKING, MADE = ".boltlaw-lock", ".boltlaw-making", ".boltlaw-made"


class BusyError(ValueError):
    """A folder of results into which another run is writing; the message says what to do."""


@contextmanager
def results_into(folder: Path) -> Iterator[Path]:
    """Hold a folder of results, and give a new one whose files take their places there if all goes well.

    The folder of results is made where it is not there, and is gone again where nothing came of it.

    Raises
    ------
    BusyError
        If another run holds the folder.
    OSError
        If nothing can be written there.
    """
    with _held(folder):
        _finish(folder)
        making = folder / MAKING
        shutil.rmtree(making, ignore_errors=True)  # of a run that was killed
        making.mkdir()
        try:
            yield making
            making.rename(folder / MADE)
        finally:
            shutil.rmtree(making, ignore_errors=True)
        try:
            _finish(folder)
        except KeyboardInterrupt:
            _finish(folder)
            raise


def finish(folder: Path) -> None:
    """Move what a killed run had finished to its place, unless another run is at it.

    Raises
    ------
    BusyError
        If another run holds the folder.
    OSError
        If nothing can be written there.
    """
    if (folder / MADE).is_dir():
        with _held(folder):
            _finish(folder)


def _finish(folder: Path) -> None:
    made = folder / MADE
    if not made.is_dir():
        return
    for path in sorted(made.iterdir()):
        path.replace(folder / path.name)
    made.rmdir()


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Be the only run that writes to a folder: the system lets go of the lock of a process that is killed."""
    from filelock import FileLock, Timeout

    new = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise BusyError(
            f"{folder}: found another run that writes its results there, expected to be the only one: "
            "wait for it, or name another folder with --out"
        ) from None
    try:
        yield
    finally:
        with suppress(OSError):
            (folder / LOCK).unlink()  # while it is held: who has just opened it notices and tries again
        lock.release()
        for path in new:
            with suppress(OSError):  # not empty
                path.rmdir()
