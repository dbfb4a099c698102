"""Weighted integral rows, and sparse fits of them with pysindy's optimizers.

    mean over bin b of (T - T(0)) = -sum_j c_j mean over bin b of integral_0^t Theta_j(x, v, ..., T) dt

Nothing is differentiated and T(0) is gone. The rows of a case are whitened by the Cholesky factor of

    covariance of its changes + (share d)(share d)' for a share of model error + tau^2 d d'

d: the change that a fitted law predicts for the case, the measured course smoothed; tau: the scatter of the
rate from case to case. The strong form, finite differences of the tension, is here for comparison only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy import optimize

from discovery.criteria.criteria import CRITERIA
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

if TYPE_CHECKING:
    from discovery.courses.fit import Fit
    from discovery.courses.frozen_motion import FrozenMotion
    from discovery.search.libraries import TermLibrary

_COLLINEAR: Numerical[float] = 1e-9  # one minus the cosine of two columns
_SMALL: Numerical[float] = 0.03
_NOTHING: Numerical[float] = 1e-30


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
        for place, row in enumerate(node_weights(nodes[0], frozen)):
            out[case, place] = (motion * row[:, None]).T @ tension
    return out


def node_weights(time: FloatArray, frozen: FrozenMotion) -> FloatArray:
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
    error = frozen.criteria.search.model_error
    total = frozen.covariance + np.einsum("cb,bd->cbd", (error * smooth) ** 2, np.eye(smooth.shape[1]))
    if tau is not None:
        total = total + np.einsum("c,cb,cd->cbd", tau**2, smooth, smooth)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def weighted(columns: FloatArray, frozen: FrozenMotion, roots: FloatArray) -> Rows:
    """Rows whitened by ``whitener``; the target is the loss, so that loosening has positive coefficients.

    Parameters
    ----------
    columns : ndarray, shape (cases, bins, ...)
        Integrals of the columns [s].
    frozen : FrozenMotion
        Courses of the cases.
    roots : ndarray, shape (cases, bins, bins)
        As from `whitener` [1/N].

    Returns
    -------
    Rows
        Their last axes as one.
    """
    flat = roots @ columns.reshape(*columns.shape[:2], -1)
    # numbers so small that their squares leave the normal range cost a hundred times the time of others
    flat[np.abs(flat) < _NOTHING * np.abs(flat).max(axis=(0, 1))] = 0.0
    return Rows(flat, -np.einsum("cij,cj->ci", roots, frozen.change))


def smoothed(fit: Fit, frozen: FrozenMotion) -> FloatArray:
    """The measured courses as a fit with its deviations predicts them on frozen motion, (cases, bins) [N]."""
    from discovery.courses.fit import predict

    return predict(fit.candidate, frozen, fit.deviations)


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


def forward(
    theta: FloatArray, target: FloatArray, count: int, ridge: float = CRITERIA.search.ridge
) -> list[int]:
    """Return the first columns that FROLS takes.

    Parameters
    ----------
    theta : ndarray, shape (rows, columns)
        Whitened columns.
    target : ndarray, shape (rows,)
        Whitened losses.
    count : int
        How many columns.
    ridge : float
        Weight of the ridge.
    """
    from pysindy import FROLS

    norms = np.linalg.norm(theta, axis=0)
    there = np.flatnonzero(norms > 0)
    if len(there) < 2:
        return [int(k) for k in there]
    path = FROLS(max_iter=count, alpha=ridge).fit(theta[:, there] / norms[there], target).history_
    return [int(there[k]) for k in np.flatnonzero(np.asarray(path[-1])[0])]


def least_squares(theta: FloatArray, target: FloatArray, signed: bool = False) -> FloatArray:
    """Coefficients that are positive or, where ``signed``, of either sign; what is left out starts small.

    Parameters
    ----------
    theta : ndarray, shape (rows, columns)
        Whitened columns, none of them zero.
    target : ndarray, shape (rows,)
        Whitened losses.
    signed : bool
        Whether coefficients may have either sign.

    Returns
    -------
    ndarray, shape (columns,)
        None of them zero: what is left out has a small share of the largest.
    """
    norms = np.linalg.norm(theta, axis=0)
    unit = theta / norms
    found = np.linalg.lstsq(unit, target, rcond=None)[0] if signed else optimize.nnls(unit, target)[0]
    largest = max(float(np.abs(found).max()), np.finfo(float).tiny)
    least = _SMALL * largest * np.where(found < 0, -1.0, 1.0)
    return np.asarray(np.where(np.abs(found) < np.abs(least), least, found) / norms)
