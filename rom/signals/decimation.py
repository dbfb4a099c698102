"""To a lower sampling rate."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import signal

from rom.signals.filters import finite_signal

FloatArray = npt.NDArray[np.float64]


def decimate(samples: FloatArray, rate_hz: float, target_hz: float) -> FloatArray:
    """Bring samples (..., samples) to a lower rate without aliasing and without delay.

    A linear-phase FIR low-pass, flat to 0.8 of the new Nyquist frequency and below -60 dB from there on, is
    applied with its delay removed; sample i of the result belongs to time i / target_hz. Ratios of whole
    numbers go through an intermediate rate (polyphase).

    Parameters
    ----------
    samples : ndarray, shape (..., samples)
        Samples.
    rate_hz : float
        Sampling rate [Hz].
    target_hz : float
        The lower rate [Hz].

    Returns
    -------
    ndarray
        Samples at the lower rate.

    Raises
    ------
    ValueError
        If the target lies above the rate, or the ratio is no fraction of whole numbers up to 1000.
    """
    array = finite_signal(samples)
    ratio = Fraction(target_hz / rate_hz).limit_denominator(1000)
    if not 0 < target_hz <= rate_hz or abs(ratio - target_hz / rate_hz) > 1e-9:
        raise ValueError(
            f"The target rate must be a simple fraction of the sampling rate and not above it, instead got "
            f"{target_hz} Hz of {rate_hz} Hz."
        )
    if ratio == 1:
        return array.copy()
    lowpass = _lowpass(ratio.denominator)
    # A tension of 3000 N must neither fall to zero at the ends ("line") nor pass the taps' ripple (its mean).
    level = array.mean(axis=-1, keepdims=True)
    resampled = signal.resample_poly(  # type: ignore[call-overload]  # the stubs know no window given as taps
        array - level, ratio.numerator, ratio.denominator, axis=-1, window=lowpass, padtype="line"
    )
    return np.asarray(resampled + level, dtype=np.float64)


@lru_cache(maxsize=64)
def _lowpass(ratio: int) -> FloatArray:
    """Taps of the low-pass, which take longer than a pass over a short record."""
    taps, beta = signal.kaiserord(60.0, 0.2 / ratio)
    return np.asarray(signal.firwin(taps | 1, 0.9 / ratio, window=("kaiser", beta)), dtype=np.float64)
