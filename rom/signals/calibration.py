"""From the strain reading of an instrumented bolt to its tension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import ndimage, optimize

from rom.criteria.identification import RULES
from rom.criteria.number import Numerical

FloatArray = npt.NDArray[np.float64]

# of force, over the loading branch: a plateau of slipping jaws then counts as one bin
_BINS: Numerical[int] = 200
_TOP: Numerical[float] = 0.9  # of the peak force: the flanks above it align the clocks
# of the test's duration: how far the alignment may move from the highest samples
_REACH: Numerical[float] = 0.02
_REAL: Numerical[float] = 1e-6  # imaginary share of a root that is a real one


@dataclass(frozen=True)
class Calibration:
    """T = c1 e + c2 e^2 + c3 e^3 + ...

    Attributes
    ----------
    coefficients
        (c1, c2, ...) [N per power of the strain reading].
    covariance
        Of the coefficients, or None where it is not known.
    strain_range
        Lowest and highest strain that were calibrated, or None where they are not known.

    Raises
    ------
    ValueError
        If there is no coefficient or one is not finite, or the covariance does not fit them.

    Notes
    -----
    He et al. (2025), Section 2.4, Eq. 1.
    """

    coefficients: tuple[float, ...]
    covariance: FloatArray | None = field(default=None, compare=False)
    strain_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check the coefficients and their covariance."""
        count = len(self.coefficients)
        if count == 0 or not np.isfinite(self.coefficients).all():
            raise ValueError(
                f"A calibration needs one or more finite coefficients, instead got {self.coefficients}."
            )
        if self.covariance is not None and np.shape(self.covariance) != (count, count):
            raise ValueError(
                f"The covariance of {count} coefficients must have shape {(count, count)}, instead got "
                f"{np.shape(self.covariance)}."
            )

    def tension(self, strain: npt.ArrayLike) -> FloatArray:
        """Tension [N] at a strain reading, shape kept."""
        return np.asarray(
            np.polynomial.polynomial.polyval(np.asarray(strain, dtype=np.float64), self._series)
        )

    def sensitivity(self, strain: npt.ArrayLike) -> FloatArray:
        """dT/de [N per unit of strain reading]."""
        slopes = np.polynomial.polynomial.polyder(self._series)
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(strain, dtype=np.float64), slopes))

    @property
    def rising_range(self) -> tuple[float, float]:
        """Strain readings about zero between which the tension rises; beyond, two have one tension."""
        slopes = np.trim_zeros(np.polynomial.polynomial.polyder(self._series), "b")
        roots = np.polynomial.polynomial.polyroots(slopes)
        real = roots.real[np.abs(roots.imag) < _REAL * np.abs(roots)]
        return float(max(real[real < 0], default=-np.inf)), float(min(real[real > 0], default=np.inf))

    def tension_standard_error(self, strain: npt.ArrayLike) -> FloatArray:
        """Standard error [N] of the tension due to the coefficients: sqrt(g' Cov g), g = (e, e^2, ...).

        Raises
        ------
        ValueError
            If the covariance is not known.
        """
        if self.covariance is None:
            raise ValueError("This calibration has no covariance: fit it from a tensile test to get one.")
        powers = _powers(np.asarray(strain, dtype=np.float64), len(self.coefficients))
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", powers, self.covariance, powers)))

    def extrapolated(self, strain: npt.ArrayLike) -> bool:
        """Whether any strain lies outside the calibrated range by more than one hundredth of it."""
        return self.warning(strain) is not None

    def warning(self, strain: npt.ArrayLike) -> str | None:
        """Text for a result whose strain leaves the calibrated range; None where it stays inside."""
        if self.strain_range is None:
            return None
        (low, high), reading = self.strain_range, np.asarray(strain, dtype=np.float64)
        slack = RULES.calibration_slack * (high - low)
        outside = (reading < low - slack) | (reading > high + slack)
        if not outside.any():
            return None
        return (
            f"Strain readings from {reading.min():.4g} to {reading.max():.4g} leave the calibrated range "
            f"{low:.4g} to {high:.4g} in {outside.mean():.1%} of the samples: the tension there "
            "is an extrapolation."
        )

    @property
    def _series(self) -> tuple[float, ...]:
        return (0.0, *self.coefficients)


def fit_calibration(
    force: npt.ArrayLike, force_rate_hz: float, strain: npt.ArrayLike, strain_rate_hz: float, degree: int = 3
) -> Calibration:
    """Polynomial through zero of force on strain, from a tensile test of several load cycles.

    The two records have clocks of their own. Cycles are found by their peaks and the first, in which jaws
    settle, is dropped. The clocks are aligned at the peaks of the others: first by the highest samples,
    then by the shift for which force is closest to one smooth function of strain on both flanks of the
    peaks. Strain is averaged over a force sample and interpolated to the force's times; the
    loading branches are averaged in bins of force, so that a plateau, where slipping jaws hold both signals
    still, adds no weight.

    Residuals of neighbouring bins are correlated (misfit, drift). The covariance is that of least squares
    times (1 + r) / (1 - r), r being the lag-one correlation of the residuals: the variance of a mean of
    first-order autoregressive noise. What the alignment leaves of the clocks' shift is common to all bins and
    is added: the change of the coefficients for one standard error of the shift.

    Parameters
    ----------
    force, strain
        [N] and the gauge's reading, 1-D.
    force_rate_hz, strain_rate_hz
        Their sampling rates [Hz].
    degree
        Of the polynomial.

    Raises
    ------
    ValueError
        If a record is not finite and one-dimensional, there are fewer than two cycles, or the records do
        not show equally many.

    Notes
    -----
    He et al. (2025), Section 2.4.
    """
    load, reading = _record("force", force), _record("strain", strain)
    smooth = ndimage.uniform_filter1d(reading, max(1, round(strain_rate_hz / force_rate_hz)), mode="nearest")
    peaks, strain_peaks = _cycle_peaks(load), _cycle_peaks(smooth)
    if len(peaks) < 2 or len(peaks) != len(strain_peaks):
        raise ValueError(
            f"A tensile test needs the same two or more load cycles in both records, instead found "
            f"{len(peaks)} in the force and {len(strain_peaks)} in the strain."
        )
    starts = [low + int(np.argmin(load[low:high])) for low, high in pairwise(peaks)]
    time, strain_time = np.arange(load.size) / force_rate_hz, np.arange(smooth.size) / strain_rate_hz
    shift = float(np.median(strain_time[strain_peaks[1:]] - time[peaks[1:]]))
    top = starts[0] + np.flatnonzero(load[starts[0] :] > _TOP * load[peaks[1:]].min())
    shift, shift_error = _align(load[top], time[top], smooth, strain_time, shift)
    branches = [np.arange(start, peak + 1) for start, peak in zip(starts, peaks[1:], strict=True)]

    def fitted(lag: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        aligned = np.interp(time + lag, strain_time, smooth, left=np.nan, right=np.nan)
        return _fit(*_mean_branch([(load[part], aligned[part]) for part in branches]), degree)

    coefficients, covariance, strains = fitted(shift)
    moved = fitted(shift + shift_error)[0] - coefficients
    return Calibration(
        tuple(float(value) for value in coefficients),
        covariance + np.outer(moved, moved),
        (min(0.0, float(strains.min())), float(strains.max())),
    )


def _record(name: str, samples: npt.ArrayLike) -> FloatArray:
    array = np.asarray(samples, dtype=np.float64)
    if array.ndim != 1 or array.size < 10 or not np.isfinite(array).all():
        raise ValueError(
            f"The {name} record must be one row of ten or more finite samples, instead got {array.shape}."
        )
    return array


def _cycle_peaks(samples: FloatArray) -> npt.NDArray[np.intp]:
    """Index of the highest sample of each cycle: a stay in the upper third between two in the lower."""
    level = (samples - samples.min()) / max(float(np.ptp(samples)), np.finfo(np.float64).tiny)
    decided = np.flatnonzero((level < 1 / 3) | (level > 2 / 3))
    upper = np.concatenate(([False], level[decided] > 2 / 3, [False]))
    edges = np.flatnonzero(np.diff(upper))
    stays = zip(decided[edges[::2]], decided[edges[1::2] - 1], strict=True)
    return np.array(
        [first + int(np.argmax(samples[first : last + 1])) for first, last in stays], dtype=np.intp
    )


def _align(
    load: FloatArray, time: FloatArray, strain: FloatArray, strain_time: FloatArray, coarse: float
) -> tuple[float, float]:
    """Shift [s] of the strain's clock for which the load is closest to one parabola of strain; its error."""

    def parabola(shift: float) -> FloatArray:
        reading = np.interp(time + shift, strain_time, strain)
        return np.asarray(np.polynomial.Polynomial.fit(reading, load, 2)(reading))

    def misfit(shift: float) -> float:
        return float(np.sum((load - parabola(shift)) ** 2))

    reach = _REACH * (time[-1] - time[0])
    found = optimize.minimize_scalar(misfit, bounds=(coarse - reach, coarse + reach), method="bounded")
    shift, step = float(found.x), float(np.median(np.diff(time)))
    slope = (parabola(shift + step) - parabola(shift - step)) / (2 * step)
    return shift, float(np.sqrt(misfit(shift) / load.size / np.sum(slope**2)))


def _mean_branch(branches: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Mean load and strain in bins of load: over the samples of a branch, then over the branches."""
    low, high = max(load.min() for load, _ in branches), min(load.max() for load, _ in branches)
    edges = np.linspace(low, high, _BINS + 1)
    means = np.full((len(branches), 2, _BINS), np.nan)
    for mean, (load, strain) in zip(means, branches, strict=True):
        bins = np.digitize(load, edges) - 1
        used = (bins >= 0) & (bins < _BINS) & np.isfinite(strain)
        count = np.bincount(bins[used], minlength=_BINS)
        for row, values in zip(mean, (load, strain), strict=True):
            np.divide(np.bincount(bins[used], values[used], minlength=_BINS), count, out=row, where=count > 0)
    complete = np.isfinite(means).all(axis=(0, 1))
    load, strain = means[:, :, complete].mean(axis=0)
    return load, strain


def _fit(load: FloatArray, strain: FloatArray, degree: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients, covariance and the strains they rest on."""
    if strain.size < 3 * degree:
        raise ValueError(
            f"Only {strain.size} bins of force are loaded in every cycle: a degree of {degree} needs more."
        )
    powers = _powers(strain, degree)
    size = np.linalg.norm(powers, axis=0)
    coefficients = np.linalg.lstsq(powers / size, load, rcond=None)[0] / size
    residual = load - powers @ coefficients
    correlation = float(np.clip(residual[1:] @ residual[:-1] / (residual @ residual), 0.0, 0.99))
    variance = residual @ residual / (strain.size - degree) * (1 + correlation) / (1 - correlation)
    normal = (powers / size).T @ (powers / size)
    covariance = variance * np.linalg.inv(normal) / np.outer(size, size)
    return np.asarray(coefficients), np.asarray(covariance), strain


def _powers(strain: FloatArray, degree: int) -> FloatArray:
    return np.asarray(strain[..., None] ** np.arange(1, degree + 1))
