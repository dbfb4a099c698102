"""Grids in time and in inner numbers along which frozen motion is kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

LEAD_S: Numerical[float] = 0.004  # a hit begins before its impact is noticed
_BRIEF_S: Numerical[float] = 0.2
_WIDE_S: Numerical[float] = 6e-3
_BURST_S: Numerical[float] = 0.06
_EARLY_S: Numerical[float] = 0.12
_SETTLED_S: Numerical[float] = 0.5
_PER_PERIOD: Numerical[int] = 16
_WIDE: Numerical[float] = 1.0e3  # variance of a nuisance direction, in largest variance of a bin


Corners = list[tuple[float, float]]  # values of a grid about a number, and their weights


def times_of(offsets: FloatArray) -> float:
    """Factor on times that are meant for a tension that is followed for 0.2 s and more, in bins from 3 ms.

    Bins are wider where a slow structure is sampled slowly.
    """
    return min(1.0, float(offsets[-1]) / _BRIEF_S) * max(1.0, float(offsets[1] - offsets[0]) / _WIDE_S)


def knots_between(offsets: FloatArray) -> FloatArray:
    """Knots every quarter of a millisecond at first, ever wider later, and at every edge of a bin."""
    times = times_of(offsets)
    offsets = offsets / times
    fine = np.concatenate(
        [[-LEAD_S], np.arange(0.0, 0.024, 2.5e-4), np.arange(0.024, 0.06, 1e-3), np.arange(0.06, 0.13, 5e-3)]
    )
    late = np.geomspace(0.13, max(offsets[-1], 0.14), 36)
    every = np.unique(np.round(np.concatenate([fine, late, offsets]), 9))
    return np.asarray(times * every[every <= offsets[-1] + 1e-9])


def averages_over(knots: FloatArray, offsets: FloatArray) -> FloatArray:
    """Weights of the knots in the mean over each bin, (bins, knots)."""
    weights, near = np.zeros((len(offsets) - 1, len(knots))), 1e-8 * times_of(offsets)
    for row, (low, high) in enumerate(pairwise(offsets)):
        inside = np.flatnonzero((knots >= low - near) & (knots <= high + near))
        half = 0.5 * np.diff(knots[inside]) / (knots[inside[-1]] - knots[inside[0]])
        weights[row, inside[:-1]] += half
        weights[row, inside[1:]] += half
    return weights


def places_kept(v: FloatArray, time: FloatArray, times: float) -> npt.NDArray[np.int64]:
    """Every sample in the burst, ever fewer until the motion settles, then some a period.

    Parameters
    ----------
    v, time : ndarray, shape (samples,)
        Relative velocity [m/s], and time from the hit [s].
    times : float
        Factor on usual times, as `times_of`.

    Returns
    -------
    ndarray of int
        Places of the samples that are kept.
    """
    time = time / times
    late = v[time > _SETTLED_S]
    crossings = int(np.sum(np.signbit(late[1:]) != np.signbit(late[:-1])))
    stride = 4
    if crossings:
        stride = max(int(2 * len(late) / (crossings * _PER_PERIOD)), 1)
    index = np.arange(len(v))
    chosen = (time < _BURST_S) | (index % min(stride, 64) == 0)
    chosen |= ((time < _EARLY_S) & (index % 4 == 0)) | ((time < _SETTLED_S) & (index % 16 == 0))
    return np.flatnonzero(chosen)


def with_nuisance(covariance: FloatArray, nodes: FloatArray, offsets: FloatArray) -> FloatArray:
    """Add wide directions for what oscillates with the motion: it is no loss, whatever its size.

    Parameters
    ----------
    covariance : ndarray, shape (bins, bins)
        Of the changes of one case [N^2].
    nodes : ndarray, shape (6, nodes)
        Of the case, as `FrozenMotion.nodes`.
    offsets : ndarray, shape (bins + 1,)
        Edges of the bins from the hit [s].
    """
    scale = _WIDE * float(np.max(np.diag(covariance)))
    result = covariance.copy()
    for signal in (nodes[1], nodes[1] ** 2):
        total = _cumulative(signal, nodes[0], offsets)
        mean = np.diff(total) / np.diff(offsets)
        size = float(np.abs(mean).max())
        if size > 0:
            result += scale * np.multiply.outer(mean, mean) / size**2
    return result


def _cumulative(values: FloatArray, time: FloatArray, knots: FloatArray) -> FloatArray:
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    return np.asarray(np.interp(knots, time, total))


def grid_corners(value: float, step: float) -> Corners:
    """The four values of a grid about a number with Lagrange's weights; itself where it is one of them."""
    first = int(np.floor(value / step))
    share = value / step - first
    if min(share, 1 - share) < 1e-9:
        return [(round(value / step) * step, 1.0)]
    first = max(first - 1, 0)
    at = value / step - first
    weights = [
        float(np.prod([(at - other) / (node - other) for other in range(4) if other != node]))
        for node in range(4)
    ]
    return [((first + node) * step, weight) for node, weight in enumerate(weights)]
