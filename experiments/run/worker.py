"""What a worker process does: tasks come in by standard input, results leave by standard output.

Run as a script; it needs no package until it is told where they are, and ends when no more tasks can come.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
import warnings
from pathlib import Path
from typing import BinaryIO


class Ended(BaseException):
    """The process that started this one wants no more: what a task has in scratch folders is removed."""


def _end(*_: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough
    raise Ended


def main() -> None:
    """Serve the process that started this one, which alone answers an interrupt from the keyboard."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    tasks, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)  # what a task prints is no reply
    sys.path[:] = pickle.load(tasks)
    warnings.filterwarnings("ignore", message="plug-in ")  # the process that started this one has said so
    try:
        _serve(tasks, replies)
    except Ended:
        sys.exit(128 + signal.SIGTERM)


def _serve(tasks: BinaryIO, replies: BinaryIO) -> None:
    while True:
        try:
            task = pickle.load(tasks)
        except EOFError:  # the other process closed its end, or is no more
            return
        pickle.dump(_reply(task), replies)
        replies.flush()
        del task


def _reply(task: bytes) -> bytes:
    """Pickle of (result, None, "") or of (None, exception, its traceback)."""
    try:
        return pickle.dumps((pickle.loads(task)(), None, ""))
    except Ended:
        raise
    except BaseException as error:
        text = traceback.format_exc()
        try:
            return pickle.dumps((None, error, text))
        except Exception:
            return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}"), text))


if __name__ == "__main__":
    main()
