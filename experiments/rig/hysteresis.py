# ruff: noqa: ARG001 - every force has the arguments of its place
"""Undeclared forces with memory: sliders, creep and masses of their own; arguments as in `forces`.

An element in series with a share kappa of the link's stiffness takes that share's place: what it adds is its
own force less ``kappa k x``.
"""

import math
from collections.abc import MutableSequence

from experiments.rig.kinds import Family, Kind, Number, constant

Array = MutableSequence[float]
LINKS: tuple[Family, ...] = ("joint", "ground")
_YIELDING_S = 2e-4  # in which a slider gives way once its limit has fallen below its force


def _jenkins(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    spring, limit = p[0] * k, p[1] + p[2] * T
    force = spring * (x - s[0])
    ds[0] = 0.0
    if abs(force) >= limit and v * force > 0.0:
        ds[0] = v
    if abs(force) > limit:
        ds[0] += math.copysign(abs(force) - limit, force) / (spring * _YIELDING_S)
    return min(max(force, -limit), limit) - spring * x


def _bouc_wen(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    z, reach = s[0], (abs(s[0]) / p[1]) ** p[2]
    ds[0] = v - (p[3] * abs(v) * math.copysign(1.0, z) + (1.0 - p[3]) * v) * reach
    return p[0] * k * (z - x)


def _lugre(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    spring = p[0] * k
    limit = max(p[1] * T * (1.0 + p[2] * math.exp(-((v / p[3]) ** 2))), 3e-7 * spring, 1e-12)
    ds[0] = v - spring * abs(v) * s[0] / limit
    return spring * (s[0] - x) + p[0] * p[4] * ds[0]


def _valanis(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    h = max(p[3] * math.copysign(1.0, v) * (p[1] * x - s[0]), -0.9)
    ds[0] = v * (1.0 + h) / (1.0 + p[2] * h)
    return p[0] * k * (s[0] - x)


def _maxwell(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    ds[0] = v - s[0] / p[1]
    return p[0] * k * s[0]


def _extra_mode(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    omega = 2.0 * math.pi * p[1]
    ds[0] = s[1]
    ds[1] = omega * (omega * (x - s[0]) + 2.0 * p[2] * (v - s[1]))
    return p[0] * ds[1]


KINDS = (
    Kind(
        "jenkins-slip", LINKS, "joint", "sat(kappa k (x - z), F_s + mu T) - kappa k x, dz/dt = v in slip",
        {
            "kappa": Number(0.6, "1", 0.0, 0.95),
            "F_s": constant(0.0, "N"),
            "mu": Number(0.12, "1", 0.05, 0.3),
        },
        ("kappa",), _jenkins, "force", 1, passive=True,
        elsewhere={
            "ground": {
                "kappa": Number(0.1, "1", 0.0, 0.5),
                "F_s": Number(0.1, "N", 0.05, 1.0),
                "mu": constant(0.0),
            }
        },
    ),
    Kind(
        "bouc-wen", LINKS, "joint",
        "kappa k (z - x), dz/dt = v - (beta abs(v) sign(z) + (1 - beta) v) (abs(z) / x_y)^n",
        {
            "kappa": Number(0.25, "1", 0.0, 0.6),
            "x_y": Number(6e-5, "m", 2e-5, 1.5e-4),
            "n": Number(1.5, "1", 1.0, 3.0),
            "beta": Number(0.5, "1", 0.5, 0.9),
        },
        ("kappa",), _bouc_wen, "force", 1, passive=True,
        elsewhere={"ground": {"kappa": Number(0.05, "1", 0.0, 0.3), "x_y": Number(3e-4, "m", 1e-4, 1e-3)}},
    ),
    Kind(
        "lugre", ("joint",), "joint",
        "kappa (k z + sigma dz/dt) - kappa k x, dz/dt = v - kappa k abs(v) z / g, "
        "g = mu T (1 + rise exp(-(v / v_s)^2))",
        {
            "kappa": Number(0.5, "1", 0.0, 0.9),
            "mu": Number(0.15, "1", 0.1, 0.25),
            "rise": Number(0.2, "1", 0.05, 0.5),
            "v_s": Number(5e-3, "m/s", 1e-3, 2e-2),
            "sigma": Number(30.0, "N s/m", 3.0, 100.0),
        },
        ("kappa",), _lugre, "force", 1,
    ),
    Kind(
        "valanis", ("joint",), "joint",
        "kappa k (z - x), dz/dt = v (1 + h) / (1 + curve h), h = steepness sign(v) (tangent x - z)",
        {
            "kappa": Number(0.5, "1", 0.0, 1.0),
            "tangent": Number(0.6, "1", 0.3, 0.9),
            "curve": Number(0.6, "1", 0.3, 0.9),
            "steepness": Number(3e4, "1/m", 1e4, 1e5),
        },
        ("kappa",), _valanis, "force", 1,
    ),
    Kind(
        "maxwell-viscoelastic", LINKS, "joint", "kappa k z, dz/dt = v - z / tau",
        {"kappa": Number(0.12, "1", 0.0, 0.3), "tau": Number(2e-3, "s", 3e-4, 5e-2)},
        ("kappa",), _maxwell, "force", 1, passive=True,
    ),
    Kind(
        "extra-mode", ("body",), "body:so", "m3 (w^2 (x - z) + 2 zeta3 w (v - dz/dt)), w = 2 pi f3",
        {
            "m3": Number(0.03, "kg", 0.0, 0.08),
            "f3": Number(250.0, "Hz", 80.0, 600.0),
            "zeta3": Number(0.02, "1", 0.005, 0.05),
        },
        ("m3",), _extra_mode, "force", 2, passive=True,
        elsewhere={"body:lo": {"m3": Number(0.3, "kg", 0.0, 0.5), "f3": Number(180.0, "Hz", 80.0, 400.0)}},
    ),
)  # fmt: skip
