# ruff: noqa: ARG001 - effects have the arguments of their place
"""Friction and hysteresis in a link: forces that depend on the sign of the velocity or on the past.

A slider in series with a share kappa of the link's stiffness takes that share's place: what it adds to the
link is its own force minus ``kappa k x``. Its state is the path that it has slipped, zero as long as it
sticks. Functions call none but those of ``math``, so that machine code on
disk never outlives its source.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]
_KAPPA = {"kappa": 0.1}
_SHARE = {"kappa": (0.0, 1.0)}  # all of a link may slip
_SLIDER = {**_SHARE, "mu": (0.0, math.inf)}
_BENDS = {**_SHARE, "beta": (0.5, 4.0)}
"""Below 2 all of the share slips in the end; above, it is stiffer on every way out, and stiffer still on the
way back, so that a closed motion always loses energy. Joints slip: elsewhere either is possible."""


def _coulomb(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return (p[0] + p[1] * T) * math.tanh(v / p[2])


def _jenkins(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    spring, z = p[0] * k, x - s[0]
    limit = max(p[1] + p[2] * T, spring * 1e-10)
    force = spring * z
    over = abs(force) - limit
    ds[0] = 0.0
    if v * z > 0.0:  # towards slip: the last two-hundredth of the limit is reached smoothly
        u = min(max(1.0 + 200.0 * over / max(limit, 1e-300), 0.0), 1.0)
        ds[0] = v * u * u * (3.0 - 2.0 * u)
    if over > 0.0:  # the limit fell below the force: the slider gives way as it moves, and at rest in 0.2 s
        ds[0] += math.copysign(2.0 * abs(v) * min(over / limit, 1.0) + over / spring / 0.2, z)
    return min(max(force, -limit), limit) - spring * x


def _bouc_wen(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    z = x - s[0]
    r = min(abs(z) / p[1], 10.0) ** p[2]
    sign = 1.0 if z >= 0.0 else -1.0
    ds[0] = (min(p[3], 1.0) * abs(v) * sign + (1.0 - p[3]) * v) * r
    return -p[0] * k * s[0]


def _lugre(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    u = min(abs(v) / p[3], 20.0)
    g = max(p[1] * T * (1.0 + p[2] * math.exp(-u * u)), p[0] * k * 1e-10, 1e-30)
    ds[0] = p[0] * k * abs(v) * (x - s[0]) / g if p[0] > 0.0 else 0.0
    return p[0] * (p[4] * (v - ds[0]) - k * s[0])


def _valanis(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    sign = 1.0 if v >= 0.0 else -1.0
    h = max(p[3] * sign * (s[0] - (1.0 - p[1]) * x), -0.9)
    ds[0] = v - v * (1.0 + h) / (1.0 + p[2] * h)
    return -p[0] * k * s[0]


def _quadratic_damping(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return p[0] * abs(v) * v


def _displacement_damping(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return p[0] * abs(x) * v


def _maxwell(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    ds[0] = v - s[0] / p[1]
    return p[0] * k * s[0]


MEMBERS = (
    Member(
        "coulomb-friction",
        ("joint", "ground"),
        "F = (F_c + mu * T) * tanh(v / v_s)",
        {
            "F_c": parameter(1.0, "N", 0.0, 10.0),
            "mu": parameter(1.2e-3, "1", 0.0, 1.0),
            "v_s": parameter(1e-3, "m/s", 3e-4, 3e-3),
        },
        {"F_c": 0.2, "mu": 3e-4},
        ("friction",),
        "Liang and Feeny, Nonlinear Dynamics 16, 337 (1998)",
        _coulomb,
        inner={"v_s": (3e-4, 1e-3, 3e-3)},
        passive=True,
        ground={"F_c": parameter(0.1, "N", 0.0, 10.0), "mu": parameter(0.0, "1", 0.0, 0.01)},
    ),
    Member(
        "jenkins-slip",
        ("joint", "ground"),
        "L = max(F_s + mu * T, kappa * k * 1e-10); f = kappa * k * (x - z1); o = max(abs(f) - L, 0); "
        "u = min(max(1 + 200 * (abs(f) - L) / L, 0), 1); F = min(max(f, -L), L) - kappa * k * x; "
        "dz1/dt = v * step(v * f) * u * u * (3 - 2 * u) "
        "+ sign(f) * (2 * abs(v) * min(o / L, 1) + o / (kappa * k * 0.2))",
        {
            "kappa": parameter(0.6, "1", 0.0, 0.95),
            "F_s": parameter(0.0, "N", 0.0, 100.0),
            "mu": parameter(0.12, "1", 0.0, 1.0),
        },
        {"kappa": 0.2},
        ("slip",),
        "Segalman, SAND2002-3828; equations as in tmdsimpy (jenkins)",
        _jenkins,
        state_units=("m",),
        inner={"mu": (0.05, 0.12, 0.3), "F_s": (0.03, 0.1, 0.3, 1.0)},
        linear=False,
        passive=True,
        ground={
            "kappa": parameter(0.1, "1", 0.0, 0.95),
            "F_s": parameter(0.1, "N", 0.0, 100.0),
            "mu": parameter(0.0, "1", 0.0, 1.0),
        },
        ends=_SLIDER,
        limits=("F_s", "mu"),
    ),
    Member(
        "bouc-wen",
        ("joint", "ground"),
        "z = x - z1; r = min(abs(z) / x_y, 10) ** n; F = -kappa * k * z1; "
        "dz1/dt = (min(beta, 1) * abs(v) * sign(z) + (1 - beta) * v) * r",
        {
            "kappa": parameter(0.25, "1", 0.0, 0.8),
            "x_y": parameter(6e-5, "m", 1e-5, 1e-3),
            "n": parameter(1.5, "1", 1.0, 3.0),
            "beta": parameter(0.5, "1", 0.5, 1.0),
        },
        _KAPPA,
        ("smooth hysteresis",),
        "Wen, J. Eng. Mech. Div. 102, 249 (1976)",
        _bouc_wen,
        state_units=("m",),
        inner={"x_y": (2e-5, 6e-5, 1.5e-4), "beta": (0.5, 2.5)},
        passive=True,
        ground={"kappa": parameter(0.05, "1", 0.0, 0.8), "x_y": parameter(3e-4, "m", 1e-5, 1e-2)},
        ends=_BENDS,
    ),
    Member(
        "lugre",
        ("joint",),
        "u = min(abs(v) / v_s, 20); g = max(mu * T * (1 + rise * exp(-u * u)), kappa * k * 1e-10, 1e-30); "
        "w = kappa * k * abs(v) * (x - z1) / g; F = kappa * (sigma * (v - w) - k * z1); dz1/dt = w",
        {
            "kappa": parameter(0.5, "1", 0.0, 0.9),
            "mu": parameter(0.15, "1", 0.02, 0.4),
            "rise": parameter(0.2, "1", 0.0, 0.5),
            "v_s": parameter(5e-3, "m/s", 1e-3, 2e-2),
            "sigma": parameter(30.0, "N s/m", 0.0, 100.0),
        },
        {"kappa": 0.2},
        ("slip",),
        "Pennestri et al., Nonlinear Dynamics 83, 1785 (2015)",
        _lugre,
        state_units=("m",),
        inner={"mu": (0.05, 0.15)},
        linear=False,
        core=False,
        ends=_SHARE,
    ),
    Member(
        "valanis",
        ("joint",),
        "h = max(steepness * sign(v) * (z1 - (1 - tangent) * x), -0.9); F = -kappa * k * z1; "
        "dz1/dt = v - v * (1 + h) / (1 + curve * h)",
        {
            "kappa": parameter(0.5, "1", 0.0, 1.0),
            "tangent": parameter(0.6, "1", 0.3, 0.9),
            "curve": parameter(0.6, "1", 0.3, 0.9),
            "steepness": parameter(3e4, "1/m", 1e4, 1e5),
        },
        _KAPPA,
        ("smooth hysteresis",),
        "Gaul and Lenz, Acta Mechanica 125, 169 (1997)",
        _valanis,
        state_units=("m",),
        inner={"tangent": (0.4, 0.8)},
        core=False,
    ),
    Member(
        "quadratic-damping",
        ("joint", "ground"),
        "F = c2 * abs(v) * v",
        {"c2": parameter(1.7e3, "N s2/m2", 0.0, 2e4)},
        {"c2": 300.0},
        ("amplitude-dependent damping",),
        "Kerschen et al., MSSP 20, 505 (2006)",
        _quadratic_damping,
        passive=True,
        ground={"c2": parameter(45.0, "N s2/m2", 0.0, 400.0)},
    ),
    Member(
        "displacement-damping",
        ("joint", "ground"),
        "F = c_x * abs(x) * v",
        {"c_x": parameter(1.7e6, "N s/m2", 0.0, 2e7)},
        {"c_x": 3e5},
        ("amplitude-dependent damping",),
        "Kerschen et al., MSSP 20, 505 (2006)",
        _displacement_damping,
        passive=True,
        ground={"c_x": parameter(1e4, "N s/m2", 0.0, 2e5)},
    ),
    Member(
        "maxwell-viscoelastic",
        ("joint", "ground"),
        "F = kappa * k * z1; dz1/dt = v - z1 / tau",
        {"kappa": parameter(0.12, "1", 0.0, 0.6), "tau": parameter(2e-3, "s", 2e-4, 5e-2)},
        {"kappa": 0.05},
        ("frequency-dependent damping",),
        "Maxwell element: Christensen, Theory of Viscoelasticity (1982)",
        _maxwell,
        state_units=("m",),
        inner={"tau": (3e-4, 2e-3, 1e-2, 5e-2)},
        passive=True,
    ),
)
