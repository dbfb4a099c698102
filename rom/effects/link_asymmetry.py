# ruff: noqa: ARG001 - effects have the arguments of their place
"""Friction, damping and stiffness of a link that differ with direction, speed, position or amplitude.

Functions call none but those of ``math``, so that machine code on disk never outlives its source.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]
_OLSSON = "Olsson et al., European Journal of Control 4, 176 (1998)"


def _asymmetric_friction(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return (p[0] if v > 0.0 else p[1]) * math.tanh(v / p[2])


def _stribeck(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    u = min(abs(v) / p[2], 20.0)
    return (p[0] + p[1] * math.exp(-u * u)) * math.tanh(v / p[3])


def _position_friction(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    angle = 2.0 * math.pi * x / p[2]
    return (p[0] * math.cos(angle) + p[1] * math.sin(angle)) * math.tanh(v / p[3])


def _asymmetric_damping(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return p[0] * abs(v)


def _bilinear(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return min(max(p[0], -0.9 * k), 0.9 * k) * abs(x)


def _amplitude(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    r: float = (abs(x) / p[2]) ** p[3]
    return -p[0] * k * x * (1.0 - 1.0 / (1.0 + r)) + p[1] * abs(x) * v


_LEVEL = parameter(1.0, "N", 0.0, 10.0)
_LEVEL_AT_GROUND = parameter(0.1, "N", 0.0, 10.0)
_TURN = parameter(1e-3, "m/s", 3e-4, 3e-3)
_TURNS = (3e-4, 1e-3, 3e-3)

MEMBERS = (
    Member(
        "asymmetric-friction",
        ("joint", "ground"),
        "F = where(v > 0, F_p, F_n) * tanh(v / v_s)",
        {"F_p": _LEVEL, "F_n": parameter(0.5, "N", 0.0, 10.0), "v_s": _TURN},
        {"F_p": 0.2, "F_n": 0.2},
        ("friction",),
        f"{_OLSSON}, levels by direction",
        _asymmetric_friction,
        inner={"v_s": _TURNS},
        passive=True,
        core=False,
        ground={"F_p": _LEVEL_AT_GROUND, "F_n": parameter(0.05, "N", 0.0, 10.0)},
        contains=("coulomb-friction",),
    ),
    Member(
        "stribeck-friction",
        ("joint", "ground"),
        "u = min(abs(v) / v_b, 20); F = (F_c + F_d * exp(-u * u)) * tanh(v / v_s)",
        {
            "F_c": _LEVEL,
            "F_d": parameter(0.5, "N", 0.0, 10.0),
            "v_b": parameter(1e-2, "m/s", 1e-3, 0.1),
            "v_s": _TURN,
        },
        {"F_c": 0.2, "F_d": 0.2},
        ("friction",),
        _OLSSON,
        _stribeck,
        inner={"v_b": (3e-3, 1e-2, 3e-2), "v_s": (3e-4, 1e-3)},
        passive=True,
        core=False,
        ground={"F_c": _LEVEL_AT_GROUND, "F_d": parameter(0.05, "N", 0.0, 10.0)},
        contains=("coulomb-friction",),
    ),
    Member(
        "position-friction",
        ("joint", "ground"),
        "u = 2 * pi * x / p; F = (F_a * cos(u) + F_b * sin(u)) * tanh(v / v_s)",
        {
            "F_a": parameter(0.3, "N", -10.0, 10.0),
            "F_b": parameter(0.3, "N", -10.0, 10.0),
            "p": parameter(2e-4, "m", 2e-5, 4e-4),
            "v_s": _TURN,
        },
        {"F_a": 0.1, "F_b": 0.1},
        ("friction",),
        "Armstrong-Helouvry, Control of Machines with Friction, Kluwer (1991): screws and guides",
        _position_friction,
        inner={"p": (5e-5, 1e-4, 2e-4, 4e-4), "v_s": (3e-4, 1e-3)},
        core=False,
        ground={
            "F_a": parameter(0.03, "N", -10.0, 10.0),
            "F_b": parameter(0.03, "N", -10.0, 10.0),
            "p": parameter(2e-3, "m", 2e-4, 4e-3),
        },
        contains=("coulomb-friction",),
        strict=("p",),
        springless=True,
    ),
    Member(
        "asymmetric-damping",
        ("joint", "ground"),
        "F = c_a * abs(v)",
        {"c_a": parameter(50.0, "N s/m", -1e3, 1e3)},
        {"c_a": 10.0},
        ("asymmetric damping",),
        f"{_OLSSON}, viscous part by direction",
        _asymmetric_damping,
        core=False,
        ground={"c_a": parameter(5.0, "N s/m", -100.0, 100.0)},
    ),
    Member(
        "bilinear-stiffness",
        ("joint", "ground"),
        "F = min(max(k_a, -0.9 * k), 0.9 * k) * abs(x)",
        {"k_a": parameter(5e4, "N/m", -5e5, 5e5)},
        {"k_a": 1e4},
        ("even stiffness",),
        "Shaw and Holmes, JSV 90, 129 (1983): two stiffnesses, no clearance",
        _bilinear,
        core=False,
        ground={"k_a": parameter(1e3, "N/m", -1e4, 1e4)},
    ),
    Member(
        "amplitude-stiffness",
        ("joint", "ground"),
        "r = (abs(x) / x_s) ** q; F = -alpha * k * x * (1 - 1 / (1 + r)) + c_x * abs(x) * v",
        {
            "alpha": parameter(0.16, "1", 0.0, 0.8),
            "c_x": parameter(1.7e6, "N s/m2", 0.0, 2e7),
            "x_s": parameter(6e-5, "m", 1e-5, 1e-3),
            "q": parameter(1.4, "1", 1.0, 2.0),
        },
        {"alpha": 0.05, "c_x": 3e5},
        ("softening",),
        "Deaner et al., J. Vib. Acoust. 137, 021012 (2015): a bolted beam softens as its damping rises",
        _amplitude,
        inner={"x_s": (2e-5, 6e-5, 1.5e-4), "q": (1.0, 2.0)},
        passive=True,
        core=False,
        ground={
            "alpha": parameter(0.03, "1", 0.0, 0.8),
            "c_x": parameter(1e4, "N s/m2", 0.0, 2e5),
            "x_s": parameter(5e-4, "m", 1e-5, 5e-3),
        },
        contains=("microslip-softening", "displacement-damping"),
    ),
)
