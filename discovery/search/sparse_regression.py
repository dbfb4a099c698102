"""Weighted integral rows, and sparse fits of them with pysindy's optimizers.

    mean over bin b of (T - T(0)) = -sum_j c_j mean over bin b of integral_0^t Theta_j(x, v, ..., T) dt

Nothing is differentiated and T(0) is gone. The rows of a case are whitened by the Cholesky factor of

    covariance of its changes + (share d)(share d)' for a share of model error + tau^2 d d'

d: the change that a fitted law predicts for the case, the measured course smoothed; tau: the scatter of the
rate from case to case. The strong form, finite differences of the tension, is here for comparison only.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import optimize

from rom.campaign.channels import FloatArray

if TYPE_CHECKING:
    from discovery.courses.fit import Fit
    from discovery.courses.frozen_motion import FrozenMotion
    from discovery.search.libraries import TermLibrary

MODEL_ERROR = 0.01  # of the change: frozen motion and tension course against the full simulation
_COLLINEAR = 1e-9  # one minus the cosine of two columns
_RIDGE = 1e-4
_LARGEST_SUPPORT = 3
_LONG = 300
_SMALL = 0.03
_NOTHING = 1e-30
_SHARES = tuple(np.geomspace(0.02, 0.8, 8))  # thresholds as a share of the target's norm
_THRESHOLDS = 12
_EXACT = 1e-10  # of the bounded fits, whose own default stops among near-equal columns
_POSITIVE = tuple(np.geomspace(0.01, 0.8, _THRESHOLDS))  # coefficients that cannot cancel stay below about 1


@dataclass(frozen=True, eq=False)
class Rows:
    """Integral rows of all cases.

    Attributes
    ----------
    columns : ndarray, shape (cases, bins, columns)
        Integrals of the library's columns [s], whitened [s/N].
    target : ndarray, shape (cases, bins)
        Measured losses, whitened [1].
    """

    columns: FloatArray
    target: FloatArray


def integrals(library: TermLibrary, frozen: FrozenMotion) -> FloatArray:
    """Integrals of the columns from the hit, averaged over bins, (cases, bins, motions, tensions) [s]."""
    bins = frozen.averages.shape[0]
    out = np.empty((len(frozen), bins, len(library.motions), len(library.tensions)))
    for case in range(len(frozen)):
        nodes = frozen.of_case(case)
        motion, tension = library.factors(nodes)
        for place, row in enumerate(_node_weights(nodes[0], frozen)):
            out[case, place] = (motion * row[:, None]).T @ tension
    return out


def _node_weights(time: FloatArray, frozen: FrozenMotion) -> FloatArray:
    """Weights of an integrand's nodes in the mean of its integral over each bin, (bins, nodes) [s].

    Trapezoids up to the knots, then the knots' averages: as along exposures, so that offsets mean the same.
    """
    step = np.diff(time)
    passed = np.clip((frozen.knots_s[:, None] - time[:-1]) / step, 0.0, 1.0)
    half = 0.5 * step * (frozen.averages @ passed)
    return np.asarray(np.pad(half, ((0, 0), (0, 1))) + np.pad(half, ((0, 0), (1, 0))))


def whitener(frozen: FrozenMotion, smooth: FloatArray, tau: FloatArray | None = None) -> FloatArray:
    """Inverse Cholesky factors of the rows' covariance, (cases, bins, bins) [1/N].

    Parameters
    ----------
    frozen : FrozenMotion
        Courses with their covariance.
    smooth : ndarray, shape (cases, bins)
        Changes as a fitted law predicts them for these cases [N].
    tau : ndarray, shape (cases,)
        Scatter of the log rate; without it the rows keep it whole.
    """
    total = frozen.covariance + np.einsum("cb,bd->cbd", (MODEL_ERROR * smooth) ** 2, np.eye(smooth.shape[1]))
    if tau is not None:
        total = total + np.einsum("c,cb,cd->cbd", tau**2, smooth, smooth)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def weighted(columns: FloatArray, frozen: FrozenMotion, roots: FloatArray) -> Rows:
    """Rows whitened by ``whitener``; the target is the loss, so that loosening has positive coefficients."""
    flat = roots @ columns.reshape(*columns.shape[:2], -1)
    # numbers so small that their squares leave the normal range cost a hundred times the time of others
    flat[np.abs(flat) < _NOTHING * np.abs(flat).max(axis=(0, 1))] = 0.0
    return Rows(flat, -np.einsum("cij,cj->ci", roots, frozen.change))


def smoothed(fit: Fit, frozen: FrozenMotion) -> FloatArray:
    """The measured courses as a fit with its deviations predicts them on frozen motion, (cases, bins) [N]."""
    from discovery.courses.fit import predict

    return predict(fit.candidate, frozen, deviations=fit.deviations)


def along(fit: Fit, frozen: FrozenMotion) -> FrozenMotion:
    """The same with the tension of a fit at the nodes, and its offsets to full simulation taken off."""
    every = replace(frozen, averages=np.eye(len(frozen.knots_s)))
    courses = frozen.initial[:, None] + smoothed(fit, every)
    nodes = frozen.nodes.copy()
    for case, (a, b) in enumerate(pairwise(frozen.starts)):
        nodes[5, a:b] = np.interp(nodes[0, a:b], frozen.knots_s, courses[case])
    return replace(frozen, nodes=nodes, change=frozen.change - fit.offsets)


def usable(theta: FloatArray, names: Sequence[str]) -> tuple[list[int], tuple[str, ...]]:
    """Which columns a regression can take, and names of those that are zero or multiples of earlier ones."""
    norms = np.linalg.norm(theta, axis=0)
    sound = np.isfinite(norms) & (norms > 0)
    unit = np.where(sound, theta, 0.0) / np.where(sound, norms, 1.0)
    cosines = np.abs(unit.T @ unit)
    kept: list[int] = []
    dropped = []
    for j, name in enumerate(names):
        if sound[j] and not np.any(cosines[j, kept] > 1 - _COLLINEAR):
            kept.append(j)
        else:
            dropped.append(name)
    return kept, tuple(dropped)


def sparse_supports(
    theta: FloatArray, target: FloatArray, rng: np.random.Generator, signed: bool = False
) -> dict[frozenset[int], tuple[str, ...]]:
    """Distinct supports on the paths of pysindy's optimizers, each with the optimizers that found it.

    Parameters
    ----------
    theta : ndarray, shape (rows, columns)
        Whitened columns, none of them zero or twice there.
    target : ndarray, shape (rows,)
        Whitened losses.
    rng : numpy.random.Generator
        Source of the ensemble's rows.
    signed : bool
        Whether terms of either sign are sought: no fit is then held to positive coefficients.
    """
    unit = theta / np.linalg.norm(theta, axis=0)
    goal = target / np.linalg.norm(target)
    found: dict[frozenset[int], tuple[str, ...]] = {}
    for optimizer, coefficients in _paths(unit, goal, rng, signed):
        for row in coefficients:
            support = frozenset(int(j) for j in np.flatnonzero(row))
            if 0 < len(support) <= _LARGEST_SUPPORT and optimizer not in found.get(support, ()):
                found[support] = (*found.get(support, ()), optimizer)
    return found


def _paths(
    theta: FloatArray, target: FloatArray, rng: np.random.Generator, signed: bool
) -> Iterator[tuple[str, list[FloatArray]]]:
    """Coefficients along the path of every optimizer."""
    from pysindy import FROLS, SR3, SSR, STLSQ, EnsembleOptimizer

    count = theta.shape[1]

    def stlsq(threshold: float) -> Any:
        return STLSQ(threshold=threshold, alpha=_RIDGE, max_iter=count + 1)

    def non_negative(threshold: float) -> Any:
        # its last step, plain least squares on what is left, would lose the signs again
        bound = {"positive": True, "tol": _EXACT}
        return STLSQ(threshold, alpha=_RIDGE, max_iter=count + 1, ridge_kw=bound, unbias=False)

    def sr3(share: float) -> Any:
        weight = SR3.calculate_l0_weight(share, 1.0)
        # from zero: the least squares of near-equal columns are far off
        return SR3(weight, initial_guess=np.zeros((1, count)), max_iter=_LONG, unbias=True)

    # the stop of FROLS is unreliable and that of SSR a guess: their whole paths are taken
    if count > 1:
        yield "FROLS", _history(FROLS(max_iter=min(_LARGEST_SUPPORT + 1, count), alpha=_RIDGE), theta, target)
        yield "SSR", _history(SSR(max_iter=count, alpha=_RIDGE), theta, target)
    # near-equal columns have large coefficients that cancel: thresholds up to the largest
    largest = np.abs(np.linalg.solve(theta.T @ theta + _RIDGE * np.eye(count), theta.T @ target)).max()
    thresholds = np.geomspace(0.02, max(float(largest), 0.04), _THRESHOLDS)
    yield "STLSQ", [c for t in thresholds for c in _coefficients(stlsq(t), theta, target)]
    if not signed:
        yield (
            "non-negative STLSQ",
            [c for t in _POSITIVE for c in _coefficients(non_negative(t), theta, target)],
        )
    yield "SR3", [c for share in _SHARES for c in _coefficients(sr3(share), theta, target)]
    with _global_seed(rng):
        yield (
            "EnsembleOptimizer",
            [
                c
                for t in thresholds[_THRESHOLDS // 2 :: 2]
                for c in _coefficients(EnsembleOptimizer(stlsq(t), bagging=True, n_models=10), theta, target)
            ],
        )


def _history(optimizer: Any, theta: FloatArray, target: FloatArray) -> list[FloatArray]:
    return [np.asarray(row)[0] for row in optimizer.fit(theta, target).history_]


def _coefficients(optimizer: Any, theta: FloatArray, target: FloatArray) -> list[FloatArray]:
    """Coefficients of one fit; none where the optimizer warns that it left nothing or did not settle."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return [np.asarray(optimizer.fit(theta, target).coef_)[0]]
        except UserWarning:
            return []


@contextmanager
def _global_seed(rng: np.random.Generator) -> Iterator[None]:
    """Seed for a while the global state that EnsembleOptimizer draws from, and put it back."""
    before = np.random.get_state()  # noqa: NPY002 - pysindy draws from it
    np.random.seed(int(rng.integers(2**31)))  # noqa: NPY002 - the same
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002 - the same


def forward(theta: FloatArray, target: FloatArray, count: int) -> list[int]:
    """Return the first columns that FROLS takes."""
    from pysindy import FROLS

    norms = np.linalg.norm(theta, axis=0)
    there = np.flatnonzero(norms > 0)
    if len(there) < 2:
        return [int(k) for k in there]
    path = FROLS(max_iter=count, alpha=_RIDGE).fit(theta[:, there] / norms[there], target).history_
    return [int(there[k]) for k in np.flatnonzero(np.asarray(path[-1])[0])]


def least_squares(theta: FloatArray, target: FloatArray, signed: bool = False) -> FloatArray:
    """Coefficients that are positive or, where ``signed``, of either sign; what is left out starts small."""
    norms = np.linalg.norm(theta, axis=0)
    unit = theta / norms
    found = np.linalg.lstsq(unit, target, rcond=None)[0] if signed else optimize.nnls(unit, target)[0]
    largest = max(float(np.abs(found).max()), np.finfo(float).tiny)
    least = _SMALL * largest * np.where(found < 0, -1.0, 1.0)
    return np.asarray(np.where(np.abs(found) < np.abs(least), least, found) / norms)


def strong_form(
    library: TermLibrary, nodes: FloatArray, tension: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Rows of the textbook form: columns at the samples, and the finite difference of the tension [N/s].

    Parameters
    ----------
    library : TermLibrary
        Columns.
    nodes : ndarray, shape (6, samples)
        Time, x, v, F, D at the samples of the tension; the tension's row is ignored.
    tension : ndarray, shape (samples,)
        Measured tension [N].
    rate_hz : float
        Its sampling rate.
    """
    from pysindy import FiniteDifference

    rows = np.vstack([nodes[:5], tension])
    slope = FiniteDifference()(tension[:, None], 1.0 / rate_hz)
    return library.transform(rows), np.asarray(slope)[:, 0]
