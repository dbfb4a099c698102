"""How the C library gives back the memory of arrays that are done with."""

from __future__ import annotations

import ctypes
import platform
import sys

_MMAP_THRESHOLD = -3  # M_MMAP_THRESHOLD of glibc's malloc.h
_ARRAY_BYTES = 400_000


def return_freed_arrays() -> None:
    """Let arrays of more than 0.4 MB go back to the system when freed.

    glibc raises this bound to 32 MB as arrays are freed, so that those of a record leave holes between
    lasting small ones: a loop closed over 42 records kept 0.6 GB that nothing used.
    """
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _ARRAY_BYTES)


def peak_memory_mb() -> float:
    """Return the most memory that this process has had [MB]; nan where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    units = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / units
