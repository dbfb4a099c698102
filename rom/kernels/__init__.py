"""Compiled equations of motion and their integrators. Imports NumPy and Numba only.

Kernels are compiled once and cached on disk. They know a structure as integer tables and a law as
the address of its compiled function, so that neither a new coefficient nor a new law compiles them
again. Kernels trust their input: it is checked where a model is made or called.
"""

from __future__ import annotations

import gc
import hashlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.event import Listener, register


def _drop_stale_cache(folder: Path) -> None:
    """Delete cached machine code that was compiled from other sources than those in ``folder``.

    Numba looks at the file of a function alone, not at the files of the functions that it calls.
    """
    sources = b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))
    digest, stamp = hashlib.sha256(sources).hexdigest(), folder / "__pycache__" / "kernels.sha256"
    if stamp.exists() and stamp.read_text(encoding="ascii") == digest:
        return
    for path in (folder / "__pycache__").glob("*.nb[ic]"):
        path.unlink(missing_ok=True)
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(digest, encoding="ascii")


class _Uncollected(Listener):
    """No garbage collection while kernels are compiled: it goes through all that the compiler holds, again
    and again, which is a quarter of the time.
    """

    def __init__(self) -> None:
        self.under_way, self.was_on = 0, False

    def on_start(self, _event: Any) -> None:
        if not self.under_way:
            self.was_on = gc.isenabled()
            gc.disable()
        self.under_way += 1

    def on_end(self, _event: Any) -> None:
        self.under_way -= 1
        if not self.under_way and self.was_on:
            gc.enable()


register("numba:compile", _Uncollected())  # type: ignore[no-untyped-call]

with suppress(OSError):  # a read-only installation has no cache here
    _drop_stale_cache(Path(__file__).parent)
