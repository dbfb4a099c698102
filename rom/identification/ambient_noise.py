"""Noise of channels as their residuals have it: ambient forces through the structure, and sensors.

S(f) = G Q(f) G^H + R
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rom.criteria.number import Numerical
from rom.identification.small_matrices import inverse, positive_part, product
from rom.identification.spectral_model import ComplexArray, FloatArray, Linearised

_SMOOTHING_HZ: Numerical[float] = 2.0
_SMOOTHING_SHARE: Numerical[float] = 0.125  # of the lines, at most: those of a slow structure are dense
_REWEIGHTED: Numerical[int] = 5
_LEAST_LEFT: Numerical[float] = 0.05  # of the noise: less tells none


def whitener(gain: ComplexArray, root: ComplexArray, sensor: FloatArray) -> ComplexArray:
    """Return S^-1/2 at every line with S = G Q G^H + R, (lines, channels, channels), from a root of Q.

    Parameters
    ----------
    gain : ndarray, shape (lines, channels, forces)
        Transfer from ambient forces to channels.
    root : ndarray, shape (lines, forces, forces)
        Of the cross-spectrum of the ambient forces, from `rom.identification.small_matrices.root_of`.
    sensor : ndarray, shape (channels,)
        Power of each sensor's noise.

    Returns
    -------
    ndarray
        Shape (lines, channels, channels).

    Raises
    ------
    numpy.linalg.LinAlgError
        If some S is not positive definite.
    """
    from rom.kernels.spectral_outputs import whiteners

    if len(sensor) > 2:
        answer = product(gain, root)
        own = np.broadcast_to(np.diag(np.sqrt(sensor)), (len(gain), len(sensor), len(sensor)))
        # of a root of S: S itself would lose the sensors' noise to rounding where ambient forces are strong
        whole = np.concatenate([answer, own], axis=2).conj().swapaxes(1, 2)
        upper = np.linalg.qr(whole).R
        return np.asarray(np.linalg.inv(upper.conj().swapaxes(1, 2)))
    out = np.empty((*gain.shape[:2], len(sensor)), dtype=np.complex128)
    gain, root = (np.ascontiguousarray(one, dtype=np.complex128) for one in (gain, root))
    if not whiteners(gain, root, np.ascontiguousarray(sensor, dtype=np.float64), out):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return out


def sensor_noise(parts: Sequence[Linearised]) -> FloatArray:
    """Return the power of the sensors' noise at a line, (channels,): the median over lines and records."""
    power = np.median(np.abs(np.stack([part.unweighted for part in parts])) ** 2, axis=(0, 1)) / np.log(2)
    return np.asarray(np.maximum(power, 1e-12 * power.max() + np.finfo(float).tiny))


def share_left(part: Linearised, covariance: FloatArray | None = None) -> FloatArray:
    """Return the share of the noise that a fit leaves in the residual at every line, (lines,).

    The rest is taken up by the record's end states and, with their ``covariance``, the coefficients: one less
    the leverage. A mode that rings longer than the record is seen at a single line, which both follow.
    """
    lines, channels = part.unweighted.shape
    taken = np.einsum("ij,ij->i", part.ends @ part.inverse, part.ends)
    if covariance is not None:
        taken = taken + np.einsum("ij,ij->i", part.jacobian @ covariance, part.jacobian)
    rows = taken[: 2 * lines * channels].reshape(2, lines, channels)
    return np.asarray(np.clip(1 - rows.mean(axis=(0, 2)), 0.0, 1.0))


def ambient_forces(
    frequency: FloatArray, parts: Sequence[Linearised], sensor: FloatArray, left: Sequence[FloatArray]
) -> ComplexArray:
    """Return the cross-spectrum Q(f) of the ambient forces: residuals brought to the joint of force, less
    their noise.

    The running mean weights lines by the inverse variance that a force has there, so resonances speak. The
    search for the level starts from above, with all lines alike: weights of a level that is too low rest on
    the one line at which a mode resonates, and leave it there.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Frequencies [Hz].
    parts : sequence of Linearised
        Residuals and gains of the records.
    sensor : ndarray, shape (channels,)
        Power of each sensor's noise.
    left : sequence of ndarray, shape (lines,)
        Share of the noise that is left in the residuals of each record, from `share_left`.

    Returns
    -------
    ndarray
        Shape (lines, forces, forces).
    """
    inverses = [_to_forces(part.gain) for part in parts]
    noises = [product(back * sensor, back.conj().swapaxes(1, 2)) for back in inverses]
    forces = [product(b, p.unweighted[:, :, None])[:, :, 0] for b, p in zip(inverses, parts, strict=True)]
    wide = _SMOOTHING_HZ / (frequency[1] - frequency[0])
    half = max(2, round(min(wide, _SMOOTHING_SHARE * len(frequency))))
    squares = [force[:, :, None] * force.conj()[:, None, :] for force in forces]
    count = _running_sum(np.full(len(frequency), float(len(parts))), half).reshape(-1, 1, 1)
    ambient = _running_sum(np.sum(squares, axis=0), half) / count
    for _ in range(_REWEIGHTED):
        total, weights = np.zeros_like(ambient), np.zeros(len(frequency))
        for square, noise, share in zip(squares, noises, left, strict=True):
            weight = (share > _LEAST_LEFT) / np.einsum("nii->n", noise + ambient).real ** 2
            total += weight[:, None, None] * (square - share[:, None, None] * noise)
            weights += weight * share
        near = _running_sum(weights, half).reshape(-1, 1, 1)
        mean = np.divide(_running_sum(total, half), near, out=np.zeros_like(total), where=near > 0)
        ambient = positive_part(mean)
    return np.asarray(ambient)


def _to_forces(gain: ComplexArray) -> ComplexArray:
    """Return what brings channels to forces: to the least ones where a joint is all but rigid."""
    try:
        return inverse(gain)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(gain))


def _running_sum(values: npt.NDArray[Any], half: int) -> npt.NDArray[Any]:
    """Return sums over windows of 2 half + 1 lines, shortened at the ends.

    Window by window: weights span so many decades that differences of a running total would lose the small.
    """
    padded = np.pad(values, [(half, half), *[(0, 0)] * (values.ndim - 1)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return np.asarray(windows.sum(axis=-1))
