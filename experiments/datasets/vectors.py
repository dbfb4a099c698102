"""Vectors and times of files that others wrote."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.collected import SourceError, unreadable
from experiments.datasets.parser_process import parsed_apart
from rom.campaign.channels import FloatArray

PRINTED = 1e-4  # of a sample: times that are off by more are rounded in print
STEP_TOLERANCE = 0.25  # of a sample: jitter of a printed time; a lost sample is a whole one


def mat_vectors(path: Path, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return variables of a MATLAB file (v4 to v7.2) as one-dimensional arrays.

    Some damage ends the process of SciPy's parser, which therefore has one of its own.

    Raises
    ------
    SourceError
        If the file cannot be read or lacks one of them, or one is not made of finite real numbers.
    """
    try:
        content = parsed_apart(partial(_variables, names=names), path, "MATLAB file")
    except SourceError:
        raise
    except Exception as cause:  # a parser of foreign bytes may fail in any way
        raise unreadable(path, "MATLAB file", cause) from None
    vectors = {}
    for name in names:
        if name not in content:
            raise SourceError(f"{path.name}: found no variable {name}, expected {', '.join(names)}")
        values = np.asarray(content[name])
        if values.dtype.kind not in "iuf" or values.size != max(values.shape, default=0):
            raise SourceError(f"{path.name}: {name}: found no vector of real numbers, expected one")
        if not np.isfinite(values).all():
            raise SourceError(f"{path.name}: {name}: found NaN or infinity, expected finite numbers")
        vectors[name] = values.ravel().astype(np.float64)
    return vectors


def _variables(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    from scipy.io import loadmat

    return dict(loadmat(str(path), appendmat=False, variable_names=names))


def rate_of(where: str, time: FloatArray, rounding: FloatArray | float = 0.0) -> float:
    """Return the rate [Hz] of evenly spaced times [s].

    Parameters
    ----------
    where : str
        File and variable, for messages.
    time : array
        n times [s].
    rounding : array or float
        What each time may be off in print [s].

    Returns
    -------
    float
        Rate [Hz].

    Raises
    ------
    SourceError
        If they do not rise evenly.
    """
    if len(time) < 2 or not np.isfinite(time).all() or time[-1] <= time[0]:
        raise SourceError(f"{where}: found no rising times, expected evenly spaced ones")
    step = (time[-1] - time[0]) / (len(time) - 1)
    even = time[0] + step * np.arange(len(time))
    if (np.abs(time - even) > STEP_TOLERANCE * step + 2 * rounding).any():
        steps = np.diff(time)
        raise SourceError(
            f"{where}: found steps from {steps.min():.4g} to {steps.max():.4g} s, expected even steps"
        )
    if np.abs(time - even).max() > PRINTED * step:  # the ends alone tell the rate of a short record badly
        step = float(np.polyfit(np.arange(len(time)), time, 1)[0])
    return float(1 / step)


def same_length(path: Path, vectors: dict[str, FloatArray]) -> None:
    """Refuse vectors of a file that were not sampled together.

    Raises
    ------
    SourceError
        If their lengths differ.
    """
    lengths = {name: len(values) for name, values in vectors.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise SourceError(f"{path.name}: found lengths that differ ({told}), expected one length")
