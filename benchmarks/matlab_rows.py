"""Rows of numbers of MATLAB files as they are published, which nobody damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from experiments.datasets.collected import SourceError, unreadable
from rom.campaign.channels import FloatArray


def rows(path: Path, name: str, count: int) -> FloatArray:
    """Return a variable as rows, (count, samples); a vector may stand either way.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        The variable.
    count : int
        Of rows.

    Raises
    ------
    SourceError
        If the file cannot be read, or the variable is not that many rows of finite numbers.
    """
    try:
        values = loadmat(str(path), appendmat=False, variable_names=(name,))[name]
    except Exception as cause:  # a parser of foreign bytes may fail in any way
        raise unreadable(path, "MATLAB file", cause) from None
    if count == 1 and values.ndim == 2 and values.shape[1] == 1:
        values = values.T
    sound = values.ndim == 2 and len(values) == count and values.dtype.kind in "iuf"
    if not sound or not np.isfinite(values).all():
        raise SourceError(f"{path.name}: {name}: found {values.shape}, expected {count} rows of numbers")
    return np.asarray(values, dtype=np.float64)
