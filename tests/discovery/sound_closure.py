"""Closed loops as `discovery.close_loop` returns them, made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discovery.detection.limit import NEVER, DetectionLimit
from discovery.localisation.force_map import ForceMap
from discovery.localisation.localise import Localisation, Profile
from discovery.loop.result import Closure, FoundEffect, LookAlike, Screened, Step
from rom.effects import CATALOGUE, ModelCorrection, free_form
from rom.evaluation.error_measures import Errors
from rom.model.laws import Parameter
from rom.parameters.he_2025 import paper_model

LADDER = "several force levels at one preload"


def errors(scale: float, records: int) -> Errors:
    there = bool(records)
    return Errors(
        motion_nrmse=0.0123 * scale if there else None,
        relative_motion_nrmse=0.0821 * scale if there else None,
        final_tension_error_percent_mean=0.4 * scale if there else None,
        final_tension_error_percent_median=0.2 * scale if there else None,
        final_tension_error_percent_max=2.0 * scale if there else None,
        tension_loss_error_percent_median=5.25 * scale if there else None,
        link_force_nrmse=None,
        tension_rmse_n=0.31 * scale if there else None,
        tension_course_within_band=0.93 if there else None,
        records=records,
        failed=0,
    )


def localisation(scale: float, p: float) -> Localisation:
    def profile(*labels: str) -> Profile:
        share = np.linspace(0.4, 1.6, len(labels))
        return tuple((label, float(1 + (scale - 1) * s)) for label, s in zip(labels, share, strict=True))

    return Localisation(
        by_channel=profile("tension", "acceleration_so", "acceleration_lo"),
        by_test=profile("coupled", "loosening"),
        by_frequency=profile("100-400 Hz", "40-100 Hz", "5-40 Hz"),
        by_preload=profile("below 30 N", "30-300 N", "above 300 N"),
        by_amplitude=profile("0 to 10 um", "10 to 50 um", "50 um and more"),
        whiteness_p=p,
        total=scale,
    )


def force_map(place: str, scale: float = 1.0) -> ForceMap:
    """A force that is friction for the most part; where both are negative there was no motion."""
    edges = np.array([-30.0, -10.0, -3.0, -1.0, 1.0, 3.0, 10.0, 30.0])
    centres = (edges[1:] + edges[:-1]) / 2
    force = np.tanh(scale * np.subtract.outer(centres, 0.05 * centres))
    force[:2, :2] = np.nan
    phase = np.linspace(0.0, 19.0, 100)
    loop = {"displacement_m": 1e-5 * np.sin(phase), "force_n": scale * np.tanh(3 * np.cos(phase))}
    return ForceMap(
        place, 1e-6 * edges, 1e-3 * edges, force, level=10.0 * scale, level_positive=9.0, level_negative=11.0,
        explained=0.8, explained_p=0.001, elastic=0.1, rest=0.1, work_per_cycle_j=4e-5,
        cosine_displacement=0.0, cosine_velocity=0.8, cosine_chance=0.05, loop=loop,
    )  # fmt: skip


def with_limits(effect: ModelCorrection, width: float = 0.1) -> ModelCorrection:
    numbers = {
        name: replace(p, low=p.value - width * abs(p.value), high=p.value + width * abs(p.value))
        for name, p in effect.parameters.items()
    }
    return replace(effect, parameters=numbers)


def friction() -> FoundEffect:
    effect = CATALOGUE["coulomb-friction"].at("flexure_lo", ground=True)
    alike = (
        LookAlike("quadratic-damping", "flexure_lo", 1.07, LADDER),
        LookAlike("coulomb-friction", "joint", 3.2),
    )
    return FoundEffect(with_limits(effect), alike, "catalogue", 0.84, 0.002, (9, 10))


def threshold() -> FoundEffect:
    effect = CATALOGUE["loosening-threshold"].at("tension")
    alike = (
        LookAlike("loosening-power", "tension", 1.02, LADDER),
        LookAlike("loosening-slip-gate", "tension", 1.3),
    )
    return FoundEffect(with_limits(effect), alike, "catalogue", 0.31, 0.0, (4, 5))


def unknown_force() -> FoundEffect:
    numbers = {"a_1": Parameter(2.1e3, "N m^-1", 1.9e3, 2.3e3), "a_2": Parameter(-40.0, "N s m^-1")}
    effect = free_form("a_1 * abs(x) + a_2 * abs(v)", "joint", numbers)
    return FoundEffect(effect, (), "free-form", 0.6, float("nan"), (0, 0))


def skew() -> FoundEffect:
    effect = CATALOGUE["acceleration-skew"].at("sensor:acceleration_so")
    return FoundEffect(with_limits(effect), (), "catalogue", 0.9, 0.01, (5, 5))


SCREENED = (
    Screened("coulomb-friction", "flexure_lo", 0.83, 0.1),
    Screened("quadratic-damping", "flexure_lo", 0.79, 30.0),
    Screened("loosening-threshold", "tension", 0.2, 0.02),
    Screened("acceleration-gain", "sensor:acceleration_lo", 0.02, 0.01),
    Screened("extra-mode", "body:so", 0.003, 0.02),
)

LIMITS = (
    DetectionLimit("cubic-stiffness", "flexure_lo", "k3", "N/m3", 1.4e8, 0.58, 0.14, 2e8),
    DetectionLimit("cubic-stiffness", "joint", "k3", "N/m3", 9e11, 0.3, 0.2, 9e11),
    DetectionLimit("even-stiffness", "flexure_so", "k2", "N/m2", 1.3e6, 0.4, 1.3, None),
    DetectionLimit("constant-force", "body:lo", "F_0", "N", None, None, None, None, NEVER),
    DetectionLimit("tension-drift", "tension", "d", "N/s", None, None, None, None, "it is each record's own"),
)


def closure(*found: FoundEffect, verdict: str = "closed", hold_out: int = 10) -> Closure:
    """A loop in which these effects were found, one after the other."""
    model = paper_model()
    steps = [Step("", {"training": errors(8.0, 32), "hold_out": errors(8.2, hold_out)})]
    for place, effect in enumerate(found, 1):
        model = model.with_effect(effect.effect)
        scale = 8.0 / 3.0**place
        steps.append(
            Step(
                effect.effect.name, {"training": errors(scale, 32), "hold_out": errors(1.1 * scale, hold_out)}
            )
        )
    left = {"closed": (1.02, 0.31), "no-effect": (1.05, 0.4), "unexplained": (4.7, 1e-9)}[verdict]
    return Closure(
        verdict,  # type: ignore[arg-type]
        found,
        model,
        tuple(steps),
        localisation(38.0 if found else left[0], 1e-12),
        localisation(*left),
        SCREENED,
        ("records/loosening_004.h5: force_lo is clipped",),
        ("strain leaves the calibrated range in 2 records",),
        LIMITS,
    )
