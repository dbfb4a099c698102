"""What the noise of one record makes of a simulation that is right.

Noise of the motion is what its channels show before the hit, sensor noise and ambient vibration together. Of
its power density S(f), the filter chain with n integrations leaves in the displacement the mean square

    int S(f) |H(f)|^(4 (n + 1)) / (2 pi f)^(2 n) df,   |H|^2 = 1 / (1 + (f_c / f)^(2 order)).

Where no record of rest is there (driven, free, cycled), noise is what the error itself shows from sample to
sample: fourth differences of white noise have 70 times its variance, of a polynomial of third degree none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy import fft, signal, special, stats

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.noise_spectrum import before_margin, is_quiet_enough
from rom.signals.filters import INTEGRATIONS, FilterChain
from rom.signals.processing import Measurement, TensionRecord, non_oscillatory

_FINER: Numerical[int] = 8  # lines of the spectrum for each that the samples resolve
_SEED: Numerical[int] = 0
_ORDER: Numerical[int] = 4  # of differences: slow errors are left out
MEDIAN: Numerical[float] = float(stats.norm.ppf(0.75))  # of the size of a normal number, over its deviation


@dataclass(frozen=True)
class RecordNoise:
    """NRMSE of each moving body, of a relative motion and of cycled links' forces, error of a loss [N], root
    mean squares [N] of the tension's noise and of what was lost after the hit, standard deviation of ln rate.
    """

    motion_nrmse: Mapping[str, float] = field(default_factory=dict)
    relative_motion_nrmse: float = np.nan
    link_force_nrmse: float = np.nan
    loss_error: float = np.nan
    tension_rms: float = np.nan
    lost_rms: float = np.nan
    rate_deviation: float = np.nan


def noise_of(measurement: Measurement, pair: tuple[str, str] | None) -> RecordNoise:
    """Return what a record's noise makes of a simulation that is right.

    Of the motion where a hit comes late enough to show it, and no band is declared.

    Parameters
    ----------
    measurement : Measurement
        The record as processed.
    pair : tuple of str or None
        Bodies whose relative motion is compared.

    Returns
    -------
    RecordNoise
        Not a number where it is not known.
    """
    impact_s, rate = measurement.impact_s or 0.0, measurement.rate_hz
    known = _of_tension(measurement.tension, impact_s, measurement.strongest_hz)
    if not is_quiet_enough(impact_s, measurement.strongest_hz) or measurement.chain.band_hz is not None:
        return known
    start, quiet = int(impact_s * rate), int(before_margin(impact_s) * rate)
    shown = {body: measurement.displacement(body)[start:] for body in measurement.motion}
    lines = {
        body: _displacement_lines(motion.samples[:quiet], INTEGRATIONS[motion.kind], rate, measurement.chain)
        for body, motion in measurement.motion.items()
    }
    relative = np.nan
    if pair is not None and set(pair) <= set(lines):
        first, second = pair
        relative = _nrmse(lines[first] - lines[second], shown[first] - shown[second])
    motion = {body: _nrmse(lines[body], shown[body]) for body in lines}
    return replace(known, motion_nrmse=motion, relative_motion_nrmse=relative)


def from_sample_to_sample(error: FloatArray) -> float:
    """Return the standard deviation of the white noise in a simulated minus a measured course.

    By the median size of its fourth differences, which jumps in a few samples do not move. Slower noise is
    not in it; an error of the model at a hundredth of the sampling rate is by 2e-6 of its size, at a tenth by
    0.02.

    Parameters
    ----------
    error : ndarray, shape (samples,)
        The error, in any unit.

    Returns
    -------
    float
        In that unit; not a number where the samples are too few, or too coarse to show noise.
    """
    steps = np.abs(np.diff(error, _ORDER))
    size = float(np.median(steps)) / MEDIAN if len(steps) else 0.0
    return size / float(np.sqrt(special.binom(2 * _ORDER, _ORDER))) if size > 0 else np.nan


def _of_tension(tension: TensionRecord | None, impact_s: float, first_mode_hz: float | None) -> RecordNoise:
    if tension is None:
        return RecordNoise()
    # a simulation starts from the mean before the hit, whose error falls with the tension at a rate like T
    kept = min(max(tension.final / tension.initial, 0.0), 1.0) if tension.initial > 0 else 1.0
    loss = float(np.hypot(kept * tension.initial_error, tension.final_error))
    if not is_quiet_enough(impact_s, first_mode_hz):
        return RecordNoise(loss_error=loss)
    hit = int(impact_s * tension.rate_hz)
    lost = np.sqrt(np.mean((tension.non_oscillatory[hit:] - tension.initial) ** 2))
    noise = _as_before(tension, impact_s)
    slow = non_oscillatory(noise, tension.rate_hz, impact_s, first_mode_hz)[hit:]
    rms = np.hypot(np.std(slow), kept * tension.initial_error)
    return RecordNoise(loss_error=loss, tension_rms=float(rms), lost_rms=float(lost))


def _as_before(tension: TensionRecord, impact_s: float) -> FloatArray:
    """Noise [N] as long as the record, with the spectrum of that before the hit and phases drawn."""
    quiet = tension.samples[: int(before_margin(impact_s) * tension.rate_hz)]
    window = signal.windows.hann(len(quiet), sym=False)
    size = len(tension.samples)
    lines = np.abs(np.fft.rfft(signal.detrend(quiet) * window)) / np.sqrt(np.sum(window**2))
    at, own = np.fft.rfftfreq(size), np.fft.rfftfreq(len(quiet))
    amplitude = np.sqrt(size) * np.interp(at, own[2:], lines[2:])  # the window smears the mean over two lines
    phases = np.random.default_rng(_SEED).standard_normal((2, len(at)))
    return np.fft.irfft(amplitude * (phases[0] + 1j * phases[1]) / np.sqrt(2), size)


def _displacement_lines(
    samples: FloatArray, integrations: int, rate_hz: float, chain: FilterChain
) -> npt.NDArray[np.complex128]:
    """Spectrum of the displacement that a chain makes of noise; its squares add up to the mean square."""
    window = signal.windows.hann(len(samples), sym=False)
    size = fft.next_fast_len(_FINER * len(samples), real=True)
    lines = fft.rfft(signal.detrend(samples) * window, size)[1:] * np.sqrt(2 / (size * np.sum(window**2)))
    frequency = np.fft.rfftfreq(size, 1 / rate_hz)[1:]
    if not integrations:  # displacement passes no high-pass
        return np.asarray(lines)
    highpass = 1 / (1 + (chain.cutoff_hz / frequency) ** (2 * chain.order))
    return np.asarray(lines * highpass ** (integrations + 1) / (2j * np.pi * frequency) ** integrations)


def _nrmse(noise: npt.NDArray[np.complex128], shown: FloatArray) -> float:
    size = float(np.sqrt(np.mean(shown**2)))
    return float(np.sqrt(np.sum(np.abs(noise) ** 2))) / size if size > 0 else np.nan
