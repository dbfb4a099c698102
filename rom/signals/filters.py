"""From raw channels to motion and tension: filters, integration, decimation, impact, split of tension."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import integrate, ndimage, signal

from rom.criteria.number import Numerical
from rom.model.laws import Z95
from rom.signals.frequency_band import Band, in_band

FloatArray = npt.NDArray[np.float64]

INTEGRATIONS = {"acceleration": 2, "velocity": 1, "displacement": 0}
# a hammer's pulse is over within this time, or so many samples; anything longer is a driven force
_LONGEST_PULSE_S: Numerical[float] = 0.02
_LONGEST_PULSE: Numerical[int] = 32
_MANY_ROWS: Numerical[int] = 2  # one is filtered by SciPy in less time
_SHARPENING: Numerical[tuple[float, ...]] = (-1 / 12, 1 / 90, -1 / 560, 1 / 3150)  # of even differences
_LEAST_CUTOFF: Numerical[float] = 1e-8  # of the rate: rounding leaves nothing of a slower one
# a pulse this long must survive the removal of single-sample spikes
_SHORTEST_PULSE_S: Numerical[float] = 5e-4


@dataclass(frozen=True)
class FilterChain:
    """Zero-phase Butterworth high-pass, repeated after every integration.

    ``y = HP(x)`` and, for each integration, ``y <- HP(cumulative trapezoid of y)``, where HP runs the filter
    forwards and backwards. A quantity integrated n times has therefore passed the filter n + 1 times; a
    simulation is compared with a measurement only after the very same call.

    Parameters
    ----------
    cutoff_hz
        Cutoff of the single pass (-3 dB; -6 dB after both directions) [Hz]: 2 uncoupled, 5 coupled.
    order
        Order of the Butterworth filter.
    band_hz
        Band [Hz] in which displacements are compared, if one is declared.

    Raises
    ------
    ValueError
        If the cutoff is not positive or the order is below one; on use, if the samples are not finite, or the
        cutoff does not lie below half the sampling rate.

    Notes
    -----
    He et al. (2025), Section 2.3. The record is extended at both ends by even reflection over two cutoff
    periods. The few samples of odd reflection that filtfilt takes by default let the first sample, noise and
    ring included, act as an offset, whose transient grows with every integration: after two of them the
    errors of the first 0.3 s are about 1.7 (a ring) to 6 times (noise) larger. Elsewhere nothing differs.
    """

    cutoff_hz: float
    order: int = 3
    band_hz: Band | None = None

    def __post_init__(self) -> None:
        """Check what a filter can be made of."""
        if not self.cutoff_hz > 0 or not np.isfinite(self.cutoff_hz):
            raise ValueError(
                f"The filter's cutoff must be a positive frequency, instead got {self.cutoff_hz} Hz."
            )
        if self.order < 1:
            raise ValueError(f"The filter's order must be at least 1, instead got {self.order}.")

    def integrated(self, samples: FloatArray, rate_hz: float, times: int) -> FloatArray:
        """Filter, then integrate and filter again, ``times`` times; shape (..., samples) is kept.

        One call serves any motion channel: acceleration to displacement is 2, velocity to displacement 1,
        displacement to displacement 0. Many rows go side by side, to the same numbers in less time.

        Parameters
        ----------
        samples : ndarray, shape (..., samples)
            Samples.
        rate_hz : float
            Sampling rate [Hz].
        times : int
            Number of integrations.

        Returns
        -------
        ndarray
            Shape (..., samples).
        """
        if np.ndim(samples) == 2 and len(samples) >= _MANY_ROWS:
            return self._integrated_rows(finite_signal(samples), rate_hz, times)
        result = self.highpass(samples, rate_hz)
        for _ in range(times):
            result = self.once_more(result, rate_hz)
        return result

    def once_more(self, filtered: FloatArray, rate_hz: float) -> FloatArray:
        """Integrate and filter again what was filtered; shape (..., samples) is kept."""
        integral = integrate.cumulative_trapezoid(filtered, dx=1 / rate_hz, axis=-1, initial=0)
        return self.highpass(integral, rate_hz)

    def _integrated_rows(self, rows: FloatArray, rate_hz: float, times: int) -> FloatArray:
        from rom.kernels.filters import filter_and_integrate

        sections = _highpass_sections(self.order, self.cutoff_hz, rate_hz)
        start, padding = signal.sosfilt_zi(sections), self._padding(rows.shape[1], rate_hz)
        filtered = filter_and_integrate(
            np.ascontiguousarray(rows), sections, start, padding, 1 / rate_hz, times
        )
        return np.asarray(filtered)

    def _padding(self, samples: int, rate_hz: float) -> int:
        return min(samples - 1, int(2 * rate_hz / self.cutoff_hz))

    def highpass(self, samples: FloatArray, rate_hz: float, passes: int = 1) -> FloatArray:
        """Zero-phase high-pass of samples (..., samples), ``passes`` times over.

        Equation errors need every term, the force included, to have passed as often as the displacement: 3.

        Parameters
        ----------
        samples : ndarray, shape (..., samples)
            Samples.
        rate_hz : float
            Sampling rate [Hz].
        passes : int
            Number of passes.

        Returns
        -------
        ndarray
            Shape (..., samples).
        """
        result = finite_signal(samples)
        sections = _highpass_sections(self.order, self.cutoff_hz, rate_hz)
        padding = self._padding(result.shape[-1], rate_hz)
        for _ in range(passes):
            result = signal.sosfiltfilt(sections, result, axis=-1, padtype="even", padlen=padding)
        return result

    def velocity(self, acceleration: FloatArray, rate_hz: float) -> FloatArray:
        """Velocity [m/s] of an acceleration [m/s2]: HP, integrate, HP."""
        return self.integrated(acceleration, rate_hz, 1)

    def displacement(self, acceleration: FloatArray, rate_hz: float) -> FloatArray:
        """Displacement [m] of an acceleration [m/s2]: HP, integrate, HP, integrate, HP."""
        return self.integrated(acceleration, rate_hz, 2)


def compile_filters() -> None:
    """Compile what filters many rows, or find it on disk: processes that start together would each do so."""
    FilterChain(1.0).integrated(np.zeros((_MANY_ROWS, 16)), 100.0, 1)


def displacement(kind: str, samples: FloatArray, rate_hz: float, chain: FilterChain) -> FloatArray:
    """Return displacement [m] from samples of a motion quantity, in the chain's band if it has one.

    Measured displacement passes no high-pass.

    Parameters
    ----------
    kind : str
        ``"acceleration"``, ``"velocity"`` or ``"displacement"``.
    samples : ndarray, shape (..., samples)
        In its SI unit.
    rate_hz : float
        Sampling rate.
    chain : FilterChain
        Of the record.

    Returns
    -------
    ndarray, shape (..., samples)
        Displacement [m].
    """
    times = INTEGRATIONS[kind]
    found = chain.integrated(samples, rate_hz, times) if times else samples
    return in_band(found, rate_hz, chain.band_hz)


@lru_cache(maxsize=64)
def _highpass_sections(order: int, cutoff_hz: float, rate_hz: float) -> FloatArray:
    if not _LEAST_CUTOFF * rate_hz < cutoff_hz < rate_hz / 2:
        raise ValueError(
            f"The filter's cutoff must lie between 0 and half the sampling rate ({rate_hz / 2} Hz), "
            f"and above {_LEAST_CUTOFF:g} of that rate, instead got {cutoff_hz} Hz."
        )
    return np.asarray(signal.butter(order, cutoff_hz, "highpass", fs=rate_hz, output="sos"), dtype=np.float64)


def finite_signal(samples: FloatArray) -> FloatArray:
    """Samples as numbers; `ValueError` for fewer than two or for what is not finite."""
    array = np.asarray(samples, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] < 2:
        raise ValueError(f"A signal must have at least 2 samples, instead got shape {array.shape}.")
    if not np.isfinite(array).all():
        raise ValueError(
            f"A signal must be finite, instead {np.count_nonzero(~np.isfinite(array))} samples are not."
        )
    return array


def longest_pulse(rate_hz: float) -> int:
    """Return how many samples a hammer's pulse lasts at most."""
    return max(round(_LONGEST_PULSE_S * rate_hz), _LONGEST_PULSE)


def find_impact(force: FloatArray, rate_hz: float) -> float | None:
    """Time [s] at which the hammer first touches, or None where there is no hit.

    A hit is the first stretch of force, of either sign, that rises above eight times the noise (from what
    95 % of the samples stay within) and three tenths of the record's peak, and ends within 20 ms or 32
    samples. Its onset is the last sample before it within three times the noise (from the median absolute
    deviation, if more) or one hundredth of its peak. Spikes of one sample do not count.
    """
    deviation = np.abs(finite_signal(force) - np.median(force))
    if rate_hz * _SHORTEST_PULSE_S >= 3:
        deviation = ndimage.median_filter(deviation, size=3, mode="nearest")
    if not deviation.any():
        return None
    # A quantised quiet channel has a median deviation of zero, yet steps now and then; of a hum the median is
    # large, yet nothing exceeds it much.
    rarely = float(np.quantile(deviation, 0.95)) / Z95
    noise = max(rarely, 1.4826 * float(np.median(deviation)))
    above = deviation > max(8 * rarely, 0.3 * float(deviation.max()))
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start <= longest_pulse(rate_hz):
            quiet = np.flatnonzero(deviation[:start] <= max(3 * noise, 0.01 * deviation[start:stop].max()))
            return float((quiet[-1] if quiet.size else 0) / rate_hz)
    return None


def split_tension(
    tension: FloatArray, rate_hz: float, window_s: float, impact_s: float | None = None, periods: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Split a tension (samples,) [N] into its non-oscillatory and its oscillatory part, whose sum it is.

    The non-oscillatory part is a moving mean over ``window_s``, which must hold a whole number ``periods`` of
    the first mode, so that its oscillation cancels. The record before and after ``impact_s`` is treated
    apart: at a border the window is moved inwards, never shortened. After the impact, however, the step of a
    loosening joint takes 0.5 to 20 ms: there the oscillation is estimated by a linear regression (two
    harmonics, amplitudes linear in time, beside a straight line) over four periods that begin one period
    after the impact, taken out, and the window grows from a single sample with the time since the impact.

    Both parts are linear in the tension: a simulated tension goes through the same call before a difference.
    The bias left on known steps is printed by ``python -m benchmarks.tension_split``.

    Parameters
    ----------
    tension : ndarray, shape (samples,)
        Tension [N].
    rate_hz : float
        Sampling rate [Hz].
    window_s : float
        Length of the moving mean [s].
    impact_s : float
        Time of the impact [s] from the first sample.
    periods : int
        Whole periods of the first mode that the window holds.

    Returns
    -------
    tuple
        Non-oscillatory and oscillatory part [N], shape (samples,) each.

    Raises
    ------
    ValueError
        If the window holds fewer than three samples or the impact lies outside the record.
    """
    samples = finite_signal(tension)
    half = round(window_s * rate_hz / 2)
    impact = 0 if impact_s is None else round(impact_s * rate_hz)
    if half < 1 or periods < 1:
        raise ValueError(
            f"The window must hold at least three samples and one period, instead got {window_s} s at "
            f"{rate_hz} Hz and {periods} periods."
        )
    if not 0 <= impact < samples.size:
        raise ValueError(
            f"The impact must lie within the {samples.size / rate_hz} s record, instead got {impact_s} s."
        )
    before, after = samples[:impact], samples[impact:]
    smooth = np.concatenate((_moving_mean(before, half), _moving_mean(after, half)))
    period = rate_hz * window_s / periods
    if impact_s is not None and after.size > 4 * period:  # fewer cannot tell an oscillation from a transient
        steady = after - _oscillation(after, period)
        near = np.arange(min(2 * half, after.size - half))
        smooth[impact + near] = _window_mean(steady, near - near // 2, near + near // 2 + 1)
    return smooth, samples - smooth


def _window_mean(samples: FloatArray, first: npt.NDArray[np.intp], last: npt.NDArray[np.intp]) -> FloatArray:
    """Mean of samples[first:last] for each pair; summed about the overall mean to keep the digits."""
    centre = samples.mean()
    total = np.concatenate(([0.0], np.cumsum(samples - centre)))
    return np.asarray((total[last] - total[first]) / (last - first) + centre)


def _moving_mean(samples: FloatArray, half: int) -> FloatArray:
    if samples.size == 0:
        return samples
    width = min(2 * half + 1, samples.size)
    first = np.clip(np.arange(samples.size) - half, 0, samples.size - width)
    return _window_mean(samples, first, first + width)


def _oscillation(samples: FloatArray, period: float) -> FloatArray:
    """Two harmonics of ``period`` [samples], fitted from one to five periods after the first sample."""
    time = np.arange(samples.size) / period
    waves = [wave(2 * np.pi * n * time) for n in (1, 2) for wave in (np.cos, np.sin)]
    terms = np.stack([*waves, *(time * wave for wave in waves), np.ones_like(time), time], axis=1)
    fitted = slice(round(period), round(5 * period))
    weights = np.linalg.lstsq(terms[fitted], samples[fitted], rcond=None)[0]
    return np.asarray(terms[:, :-2] @ weights[:-2])


def for_straight_lines(samples: FloatArray, terms: int = 2) -> FloatArray:
    """Samples whose straight connection has the spectrum of a signal: f - 2nd / 12 + 4th difference / 90 ...

    Straight lines between samples h apart weaken a component of angular frequency w by sinc^2(w h / 2). With
    s = 4 sin^2(w h / 2), which minus second differences multiply by,

        sinc^-2 = 4 asin^2(s^1/2 / 2) / s = 1 + s / 12 + s^2 / 90 + s^3 / 560 + s^4 / 3150 + ...

    Without the first, gamma of a 0.65 ms pulse at 19.2 kHz comes out 0.5 % too large; without the second, a
    force of 12 samples a period is 0.1 % too small, and without the other two one of 6 samples 0.2 %.

    Parameters
    ----------
    samples : ndarray, shape (samples,)
        The signal.
    terms : int
        Of the series, four at most: two for a hammer's pulse, whose ends are no smooth signal.
    """
    found = difference = samples
    for weight in _SHARPENING[:terms]:
        difference = np.diff(np.pad(difference, 1, mode="edge"), 2)
        found = found + weight * difference
    return np.asarray(found)


def ac_coupled(samples: FloatArray, rate_hz: float, corner: float) -> FloatArray:
    """Return what a sensor with AC coupling ``s / (s + corner)`` shows of samples; ``corner`` in rad/s.

    Parameters
    ----------
    samples : ndarray, shape (..., samples)
        Samples.
    rate_hz : float
        Sampling rate [Hz].
    corner : float
        Corner [rad/s].

    Returns
    -------
    ndarray
        Shape of the samples.
    """
    from rom.kernels.filters import first_order

    whole, step = 2 * rate_hz + corner, 2 * rate_hz  # bilinear: s = 2 rate (z - 1) / (z + 1)
    rows = np.array(samples, dtype=np.float64, order="C", ndmin=1)
    first_order(rows.reshape(-1, rows.shape[-1]), step / whole, -step / whole, (corner - step) / whole)
    return rows
