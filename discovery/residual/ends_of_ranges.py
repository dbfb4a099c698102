"""Numbers that a fit within a range has brought to an end of it: they are said to be there."""

from __future__ import annotations

from collections.abc import Callable

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


def on_ends_that_suit(
    rows: Callable[[FloatArray], FloatArray],
    values: FloatArray,
    low: FloatArray,
    high: FloatArray,
    near: float,
    most: float,
) -> FloatArray:
    """Return fitted numbers, each put upon an end that it all but touches where that leaves hardly more.

    What is small beside its range need not be nothing.

    Parameters
    ----------
    rows : callable
        What numbers leave over, (rows,).
    values, low, high, near
        As for `on_ends`.
    most : float
        By how much a number may raise the sum of the squares.
    """
    here, there = values.copy(), on_ends(values, low, high, near)
    left = [rows(values)] if np.any(there != values) else []
    for place in np.flatnonzero(there != values):
        tried = here.copy()
        tried[place] = there[place]
        after = rows(tried)
        if after @ after <= left[0] @ left[0] + most:
            here = tried
    return here
