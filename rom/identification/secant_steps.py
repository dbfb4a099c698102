"""Steps of a weighted least-squares fit whose residual may stay large: a structured secant method.

Gauss and Newton leave out the curvature of the model, sum r_i r_i''. Where a model lacks something it can be
as large as J^T J, and their steps overshoot and swing about the minimum. Here it is built up from the
gradients that the steps find, and taken where it foretells the last change of the cost better than J^T J
alone (J. E. Dennis, D. M. Gay and R. E. Welsch, An adaptive nonlinear least-squares algorithm, ACM Trans.
Math. Softw. 7, 1981, 348-368). A step is the minimum of the quadratic model within a box about the values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear

from rom.criteria.number import Numerical
from rom.identification.spectral_model import FloatArray

_LOSS: Numerical[float] = 0.6  # share of a value that it may lose at once
_LEAST: Numerical[float] = 1e-6  # of the start: below, a coefficient is as good as nothing, and can return
_RETURN: Numerical[float] = 0.5  # of the start, that any coefficient may gain at once
_FLAT: Numerical[float] = 1e-14  # of the largest curvature of scaled coefficients
_TINY = np.finfo(float).tiny
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Normal:
    """J^T J, shape (n, n), J^T r, shape (n,), and r^T r, all with coefficients counted in ``units`` (n,)."""

    hessian: FloatArray
    gradient: FloatArray
    cost: float
    units: FloatArray


@dataclass(frozen=True)
class Secant:
    """Curvature of the model times its residual, in the coefficients' own units, and whether it foretells."""

    matrix: FloatArray
    trusted: bool = False

    def of(self, normal: Normal) -> FloatArray:
        """Return the whole Hessian in which the next step is taken, (n, n)."""
        if not self.trusted:
            return normal.hessian
        return normal.hessian + self.matrix * np.outer(normal.units, normal.units)

    def after(
        self, step: FloatArray, before: Normal, trial: Normal, misfits: tuple[FloatArray, ...]
    ) -> Secant:
        """Update along a step.

        Parameters
        ----------
        step : ndarray, shape (n,)
            In the units of ``before``.
        before, trial : Normal
            Normal equations at both ends.
        misfits : tuple of ndarray, shape (n,)
            J^T r at the start and at the end of the step, and J of the start times r of its end.

        Returns
        -------
        Secant
            With the size that the step shows (Dennis et al., Eq. 3.1 and 3.2).
        """
        if not np.isfinite(trial.cost):
            return self
        moved = step * before.units
        start, end, across = misfits
        seen = across / before.units - end / trial.units
        whole = start / before.units - end / trial.units
        along = float(whole @ moved)
        if abs(along) <= _FLAT * np.linalg.norm(whole) * np.linalg.norm(moved):
            return self
        expected = float(moved @ self.matrix @ moved)
        size = min(1.0, abs(float(moved @ seen) / expected)) if expected else 1.0
        off = seen - size * (self.matrix @ moved)
        matrix = (
            size * self.matrix
            + (np.outer(off, whole) + np.outer(whole, off)) / along
            - float(moved @ off) * np.outer(whole, whole) / along**2
        )
        plain = decrease(before.hessian, before.gradient, step)
        other = plain - float(moved @ self.matrix @ moved)
        fell = before.cost - trial.cost
        return Secant(matrix, trusted=abs(fell - other) < abs(fell - plain))


def decrease(hessian: FloatArray, gradient: FloatArray, step: FloatArray) -> float:
    """Return by how much the quadratic model of the cost falls along a step, ``2 g^T d - d^T H d``.

    Parameters
    ----------
    hessian : ndarray, shape (n, n)
        H.
    gradient : ndarray, shape (n,)
        J^T r.
    step : ndarray, shape (n,)
        d.

    Returns
    -------
    float
    """
    return float(2 * gradient @ step - step @ hessian @ step)


def box(
    values: FloatArray, starts: FloatArray, units: FloatArray, positive: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far each coefficient may step down and up, in its unit.

    A positive one, counted in its value, loses at most 60 %, and gains its value or half of its start: one
    that has come to nothing can return at once. Any other moves by its unit or by its value.

    Parameters
    ----------
    values, starts, units : ndarray, shape (n,)
        Where the coefficients stand, where they started, and in what steps are counted.
    positive : ndarray of bool, shape (n,)
        Which stay above zero.

    Returns
    -------
    tuple of ndarray, shape (n,)
        Lower and upper limits of a step.
    """
    size = np.maximum(np.abs(values / units), 1.0)
    down = np.clip(_LEAST * starts / units - 1.0, -_LOSS, 0.0)
    return np.where(positive, down, -size), np.where(
        positive, np.maximum(_RETURN * starts / units, 1.0), size
    )


def step_within(hessian: FloatArray, gradient: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Minimise the quadratic model of the cost within a box: d = argmin d^T H d / 2 - g^T d.

    Parameters
    ----------
    hessian : ndarray, shape (n, n)
        H; directions of negative curvature count with its size.
    gradient : ndarray, shape (n,)
        J^T r.
    low, high : ndarray, shape (n,)
        The box.

    Returns
    -------
    ndarray, shape (n,)
    """
    scale = 1 / np.sqrt(np.maximum(np.abs(np.diag(hessian)), _TINY))
    level, direction = np.linalg.eigh(hessian * np.outer(scale, scale))
    level = np.maximum(np.abs(level), _FLAT * np.abs(level).max())
    target = direction.T @ (gradient * scale)
    free = np.asarray(scale * (direction @ (target / level)))
    if np.all((free >= low) & (free <= high)):
        return free
    root = np.sqrt(level)
    found = lsq_linear(
        root[:, None] * direction.T, target / root, bounds=(low / scale, high / scale), method="bvls"
    )
    return np.clip(found.x * scale, low, high)
