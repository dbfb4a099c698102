"""What a result was made with: versions of the program and of the libraries that do its arithmetic."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from rom.plug_ins import packages

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "pysindy", "h5py", "pandas", "joblib")


def program_version() -> str:
    """Return the version of the program, "unknown" where it is not installed."""
    try:
        return version("boltlaw")
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions of Python, and of the libraries and plug-ins on which the numbers of a result may
    depend.
    """
    libraries = {name: version(name) for name in _LIBRARIES}
    return {"python": platform.python_version(), **libraries, **packages()}
