"""How many processes work side by side where nobody says: as many in Python as for a command."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from rom.criteria.number import Numerical

CORES = os.cpu_count() or 1
_FEW_BYTES: Numerical[int] = 50_000_000  # of records: read and judged before more processes have started


def processes(jobs: int | None) -> int:
    """Return the processes asked for; where none are, all cores, but one process within a process."""
    if jobs is not None:
        return jobs
    return 1 if multiprocessing.parent_process() is not None else CORES


def processes_for(jobs: int | None, records: Iterable[Path]) -> int:
    """Return the same for work that takes about as long as reading records: one process for few.

    Parameters
    ----------
    jobs : int or None
        Processes asked for.
    records : iterable of Path
        Files of the records; those that cannot be found count nothing.
    """
    if jobs is not None:
        return jobs
    return 1 if sum(map(_size, records)) < _FEW_BYTES else processes(None)


def _size(path: Path) -> int:
    with suppress(OSError, ValueError):  # a name that no file can have is told where the file is read
        return path.stat().st_size
    return 0
