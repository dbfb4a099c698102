"""The force left unbalanced at a place along a record's motion, and its size to either side of rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_DISTANCES: Numerical[FloatArray] = 10.0 ** (np.arange(-12, 0) / 12)  # from rest, of a record's largest
_CLASSES: Numerical[int] = 2 * (len(_DISTANCES) + 1) ** 2


@dataclass(frozen=True, eq=False)
class Course:
    """Force left unbalanced at a place along a record's motion, at even times.

    Attributes
    ----------
    time : ndarray, shape (samples,)
        Since the impact [s].
    force, displacement, velocity : ndarray, shape (samples,)
        [N], relative motion of the place's ends [m], [m/s].
    variance : ndarray, shape (samples,)
        Of the force, were noise alone left [N^2].
    """

    time: FloatArray
    force: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    variance: FloatArray

    @property
    def weight(self) -> float:
        """Of a sample's square: 1 / N^2 of noise far from the ends, where nothing is projected out."""
        return 1.0 / float(self.variance.max())


def by_sign(courses: Sequence[Course]) -> tuple[float, float]:
    """Return the force's mean square over noise where the displacement is positive, and where negative.

    Like with like: a decay begins with its largest swing, to one side. So in every record as many samples of
    either side count in each class of motion and its mirror image, by even ratios of the largest.
    """
    square, left = np.zeros(2), np.zeros(2)
    for one in courses:
        order, moves = _mirrored(one.displacement, one.velocity)
        sides = [(sign * one.displacement > 0) & moves for sign in (1, -1)]
        counts = [np.bincount(order[side], minlength=_CLASSES) for side in sides]
        for place, (side, count) in enumerate(zip(sides, counts, strict=True)):
            share = (np.minimum(*counts) / np.maximum(count, 1) * one.weight)[order[side]]
            square[place] += float(np.sum(share * one.force[side] ** 2))
            left[place] += float(np.sum(share * one.variance[side]))
    positive, negative = np.divide(square, left, out=np.full(2, np.nan), where=left > 0)
    return float(positive), float(negative)


def _mirrored(x: FloatArray, v: FloatArray) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Class of every sample, the same at (x, v) and (-x, -v), and whether it is away from rest."""
    far, fast = (
        np.searchsorted(_DISTANCES, np.abs(one) / max(float(np.abs(one).max()), 1e-300)) for one in (x, v)
    )
    count = len(_DISTANCES) + 1
    return far + count * (fast + count * (x * v > 0)), far > 0
