"""What a whole catalogue explains by chance of the residuals of this very campaign.

In the motion, signs are drawn by record.
Of a residual r, what effect e explains is (sum_i a_i)^2, a_i = (s_e . r)_i / |s_e| over the rows of record i
(s_e its output, both without what the model's numbers imitate). Where no effect is missing, records err to
either side alike, so that r with the signs of whole records drawn anew is as likely as r itself: neither
white noise nor a small misfit that all lines of a record share is mistaken for an effect. The largest gain
of any effect that a rough screen lets pass under each draw is the null distribution that they have together
(P. Westfall, S. Young, Resampling-Based Multiple Testing, Wiley 1993, section 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import linalg

from discovery.criteria.criteria import CRITERIA, Criteria
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_TINY: Numerical[float] = 1e-300
_SEED: Numerical[int] = 0  # numbers of a closure are the same on every run


def by_record(
    output: FloatArray, residual: FloatArray, owner: npt.NDArray[np.int64], records: int
) -> FloatArray:
    """Return a_i of one effect, (records,); rows past those of the records, as of ties, tell nothing.

    Parameters
    ----------
    output : ndarray, shape (rows or more,)
        Output of the effect over the noise, what the model's numbers imitate taken off.
    residual : ndarray, shape (rows or more,)
        Whitened residual, the same taken off.
    owner : ndarray of int, shape (rows,)
        Place of each row's record.
    records : int
        Number of records.

    Returns
    -------
    ndarray, shape (records,)
        a_i; NaN for an output that is zero.
    """
    product = output[: len(owner)] * residual[: len(owner)]
    return np.asarray(np.bincount(owner, weights=product, minlength=records) / np.linalg.norm(output))


def largest_by_chance(scores: FloatArray, criteria: Criteria = CRITERIA) -> FloatArray:
    """Return the largest gain of any effect under every draw of signs, (draws,), from its a_i.

    Parameters
    ----------
    scores : ndarray, shape (effects, records)
        From `by_record`.
    criteria : Criteria
        For the number of draws.
    """
    draws = criteria.chance.draws
    signs = np.random.default_rng(_SEED).choice((-1.0, 1.0), size=(scores.shape[1], draws))
    return np.asarray(np.max((scores @ signs) ** 2, axis=0, initial=0.0))


def largest_of_noise(
    effects: Sequence[FloatArray], spread: float, criteria: Criteria = CRITERIA
) -> FloatArray:
    """Return the largest gain of any effect in normal numbers, (draws,).

    Parameters
    ----------
    effects : sequence of ndarray, shape (directions, rows)
        Directions in which each effect's numbers can move whitened residuals; nearly equal ones count once.
    spread : float
        Mean square of the numbers: what is left over may be more than noise.
    criteria : Criteria
        For the number of draws.

    Returns
    -------
    ndarray, shape (draws,)
        In the units of the cost.
    """
    rules = criteria.chance
    drawn = np.random.default_rng(_SEED).standard_normal((effects[0].shape[1], rules.draws))
    largest = np.zeros(rules.draws)
    for directions in effects:
        sizes = np.linalg.norm(directions, axis=1, keepdims=True)
        apart = linalg.orth((directions / np.maximum(sizes, _TINY)).T, rcond=rules.same_direction)
        largest = np.maximum(largest, np.sum((apart.T @ drawn) ** 2, axis=0) * bool(sizes.any()))
    return spread * largest


def p_value(gain: float, largest: FloatArray) -> float:
    """Return the chance that some effect of the catalogue gains as much; at least 1 / (draws + 1)."""
    return float((1 + np.sum(largest >= gain)) / (1 + len(largest)))
