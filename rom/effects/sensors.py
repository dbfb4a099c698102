"""Faults of a sensor, from what is true to what its channel shows, and back: corrected, never a force."""

from __future__ import annotations

import math

import numpy as np

from rom.effects.member import OF_CHANNEL, Member, parameter
from rom.kernels.elementwise import elementwise, times
from rom.model.effect import FloatArray, Numbers


@elementwise
def _over(y: float, factor: float) -> float:
    return y / factor


@elementwise
def _plus(y: float, factor: float, other: float) -> float:
    return y + factor * other


@elementwise
def _by_sign(y: float, g: float) -> float:
    return y * (1.0 + math.copysign(g, y))


@elementwise
def _without_sign(y: float, g: float) -> float:
    return y / (1.0 + math.copysign(g, y))


@elementwise
def _beyond(y: float, f_0: float) -> float:
    return y + (math.copysign(f_0, y) if y != 0.0 else 0.0)


@elementwise
def _within(y: float, f_0: float) -> float:
    return math.copysign(max(abs(y) - f_0, 0.0), y)


@elementwise
def _line(sample: float, rate_hz: float, A: float, B: float, f: float) -> float:
    phase = 2.0 * math.pi * f / rate_hz * sample
    return A * math.cos(phase) + B * math.sin(phase)


@elementwise
def _parabola(y: float, T_0: float, c_1: float, c_2: float) -> float:
    return T_0 + y * (1.0 + c_1 + c_2 * y)


@elementwise
def _inverse_parabola(y: float, T_0: float, c_1: float, c_2: float) -> float:
    shown, slope = y - T_0, 1.0 + c_1
    return 2.0 * shown / (slope + math.sqrt(max(slope * slope + 4.0 * c_2 * shown, 0.0)))


def _gain(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return times(samples, 1.0 + p[0])


def _no_gain(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _over(samples, 1.0 + p[0])


def _signed(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _by_sign(samples, p[0])


def _unsigned(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _without_sign(samples, p[0])


def _dead(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _beyond(samples, p[0])


def _alive(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _within(samples, p[0])


def _late(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    """Delay by splines of fifth order; the first and last samples stand for what lies outside."""
    if p[0] == 0.0:
        return samples
    from scipy import ndimage

    shifted = ndimage.shift(samples - samples[0], p[0] * rate_hz, order=5, mode="nearest")
    return np.asarray(shifted + samples[0], dtype=np.float64)


def _early(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    return _late(samples, rate_hz, (-p[0],))


def _coupling(rate_hz: float, corner: float) -> tuple[list[float], list[float]]:
    """Bilinear ``s / (s + corner)`` scaled to a leading numerator of 1."""
    half = 0.5 * corner / rate_hz
    return [1.0, -1.0], [1.0 + half, half - 1.0]


def _coupled(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    if p[0] == 0.0:
        return samples
    from scipy import signal

    numerator, denominator = _coupling(rate_hz, p[0])
    return np.asarray(signal.lfilter(numerator, denominator, samples), dtype=np.float64)


def _uncoupled(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    if p[0] == 0.0:
        return samples
    from scipy import signal

    numerator, denominator = _coupling(rate_hz, p[0])
    return np.asarray(signal.lfilter(denominator, numerator, samples), dtype=np.float64)


def _hum(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    return samples + _line(np.arange(samples.size), rate_hz, *p)


def _no_hum(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:
    return samples - _line(np.arange(samples.size), rate_hz, *p)


def _calibration(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _parabola(samples, *p)


def _recalibrated(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _inverse_parabola(samples, *p)


def _biased(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _plus(samples, p[0], 1.0)


def _unbiased(samples: FloatArray, rate_hz: float, p: Numbers) -> FloatArray:  # noqa: ARG001
    return _plus(samples, -p[0], 1.0)


def _crossed(samples: FloatArray, rate_hz: float, p: Numbers, other: FloatArray) -> FloatArray:  # noqa: ARG001
    return _plus(samples, p[0], other)


def _uncrossed(samples: FloatArray, rate_hz: float, p: Numbers, other: FloatArray) -> FloatArray:  # noqa: ARG001
    return _plus(samples, -p[0], other)


_GAIN = {"g": parameter(0.03, "1", -0.5, 0.5)}

MEMBERS = (
    Member(
        "force-gain",
        ("sensor:force",),
        "y = (1 + g) * y_true",
        _GAIN,
        {"g": 0.01},
        ("gain",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 7: sensitivity",
        _gain,
        _no_gain,
    ),
    Member(
        "force-gain-signed",
        ("sensor:force",),
        "y = (1 + g * sign(y_true)) * y_true",
        {"g": parameter(0.05, "1", -0.5, 0.5)},
        {"g": 0.02},
        ("signed gain",),
        "constant of a motor that differs for the two directions of its current",
        _signed,
        _unsigned,
        core=False,
    ),
    Member(
        "force-dead-zone",
        ("sensor:force",),
        "y = y_true + f_0 * sign(y_true)",
        {"f_0": parameter(5.0, "N", 0.0, 50.0)},
        {"f_0": 0.5},
        ("dead zone",),
        "a drive that makes no force up to f_0",
        _dead,
        _alive,
        core=False,
    ),
    Member(
        "acceleration-gain",
        ("sensor:acceleration",),
        "y = (1 + g) * y_true",
        _GAIN,
        {"g": 0.01},
        ("gain",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 7: sensitivity",
        _gain,
        _no_gain,
    ),
    Member(
        "tension-skew",
        ("sensor:tension",),
        "y(t) = y_true(t - tau)",
        {"tau": parameter(5e-4, "s", -1e-2, 1e-2)},
        {"tau": 1e-4},
        ("tension skew",),
        "He et al. (2025), section 2.3: tension is sampled by another module",
        _late,
        _early,
        linear=False,
    ),
    Member(
        "acceleration-skew",
        ("sensor:acceleration",),
        "y(t) = y_true(t - tau)",
        {"tau": parameter(1e-4, "s", -1e-3, 1e-3)},
        {"tau": 2e-5},
        ("frequency-dependent damping", "acceleration skew"),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 11: channels sampled in turn",
        _late,
        _early,
        linear=False,
    ),
    Member(
        "ac-coupling",
        ("sensor:acceleration",),
        "y' + r * y = y_true'",
        {"r": parameter(2.0, "1/s", 0.0, 20.0)},
        {"r": 0.5},
        ("low-frequency response",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 7: r = 1 / time constant",
        _coupled,
        _uncoupled,
        linear=False,
    ),
    Member(
        "hum",
        ("sensor:acceleration", "sensor:force", "sensor:tension"),
        "y = y_true + A * cos(2 * pi * f * t) + B * sin(2 * pi * f * t)",
        {
            "A": parameter(0.1, OF_CHANNEL, -10.0, 10.0),
            "B": parameter(0.1, OF_CHANNEL, -10.0, 10.0),
            "f": parameter(50.0, "Hz", 40.0, 70.0),
        },
        {"A": 0.02, "B": 0.02},
        ("hum",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 11: lines of the mains",
        _hum,
        _no_hum,
        inner={"f": (50.0, 60.0)},
        by_record=("A", "B"),
    ),
    Member(
        "calibration-error",
        ("sensor:tension",),
        "y = T_0 + (1 + c_1) * y_true + c_2 * y_true ** 2",
        {
            "T_0": parameter(2.0, "N", -50.0, 50.0),
            "c_1": parameter(0.1, "1", -0.5, 1.0),
            "c_2": parameter(0.0, "1/N", -1e-4, 1e-4),
        },
        {"T_0": 0.5, "c_1": 0.02, "c_2": 1e-6},
        ("calibration",),
        "He et al. (2025), section 2.4, Eq. 1",
        _calibration,
        _recalibrated,
    ),
    Member(
        "acceleration-bias",
        ("sensor:acceleration",),
        "y = y_true + b",
        {"b": parameter(0.1, "m/s2", -5.0, 5.0)},
        {"b": 0.02},
        ("acceleration offset",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 11: offset of an amplifier",
        _biased,
        _unbiased,
    ),
    Member(
        "cross-axis",
        ("sensor:acceleration",),
        "y = y_true + epsilon * y_other",
        {"epsilon": parameter(0.02, "1", -0.2, 0.2)},
        {"epsilon": 0.01},
        ("cross-axis",),
        "A. Brandt, Noise and Vibration Analysis, Wiley (2011), chapter 7: transverse sensitivity",
        _crossed,
        _uncrossed,
        core=False,
        other="acceleration",
    ),
)
