"""The declared band in which measured and simulated motion are compared: one zero-phase filter for both."""

from __future__ import annotations

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
            sections = signal.butter(order, cutoff, kind, fs=rate_hz, output="sos")
            padding = min(samples.shape[-1] - 1, int(periods * rate_hz / cutoff))
            samples = signal.sosfiltfilt(sections, samples, axis=-1, padtype="even", padlen=padding)
    return np.asarray(samples)


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
