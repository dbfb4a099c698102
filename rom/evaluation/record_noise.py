"""What the noise of one record makes of a simulation that is right.

Noise of the motion is what its channels show before the hit, sensor noise and ambient vibration together. Of
its power density S(f), the filter chain with n integrations leaves in the displacement the mean square

    int S(f) |H(f)|^(4 (n + 1)) / (2 pi f)^(2 n) df,   |H|^2 = 1 / (1 + (f_c / f)^(2 order)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import signal

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.noise_spectrum import MARGIN_S, SHORTEST_S
from rom.signals.filters import INTEGRATIONS, FilterChain
from rom.signals.processing import Measurement

_FINER: Numerical[int] = 8  # lines of the spectrum for each that the samples resolve


@dataclass(frozen=True)
class RecordNoise:
    """NRMSE of each moving body, of a relative motion, and standard error of a record's loss [N]."""

    motion_nrmse: Mapping[str, float] = field(default_factory=dict)
    relative_motion_nrmse: float = np.nan
    loss_error: float = np.nan
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
    tension, impact_s, rate = measurement.tension, measurement.impact_s or 0.0, measurement.rate_hz
    loss = np.nan if tension is None else float(np.hypot(tension.initial_error, tension.final_error))
    if impact_s < SHORTEST_S + MARGIN_S or measurement.chain.band_hz is not None:
        return RecordNoise(loss_error=loss)
    start, quiet = int(impact_s * rate), int((impact_s - MARGIN_S) * rate)
    shown = {body: measurement.displacement(body)[start:] for body in measurement.motion}
    lines = {
        body: _displacement_lines(motion.samples[:quiet], INTEGRATIONS[motion.kind], rate, measurement.chain)
        for body, motion in measurement.motion.items()
    }
    relative = np.nan
    if pair is not None and set(pair) <= set(lines):
        first, second = pair
        relative = _nrmse(lines[first] - lines[second], shown[first] - shown[second])
    return RecordNoise({body: _nrmse(lines[body], shown[body]) for body in lines}, relative, loss)


def _displacement_lines(
    samples: FloatArray, integrations: int, rate_hz: float, chain: FilterChain
) -> npt.NDArray[np.complex128]:
    """Spectrum of the displacement that a chain makes of noise; its squares add up to the mean square."""
    window = signal.windows.hann(len(samples), sym=False)
    size = _FINER * len(samples)
    lines = np.fft.rfft(signal.detrend(samples) * window, size)[1:] * np.sqrt(2 / (size * np.sum(window**2)))
    frequency = np.fft.rfftfreq(size, 1 / rate_hz)[1:]
    if not integrations:  # displacement passes no high-pass
        return np.asarray(lines)
    highpass = 1 / (1 + (chain.cutoff_hz / frequency) ** (2 * chain.order))
    return np.asarray(lines * highpass ** (integrations + 1) / (2j * np.pi * frequency) ** integrations)


def _nrmse(noise: npt.NDArray[np.complex128], shown: FloatArray) -> float:
    size = float(np.sqrt(np.mean(shown**2)))
    return float(np.sqrt(np.sum(np.abs(noise) ** 2))) / size if size > 0 else np.nan
