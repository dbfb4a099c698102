"""A quick measure of candidate laws on integral rows, thousands at once.

-2 log likelihood of the whitened rows of all cases, with the scatter of the rate from case to case integrated
out,

    y_i = (1 + u_i) g_i + e_i,   g_i = G_i c,   u_i ~ N(0, tau^2),   e_i ~ N(0, I),

so that the shape of a case's course counts in full and its size only as far as the scatter lets it. Rows that
allow for the scatter of the measured course instead could be fitted by shrinking every coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from discovery.criteria.courses import Courses
from discovery.criteria.criteria import CRITERIA
from discovery.search.sparse_regression import Rows
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_SCATTERS: Numerical[tuple[float, ...]] = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
_MIXTURES: Numerical[tuple[float, ...]] = (0.1, 0.3, 0.5, 0.7, 0.9)
_NEWTON_STEPS: Numerical[int] = 6
_LARGEST_STEP: Numerical[float] = 0.7
_STEP: Numerical[float] = 0.02
_WIDE_START: Numerical[float] = 3.0
_FARTHEST: Numerical[float] = 10.0  # of the logarithm of a coefficient from its start
_TINY: Numerical[float] = 1e-300


@dataclass(frozen=True)
class Found:
    """Columns of a library with their coefficients, the deviance, and where they came from."""

    columns: tuple[int, ...]
    coefficients: tuple[float, ...]
    deviance: float
    sources: tuple[str, ...]


def assumed_variability(signed: bool, rules: Courses = CRITERIA.courses) -> float:
    """Between-test standard deviation of the log rate that is assumed before it is fitted."""
    return rules.signed_variability if signed else rules.usual_variability


def marginal_deviance(
    size: FloatArray, along: FloatArray, square: FloatArray, scatter: FloatArray | float
) -> FloatArray:
    """-2 log likelihood by case with the scatter integrated out.

    Parameters
    ----------
    size : ndarray
        ``|y|^2`` of the whitened losses of a case.
    along, square : ndarray
        ``g . y`` and ``g . g`` of the law's whitened course g of the case.
    scatter : ndarray or float
        tau.
    """
    tau2 = np.square(scatter)
    there = np.maximum(square, _TINY)
    shape = np.maximum(size - along**2 / there, 0.0)
    return np.asarray(shape + (along - square) ** 2 / (there * (1 + tau2 * square)) + np.log1p(tau2 * square))


def single_terms(rows: Rows, source: str, *, signed: bool = False) -> list[Found]:
    """Every column alone that is not zero, with the coefficient and the scatter that suit it best.

    With ``signed`` the coefficient may have either sign.

    Parameters
    ----------
    rows : Rows
        Whitened by the noise.
    source : str
        Where the columns come from.
    signed : bool
        Whether coefficients may have either sign.

    Returns
    -------
    list of Found
        One for each such column, in their order.
    """
    found = _of_one_sign(rows, source)
    if not signed:
        return found
    others = _of_one_sign(Rows(-rows.columns, rows.target), source)
    turned = {one.columns: replace(one, coefficients=(-one.coefficients[0],)) for one in others}
    return [min(one, turned.get(one.columns, one), key=lambda f: f.deviance) for one in found]


def _of_one_sign(rows: Rows, source: str) -> list[Found]:
    size = (rows.target**2).sum(axis=1)[:, None]
    along = np.einsum("cbk,cb->ck", rows.columns, rows.target)
    square = np.einsum("cbk,cbk->ck", rows.columns, rows.columns)
    start = _typical(along, square)
    best, where = np.full(len(start), np.inf), start
    for scatter in _SCATTERS:
        value, logs = _scaled(size, along, square, start, scatter)
        better = value < best
        best, where = np.where(better, value, best), np.where(better, logs, where)
    sound = np.flatnonzero(np.isfinite(best) & (square.sum(axis=0) > 0))
    return [Found((int(k),), (float(np.exp(where[k])),), float(best[k]), (source,)) for k in sound]


def best_pairs(
    rows: Rows, sizes: FloatArray, count: int, signed: bool = False, rules: Courses = CRITERIA.courses
) -> list[tuple[int, int]]:
    """Pairs of columns of the largest marginal likelihood, over a few mixtures of each pair, best first.

    Parameters
    ----------
    rows : Rows
        Whitened by the noise.
    sizes : ndarray, shape (columns,)
        Coefficient of every column alone.
    count : int
        How many pairs to return.
    signed : bool
        Whether one of the two may tighten.
    rules : Courses
        Between-test variability that is assumed.
    """
    columns = rows.columns * sizes
    gram = np.einsum("cbj,cbk->cjk", columns, columns, optimize=True)
    product = np.einsum("cbj,cb->cj", columns, rows.target)
    size = (rows.target**2).sum(axis=1)[:, None]
    j, k = np.triu_indices(len(sizes), 1)
    best, assumed = np.full(len(j), np.inf), assumed_variability(signed, rules)
    for first, second in _mixtures(signed):
        along = first * product[:, j] + second * product[:, k]
        square = first**2 * gram[:, j, j] + second**2 * gram[:, k, k] + 2 * first * second * gram[:, j, k]
        value, _ = _scaled(size, along, square, _typical(along, square), assumed)
        best = np.minimum(best, np.where(np.isfinite(value), value, np.inf))
    return [(int(j[place]), int(k[place])) for place in np.argsort(best)[:count]]


def _mixtures(signed: bool) -> list[tuple[float, float]]:
    plain = [(1 - share, share) for share in _MIXTURES]
    if not signed:
        return plain
    return [*plain, *((1.0, -share) for share in _MIXTURES), *((-share, 1.0) for share in _MIXTURES)]


def fitted_sum(
    rows: Rows,
    members: Sequence[int],
    start: FloatArray,
    sources: tuple[str, ...],
    rules: Courses = CRITERIA.courses,
) -> Found:
    """A sum of columns with the coefficients (of the signs of ``start``) and scatter that suit it best.

    Parameters
    ----------
    rows : Rows
        Whitened by the noise.
    members : sequence of int
        Places of the columns.
    start : ndarray, shape (members,)
        Coefficients to start from, none of them zero.
    sources : tuple of str
        Where the sum comes from.
    rules : Courses
        Between-test variability to start from.

    Returns
    -------
    Found
        With coefficients and deviance.
    """
    columns = rows.columns[:, :, list(members)] * start
    gram = np.einsum("cbj,cbk->cjk", columns, columns)
    product = np.einsum("cbj,cb->cj", columns, rows.target)
    size = (rows.target**2).sum(axis=1)

    def deviance(logs: FloatArray) -> tuple[float, FloatArray]:
        weight, tau2 = np.exp(logs[:-1]), np.exp(2 * logs[-1])
        pull = gram @ weight
        along, square = product @ weight, pull @ weight
        spread = 1 + tau2 * square
        lag = (along - square) / spread
        value = marginal_deviance(size, along, square, np.sqrt(tau2)).sum()
        by_along = -2 * (1 + tau2 * lag)
        by_square = (1 + tau2 * lag) ** 2 + tau2 / spread
        slopes = weight * (by_along @ product + 2 * by_square @ pull)
        return float(value), np.append(slopes, 2 * tau2 * (square / spread - lag**2).sum())

    limits = [(-_FARTHEST, _FARTHEST)] * len(members) + [(-5.0, 2.0)]
    # far from the minimum a coefficient may run off to nothing; a wide scatter at the start goes another way
    tries = [
        optimize.minimize(
            deviance, np.append(np.zeros(len(members)), np.log(scatter)), jac=True, method="L-BFGS-B",
            bounds=limits, options={"ftol": 1e-7},
        )
        for scatter in (rules.usual_variability, _WIDE_START)
    ]  # fmt: skip
    found = min(tries, key=lambda item: float(item.fun))
    coefficients = start * np.exp(found.x[:-1])
    return Found(tuple(members), tuple(float(c) for c in coefficients), float(found.fun), sources)


def _typical(along: FloatArray, square: FloatArray) -> FloatArray:
    """Logarithm of a column's coefficient: mean over the cases, weighted by how well it shows in each."""
    amplitude = along / np.maximum(square, _TINY)
    seen = np.where(amplitude > 0, 1 / (0.25 + 1 / np.maximum(along * amplitude, _TINY)), 0.0)
    logs = np.log(np.maximum(amplitude, _TINY))
    return np.asarray((seen * logs).sum(axis=0) / np.maximum(seen.sum(axis=0), _TINY))


def _scaled(
    size: FloatArray, along: FloatArray, square: FloatArray, start: FloatArray, scatter: float
) -> tuple[FloatArray, FloatArray]:
    """Smallest deviance of many courses over a factor each, and its logarithm, by Newton steps."""

    def deviance(logs: FloatArray) -> FloatArray:
        factor = np.exp(np.clip(logs, -300, 300))
        total = marginal_deviance(size, factor * along, factor**2 * square, scatter).sum(axis=0)
        return np.asarray(total)

    at = start
    for _ in range(_NEWTON_STEPS):
        here, ahead, behind = deviance(at), deviance(at + _STEP), deviance(at - _STEP)
        slope, bend = (ahead - behind) / (2 * _STEP), (ahead + behind - 2 * here) / _STEP**2
        change = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), 0.5 * np.sign(slope))
        at = at - np.clip(change, -_LARGEST_STEP, _LARGEST_STEP)
    return deviance(at), at
