"""Noise of a gauge that watches a bolt at rest, by lines of its spectrum: white, flicker, and a wander.

    S_k = a + b / k,   V_k = S_k + c w_k,   w_k = d (m / pi k)^2

k: half-waves over the record of m samples at intervals d (a discrete cosine transform, whose lines are
independent for such noise). a and b come by Whittle's likelihood from lines above the slow ones, where
effects have little; c [N^2/s], of a tension or a gauge that walks at random, from the slow lines of all
training records.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_STEPS: Numerical[int] = 12
_ROUGH_STEPS: Numerical[int] = 3  # before lines are left out
_MEDIAN_SQUARE: Numerical[float] = 0.4549  # of a normal number
_DECADES: Numerical[FloatArray] = np.arange(-6.0, 14.0)


def gauge_noise(lines: FloatArray, slow: int, outlier: float, floor: float) -> FloatArray:
    """Return S_k [N^2] of all lines from those above the slow ones.

    The likelihood's maximum is where sum (p - S) / S^2 dS = 0, so least squares weighted by the last S lead
    there; lines far above the noise are a disturbance's.

    Parameters
    ----------
    lines : ndarray, shape (lines,)
        What is left over of a record [N], from the first half-wave on.
    slow : int
        Number of slow lines.
    outlier : float
        Power over the noise above which a line is left out.
    floor : float
        Least noise of a line [N^2].

    Returns
    -------
    ndarray, shape (lines,)
        a + b / k and the least noise.
    """
    columns = np.stack([np.ones(len(lines)), slow / np.arange(1.0, len(lines) + 1)], axis=1)
    power, among = lines[slow:] ** 2, columns[slow:]
    noise = np.full(len(power), np.median(power) / _MEDIAN_SQUARE + floor)
    kept, numbers = np.ones(len(power), dtype=bool), np.zeros(2)
    for step in range(_STEPS):
        if step >= _ROUGH_STEPS:
            kept = power < outlier * noise
        numbers = optimize.nnls((among / noise[:, None])[kept], (power / noise)[kept])[0]
        noise = among @ numbers + floor
    return np.asarray(columns @ numbers + floor)


def wander_of(powers: FloatArray, shapes: FloatArray) -> float:
    """Return c [N^2/s] that suits slow lines best; zero where they need none.

    Parameters
    ----------
    powers : ndarray, shape (rows,)
        Squares of what is left over, over the gauge's noise.
    shapes : ndarray, shape (rows,)
        w_k over the gauge's noise [s/N^2].
    """
    tried = np.log(10.0) * _DECADES - np.log(float(shapes.max()))

    def deviance(at: float) -> float:
        return float(np.sum(deviances(powers, 1 + np.exp(at) * shapes)))

    best = tried[int(np.argmin([deviance(at) for at in tried]))]
    found = optimize.minimize_scalar(deviance, bounds=(best - 2.5, best + 2.5), method="bounded")
    return float(np.exp(found.x)) if found.fun < powers.sum() else 0.0


def deviances(powers: FloatArray, variances: FloatArray) -> FloatArray:
    """-2 ln L of normal numbers by their squares and variances, but for a constant."""
    return np.asarray(np.log(variances) + powers / variances)


def drawn_lines(variances: Sequence[FloatArray], draws: int, seed: int) -> FloatArray:
    """Return lines as noise makes them, records one after the other.

    Parameters
    ----------
    variances : sequence of ndarray, shape (lines,)
        Of the lines of every record.
    draws : int
        How often noise is drawn.
    seed : int
        Of what is drawn.

    Returns
    -------
    ndarray, shape (rows, draws)
        In the unit of the variances' roots.
    """
    sizes = np.sqrt(np.concatenate(list(variances)))
    return np.asarray(sizes[:, None] * np.random.default_rng(seed).standard_normal((len(sizes), draws)))
