# ruff: noqa: ARG001 - effects have the arguments of their place
"""Sliders in a link with a stiffness of their own, which is no share of the link's.

Functions call none but those of ``math``, so that machine code on disk never outlives its source.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]


def _backlash_slip(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    spring, z = max(p[0], 1e-9), x - s[0]
    limit = max(p[1] + p[2] * T, spring * 1e-10)
    force = spring * max(abs(z) - 0.5 * p[3], 0.0)
    over = force - limit
    ds[0] = 0.0
    if v * z > 0.0:  # towards slip: the last two-hundredth of the limit is reached smoothly
        u = min(max(1.0 + 200.0 * over / limit, 0.0), 1.0)
        ds[0] = v * u * u * (3.0 - 2.0 * u)
    if over > 0.0:  # the limit fell below the force: the slider gives way as it moves, and at rest in 0.2 s
        ds[0] += math.copysign(2.0 * abs(v) * min(over / limit, 1.0) + over / spring / 0.2, z)
    return math.copysign(min(force, limit), z) if p[0] > 0.0 else 0.0


def _elastic_slip(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    spring, z = max(p[0], 1e-9), x - s[0]
    limit = max(p[1] + p[2] * T, spring * 1e-10)
    force = spring * abs(z)
    over = force - limit
    ds[0] = 0.0
    if v * z > 0.0:
        u = min(max(1.0 + 200.0 * over / limit, 0.0), 1.0)
        ds[0] = v * u * u * (3.0 - 2.0 * u)
    if over > 0.0:
        ds[0] += math.copysign(2.0 * abs(v) * min(over / limit, 1.0) + over / spring / 0.2, z)
    return math.copysign(min(force, limit), z) if p[0] > 0.0 else 0.0


_SLIDER = (
    "o = max(f - L, 0); u = min(max(1 + 200 * (f - L) / L, 0), 1); F = min(f, L) * sign(x - z1); "
    "dz1/dt = v * step(v * (x - z1)) * u * u * (3 - 2 * u) "
    "+ sign(x - z1) * (2 * abs(v) * min(o / L, 1) + o / (k_t * 0.2))"
)
_NUMBERS = {
    "k_t": parameter(3e5, "N/m", 0.0, 1e7),
    "F_s": parameter(10.0, "N", 0.0, 500.0),
    "mu": parameter(0.0, "1", 0.0, 1.0),
}
_AT_GROUND = {"k_t": parameter(1e4, "N/m", 0.0, 1e6), "F_s": parameter(0.3, "N", 0.0, 100.0)}
_ENDS = {"mu": (0.0, math.inf)}

MEMBERS = (
    Member(
        "elastic-slip",
        ("joint", "ground"),
        f"L = max(F_s + mu * T, k_t * 1e-10); f = k_t * abs(x - z1); {_SLIDER}",
        _NUMBERS,
        {"k_t": 1e5},
        ("slip",),
        "Segalman, SAND2002-3828; Dahl's bristle that slips at once",
        _elastic_slip,
        state_units=("m",),
        inner={"F_s": (1.0, 3.0, 10.0)},
        linear=False,
        passive=True,
        core=False,
        ground=_AT_GROUND,
        ends=_ENDS,
        limits=("F_s", "mu"),
        springless=True,
    ),
    Member(
        "backlash-slip",
        ("joint", "ground"),
        f"L = max(F_s + mu * T, k_t * 1e-10); f = k_t * max(abs(x - z1) - b / 2, 0); {_SLIDER}",
        {**_NUMBERS, "b": parameter(2e-5, "m", 0.0, 2e-4)},
        {"k_t": 1e5},
        ("slip",),
        "Segalman, SAND2002-3828, with the play of a loose fit in series",
        _backlash_slip,
        state_units=("m",),
        inner={"F_s": (1.0, 3.0, 10.0), "b": (3e-6, 1e-5, 3e-5)},
        linear=False,
        passive=True,
        core=False,
        ground={**_AT_GROUND, "b": parameter(3e-5, "m", 0.0, 2e-3)},
        ends=_ENDS,
        limits=("F_s", "mu"),
        needs=("b",),
        contains=("jenkins-slip", "elastic-slip"),
    ),
)
