"""Undeclared signs in the measured tension, which leave motion and bolt alone."""

from typing import NamedTuple

import numpy as np

from experiments.rig.excitation import FloatArray
from experiments.rig.kinds import Family, Kind, Number

TENSION: tuple[Family, ...] = ("tension",)
Numbers = tuple[float, ...]


class Seen(NamedTuple):
    """What a gauge might see: time from the record's first sample and since the hit [s], motion, force."""

    time: FloatArray
    since: FloatArray
    x: FloatArray
    v: FloatArray
    joint_force: FloatArray
    x_lo: FloatArray


def _log(seen: Seen, p: Numbers) -> FloatArray:
    return -p[0] * np.log(1.0 + seen.since / p[1])


def _stretched(seen: Seen, p: Numbers) -> FloatArray:
    return -p[0] * (1.0 - np.exp(-((seen.since / p[1]) ** p[2])))


def _drift(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * seen.time


def _with_shift(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * seen.x


def _with_square(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * seen.x**2


def _with_force(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * seen.joint_force


def _with_body(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * seen.x_lo


def _with_speed(seen: Seen, p: Numbers) -> FloatArray:
    return p[0] * np.abs(seen.v)


KINDS = (
    Kind(
        "relaxation-log", TENSION, "tension", "-A log(1 + t / t_0), t from the hit",
        {"A": Number(0.3, "N", 0.0, 1.0), "t_0": Number(0.05, "s", 0.01, 0.2)}, ("A",), _log, "reading",
    ),
    Kind(
        "relaxation-stretched", TENSION, "tension", "-A (1 - exp(-(t / tau)^b)), t from the hit",
        {
            "A": Number(1.5, "N", 0.0, 5.0),
            "tau": Number(0.5, "s", 0.05, 5.0),
            "b": Number(0.6, "1", 0.3, 1.0),
        },
        ("A",), _stretched, "reading",
    ),
    Kind(
        "tension-drift", TENSION, "tension", "d t, of another size in every record",
        {"d": Number(0.05, "N/s", -0.3, 0.3)}, ("d",), _drift, "reading", by_record="size",
    ),
    Kind(
        "tension-follows-displacement", TENSION, "tension", "a x", {"a": Number(1e4, "N/m", -1e5, 1e5)},
        ("a",), _with_shift, "reading",
    ),
    Kind(
        "tension-follows-displacement-squared", TENSION, "tension", "b x^2",
        {"b": Number(2e8, "N/m2", 0.0, 5e9)}, ("b",), _with_square, "reading",
    ),
    Kind(
        "tension-follows-joint-force", TENSION, "tension", "c_F (k_C x + c_C v)",
        {"c_F": Number(0.02, "1", -0.1, 0.1)}, ("c_F",), _with_force, "reading",
    ),
    Kind(
        "tension-follows-body", TENSION, "tension", "d_b x_lo", {"d_b": Number(2e3, "N/m", -1e4, 1e4)},
        ("d_b",), _with_body, "reading",
    ),
    Kind(
        "outside-tension-follows-speed", TENSION, "tension", "c_s abs(v)",
        {"c_s": Number(20.0, "N s/m", -200.0, 200.0)}, ("c_s",), _with_speed, "reading",
    ),
)  # fmt: skip
