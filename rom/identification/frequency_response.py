"""Frequency responses of impact tests, and poles and residues fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import optimize

from rom.criteria.number import Numerical
from rom.signals.filters import find_impact

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Motion = Literal["displacement", "velocity", "acceleration"]

_DERIVATIVES: dict[Motion, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}
_LEAD_S: Numerical[float] = 1e-3  # kept before the onset of the force
_PULSE_S: Numerical[float] = 0.01  # force after it is noise
_REWEIGHTINGS: Numerical[int] = 3


@dataclass(frozen=True)
class Estimate:
    """A value and its standard error, both in the same unit."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class FrequencyResponse:
    """H1 estimate of response over force; arrays of shape (lines,).

    Attributes
    ----------
    frequency
        [Hz].
    frf
        Complex, [unit of the response / N].
    coherence
        Between force and response; None for a single hit, whose coherence is one whatever the noise.
    weight
        Root of the force's summed power: makes white noise of the response white in the FRF.
    duration_s
        Time from the hit to the record's end.
    window_decay
        Decay rate [1/s] of the exponential window on force and response; a fit takes it out of its poles.
    force_error
        Relative standard error of the force spectrum from the noise under the pulse.
    motion
        What the response is.
    """

    frequency: FloatArray
    frf: ComplexArray
    coherence: FloatArray | None
    weight: FloatArray
    duration_s: float
    window_decay: float
    force_error: float
    motion: Motion


@dataclass(frozen=True)
class Mode:
    """One mode of a fitted frequency response, with standard errors.

    ``residue`` R is that of the receptance R / (s - pole) + conj(R) / (s - conj(pole)) [m/(N s)], whatever
    motion was measured.
    """

    natural_frequency: Estimate
    damping_ratio: Estimate
    residue: complex
    residue_standard_error: float

    @property
    def mass(self) -> Estimate:
        """1 / (2 omega_d |R|) [kg]: the modal mass where force and response share a place."""
        damped = 2 * np.pi * self.natural_frequency.value * np.sqrt(1 - self.damping_ratio.value**2)
        mass = 1 / (2 * damped * abs(self.residue))
        return Estimate(float(mass), float(mass * self.residue_standard_error / abs(self.residue)))


def frequency_response(
    force: FloatArray,
    response: FloatArray,
    rate_hz: float,
    motion: Motion = "acceleration",
    window_end: float = 1.0,
) -> FrequencyResponse:
    """H1 = sum(conj(F) Y) / sum(|F|^2) over one hit (samples,) or several (hits, samples).

    Every hit is cut from its onset to the record's end, so that a ring that has not died out changes the
    residues only, not the poles (:func:`fit_modes`). The force is set to zero 10 ms after its onset, where it
    is noise, and in the latter half of a record that is shorter. Give the raw response: filters of Section
    2.3 on the response alone bend the FRF.

    Parameters
    ----------
    force, response
        [N] and [m], [m/s] or [m/s2], of equal shape.
    rate_hz
        Sampling rate [Hz].
    motion
        What the response is.
    window_end
        Value at the end of an exponential window on force and response; 1 is no window. The decay it adds
        is kept and taken out of the poles again.

    Raises
    ------
    ValueError
        If the shapes differ, a record has no hit, or the window does not end within (0, 1].
    """
    force, response = np.atleast_2d(force), np.atleast_2d(response)
    if force.shape != response.shape:
        raise ValueError(
            f"Force and response must have one shape, instead got {force.shape} and {response.shape}."
        )
    if not 0 < window_end <= 1:
        raise ValueError(f"The exponential window must end within (0, 1], instead got {window_end}.")
    onsets = [find_impact(row, rate_hz) for row in force]
    if None in onsets:
        raise ValueError(f"Record {onsets.index(None) + 1} of {len(onsets)} has no hit in its force channel.")
    starts = [max(0, round((onset - _LEAD_S) * rate_hz)) for onset in onsets if onset is not None]
    size = force.shape[1] - max(starts)
    pulse = np.arange(size) < min((_LEAD_S + _PULSE_S) * rate_hz, size / 2)
    window = window_end ** (np.arange(size) / size)
    cut = [slice(start, start + size) for start in starts]
    inputs = np.stack([row[part] - np.median(row) for row, part in zip(force, cut, strict=True)])
    outputs = np.stack([row[part] - row.mean() for row, part in zip(response, cut, strict=True)])
    F, Y = np.fft.rfft(inputs * pulse * window), np.fft.rfft(outputs * window)
    cross, power = (F.conj() * Y).sum(axis=0), (np.abs(F) ** 2).sum(axis=0)
    coherence = np.abs(cross) ** 2 / (power * (np.abs(Y) ** 2).sum(axis=0)) if len(force) > 1 else None
    duration = size / rate_hz
    return FrequencyResponse(
        np.asarray(np.fft.rfftfreq(size, 1 / rate_hz), dtype=np.float64),
        cross / power,
        coherence,
        np.sqrt(power),
        duration,
        -float(np.log(window_end)) / duration,
        _force_error(inputs, pulse, power),
        motion,
    )


def _force_error(inputs: FloatArray, pulse: npt.NDArray[np.bool_], power: FloatArray) -> float:
    noise = np.std(inputs[:, ~pulse], axis=1) * np.sqrt(np.count_nonzero(pulse))
    return float(np.sqrt(np.sum(noise**2) / power[0])) if power[0] else 0.0


def fit_modes(
    response: FrequencyResponse, n_modes: int, band: tuple[float, float], residual_order: int = 1
) -> tuple[Mode, ...]:
    """Fit poles and residues within a band [Hz] by weighted non-linear least squares.

    ``H = sum_r R_r / (s - p_r) + conj(R_r) / (s - conj(p_r)) + out-of-band polynomial (complex, of degree
    residual_order)``. Starting poles are those of a rational fraction polynomial B / A with complex
    coefficients, solved linearly and reweighted by 1 / |A| (Sanathanan-Koerner). Residues and polynomial are
    eliminated linearly (variable projection), so only the poles are searched.

    AC coupling of a sensor and modes outside the band vary slowly within it: the complex residue and the
    polynomial take them up, and the pole stays. A ring cut off by the record's end after time D scales a
    residue by 1 - exp(p D), which is divided out.

    The error of the response has variance a + b |H F|^2: white noise of the sensor, and ambient vibration
    that passes the structure itself. b / a is the most likely one given the residuals, and the fit is
    weighted accordingly; without it the standard errors are two to six times too small on a trembling floor.
    Under an exponential window the noise of neighbouring lines is correlated and the variances are raised by
    samples / sum(window^2).

    Parameters
    ----------
    response : FrequencyResponse
        The measured frequency response.
    n_modes : int
        Number of modes in the band.
    band : tuple of float
        From and to [Hz].
    residual_order : int
        Degree of the polynomial.

    Returns
    -------
    tuple
        One for each mode.

    Raises
    ------
    ValueError
        If the band holds too few lines for the unknowns.
    """
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1])
    count = 4 * n_modes + 2 * (residual_order + 1)
    if 2 * np.count_nonzero(inside) <= count:
        raise ValueError(
            f"A fit of {n_modes} modes needs more than {count / 2:.0f} lines, but {band[0]} to "
            f"{band[1]} Hz holds {np.count_nonzero(inside)} of {1 / response.duration_s:.3g} Hz: widen it."
        )
    fit = _PoleFit(response, inside, residual_order)
    unknowns = fit.solved(fit.starting_poles(n_modes))
    for _ in range(_REWEIGHTINGS):
        fit.reweight(unknowns)
        unknowns = fit.solved(unknowns)
    return fit.modes(unknowns)


class _PoleFit:
    """The least-squares problem of :func:`fit_modes`; unknowns are (frequency, decay) [Hz] pairs."""

    def __init__(
        self, response: FrequencyResponse, inside: npt.NDArray[np.bool_], residual_order: int
    ) -> None:
        self.response = response
        frequency = response.frequency[inside]
        self.s = 2j * np.pi * frequency
        self.centre, self.half = (frequency[0] + frequency[-1]) / 2, (frequency[-1] - frequency[0]) / 2
        self.x = (frequency - self.centre) / self.half
        self.frf, self.force = response.frf[inside], response.weight[inside]
        self.weight, self.ambient = self.force, 0.0
        self.powers = self.x[:, None] ** np.arange(residual_order + 1)

    def starting_poles(self, n_modes: int) -> FloatArray:
        numerator = self.x[:, None] ** np.arange(n_modes + self.powers.shape[1])
        denominator = self.x[:, None] ** np.arange(n_modes)
        leading = self.frf * self.x**n_modes
        scale = self.weight.copy()
        roots = np.zeros(n_modes, dtype=np.complex128)
        for _ in range(20):
            terms = np.hstack((numerator, -self.frf[:, None] * denominator))
            weights = np.linalg.lstsq(terms * scale[:, None], leading * scale, rcond=None)[0]
            polynomial = np.append(weights[-n_modes:], 1.0)
            roots = np.asarray(np.roots(polynomial[::-1]), dtype=np.complex128)
            scale = self.weight / np.abs(np.polyval(polynomial[::-1], self.x))
        poles = self.centre + self.half * roots
        return np.stack((poles.real, np.abs(poles.imag)), axis=1).ravel()

    def solved(self, start: FloatArray) -> FloatArray:
        return np.asarray(
            optimize.least_squares(self.residual, start, x_scale="jac", xtol=1e-12, ftol=1e-12, method="lm").x
        )

    def reweight(self, unknowns: FloatArray) -> None:
        """Weights 1 / sqrt(1 + ratio |H|^2) times those of the force, the ratio being the most likely one."""
        terms, target = self._linear(_poles(unknowns))
        model = terms @ np.linalg.lstsq(terms, target, rcond=None)[0]
        half = target.size // 2
        scale = self.force / self.weight
        error = ((target - model) ** 2).reshape(2, half).sum(axis=0) * scale**2
        level = (model**2).reshape(2, half).sum(axis=0) * scale**2

        def unlikelihood(logarithm: float) -> float:
            variance = 1 + np.exp(logarithm) * level
            return float(half * np.log(np.mean(error / variance)) + np.sum(np.log(variance)))

        centre = -float(np.log(level.max()))
        found = optimize.minimize_scalar(unlikelihood, bounds=(centre - 7, centre + 14), method="bounded")
        variance = 1 + np.exp(found.x) * level
        self.weight = self.force / np.sqrt(variance)
        self.ambient = float(np.exp(found.x) * np.mean(error / variance))

    def residual(self, unknowns: FloatArray) -> FloatArray:
        terms, target = self._linear(_poles(unknowns))
        orthogonal = np.linalg.qr(terms)[0]
        return np.asarray(target - orthogonal @ (orthogonal.T @ target))

    def _linear(self, poles: ComplexArray) -> tuple[FloatArray, FloatArray]:
        first = 1 / (self.s[:, None] - poles)
        second = 1 / (self.s[:, None] - poles.conj())
        terms = np.hstack((first + second, 1j * (first - second), self.powers, 1j * self.powers))
        return _stack(np.asarray(terms * self.weight[:, None])), _stack(self.frf * self.weight)

    def modes(self, unknowns: FloatArray) -> tuple[Mode, ...]:
        poles = _poles(unknowns)
        n = poles.size
        terms, target = self._linear(poles)
        weights = np.linalg.lstsq(terms, target, rcond=None)[0]
        residues = weights[:n] + 1j * weights[n : 2 * n]
        first = residues / (self.s[:, None] - poles) ** 2
        second = residues.conj() / (self.s[:, None] - poles.conj()) ** 2
        slopes = np.hstack((first + second, 1j * (first - second)))  # with respect to Re p and Im p
        jacobian = np.hstack((_stack(slopes * self.weight[:, None]), terms))
        spare = target.size - jacobian.shape[1]
        variance = float(np.sum((target - terms @ weights) ** 2)) / spare * self._correlation()
        # Columns differ by many orders: scale them before the normal matrix is inverted.
        size = np.linalg.norm(jacobian, axis=0)
        covariance = variance * np.linalg.inv((jacobian / size).T @ (jacobian / size)) / np.outer(size, size)
        order = np.argsort(np.abs(poles))
        return tuple(self._mode(poles[i], residues[i], covariance[i::n, i::n][:4, :4]) for i in order)

    def _correlation(self) -> float:
        decay = 2 * self.response.window_decay * self.response.duration_s
        return 1.0 if decay == 0 else float(decay / -np.expm1(-decay))

    def _mode(self, windowed: complex, residue: complex, covariance: FloatArray) -> Mode:
        """Undo window, cut and integration; ``covariance`` is that of Re p, Im p, Re R, Im R."""
        pole = windowed + self.response.window_decay
        size = abs(pole)
        direction = np.array([pole.real, pole.imag]) / size
        across = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3  # gradient of -Re p / |p|
        poles = covariance[:2, :2]
        duration = self.response.duration_s
        factor = 1 / ((1 - np.exp(windowed * duration)) * pole ** _DERIVATIVES[self.response.motion])
        # Motion that the ambience kept up before the hit rings on with the same pole: no residual shows it.
        # Its stationary variance is taken whole, since the fit absorbs some of what it is estimated from.
        ambient = self.ambient * self._correlation() / (-2 * pole.real * duration)
        relative = np.sqrt(
            np.trace(covariance[2:, 2:]) / (2 * abs(residue) ** 2) + self.response.force_error**2 + ambient
        )
        return Mode(
            Estimate(size / (2 * np.pi), float(np.sqrt(direction @ poles @ direction)) / (2 * np.pi)),
            Estimate(-pole.real / size, float(np.sqrt(across @ poles @ across))),
            complex(residue * factor),
            float(relative * abs(residue * factor)),
        )


def _poles(unknowns: FloatArray) -> ComplexArray:
    frequency, decay = unknowns.reshape(-1, 2).T
    return np.asarray(2 * np.pi * (1j * frequency - np.abs(decay)))


def _stack(values: npt.NDArray[np.complex128]) -> FloatArray:
    return np.concatenate((values.real, values.imag))
