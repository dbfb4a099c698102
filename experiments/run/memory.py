"""How memory is given back: by the C library for arrays, by Python for objects that refer to each other."""

from __future__ import annotations

import ctypes
import gc
import platform
import sys

_MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h
_ARRAY_BYTES = 400_000
_SELDOM = (50_000, 20, 20)  # objects made since the last search for cycles, and searches of young ones


def return_freed_arrays() -> None:
    """Let arrays of more than 0.4 MB go back to the system when freed.

    glibc raises this bound to 32 MB as arrays are freed, so that those of a record leave holes between
    lasting small ones: a loop closed over 42 records kept 0.6 GB that nothing used.
    """
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _ARRAY_BYTES)


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
