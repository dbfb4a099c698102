"""Least squares by damped Gauss-Newton steps, each corrected along the slopes that are known.

    (J'J + lambda D) s = -J' r,   D the squares of the columns' norms

Slopes cost as many simulations as there are numbers, a step costs one. So from where a step ends the next
ones go along the same slopes, with r as it is there, while they lower the cost by much (J. Fan, Math. Comput.
81, 447, 2012). A long record holds the phase so exactly that the cost has narrow curved valleys: a step
leaves the floor, its corrections lead back, and the cost there is what is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import optimize

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

Rows = Callable[[FloatArray], FloatArray]
Range = tuple[FloatArray, FloatArray]
_DAMPING: Numerical[float] = 1e-4  # lambda of the first step
_LEAST_DAMPING: Numerical[float] = 1e-9
_CORRECTION_DAMPING: Numerical[float] = 1e-2  # at least: a correction goes along what slopes tell well
_CORRECTIONS: Numerical[int] = 3
_MUCH: Numerical[float] = 0.1  # of the cost
_HARDER: Numerical[float] = 10.0
_SOFTER: Numerical[float] = 0.02
_TRIALS: Numerical[int] = 12  # dampings of one step
_SETTLED: Numerical[float] = 1e-5  # of the cost


class Minimum(NamedTuple):
    """Where a fit ends, what is left over there, and its slopes there, None where a step led on from them."""

    x: FloatArray
    rows: FloatArray
    slopes: FloatArray | None


class _Place(NamedTuple):
    """Numbers, what they leave over, and the sum of its squares."""

    x: FloatArray
    rows: FloatArray
    cost: float


def minimum(
    rows: Rows,
    start: FloatArray,
    slopes: Rows,
    bounds: Range,
    rounds: int,
    little: Callable[[float], float],
) -> Minimum:
    """Return numbers in their ranges that leave least.

    Parameters
    ----------
    rows : callable
        ``r(x)``, (rows,), all finite.
    start : ndarray, shape (numbers,)
        Where to start.
    slopes : callable
        ``J(x)``, (rows, numbers).
    bounds : tuple of ndarray
        Lowest and highest numbers.
    rounds : int
        Times that slopes are taken for steps, at most; with 0 the numbers stay.
    little : callable
        Of a cost, by how much a step that is the last lowers it at most.

    Returns
    -------
    Minimum
        The end.
    """

    def at(x: FloatArray) -> _Place:
        inside = np.clip(x, *bounds)
        left = rows(inside)
        return _Place(inside, left, float(left @ left))

    here, damping = at(start), float(_DAMPING)
    for _ in range(rounds):
        table = slopes(here.x)
        step = _Step(table, here, bounds)
        before, least, first = here.cost, little(here.cost), damping
        if step.foreseen <= least:
            return Minimum(here.x, here.rows, table)
        for _ in range(_TRIALS):
            there = _corrected(at, step, here, damping)
            if there.cost <= before + least:
                break
            damping *= _HARDER
        if there.cost < before:
            here = there
        if before - here.cost <= least and (damping > first or damping <= _LEAST_DAMPING):
            return Minimum(here.x, here.rows, table)  # so near that slopes are those of the end
        damping = max(_SOFTER * damping, _LEAST_DAMPING)
    return Minimum(here.x, here.rows, None)


def minimum_nearby(
    rows: Rows,
    start: FloatArray,
    slopes: Rows,
    bounds: Range,
    rounds: int,
) -> Minimum:
    """The same by steps in a region of trust, which shrinks where slopes tell the cost near by alone.

    Parameters
    ----------
    rows, start, slopes, bounds
        As for `minimum`.
    rounds : int
        Places at which rows are taken, at most; with 0 the numbers stay.
    """
    low, high = bounds
    margin = 1e-9 * np.minimum(high - low, 1.0)
    x = np.clip(start, low + margin, high - margin)
    if rounds == 0:
        return Minimum(x, rows(x), None)
    found = optimize.least_squares(
        rows, x, jac=slopes, bounds=bounds, x_scale="jac", max_nfev=rounds, ftol=_SETTLED, xtol=1e-8
    )
    return Minimum(found.x, found.fun, np.asarray(found.jac))


class _Step:
    """Damped steps along slopes, numbers that would leave their range held."""

    def __init__(self, table: FloatArray, here: _Place, bounds: Range) -> None:
        low, high = bounds
        gradient = table.T @ here.rows
        held = ((here.x <= low) & (gradient > 0)) | ((here.x >= high) & (gradient < 0))
        self.free = np.flatnonzero(~held)
        self.size = np.maximum(np.linalg.norm(table[:, self.free], axis=0), np.finfo(float).tiny)
        self.left, self.values, self.right = np.linalg.svd(
            table[:, self.free] / self.size, full_matrices=False
        )
        self.foreseen = float(np.sum((self.left.T @ here.rows) ** 2))
        self.count = len(here.x)

    def along(self, rows: FloatArray, damping: float) -> FloatArray:
        """The step from what is left over."""
        shares = self.values / (self.values**2 + damping)
        step = np.zeros(self.count)
        step[self.free] = -(self.right.T @ (shares * (self.left.T @ rows))) / self.size
        return step


def _corrected(at: Callable[[FloatArray], _Place], step: _Step, here: _Place, damping: float) -> _Place:
    """Where a step and its corrections end."""
    there = at(here.x + step.along(here.rows, damping))
    for _ in range(_CORRECTIONS):
        after = at(there.x + step.along(there.rows, max(damping, _CORRECTION_DAMPING)))
        if not after.cost < there.cost:
            break
        gained, there = there.cost - after.cost, after
        if gained < _MUCH * there.cost:
            break
    return there
