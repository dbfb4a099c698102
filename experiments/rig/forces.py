# ruff: noqa: ARG001 - every force has the arguments of its place
"""Undeclared forces in links and on bodies, without memory.

Each is ``f(t, x, v, T, k, s, p, ds) -> force [N]`` and pulls the first body of its link back; x, v: relative
displacement [m] and velocity [m/s] there, T: bolt tension [N], k: the link's stiffness [N/m], s, ds: its own
states and their slopes, p: its numbers. They call functions of ``math`` only, so that machine code kept on
disk never outlives its source.
"""

import math
from collections.abc import MutableSequence

from experiments.rig.kinds import Family, Kind, Number, constant

Array = MutableSequence[float]
LINKS: tuple[Family, ...] = ("joint", "ground")


def _coulomb(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return (p[0] + p[1] * T) * math.tanh(v / p[2])


def _speed_squared(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * v * abs(v)


def _shift_damping(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * v * abs(x)


def _cubic(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return max(p[0] * x**2, -0.9 * k) * x


def _quintic(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return max(p[0] * x**4, -0.9 * k) * x


def _even(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return max(p[0] * x, -0.9 * k) * x


def _softening(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    r: float = (abs(x) / p[1]) ** p[2]
    return -p[0] * k * x * r / (1.0 + r)


def _gap(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return math.copysign(p[0] * max(abs(x) - p[1], 0.0), x)


def _stop(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[2] * p[0] * max(p[2] * x - p[1], 0.0)


def _stiffened(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return -p[0] * k * math.expm1(-T / p[1]) * x


def _contact(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    softness: float = k * p[0] * (100.0 / max(T, 1.0)) ** p[1]
    return -k * x * softness / (1.0 + softness)


def _oscillating(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    now = max(T + x * (p[0] + p[1] * x), 0.0)
    mean = 1.0 + math.exp(p[2] * (T - p[3]))
    return k * x * (mean / (1.0 + math.exp(p[2] * (now - p[3]))) - 1.0)


def _constant(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return -p[0]


def _harmonic(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    angle = 2.0 * math.pi * p[2] * t
    return -(p[0] * math.cos(angle) + p[1] * math.sin(angle))


_CLEARANCE = Number(4e-5, "m", 1.5e-5, 1e-4)
_WIDE = {"k_g": Number(1e4, "N/m", 0.0, 1e5), "delta": Number(4e-4, "m", 2e-4, 8e-4)}

KINDS = (
    Kind(
        "coulomb-friction", LINKS, "joint", "(F_c + mu T) tanh(v / v_s)",
        {
            "F_c": Number(1.0, "N", 0.0, 5.0),
            "mu": Number(1.2e-3, "1", 0.0, 5e-3),
            "v_s": Number(1e-3, "m/s", 3e-4, 3e-3),
        },
        ("F_c", "mu"), _coulomb, "force", passive=True,
        elsewhere={"ground": {"F_c": Number(0.1, "N", 0.0, 0.5), "mu": constant(0.0)}},
    ),
    Kind(
        "quadratic-damping", LINKS, "joint", "c2 abs(v) v", {"c2": Number(1.7e3, "N s2/m2", 0.0, 1e4)},
        ("c2",), _speed_squared, "force", passive=True,
        elsewhere={"ground": {"c2": Number(45.0, "N s2/m2", 0.0, 200.0)}},
    ),
    Kind(
        "displacement-damping", LINKS, "joint", "c_x abs(x) v", {"c_x": Number(1.7e6, "N s/m2", 0.0, 1e7)},
        ("c_x",), _shift_damping, "force", passive=True,
        elsewhere={"ground": {"c_x": Number(1e4, "N s/m2", 0.0, 1e5)}},
    ),
    Kind(
        "cubic-stiffness", LINKS, "joint", "max(k3 x^2, -0.9 k) x",
        {"k3": Number(4.5e12, "N/m3", -6e12, 2e13)}, ("k3",), _cubic, "force",
        elsewhere={"ground": {"k3": Number(1e9, "N/m3", -2e9, 1e10)}},
    ),
    Kind(
        "quintic-stiffness", LINKS, "joint", "max(k5 x^4, -0.9 k) x",
        {"k5": Number(5e20, "N/m5", -5e20, 3e21)}, ("k5",), _quintic, "force",
        elsewhere={"ground": {"k5": Number(1e15, "N/m5", -2e15, 1e16)}},
    ),
    Kind(
        "even-stiffness", LINKS, "joint", "max(k2 x, -0.9 k) x",
        {"k2": Number(4.5e8, "N/m2", -2e9, 2e9)}, ("k2",), _even, "force",
        elsewhere={"ground": {"k2": Number(1e6, "N/m2", -4e6, 4e6)}},
    ),
    Kind(
        "microslip-softening", LINKS, "joint", "-alpha k x r / (1 + r), r = (abs(x) / x_s)^q",
        {
            "alpha": Number(0.16, "1", 0.0, 0.5),
            "x_s": Number(6e-5, "m", 2e-5, 1.5e-4),
            "q": Number(1.4, "1", 1.0, 2.0),
        },
        ("alpha",), _softening, "force",
        elsewhere={"ground": {"alpha": Number(0.03, "1", 0.0, 0.2), "x_s": Number(5e-4, "m", 2e-4, 1e-3)}},
    ),
    Kind(
        "two-sided-gap", LINKS, "joint", "k_g max(abs(x) - delta, 0) sign(x)",
        {"k_g": Number(7e5, "N/m", 0.0, 5e6), "delta": _CLEARANCE}, ("k_g",), _gap, "force",
        elsewhere={"ground": _WIDE},
    ),
    Kind(
        "one-sided-gap", LINKS, "joint", "side k_g max(side x - delta, 0)",
        {"k_g": Number(7e5, "N/m", 0.0, 5e6), "delta": _CLEARANCE, "side": Number(1.0, "1", -1.0, 1.0)},
        ("k_g",), _stop, "force", elsewhere={"ground": _WIDE},
    ),
    Kind(
        "tension-dependent-stiffness", ("ground",), "flexure_lo", "epsilon k (1 - exp(-T / T_g)) x",
        {"epsilon": Number(0.05, "1", -0.25, 0.25), "T_g": Number(450.0, "N", 100.0, 2000.0)},
        ("epsilon",), _stiffened, "force",
        elsewhere={"flexure_lo": {"epsilon": Number(0.05, "1", -0.1, 0.1)}},
    ),
    Kind(
        "contact-stiffness", ("joint",), "joint", "-k x y / (1 + y), y = k compliance (100 / max(T, 1))^n",
        {"compliance": Number(1.6e-7, "m/N", 0.0, 5e-7), "n": Number(0.6, "1", 0.33, 1.0)},
        ("compliance",), _contact, "force",
    ),
    Kind(
        "oscillating-tension-stiffness", ("joint",), "joint",
        "k x ((1 + exp(alpha (T - beta))) / (1 + exp(alpha (max(T + a x + b x^2, 0) - beta))) - 1)",
        {
            "a": Number(5e4, "N/m", -2e5, 2e5),
            "b": Number(1e9, "N/m2", 0.0, 1e10),
            "alpha": constant(-0.0608, "1/N"),
            "beta": constant(2.003, "N"),
        },
        ("a", "b"), _oscillating, "force",
    ),
    Kind(
        "constant-force", ("body",), "body:lo", "-F_0", {"F_0": Number(0.5, "N", -5.0, 5.0)}, ("F_0",),
        _constant, "force",
    ),
    Kind(
        "ground-motion", ("body",), "body:lo", "-(F_a cos(2 pi f t) + F_b sin(2 pi f t))",
        {
            "F_a": Number(0.02, "N", -0.2, 0.2),
            "F_b": Number(0.02, "N", -0.2, 0.2),
            "f": Number(10.0, "Hz", 3.0, 30.0),
        },
        ("F_a", "F_b"), _harmonic, "force", by_record="phase",
    ),
)  # fmt: skip
