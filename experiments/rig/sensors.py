"""From the motion of the rig to what the data acquisition writes down."""

from dataclasses import dataclass, replace
from functools import cache
from math import ceil
from typing import Self

import numpy as np
from scipy import signal

from experiments.rig.excitation import STEP_RATE_HZ, FloatArray

CALIBRATION = (2718.7, 2363.7, -575.63)
"""Eq. 1, ``T = c1 e + c2 e^2 + c3 e^3`` [N], e in mm/m.

It rises only from e = -0.488 (-697 N) to e = 3.2255 (14.04 kN): far beyond the 3 kN of the campaign.
"""


@dataclass(frozen=True)
class Transducer:
    """One measuring chain: sensor, cable and 24-bit converter.

    Attributes
    ----------
    noise : float
        RMS of its white noise over the whole band, in the unit measured. It, not the converter, sets what is
        resolved: the effective number of bits is log2(2 full_scale / (noise sqrt(12))), 14 to 18 here.
    full_scale : float
        Largest reading; the converter clips there.
    step : float
        Quantisation step, 2 full_scale / 2^24 for the real converter.
    time_constant : float or None
        Of the AC coupling [s]; None where the chain passes DC.
    """

    noise: float
    full_scale: float
    step: float
    time_constant: float | None = None

    def scaled(self, noise: float) -> Self:
        """Scale noise and quantisation; the AC coupling stays, it is the instrument."""
        return replace(self, noise=self.noise * noise, step=self.step * noise)

    def read(self, sampled: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Add noise, quantise and clip."""
        reading = sampled + self.noise * rng.standard_normal(sampled.size)
        if self.step > 0.0:
            reading = self.step * np.round(reading / self.step)
        return np.clip(reading, -self.full_scale, self.full_scale)


def chain(noise: float, full_scale: float, time_constant: float | None = None) -> Transducer:
    """Return a transducer read by a 24-bit converter.

    Parameters
    ----------
    noise : float
        RMS of its white noise, in the unit measured.
    full_scale : float
        Largest reading.
    time_constant : float or None
        Of the AC coupling [s]; None where the chain passes DC.

    Returns
    -------
    Transducer
        Its steps those of the converter.
    """
    return Transducer(noise, full_scale, 2.0 * full_scale / 2.0**24, time_constant)


HAMMER = chain(0.05, 22_240.0)
SENSITIVE = chain(0.003, 49.0, 1.5)
ROBUST = chain(0.05, 4_905.0, 1.0)
STRAIN_GAUGE = chain(3e-4, 8.0)


@dataclass(frozen=True)
class Instruments:
    """The sensor chain of Section 2.3, with typical values where the paper gives none.

    Attributes
    ----------
    force : Transducer
        Hammer 086D05, 0.23 mV/N [N].
    sensitive : Transducer
        Accelerometer 333B50, 102 mV/(m/s2), +-5 g, for hits below 100 N [m/s2]. The sensor resolves about
        0.0005; mounting, cable and converter bring it to 0.003, 2 % of the ringing of a 30 N hit.
    robust : Transducer
        Accelerometer 353B15, 1.02 mV/(m/s2), +-500 g, for harder hits [m/s2]. Its broadband resolution is
        about 0.005 g.
    strain : Transducer
        Strain-sensing bolt, 0.3 micro-strain RMS [mm/m].
    floor : float
        RMS displacement of the floor from 2 to 30 Hz [m]. It keeps LO moving by 3 to 8 % of a 30 N hit.
    drift_rate, drift_walk : float
        Apparent tension from warming: largest steady rate [N/s] and random walk [N/sqrt(s)].
    oscillation, oscillation_tension : float
        Oscillating part of the measured tension, ``oscillation exp(-T / oscillation_tension) (x_LO - x_SO)``,
        [N/m] and [N]: below the noise of one sample, visible in the mean of many, zero on average.
    motion_rate_hz, tension_rate_hz : float
        Sampling rates; both divide the integrator's.
    """

    force: Transducer = HAMMER
    sensitive: Transducer = SENSITIVE
    robust: Transducer = ROBUST
    strain: Transducer = STRAIN_GAUGE
    floor: float = 3e-7
    drift_rate: float = 0.003
    drift_walk: float = 0.005
    oscillation: float = 5e3
    oscillation_tension: float = 150.0
    motion_rate_hz: float = 19_200.0
    tension_rate_hz: float = 4_800.0

    def scaled(self, noise: float) -> Self:
        """Scale every disturbance: noise, quantisation, floor, drift, oscillating part of the tension."""
        return replace(
            self,
            force=self.force.scaled(noise),
            sensitive=self.sensitive.scaled(noise),
            robust=self.robust.scaled(noise),
            strain=self.strain.scaled(noise),
            floor=self.floor * noise,
            drift_rate=self.drift_rate * noise,
            drift_walk=self.drift_walk * noise,
            oscillation=self.oscillation * noise,
        )

    @property
    def lead(self) -> float:
        """Time the anti-alias filters reach beyond the record on either side [s]."""
        return max(reach(self.motion_rate_hz), reach(self.tension_rate_hz))


@cache
def anti_alias(ratio: int) -> FloatArray:
    """Return the taps of the low-pass before keeping every `ratio`-th sample.

    Linear phase, flat to 0.4 and 80 dB down from 0.6 of the new rate, unit gain at DC: how a sigma-delta
    converter filters, its constant delay taken out. The delay is a whole number of new samples.
    """
    count, beta = signal.kaiserord(80.0, 0.4 / ratio)
    delay = ratio * ceil(count / (2 * ratio))
    taps: FloatArray = signal.firwin(2 * delay + 1, 1.0 / ratio, window=("kaiser", beta))
    return taps


def reach(rate_hz: float) -> float:
    """Delay of the anti-alias filter of one sampling rate [s]."""
    return float(anti_alias(round(STEP_RATE_HZ / rate_hz)).size // 2 / STEP_RATE_HZ)


def sample(analog: FloatArray, start: float, rate_hz: float, duration: float) -> FloatArray:
    """Anti-alias and sample over [0, duration) what was integrated from `start` < 0 [s] on.

    Parameters
    ----------
    analog : ndarray, shape (steps,)
        The signal at `STEP_RATE_HZ`, the anti-alias filter's reach longer on either side.
    start : float
        Time of its first step [s], negative.
    rate_hz : float
        Sampling rate.
    duration : float
        Of the record [s].

    Returns
    -------
    ndarray, shape (samples,)
        Without the filter's delay.
    """
    ratio = round(STEP_RATE_HZ / rate_hz)
    taps = anti_alias(ratio)
    delay = taps.size // 2
    seen = analog[round(-start * STEP_RATE_HZ) - delay :]
    filtered: FloatArray = signal.upfirdn(taps, seen, 1, ratio)
    return filtered[2 * delay // ratio :][: round(duration * rate_hz)]


@cache
def ac_coupling(time_constant: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator of ``s tau / (1 + s tau)`` on the integrator's grid."""
    numerator, denominator = signal.bilinear([time_constant, 0.0], [time_constant, 1.0], STEP_RATE_HZ)
    return numerator, denominator


def couple(acceleration: FloatArray, time_constant: float | None) -> FloatArray:
    """Pass a signal on the integrator's grid through first-order AC coupling, ``s tau / (1 + s tau)``."""
    if time_constant is None:
        return acceleration
    numerator, denominator = ac_coupling(time_constant)
    coupled, _ = signal.lfilter(
        numerator, denominator, acceleration, zi=[acceleration[0] * (1.0 - numerator[0])]
    )
    return np.asarray(coupled)


def strain_of(tension: FloatArray) -> FloatArray:
    """Invert Eq. 1 on its rising branch by Newton's method: tension [N] to strain [mm/m]."""
    first, second, third = CALIBRATION
    strain = (np.sqrt(first**2 + 4.0 * second * tension) - first) / (2.0 * second)  # without the cubic term
    for _ in range(3):
        excess = strain * (first + strain * (second + strain * third)) - tension
        strain -= excess / (first + strain * (2.0 * second + 3.0 * third * strain))
    return np.asarray(strain)


def drift(instruments: Instruments, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the slow drift of the apparent tension [N] at increasing times [s].

    Parameters
    ----------
    instruments : Instruments
        Largest steady rate [N/s] and random walk [N/sqrt(s)].
    time : ndarray, shape (steps,)
        Times [s].
    rng : numpy.random.Generator
        Source of both.

    Returns
    -------
    ndarray, shape (steps,)
        Apparent tension [N].
    """
    knots = np.arange(time[0], time[-1] + 0.2, 0.1)
    walk = np.cumsum(instruments.drift_walk * np.sqrt(0.1) * rng.standard_normal(knots.size))
    steady = instruments.drift_rate * rng.uniform(-1.0, 1.0)
    return np.interp(time, knots, walk + steady * knots)
