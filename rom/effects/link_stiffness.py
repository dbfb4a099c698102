# ruff: noqa: ARG001 - effects have the arguments of their place
"""Restoring forces in a link without memory: polynomial, softening, gaps, and what the tension does.

A softening force never takes more than nine tenths of the link's own stiffness, so that no motion escapes.
Functions call none but those of ``math``, so that machine code on disk never outlives its source.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]
_KERSCHEN = "Kerschen et al., MSSP 20, 505 (2006)"
_GAP = "Rahmani and Ervin, Shock and Vibration 310834 (2014)"
_PAPER = "He et al. (2025)"


def _cubic(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return max(p[0] * x * x, -0.9 * k) * x


def _quintic(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return max(p[0] * x * x * x * x, -0.9 * k) * x


def _even(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return max(p[0] * x, -0.9 * k) * x


def _softening(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    r: float = (abs(x) / p[1]) ** p[2]
    return -p[0] * k * x * (1.0 - 1.0 / (1.0 + r))


def _two_sided_gap(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    edge = 0.01 * p[1]
    beyond = max(abs(x) - p[1] + 0.5 * edge, 0.0)
    force = p[0] * (beyond - 0.5 * edge if beyond > edge else 0.5 * beyond * beyond / edge)
    return force if x > 0.0 else -force


def _one_sided_gap(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    edge = 0.01 * p[1]
    beyond = max(p[2] * x - p[1] + 0.5 * edge, 0.0)
    return p[2] * p[0] * (beyond - 0.5 * edge if beyond > edge else 0.5 * beyond * beyond / edge)


def _tension_dependent(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return p[0] * k * (1.0 - math.exp(-T / p[1])) * x


def _contact(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    y: float = k * p[0] * (100.0 / max(T, 1.0)) ** p[1]
    return -k * x * y / (1.0 + y)


def _oscillating(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    now = max(T + p[0] * x + p[1] * x * x, 0.0)
    before = 1.0 + math.exp(min(p[2] * (T - p[3]), 300.0))
    return k * x * (before / (1.0 + math.exp(min(p[2] * (now - p[3]), 300.0))) - 1.0)


_CLEARANCE = {"delta": (1e-5, 3e-5, 6e-5, 1e-4)}

MEMBERS = (
    Member(
        "microslip-softening",
        ("joint", "ground"),
        "r = (abs(x) / x_s) ** q; F = -alpha * k * x * (1 - 1 / (1 + r))",
        {
            "alpha": parameter(0.16, "1", 0.0, 0.8),
            "x_s": parameter(6e-5, "m", 1e-5, 1e-3),
            "q": parameter(1.4, "1", 1.0, 2.0),
        },
        {"alpha": 0.05},
        ("softening",),
        "Daouk et al., JSV (2017); Lacayo, limits of modal Iwan models",
        _softening,
        inner={"x_s": (2e-5, 6e-5, 1.5e-4), "q": (1.0, 2.0)},
        ground={"alpha": parameter(0.03, "1", 0.0, 0.8), "x_s": parameter(5e-4, "m", 1e-5, 5e-3)},
    ),
    Member(
        "cubic-stiffness",
        ("joint", "ground"),
        "F = max(k3 * x ** 2, -0.9 * k) * x",
        {"k3": parameter(4.5e12, "N/m3", -6e12, 4e13)},
        {"k3": 1e12},
        ("odd stiffness",),
        _KERSCHEN,
        _cubic,
        ground={"k3": parameter(1e9, "N/m3", -5e9, 2e10)},
    ),
    Member(
        "quintic-stiffness",
        ("joint", "ground"),
        "F = max(k5 * x ** 4, -0.9 * k) * x",
        {"k5": parameter(5e20, "N/m5", -1e21, 6e21)},
        {"k5": 1e20},
        ("odd stiffness",),
        _KERSCHEN,
        _quintic,
        core=False,
        ground={"k5": parameter(1e15, "N/m5", -5e15, 2e16)},
    ),
    Member(
        "even-stiffness",
        ("joint", "ground"),
        "F = max(k2 * x, -0.9 * k) * x",
        {"k2": parameter(4.5e8, "N/m2", -4e9, 4e9)},
        {"k2": 1e8},
        ("even stiffness",),
        _KERSCHEN,
        _even,
        ground={"k2": parameter(1e6, "N/m2", -2e7, 2e7)},
    ),
    Member(
        "two-sided-gap",
        ("joint", "ground"),
        "e = 0.01 * delta; b = max(abs(x) - delta + 0.5 * e, 0); "
        "F = k_g * where(b > e, b - 0.5 * e, 0.5 * b * b / e) * sign(x)",
        {"k_g": parameter(7e5, "N/m", 0.0, 1e7), "delta": parameter(4e-5, "m", 5e-6, 6e-4)},
        {"k_g": 1e5},
        ("gap", "odd stiffness"),
        _GAP,
        _two_sided_gap,
        inner=_CLEARANCE,
        needs=("delta",),
        ground={"k_g": parameter(1e4, "N/m", 0.0, 1e6), "delta": parameter(4e-4, "m", 5e-6, 5e-3)},
    ),
    Member(
        "one-sided-gap",
        ("joint", "ground"),
        "e = 0.01 * delta; b = max(side * x - delta + 0.5 * e, 0); "
        "F = side * k_g * where(b > e, b - 0.5 * e, 0.5 * b * b / e)",
        {
            "k_g": parameter(7e5, "N/m", 0.0, 1e7),
            "delta": parameter(4e-5, "m", 5e-6, 6e-4),
            "side": parameter(1.0, "1", -1.0, 1.0),
        },
        {"k_g": 1e5},
        ("gap",),
        f"{_PAPER}; {_GAP}",
        _one_sided_gap,
        inner={**_CLEARANCE, "side": (-1.0, 1.0)},
        needs=("delta",),
        ground={"k_g": parameter(1e4, "N/m", 0.0, 1e6), "delta": parameter(4e-4, "m", 5e-6, 5e-3)},
    ),
    Member(
        "tension-dependent-stiffness",
        ("ground",),
        "F = epsilon * k * (1 - exp(-T / T_g)) * x",
        {"epsilon": parameter(0.05, "1", -0.5, 0.5), "T_g": parameter(450.0, "N", 50.0, 4000.0)},
        {"epsilon": 0.01},
        ("support stiffness",),
        f"{_PAPER}, section 3.2",
        _tension_dependent,
        inner={"T_g": (100.0, 450.0, 2000.0)},
        tensioned=True,
    ),
    Member(
        "contact-stiffness",
        ("joint",),
        "y = k * compliance * (100 / max(T, 1)) ** n; F = -k * x * y / (1 + y)",
        {"compliance": parameter(1.6e-7, "m/N", 0.0, 1e-6), "n": parameter(0.6, "1", 0.33, 1.0)},
        {"compliance": 5e-8},
        ("joint stiffness over tension",),
        "Greenwood and Williamson, Proc. R. Soc. A 295, 300 (1966); exponents of rough contact as in tmd-lab",
        _contact,
        inner={"n": (0.33, 0.66, 1.0)},
        linear=False,
        tensioned=True,
    ),
    Member(
        "oscillating-tension-stiffness",
        ("joint",),
        "F = k * x * ((1 + exp(alpha * (T - beta))) "
        "/ (1 + exp(alpha * (max(T + a * x + b * x ** 2, 0) - beta))) - 1)",
        {
            "a": parameter(5e4, "N/m", -4e5, 4e5),
            "b": parameter(1e9, "N/m2", -2e10, 2e10),
            "alpha": parameter(-0.0608, "1/N", -10.0, -1e-4),
            "beta": parameter(2.003, "N", -1e3, 1e4),
        },
        {"a": 1e4, "b": 1e8},
        ("oscillating stiffness",),
        f"{_PAPER}, Eq. 5 at the oscillating tension",
        _oscillating,
        linear=False,
        of_stiffness=("alpha", "beta"),
        tensioned=True,
    ),
)
