"""A parser in a process of its own: what damage in a file ends, or never ends, is that process."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from threading import Timer
from typing import TypeVar

from experiments.datasets.collected import unreadable
from experiments.run.processes import Worker, WorkerLostError

LONGEST_S = 15.0  # for a small file, with the start of the process
SLOWEST_BYTES_PER_S = 1e6
Result = TypeVar("Result")


def parsed_apart(parse: Callable[[Path], Result], path: Path, kind: str) -> Result:
    """Return what a parser returns.

    Parameters
    ----------
    parse : callable
        Importable by name; takes the path.
    path : Path
        The file.
    kind : str
        What it is expected to be.

    Returns
    -------
    Result
        That of the parser.

    Raises
    ------
    SourceError
        If the process ends or takes too long. Every other exception is the parser's own.
    """
    worker = _worker()
    guard = Timer(LONGEST_S + path.stat().st_size / SLOWEST_BYTES_PER_S, worker.end)
    guard.start()
    try:
        result, error, _ = worker.run(partial(parse, path))
    except WorkerLostError:
        worker.hang_up()
        _worker.cache_clear()
        raise unreadable(path, kind, ChildProcessError("its parser came to a sudden end or none")) from None
    finally:
        guard.cancel()
    if error is not None:
        raise error
    return result  # type: ignore[no-any-return]


@cache
def _worker() -> Worker:
    """Return the one process, which stays for the files to come."""
    worker = Worker({})
    atexit.register(_leave, worker)
    return worker


def _leave(worker: Worker) -> None:
    worker.end()
    worker.hang_up()
