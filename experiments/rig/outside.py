# ruff: noqa: ARG001 - every force has the arguments of its place
"""Undeclared forces that stand outside the catalogue of effects; arguments as in `forces`.

None of them is a member of it, so that no name of it is the right answer; but some act so much like one
that records hardly tell (`Kind.nearest`).
"""

import math
from collections.abc import MutableSequence

from experiments.rig.kinds import Family, Kind, Number

Array = MutableSequence[float]
LINKS: tuple[Family, ...] = ("joint", "ground")
EVERYWHERE = ("joint", "flexure_lo", "flexure_so")


def _dead_zone(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return math.copysign(p[0] * max(abs(v) - p[1], 0.0), v)


def _fractional(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * v * math.sqrt(abs(v))


def _cubic_damper(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * abs(x) ** 3 * v


def _one_sided(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * max(p[1] * x, 0.0) * v


def _skew(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * x * v


def _even_drag(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    return p[0] * v * v


def _fast(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    square = (v / p[1]) ** 2
    return -p[0] * k * x * square / (1.0 + square)


def _parametric(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    angle = 2.0 * math.pi * p[2] * t
    return k * x * (p[0] * math.cos(angle) + p[1] * math.sin(angle))


def _uneven_slip(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    spring = p[0] * k
    force = spring * (x - s[0])
    limit = p[1] if force > 0.0 else p[2]
    ds[0] = 0.0
    if abs(force) >= limit and v * force > 0.0:
        ds[0] = v
    if abs(force) > limit:
        ds[0] += math.copysign(abs(force) - limit, force) / (spring * 2e-4)
    return min(max(force, -p[2]), p[1]) - spring * x


def _wearing(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    ds[0] = v * v / p[1]
    return p[0] * k * x * math.expm1(-s[0])


def _rattling(t: float, x: float, v: float, T: float, k: float, s: Array, p: Array, ds: Array) -> float:
    gap, speed = x - s[0], v - s[1]
    ds[0] = s[1]
    ds[1] = 0.0
    if abs(gap) > p[1]:
        omega = 2.0 * math.pi * p[2]
        push = omega * (omega * (abs(gap) - p[1]) + 0.4 * math.copysign(speed, gap * speed))
        ds[1] = math.copysign(max(push, 0.0), gap)
    return p[0] * ds[1]


KINDS = (
    Kind(
        "outside-dead-zone-damper", LINKS, "joint", "c_z max(abs(v) - v_0, 0) sign(v)",
        {"c_z": Number(400.0, "N s/m", 0.0, 3000.0), "v_0": Number(0.015, "m/s", 0.005, 0.03)},
        ("c_z",), _dead_zone, "force", passive=True,
        elsewhere={
            "ground": {"c_z": Number(5.0, "N s/m", 0.0, 60.0), "v_0": Number(0.03, "m/s", 0.01, 0.06)}
        },
        nearest=dict.fromkeys(EVERYWHERE, "quadratic-damping"),
    ),
    Kind(
        "outside-fractional-drag", LINKS, "joint", "c_f abs(v)^0.5 v",
        {"c_f": Number(800.0, "N (s/m)^1.5", 0.0, 8000.0)}, ("c_f",), _fractional, "force", passive=True,
        elsewhere={"ground": {"c_f": Number(15.0, "N (s/m)^1.5", 0.0, 150.0)}},
        nearest=dict.fromkeys(EVERYWHERE, "quadratic-damping"),
    ),
    Kind(
        "outside-cubic-damper", LINKS, "joint", "c_3 abs(x)^3 v",
        {"c_3": Number(3e14, "N s/m4", 0.0, 5e15)}, ("c_3",), _cubic_damper, "force", passive=True,
        elsewhere={"ground": {"c_3": Number(1e10, "N s/m4", 0.0, 3e11)}},
        nearest=dict.fromkeys(EVERYWHERE, "displacement-damping"),
    ),
    Kind(
        "outside-one-sided-damper", LINKS, "joint", "c_1 max(side x, 0) v",
        {"c_1": Number(3e6, "N s/m2", 0.0, 4e7), "side": Number(1.0, "1", -1.0, 1.0)},
        ("c_1",), _one_sided, "force", passive=True,
        elsewhere={"ground": {"c_1": Number(1e4, "N s/m2", 0.0, 2e5)}},
        nearest=dict.fromkeys(EVERYWHERE, "displacement-damping"),
    ),
    Kind(
        "outside-skew-damper", LINKS, "joint", "c_k x v", {"c_k": Number(2e6, "N s/m2", -8e6, 8e6)},
        ("c_k",), _skew, "force",
        elsewhere={"ground": {"c_k": Number(1e4, "N s/m2", -1e5, 1e5)}},
        nearest={"joint": "displacement-damping"},
    ),
    Kind(
        "outside-even-drag", LINKS, "joint", "c_e v^2", {"c_e": Number(2e3, "N s2/m2", -2e4, 2e4)},
        ("c_e",), _even_drag, "force",
        elsewhere={"ground": {"c_e": Number(50.0, "N s2/m2", -400.0, 400.0)}},
    ),
    Kind(
        "outside-speed-softening", LINKS, "joint", "-alpha k x v^2 / (v^2 + v_r^2)",
        {"alpha": Number(0.2, "1", 0.0, 0.8), "v_r": Number(0.02, "m/s", 0.008, 0.05)},
        ("alpha",), _fast, "force",
        elsewhere={
            "ground": {"alpha": Number(0.03, "1", 0.0, 0.2), "v_r": Number(0.05, "m/s", 0.02, 0.1)}
        },
        nearest=dict.fromkeys(EVERYWHERE[1:], "microslip-softening"),
    ),
    Kind(
        "outside-parametric-stiffness", LINKS, "joint", "k x (a_c cos(2 pi f t) + a_s sin(2 pi f t))",
        {
            "a_c": Number(0.1, "1", -0.5, 0.5),
            "a_s": Number(0.1, "1", -0.5, 0.5),
            "f": Number(7.0, "Hz", 2.0, 12.0),
        },
        ("a_c", "a_s"), _parametric, "force", by_record="phase",
        elsewhere={"ground": {"a_c": Number(0.02, "1", -0.1, 0.1), "a_s": Number(0.02, "1", -0.1, 0.1)}},
    ),
    Kind(
        "outside-uneven-slip", ("joint",), "joint",
        "sat(kappa k (x - z), -F_minus, F_plus) - kappa k x, dz/dt = v in slip",
        {
            "kappa": Number(0.4, "1", 0.0, 0.9),
            "F_plus": Number(25.0, "N", 15.0, 40.0),
            "F_minus": Number(8.0, "N", 3.0, 12.0),
        },
        ("kappa",), _uneven_slip, "force", 1, passive=True,
    ),
    Kind(
        "outside-path-softening", ("joint",), "joint", "-alpha k x (1 - exp(-z)), dz/dt = v^2 / e_0",
        {"alpha": Number(0.2, "1", 0.0, 0.7), "e_0": Number(5e-5, "m2/s", 1e-5, 3e-4)},
        ("alpha",), _wearing, "force", 1,
    ),
    Kind(
        "outside-rattling-mass", ("body",), "body:so",
        "m_r a, a = w^2 (abs(x - z) - delta) and 0.4 w (v - dz/dt) at the stops; d2z/dt2 = a, w = 2 pi f_r",
        {
            "m_r": Number(0.04, "kg", 0.0, 0.2),
            "delta": Number(1e-4, "m", 3e-5, 2e-4),
            "f_r": Number(300.0, "Hz", 150.0, 500.0),
        },
        ("m_r",), _rattling, "force", 2, passive=True,
        nearest={"body:lo": "jenkins-slip"},
    ),
)  # fmt: skip
