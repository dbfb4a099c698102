# ruff: noqa: ARG001 - effects have the arguments of their place
"""Forces on one body: a mass of its own on a spring, a constant force, the motion of the ground.

Functions call none but those of ``math``, so that machine code on disk never outlives its source.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]


def _extra_mode(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    omega = 2.0 * math.pi * p[1]
    pull = omega * (omega * (x - s[0]) + 2.0 * p[2] * (v - s[1]))
    ds[0] = s[1]
    ds[1] = pull
    return p[0] * pull


def _constant(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return -p[0]


def _ground_motion(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    phase = 2.0 * math.pi * p[2] * t
    return -p[0] * math.cos(phase) - p[1] * math.sin(phase)


MEMBERS = (
    Member(
        "extra-mode",
        ("body",),
        "w = 2 * pi * f3; a = w * (w * (x - z1) + 2 * zeta3 * (v - z2)); F = m3 * a; dz1/dt = z2; dz2/dt = a",
        {
            "m3": parameter(0.03, "kg", 0.0, 0.6),
            "f3": parameter(250.0, "Hz", 40.0, 1000.0),
            "zeta3": parameter(0.02, "1", 0.001, 0.2),
        },
        {"m3": 0.01},
        ("extra mode",),
        "Den Hartog, Mechanical Vibrations (1956), section 3.2",
        _extra_mode,
        state_units=("m", "m/s"),
        starts=("x", "v"),
        inner={"f3": tuple(60.0 * 1.08**step for step in range(36))},
        passive=True,
        ends={"zeta3": (0.0, 1.0)},
        of_joint=True,
    ),
    Member(
        "constant-force",
        ("body",),
        "F = -F_0",
        {"F_0": parameter(0.5, "N", -50.0, 50.0)},
        {"F_0": 0.02},
        ("offset",),
        "offset of an amplifier, or gravity along the motion",
        _constant,
    ),
    Member(
        "ground-motion",
        ("body",),
        "F = -(F_a * cos(2 * pi * f * t) + F_b * sin(2 * pi * f * t))",
        {
            "F_a": parameter(0.02, "N", -2.0, 2.0),
            "F_b": parameter(0.02, "N", -2.0, 2.0),
            "f": parameter(10.0, "Hz", 1.0, 60.0),
        },
        {"F_a": 1e-3, "F_b": 1e-3},
        ("disturbance",),
        "He et al. (2025), beats of small impacts; force of a flexure whose foot moves: k x_g + c v_g",
        _ground_motion,
        inner={"f": (2.0, 5.0, 8.0, 12.0, 16.0, 24.0, 30.0)},
        by_record=("F_a", "F_b"),
    ),
)
