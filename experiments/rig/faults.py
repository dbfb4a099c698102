# ruff: noqa: ARG001 - every fault has the arguments of its place
"""Undeclared faults of a channel, on the analog signal: before filter, noise, quantisation and clipping.

Each is ``f(analog, time, p, other) -> analog`` on the integrator's grid; time [s] counts from the record's
first sample, other: the acceleration of the other body.
"""

import numpy as np
from scipy import ndimage

from experiments.rig.excitation import STEP_RATE_HZ, FloatArray
from experiments.rig.kinds import Family, Kind, Number
from experiments.rig.sensors import couple

Numbers = tuple[float, ...]
ACCELERATION: tuple[Family, ...] = ("sensor:acceleration",)
SO = "sensor:acceleration_so"


def _gain(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return (1.0 + p[0]) * analog


def _late(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    if p[0] == 0.0:
        return analog
    # About the first value: the tension's height would cost the spline its digits.
    shifted = ndimage.shift(analog - analog[0], p[0] * STEP_RATE_HZ, order=3, mode="nearest")
    return np.asarray(analog[0] + shifted, dtype=np.float64)


def _coupled(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return couple(analog, 1.0 / p[0] if p[0] > 0.0 else None)


def _hum(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    angle = 2.0 * np.pi * p[2] * time
    return np.asarray(analog + p[0] * np.cos(angle) + p[1] * np.sin(angle))


def _calibration(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return p[0] + (1.0 + p[1]) * analog + p[2] * analog**2


def _bias(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return analog + p[0]


def _crossed(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return analog + p[0] * other


def _compressed(analog: FloatArray, time: FloatArray, p: Numbers, other: FloatArray) -> FloatArray:
    return np.asarray(analog / (1.0 + p[0] * np.abs(analog)))


KINDS = (
    Kind(
        "force-gain", ("sensor:force",), "sensor:force_lo", "(1 + g) y", {"g": Number(0.03, "1", -0.1, 0.1)},
        ("g",), _gain, "fault",
    ),
    Kind(
        "acceleration-gain", ACCELERATION, SO, "(1 + g) y", {"g": Number(0.03, "1", -0.1, 0.1)},
        ("g",), _gain, "fault",
    ),
    Kind(
        "tension-skew", ("sensor:tension",), "sensor:tension", "y(t - tau)",
        {"tau": Number(5e-4, "s", -4e-3, 4e-3)}, ("tau",), _late, "fault",
    ),
    Kind(
        "acceleration-skew", ACCELERATION, SO, "y(t - tau)", {"tau": Number(1e-4, "s", -2e-4, 2e-4)},
        ("tau",), _late, "fault",
    ),
    Kind(
        "ac-coupling", ACCELERATION, SO, "dy/dt + r y = dy_true/dt", {"r": Number(2.0, "1/s", 0.0, 10.0)},
        ("r",), _coupled, "fault",
    ),
    Kind(
        "hum", ("sensor:acceleration", "sensor:force", "sensor:tension"), SO,
        "y + A cos(2 pi f t) + B sin(2 pi f t)",
        {
            "A": Number(0.1, "m/s2", -0.5, 0.5),
            "B": Number(0.1, "m/s2", -0.5, 0.5),
            "f": Number(50.0, "Hz", 49.9, 50.1),
        },
        ("A", "B"), _hum, "fault", by_record="phase",
        elsewhere={
            family: {"A": Number(0.3, "N", -3.0, 3.0), "B": Number(0.3, "N", -3.0, 3.0)}
            for family in ("sensor:force", "sensor:tension")
        },
    ),
    Kind(
        "calibration-error", ("sensor:tension",), "sensor:tension", "T_0 + (1 + c_1) y + c_2 y^2",
        {
            "T_0": Number(2.0, "N", -10.0, 10.0),
            "c_1": Number(0.1, "1", -0.4, 0.6),
            "c_2": Number(0.0, "1/N", -5e-5, 5e-5),
        },
        ("T_0", "c_1", "c_2"), _calibration, "fault",
    ),
    Kind(
        "acceleration-bias", ACCELERATION, SO, "y + b", {"b": Number(0.1, "m/s2", -0.5, 0.5)}, ("b",),
        _bias, "fault",
    ),
    Kind(
        "cross-axis", ACCELERATION, SO, "y + epsilon y_other", {"epsilon": Number(0.02, "1", -0.1, 0.1)},
        ("epsilon",), _crossed, "fault",
    ),
    Kind(
        "outside-compression", ACCELERATION, SO, "y / (1 + s abs(y))",
        {"s": Number(2e-3, "s2/m", 0.0, 2e-2)}, ("s",), _compressed, "fault",
    ),
)  # fmt: skip
