"""Numbers that a fit within a range has brought to an end of it: they are said to be there."""

from __future__ import annotations

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_NEAR: Numerical[float] = 1e-6


def on_ends(values: FloatArray, low: FloatArray, high: FloatArray, near: float = _NEAR) -> FloatArray:
    """Return fitted numbers with those that all but touch an end of their range upon it.

    An interior-point fit never reaches an end.

    Parameters
    ----------
    values : ndarray, shape (numbers,)
        Fitted numbers, in units of their sizes.
    low, high : ndarray, shape (numbers,)
        Ends of the ranges, in the same units.
    near : float
        How close that is, as a share of the end; of the number's size where the end is zero.
    """
    at = np.where(np.abs(values - low) < near * np.where(low == 0, 1.0, np.abs(low)), low, values)
    return np.asarray(np.where(np.abs(at - high) < near * np.where(high == 0, 1.0, np.abs(high)), high, at))
