"""What a result was made with: versions of the program and of the libraries that do its arithmetic."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "pysindy", "h5py", "pandas", "joblib")


def program_version() -> str:
    """Return the version of the program, "unknown" where it is not installed."""
    try:
        return version("boltlaw")
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries on which the numbers of a result may depend."""
    return {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}}
