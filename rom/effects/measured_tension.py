"""What a bolt's gauge shows beyond the tension of the model: slow changes, and what follows the motion."""

from __future__ import annotations

import math

from rom.effects.member import Member, parameter
from rom.kernels.elementwise import elementwise, times
from rom.model.effect import FloatArray, Motion, Numbers


@elementwise
def _log_creep(t: float, t_hit: float, A: float, t_0: float) -> float:
    return -A * math.log1p(max(t - t_hit, 0.0) / t_0)


@elementwise
def _stretched_creep(t: float, t_hit: float, A: float, tau: float, b: float) -> float:
    return A * math.expm1(-((max(t - t_hit, 0.0) / tau) ** b))


@elementwise
def _times_square(factor: float, x: float) -> float:
    return factor * x * x


def _relaxation_log(motion: Motion, p: Numbers) -> FloatArray:
    return _log_creep(motion.time, motion.impact_s, *p)


def _relaxation_stretched(motion: Motion, p: Numbers) -> FloatArray:
    return _stretched_creep(motion.time, motion.impact_s, *p)


def _drift(motion: Motion, p: Numbers) -> FloatArray:
    return times(p[0], motion.time)


def _follows_displacement(motion: Motion, p: Numbers) -> FloatArray:
    return times(p[0], motion.displacement)


def _follows_square(motion: Motion, p: Numbers) -> FloatArray:
    return _times_square(p[0], motion.displacement)


def _follows_force(motion: Motion, p: Numbers) -> FloatArray:
    if motion.link_force.shape != motion.time.shape:
        raise ValueError("a reading that follows the joint's force needs motion.link_force, got none")
    return times(p[0], motion.link_force)


def _follows_body(motion: Motion, p: Numbers) -> FloatArray:
    if not motion.body_displacement:
        raise ValueError("a reading that follows a body needs motion.body_displacement, got none")
    return times(p[0], next(iter(motion.body_displacement.values())))


_SLOW = ("slow tension",)
_IN_PHASE = ("tension in phase with motion",)
_GAUGE = "Sakai, JMMP 5, 627 (2011): bending of the bolt seen by its gauge"

MEMBERS = (
    Member(
        "relaxation-log",
        ("tension",),
        "F = -A * log(1 + max(t - t_hit, 0) / t_0)",
        {"A": parameter(0.3, "N", 0.0, 5.0), "t_0": parameter(0.05, "s", 1e-3, 1.0)},
        {"A": 0.1},
        _SLOW,
        "VDI 2230: embedding; logarithmic creep",
        _relaxation_log,
        inner={"t_0": (0.01, 0.05, 0.2)},
    ),
    Member(
        "relaxation-stretched",
        ("tension",),
        "F = -A * (1 - exp(-(max(t - t_hit, 0) / tau) ** b))",
        {
            "A": parameter(1.5, "N", 0.0, 20.0),
            "tau": parameter(0.5, "s", 0.01, 20.0),
            "b": parameter(0.6, "1", 0.3, 1.0),
        },
        {"A": 0.5},
        _SLOW,
        "VDI 2230: embedding; stretched exponential",
        _relaxation_stretched,
        inner={"tau": (0.05, 0.5, 5.0), "b": (0.5, 1.0)},
        core=False,
    ),
    Member(
        "tension-drift",
        ("tension",),
        "F = d * t",
        {"d": parameter(0.05, "N/s", -2.0, 2.0)},
        {"d": 0.01},
        _SLOW,
        "thermal expansion of bolt against plate: 25-40 N/K",
        _drift,
        by_record=("d",),
    ),
    Member(
        "tension-follows-displacement",
        ("tension",),
        "F = a * x",
        {"a": parameter(1e4, "N/m", -4e5, 4e5)},
        {"a": 1e3},
        _IN_PHASE,
        "He et al. (2025), section 2.4: oscillating part of the tension",
        _follows_displacement,
    ),
    Member(
        "tension-follows-displacement-squared",
        ("tension",),
        "F = b * x ** 2",
        {"b": parameter(2e8, "N/m2", -1e10, 1e10)},
        {"b": 1e7},
        ("tension at twice the frequency",),
        f"He et al. (2025), section 2.4; {_GAUGE}",
        _follows_square,
    ),
    Member(
        "tension-follows-joint-force",
        ("tension",),
        "F = c_F * F_J",
        {"c_F": parameter(0.02, "1", -0.5, 0.5)},
        {"c_F": 0.005},
        _IN_PHASE,
        _GAUGE,
        _follows_force,
        core=False,
    ),
    Member(
        "tension-follows-body",
        ("tension",),
        "F = d_b * x_b",
        {"d_b": parameter(2e3, "N/m", -4e4, 4e4)},
        {"d_b": 500.0},
        _IN_PHASE,
        "bending of a body seen by the gauge (of the first body)",
        _follows_body,
        core=False,
    ),
)
