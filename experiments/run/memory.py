"""How memory is given back: by the C library for arrays, by Python for objects that refer to each other."""

from __future__ import annotations

import ctypes
import gc
import platform
import sys

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1  # of glibc's malloc.h
_ARRAY_BYTES = 1_000_000
_KEPT_BYTES = 64_000_000
_SELDOM = (50_000, 20, 20)  # objects made since the last search for cycles, and searches of young ones


def return_freed_arrays() -> None:
    """Let arrays of more than 1 MB go back to the system when freed, and all but 64 MB of what is free last.

    glibc raises the first bound to 32 MB as arrays are freed, so that those of a record leave holes between
    lasting small ones: a loop closed over 42 records kept 0.6 GB that nothing used. Smaller arrays come and
    go by the hundred: pages of theirs that the system cleared anew took a third of the time of a filter.
    """
    if platform.libc_ver()[0] == "glibc":
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, _ARRAY_BYTES)
        library.mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)


def collect_cycles_seldom() -> None:
    """Look less often for objects that only each other refers to.

    Each full search walks through all that the libraries hold. A first `identify` spent 4 of 51 s of CPU on
    20 of them, and held 40 MB less for it.
    """
    gc.set_threshold(*_SELDOM)


def peak_memory_mb() -> float:
    """Return the most memory that this process has had [MB]; nan where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    units = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / units
