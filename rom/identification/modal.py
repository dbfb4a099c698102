"""Natural frequencies, damping ratios, and what they say about a joint between two bodies."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import linalg, signal

from rom.identification.frequency_response import (
    Estimate,
    FrequencyResponse,
    Mode,
    fit_modes,
    frequency_response,
)

__all__ = [
    "Estimate",
    "FrequencyResponse",
    "Mode",
    "average_period_frequency",
    "fit_modes",
    "frequency_response",
    "joint_damping",
    "joint_stiffness",
    "logarithmic_decrement",
    "maximum_frequency",
    "modal_damping_ratio",
    "oscillator_constants",
    "undamped_modes",
]

FloatArray = npt.NDArray[np.float64]
Pair = tuple[float, float]


def average_period_frequency(
    displacement: FloatArray,
    rate_hz: float,
    duration_s: float = 3.0,
    max_hz: float = 17.0,
    start_s: float = 0.0,
    min_hz: float = 0.0,
) -> Estimate:
    """f = 1 / mean(time between consecutive peaks of one sign), over ``duration_s`` after ``start_s`` [Hz].

    Peaks of both signs are used, each placed between samples by a parabola; a period shorter than
    1 / max_hz is dropped. What comes out is the damped frequency, below the natural one by zeta^2 / 2.

    In a chain of periods the timing errors of all peaks but the first and the last cancel; the standard
    error rests on these two, with the scatter of all peak times about a straight line. A sign with two peaks
    or fewer, as a strongly damped motion leaves, has no such scatter: the other sign tells the error.

    Parameters
    ----------
    displacement : ndarray, shape (samples,)
        Free vibration [m].
    rate_hz : float
        Sampling rate [Hz].
    duration_s : float
        How much of the record is used [s].
    max_hz : float
        Highest frequency that a period may have [Hz].
    start_s : float
        Where to start [s].
    min_hz : float
        Lowest frequency that a period may have [Hz]: peaks after a longer one are those of noise.

    Returns
    -------
    Estimate
        Frequency [Hz].

    Raises
    ------
    ValueError
        If fewer than three periods are left.

    Notes
    -----
    He et al. (2025), Section 3.2.
    """
    tops = _peaks(displacement, rate_hz, start_s, duration_s, (min_hz, max_hz))
    periods = np.concatenate([np.diff(times) for times, _ in tops])
    kept = periods[periods >= 1 / max_hz]
    if kept.size < 3:
        raise ValueError(
            f"An average period needs at least 3 periods longer than {1 / max_hz:.4g} s, instead got "
            f"{kept.size} of {periods.size} within {duration_s} s."
        )
    period = float(kept.mean())
    errors = [_timing_error(times, heights, period) for times, heights in tops if times.size > 2]
    return Estimate(1 / period, float(np.linalg.norm(errors)) / len(errors) / period**2)


def _timing_error(times: FloatArray, heights: FloatArray, period: float) -> float:
    """Standard error of (last - first) / periods; noise on a height shifts a peak by noise / height."""
    index = np.round((times - times[0]) / period)
    line = np.polynomial.Polynomial.fit(index, times, 1, w=heights)
    scatter = np.sum(((times - line(index)) * heights) ** 2) / (times.size - 2)
    return float(np.sqrt(scatter * (heights[0] ** -2.0 + heights[-1] ** -2.0)) / index[-1])


def logarithmic_decrement(
    displacement: FloatArray,
    rate_hz: float,
    duration_s: float = 3.0,
    max_hz: float = 17.0,
    start_s: float = 0.0,
    first_peak: int = 2,
    min_hz: float = 0.0,
) -> Estimate:
    """zeta = delta / sqrt(4 pi^2 + delta^2), delta = mean over n of ln(x_p / x_(p+n)) / n.

    x_p is the second peak of a sign (``first_peak``), as printed; both signs are averaged, so that an offset
    cancels to first order. All terms share x_p: the standard error propagates noise of constant size on the
    heights, measured by the scatter of ln(x) about a straight line, through the sum as it stands.

    The high-pass filter reaches about 0.2 s past the impact and bends the first peaks.

    Parameters
    ----------
    displacement : ndarray, shape (samples,)
        Free vibration [m].
    rate_hz : float
        Sampling rate [Hz].
    duration_s : float
        How much of the record is used [s].
    max_hz : float
        Highest frequency that a period may have [Hz].
    start_s : float
        Where to start [s].
    first_peak : int
        Which peak of a sign is x_p.
    min_hz : float
        Lowest frequency that a period may have [Hz]: peaks after a longer one are those of noise.

    Returns
    -------
    Estimate
        Damping ratio.

    Raises
    ------
    ValueError
        If a sign has fewer than three peaks from ``first_peak`` on, within ``duration_s`` after ``start_s``.

    Notes
    -----
    He et al. (2025), Section 3.2.
    """
    tops = _peaks(displacement, rate_hz, start_s, duration_s, (min_hz, max_hz))
    decrements = [_decrement(heights[first_peak - 1 :]) for _, heights in tops]
    delta = float(np.mean([value for value, _ in decrements]))
    error = float(np.linalg.norm([error for _, error in decrements])) / len(decrements)
    root = np.hypot(2 * np.pi, delta)
    return Estimate(float(delta / root), float(error * 4 * np.pi**2 / root**3))


def _peaks(
    displacement: FloatArray, rate_hz: float, start_s: float, duration_s: float, band_hz: Pair
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Times [s] and heights of the positive and of the negative peaks."""
    first = round(start_s * rate_hz)
    part = np.asarray(displacement, dtype=np.float64)[first : first + round(duration_s * rate_hz)]
    if part.size < 3:
        raise ValueError(f"No samples of the displacement lie within {duration_s} s after {start_s} s.")
    return _unbroken(part, rate_hz, band_hz), _unbroken(-part, rate_hz, band_hz)


def _unbroken(samples: FloatArray, rate_hz: float, band_hz: Pair) -> tuple[FloatArray, FloatArray]:
    """Times [s] and heights of the peaks up to the first gap: what has rung down leaves peaks of noise."""
    times, heights = _signed_peaks(samples, rate_hz, band_hz[1])
    gaps = np.flatnonzero(np.diff(times) * band_hz[0] > 1)
    end = int(gaps[0]) + 1 if len(gaps) else len(times)
    return times[:end], heights[:end]


def _signed_peaks(samples: FloatArray, rate_hz: float, max_hz: float) -> tuple[FloatArray, FloatArray]:
    # Noise on a flat top makes several maxima: the highest within half the shortest period counts. A ripple
    # on a flank, as the filter leaves at the impact, stands out from its surroundings by less than its
    # height.
    distance = max(1, int(rate_hz / max_hz / 2))
    at, found = signal.find_peaks(samples, height=0.0, distance=distance, prominence=0.0)
    at = at[found["prominences"] >= 0.5 * found["peak_heights"]]
    before, top, after = samples[at - 1], samples[at], samples[at + 1]
    bend = before - 2 * top + after
    shift = np.where(bend < 0, (before - after) / (2 * np.where(bend < 0, bend, -1.0)), 0.0)
    return (at + shift) / rate_hz, top - (before - after) * shift / 4


def _decrement(heights: FloatArray) -> tuple[float, float]:
    if heights.size < 3:
        raise ValueError(
            f"A decrement needs at least 3 peaks a sign from the first used on, instead got {heights.size}."
        )
    logarithm = np.log(heights)
    n = np.arange(1, heights.size)
    weights = np.append(np.mean(1 / n), -1 / (n * n.size))
    index = np.arange(heights.size)
    line = np.polynomial.Polynomial.fit(index, logarithm, 1, w=heights)
    scatter = np.sum(((logarithm - line(index)) * heights) ** 2) / (heights.size - 2)
    return float(weights @ logarithm), float(np.sqrt(scatter * np.sum((weights / heights) ** 2)))


def oscillator_constants(mass: float, natural_frequency: float, damping_ratio: float) -> Pair:
    """k = m (2 pi f)^2 [N/m] and c = 2 zeta m 2 pi f [N s/m] of a single oscillator (Section 3.1).

    Parameters
    ----------
    mass : float
        Mass [kg].
    natural_frequency : float
        Natural frequency [Hz].
    damping_ratio : float
        Damping ratio.

    Returns
    -------
    Pair
        k [N/m] and c [N s/m].
    """
    omega = 2 * np.pi * natural_frequency
    return float(mass * omega**2), float(2 * damping_ratio * mass * omega)


def undamped_modes(mass: FloatArray, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Natural frequencies [Hz], ascending, and mass-normalised shapes (bodies, modes): phi' M phi = 1.

    Notes
    -----
    He et al. (2025), Eq. 6.
    """
    squared, shapes = linalg.eigh(stiffness, mass)
    return np.sqrt(np.clip(squared, 0, None)) / (2 * np.pi), np.asarray(shapes)


def modal_damping_ratio(natural_frequency: FloatArray, shapes: FloatArray, damping: FloatArray) -> FloatArray:
    """zeta_r = phi_r' C phi_r / (2 omega_r), first order in the damping.

    Exact for proportional damping only: it ignores what C couples between modes. With the paper's joint the
    second mode's ratio is 0.07 to 0.65, yet its shape couples so little to the first that zeta_1 is 0.6 to
    1.5 % and off by one part in a hundred at worst.

    Parameters
    ----------
    natural_frequency : ndarray, shape (modes,)
        Natural frequencies [Hz].
    shapes : ndarray, shape (bodies, modes)
        Mode shapes, mass-normalised.
    damping : ndarray, shape (bodies, bodies)
        Damping matrix [N s/m].

    Returns
    -------
    ndarray
        Shape (modes,).

    Notes
    -----
    He et al. (2025), Eq. 7.
    """
    return np.asarray(np.einsum("br,bc,cr->r", shapes, damping, shapes) / (4 * np.pi * natural_frequency))


def maximum_frequency(masses: Pair, ground_stiffness: Pair) -> float:
    """f_1 = sqrt((k_1 + k_2) / (m_1 + m_2)) / (2 pi) [Hz]: both bodies locked together (Eq. 4)."""
    return float(np.sqrt(sum(ground_stiffness) / sum(masses)) / (2 * np.pi))


def joint_stiffness(first_frequency: npt.ArrayLike, masses: Pair, ground_stiffness: Pair) -> FloatArray:
    """k_C = (-k_1 k_2 + (k_2 m_1 + k_1 m_2) w^2 - m_1 m_2 w^4) / (k_1 + k_2 - (m_1 + m_2) w^2) [N/m].

    Parameters
    ----------
    first_frequency
        Natural frequency of the first mode, w / (2 pi) [Hz]; any shape.
    masses, ground_stiffness
        Of the two bodies [kg], and of the springs that tie them to ground [N/m].

    Notes
    -----
    He et al. (2025), Eq. 3; exact. It turns negative above :func:`maximum_frequency`, where no joint is stiff
    enough, and below the lower uncoupled frequency. Near the maximum 1 % of frequency is 31 % of stiffness.
    """
    (m_1, m_2), (k_1, k_2) = masses, ground_stiffness
    squared = (2 * np.pi * np.asarray(first_frequency, dtype=np.float64)) ** 2
    # The characteristic polynomial in factors: expanded as printed, its terms cancel.
    return np.asarray((k_1 - m_1 * squared) * (k_2 - m_2 * squared) / ((m_1 + m_2) * squared - k_1 - k_2))


def joint_damping(
    first_frequency: npt.ArrayLike,
    first_damping_ratio: npt.ArrayLike,
    stiffness: npt.ArrayLike,
    masses: Pair,
    ground_stiffness: Pair,
    ground_damping: Pair,
) -> FloatArray:
    """c_C = A / B [N s/m], Eq. 7 solved for the joint.

    Parameters
    ----------
    first_frequency, first_damping_ratio
        Of the first mode [Hz] and [-]; any shapes that broadcast with ``stiffness``.
    stiffness
        Joint stiffness k_C [N/m].
    masses, ground_stiffness, ground_damping
        Of the two bodies [kg], and of the springs [N/m] and dampers [N s/m] that tie them to ground.

    Notes
    -----
    He et al. (2025), Eqs. 9 and 10; exact for the modal damping ratio of :func:`modal_damping_ratio`.
    """
    (m_1, m_2), (k_1, k_2), (c_1, c_2) = masses, ground_stiffness, ground_damping
    k_C = np.asarray(stiffness, dtype=np.float64)
    modal = 4 * np.pi * np.asarray(first_frequency) * np.asarray(first_damping_ratio)
    total, skew = m_1 + m_2, k_2 * m_1 - k_1 * m_2
    Q = k_C * total + skew * (m_1 - m_2) / total
    P = np.hypot(Q, 2 * np.sqrt(m_1 * m_2) * skew / total)
    A = (m_1 * (k_C + k_2) - m_2 * (k_C + k_1)) * (m_1 * c_2 - m_2 * c_1) + (
        2 * m_1 * m_2 * modal - m_1 * c_2 - m_2 * c_1
    ) * P
    # B = total (P - Q), whose terms cancel for a stiff joint: the difference of squares keeps the digits.
    B = np.where(Q > 0, 4 * m_1 * m_2 * skew**2 / (total * (P + np.abs(Q))), total * (P - Q))
    return np.asarray(A / B)
