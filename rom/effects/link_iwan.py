# ruff: noqa: ARG001 - effects have the arguments of their place
"""The four-parameter Iwan joint: sliders in parallel whose limits follow a power law, and one at its end.

Of the density ``R phi^chi`` up to ``phi_max`` four sliders are left, each with the stiffness and the limit of
its part, so that the whole has its stiffness and its limit exactly.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from rom.effects.member import Member, parameter

Array = MutableSequence[float]


def _iwan(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    spring, beta, a = max(p[0] * k, 1e-9), p[4], p[3] + 1.0
    limit = max(p[1] + p[2] * T, spring * 1e-10)
    last = limit * (1.0 + beta) / (spring * (beta + a / (a + 1.0)))
    slipped, lower, lower_moment, edge, doubled = 0.0, 0.0, 0.0, 0.125, 2.0**a
    upper = 0.125**a
    for i in range(5):
        share, reach = beta, last
        if i < 4:
            share = upper - lower
            reach = last * a / (a + 1.0) * (edge * upper - lower_moment) / share
            lower, lower_moment = upper, edge * upper
            upper, edge = upper * doubled, 2.0 * edge
        z = x - s[i]
        over = abs(z) - reach
        ds[i] = 0.0
        if v * z > 0.0:
            u = min(max(1.0 + 10.0 * over / reach, 0.0), 1.0)
            ds[i] = v * u * u * (3.0 - 2.0 * u)
        if over > 0.0:
            ds[i] += math.copysign(2.0 * abs(v) * min(over / reach, 1.0) + over / 0.2, z)
        slipped += share * s[i]
    return -p[0] * k * slipped / (1.0 + beta)


def _slider(i: int) -> str:
    """Reach, slip rate and share of the slipped path of one slider, as text."""
    upper, lower = f"{0.125 * 2.0**i:g}", f"{0.0625 * 2.0**i:g}"
    share = f"({upper} ** a - {lower} ** a)" if i else f"{upper} ** a"
    moment = f"({upper} ** (a + 1) - {lower} ** (a + 1))" if i else f"{upper} ** (a + 1)"
    reach = "d" if i == 4 else f"d * a / (a + 1) * {moment} / ({share})"
    y, z = f"y{i + 1}", f"z{i + 1}"
    return (
        f"w{i + 1} = {'beta' if i == 4 else share}; r{i + 1} = {reach}; {y} = x - {z}; "
        f"o{i + 1} = max(abs({y}) - r{i + 1}, 0); "
        f"u{i + 1} = min(max(1 + 10 * (abs({y}) / r{i + 1} - 1), 0), 1); "
        f"d{z}/dt = v * step(v * {y}) * u{i + 1} * u{i + 1} * (3 - 2 * u{i + 1}) "
        f"+ sign({y}) * (2 * abs(v) * min(o{i + 1} / r{i + 1}, 1) + o{i + 1} / 0.2)"
    )


_EQUATION = "; ".join(
    [
        "L = max(F_s + mu * T, kappa * k * 1e-10); a = chi + 1",
        "d = L * (1 + beta) / (kappa * k * (beta + a / (a + 1)))",
        *(_slider(i) for i in range(5)),
        "F = -kappa * k * (w1 * z1 + w2 * z2 + w3 * z3 + w4 * z4 + w5 * z5) / (1 + beta)",
    ]
)

MEMBERS = (
    Member(
        "iwan-slip",
        ("joint", "ground"),
        _EQUATION,
        {
            "kappa": parameter(0.6, "1", 0.0, 0.95),
            "F_s": parameter(0.0, "N", 0.0, 100.0),
            "mu": parameter(0.15, "1", 0.0, 1.0),
            "chi": parameter(-0.5, "1", -0.9, 0.0),
            "beta": parameter(1.0, "1", 0.0, 5.0),
        },
        {"kappa": 0.2},
        ("slip",),
        "Segalman, SAND2002-3828, four-parameter model",
        _iwan,
        state_units=("m",) * 5,
        inner={"mu": (0.05, 0.15, 0.3), "chi": (-0.7, -0.3)},
        linear=False,
        passive=True,
        core=False,
        ground={
            "kappa": parameter(0.1, "1", 0.0, 0.95),
            "F_s": parameter(0.3, "N", 0.0, 100.0),
            "mu": parameter(0.0, "1", 0.0, 1.0),
        },
        ends={"kappa": (0.0, 1.0), "mu": (0.0, math.inf)},
        limits=("F_s", "mu"),
    ),
)
