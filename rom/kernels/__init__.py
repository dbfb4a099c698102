"""Compiled equations of motion and their integrators. Imports NumPy and Numba only.

Kernels are compiled once and cached on disk. They know a structure as integer tables and a law as
the address of its compiled function, so that neither a new coefficient nor a new law compiles them
again. Kernels trust their input: it is checked where a model is made or called.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path


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


with suppress(OSError):  # a read-only installation has no cache here
    _drop_stale_cache(Path(__file__).parent)
