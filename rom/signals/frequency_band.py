"""The declared band in which measured and simulated motion are compared: one zero-phase filter for both."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import signal

from rom.criteria.number import Numerical

FloatArray = npt.NDArray[np.float64]
Band = tuple[float, float]

_LOWPASS_ORDER: Numerical[int] = 8
_HIGHPASS_ORDER: Numerical[int] = 4
_PERIODS: Numerical[tuple[float, float]] = (2.0, 8.0)  # of the lower and of the upper end
_MOST: Numerical[float] = 0.25  # of a record, at each of its ends


def in_band(samples: FloatArray, rate_hz: float, band_hz: Band | None) -> FloatArray:
    """Return samples without what lies outside a band, by Butterworth filters forwards and backwards.

    Parameters
    ----------
    samples : ndarray, shape (..., samples)
        Samples.
    rate_hz : float
        Sampling rate [Hz].
    band_hz : tuple of float or None
        From and to [Hz]; an end at 0 Hz or above half the rate filters nothing. None: no band.

    Returns
    -------
    ndarray
        Shape (..., samples).
    """
    if band_hz is None:
        return samples
    low, high = band_hz
    for cutoff, order, periods in ((low, _HIGHPASS_ORDER, _PERIODS[0]), (high, _LOWPASS_ORDER, _PERIODS[1])):
        if 0 < cutoff < rate_hz / 2:
            kind: Literal["lowpass", "highpass"] = "highpass" if cutoff == low else "lowpass"
            padding = min(samples.shape[-1] - 1, int(periods * rate_hz / cutoff))
            samples = _there_and_back(samples, padding, *_sections(order, cutoff, kind, rate_hz))
    return np.asarray(samples)


@lru_cache(maxsize=64)
def _sections(
    order: int, cutoff_hz: float, kind: Literal["lowpass", "highpass"], rate_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Sections of a filter and their steady state, which take longer than a pass over a short record."""
    sections = np.asarray(signal.butter(order, cutoff_hz, kind, fs=rate_hz, output="sos"), dtype=np.float64)
    return sections, np.asarray(signal.sosfilt_zi(sections))


def _there_and_back(
    samples: FloatArray, padding: int, sections: FloatArray, steady: FloatArray
) -> FloatArray:
    """What ``scipy.signal.sosfiltfilt`` gives with even padding, the steady state being known."""
    before, after = samples[..., padding:0:-1], samples[..., -2 : -padding - 2 : -1]
    rows = np.concatenate([before, samples, after], axis=-1) if padding else samples
    state = steady.reshape(len(steady), *(1,) * (samples.ndim - 1), 2)
    for _ in range(2):
        rows = signal.sosfilt(sections, rows, axis=-1, zi=state * rows[..., :1])[0][..., ::-1]
    return np.asarray(rows[..., padding : rows.shape[-1] - padding])


def edge_samples(samples: int, rate_hz: float, band_hz: Band | None) -> int:
    """Return how many samples at either end of a record the filter of a band spoils.

    Parameters
    ----------
    samples : int
        Length of the record.
    rate_hz : float
        Sampling rate [Hz].
    band_hz : tuple of float or None
        From and to [Hz].
    """
    if band_hz is None:
        return 0
    spoilt = [periods / end for periods, end in zip((1.0, _PERIODS[1]), band_hz, strict=True) if end > 0]
    return int(min(max(spoilt) * rate_hz, _MOST * samples))


def kink_samples(samples: int, rate_hz: float, band_hz: Band | None) -> int:
    """Return how many samples at either end show the kink that faster modes have where a record is reflected.

    Of what lies in the band a measured and a simulated record have the same there.

    Parameters
    ----------
    samples : int
        Length of the record.
    rate_hz : float
        Sampling rate [Hz].
    band_hz : tuple of float or None
        From and to [Hz].
    """
    return 0 if band_hz is None else int(min(rate_hz / band_hz[1], _MOST * samples))
