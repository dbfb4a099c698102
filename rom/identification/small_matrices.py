"""Products and inverses of many small matrices at once: one a line, as many rows as bodies move.

BLAS and LAPACK called line by line take several times as long for one or two bodies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rom.criteria.number import Numerical

ComplexArray = npt.NDArray[np.complexfloating[Any, Any]]
_FEW: Numerical[int] = 8  # columns: for more a call a line is faster
_QUIETLY = np.errstate(over="ignore", invalid="ignore")  # a step of a fit too far has no number for a cost


def product(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> ComplexArray:
    """Products ``a_l b_l`` of complex matrices, (lines, n, m) and (lines, m, k)."""
    if b.shape[2] > _FEW or a.shape[2] > 2:
        return np.asarray(a @ b)
    out = a[:, :, 0, None] * b[:, None, 0]
    for inner in range(1, a.shape[2]):
        out += a[:, :, inner, None] * b[:, None, inner]
    return np.asarray(out)


def by_one(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> ComplexArray:
    """Products ``a_l b`` with one matrix, (lines, n, m) and (m, k)."""
    return np.asarray((a.reshape(-1, a.shape[2]) @ b).reshape(*a.shape[:2], b.shape[1]))


@_QUIETLY
def inverse(a: npt.NDArray[Any]) -> ComplexArray:
    """Inverses, (lines, n, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        If one is singular.
    """
    if a.shape[1] != 2:
        return np.asarray(np.linalg.inv(a))
    determinant = a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0]
    if (determinant == 0).any():
        raise np.linalg.LinAlgError("Singular matrix")
    out = np.empty_like(a)
    out[:, 0, 0], out[:, 1, 1] = a[:, 1, 1] / determinant, a[:, 0, 0] / determinant
    out[:, 0, 1], out[:, 1, 0] = -a[:, 0, 1] / determinant, -a[:, 1, 0] / determinant
    return out


def positive_part(power: npt.NDArray[Any]) -> ComplexArray:
    """Nearest Hermitian matrices without negative power: negative eigenvalues become zero, (lines, n, n)."""
    power = (power + power.conj().swapaxes(1, 2)) / 2
    if power.shape[1] != 2:
        level, direction = np.linalg.eigh(power)
        return np.asarray((direction * np.maximum(level, 0.0)[:, None, :]) @ direction.conj().swapaxes(1, 2))
    first, second = power[:, 0, 0].real, power[:, 1, 1].real
    across = power[:, 1, 0]
    mean, half = (first + second) / 2, np.hypot((first - second) / 2, np.abs(across))
    # of one eigenvalue below zero and one above: the projector on the latter times it
    share = np.divide(mean + half, 2 * half, out=np.zeros_like(half), where=half > 0)
    out = share[:, None, None] * power
    lower = share * (half - mean)
    out[:, 0, 0] += lower
    out[:, 1, 1] += lower
    out[mean >= half] = power[mean >= half]
    out[mean <= -half] = 0.0
    return np.asarray(out)


def root_of(power: npt.NDArray[Any]) -> ComplexArray:
    """Roots R of Hermitian matrices without negative power, ``R R^H``, (lines, n, n).

    From eigenvectors: a determinant would lose a small power beside a large one.
    """
    level, direction = np.linalg.eigh(power)
    return np.asarray(direction * np.sqrt(np.maximum(level, 0.0))[:, None, :])
