"""Motion of a body as it was measured, and the frequency at which a structure moves most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import fft, signal

from rom.campaign.channels import FloatArray
from rom.campaign.channels import Motion as MotionKind
from rom.criteria.number import Numerical
from rom.signals.filters import INTEGRATIONS
from rom.signals.frequency_band import Band

_STRONGEST_S: Numerical[float] = 4.0
_LONGEST_S: Numerical[float] = 30.0
_FEWEST: Numerical[int] = 2048  # samples in place of those seconds, where a slow structure is sampled slowly
_FEWEST_PERIODS: Numerical[int] = 16  # in what is looked at, longer where the strongest line has fewer
_DRIFT_HZ: Numerical[float] = 0.5  # an accelerometer drifts below; as a share of the rate where that is low
_DRIFT_SHARE: Numerical[float] = 1 / 400
_DRIFT_POWER: Numerical[float] = 0.1  # of an acceleration; sound campaigns have 1e-3, slow structures 0.3
_USUAL_HZ: Numerical[tuple[float, float]] = (1.0, 100.0)
_LOSES_HZ: Numerical[float] = 15.0
_LARGEST_NOISE: Numerical[float] = 30.0  # medians of a density; the largest of 10^6 lines of noise has 20


@dataclass(frozen=True, eq=False)
class Motion:
    """Measured motion of one body: `kind` is "acceleration", "velocity" or "displacement", `samples` raw in
    SI.
    """

    kind: MotionKind
    samples: FloatArray


def time_factor(strongest_hz: float | None) -> float:
    """Return the factor on times that are meant for structures of 1 to 100 Hz.

    Slower ones need longer, faster ones shorter times in proportion.
    """
    low, high = _USUAL_HZ
    return 1.0 if not strongest_hz else max(low / strongest_hz, 1.0) * min(high / strongest_hz, 1.0)


def loss_factor(strongest_hz: float | None) -> float:
    """Return the factor on times that are meant for a loss in a joint that moves at 15 Hz and more."""
    factor = time_factor(strongest_hz)
    return max(factor, _LOSES_HZ / strongest_hz) if factor >= 1.0 and strongest_hz else factor


def dominant_frequency(
    motion: Mapping[str, Motion], rate_hz: float, impact_s: float | None, band_hz: Band | None = None
) -> float | None:
    """Return the frequency [Hz] of the strongest line of all velocity spectra after the impact.

    Velocity lies between acceleration, where fast modes speak, and displacement, where slow noise would.

    Parameters
    ----------
    motion : mapping of str to Motion
        Motion by body.
    rate_hz, impact_s : float
        Sampling rate [Hz]; time of the impact [s], None where there is none.
    band_hz : tuple of float
        Where to look [Hz], from and to; None for everywhere.

    Returns
    -------
    float or None
        Frequency [Hz]; None where nothing moves.
    """
    start = int((impact_s or 0.0) * rate_hz)
    longest = max((len(channel.samples) for channel in motion.values()), default=0) - start
    length = max(int((_STRONGEST_S if impact_s is not None else _LONGEST_S) * rate_hz), _FEWEST)
    if impact_s is not None and _DRIFT_SHARE * rate_hz < _DRIFT_HZ:  # of what is so slow nothing is too long
        length = max(length, longest)
    while True:
        ringing = {body: Motion(m.kind, m.samples[start : start + length]) for body, m in motion.items()}
        found = _strongest(ringing, rate_hz, band_hz, from_rest=impact_s is not None)
        if length >= longest or (found is not None and found * length >= _FEWEST_PERIODS * rate_hz):
            return found
        length *= 4


def _strongest(
    motion: Mapping[str, Motion], rate_hz: float, band_hz: Band | None, *, from_rest: bool
) -> float | None:
    power, frequency = 0.0, None
    for channel in motion.values():
        if len(channel.samples) < 16:
            continue
        lines, weight = _velocity_lines(channel, rate_hz, band_hz, from_rest=from_rest)
        if band_hz is not None:
            weight = np.where((lines >= band_hz[0]) & (lines <= band_hz[1]), weight, 0.0)
        if weight.size and weight.max() > power:
            power, frequency = float(weight.max()), float(lines[np.argmax(weight)])
    return frequency


def _velocity_lines(
    motion: Motion, rate_hz: float, band_hz: Band | None, *, from_rest: bool
) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and velocity's power there; lines no higher than noise, where there are others,
    have none.

    A window that begins at zero hides a motion from rest that has died away before it opens: where nothing
    shows through it, one that falls towards the end alone is taken.
    """
    samples, order = motion.samples - motion.samples.mean(), INTEGRATIONS[motion.kind]
    size, resolution = fft.next_fast_len(len(samples), real=True), rate_hz / len(samples)
    lines, window = fft.rfftfreq(size, 1 / rate_hz), signal.windows.hann(len(samples))
    inside = lines > (4 if order == 2 else 1.5) * resolution
    density, above = _above_noise(samples * window, size)
    if from_rest and not np.any(above[inside]):
        window[: len(samples) // 2] = 1.0
        density, above = _above_noise(samples * window, size)
    density = above if np.any(above[inside]) else density
    slow = lines <= min(_DRIFT_HZ, _DRIFT_SHARE * rate_hz, np.inf if band_hz is None else band_hz[0])
    if order == 2 and density[inside & slow].sum() <= _DRIFT_POWER * density[inside].sum():
        inside &= ~slow
    return lines[inside], density[inside] * lines[inside] ** (2 - 2 * order)


def _above_noise(samples: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Return a spectrum, and by how much each of its lines exceeds the largest of noise."""
    density = np.abs(fft.rfft(samples, size)) ** 2
    return density, np.maximum(density - _LARGEST_NOISE * float(np.median(density)), 0.0)


def stands_out(samples: FloatArray) -> bool:
    """Return whether some line of a signal's spectrum stands above its noise."""
    whole = samples - samples.mean()
    return bool(np.any(_above_noise(whole * signal.windows.hann(len(whole)), len(whole))[1]))
