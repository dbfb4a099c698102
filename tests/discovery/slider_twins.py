"""Twins of a body on a spring beside a slider, under noise, integrated here with own code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rom
from rom.campaign.channels import FloatArray
from tests.discovery.driven_twins import campaign_of

MASS_KG, FREQUENCY_HZ, RATIO, SHARE, SLIP = 0.3, 5.0, 0.006, 0.15, 0.08
FINER, RATE_HZ, SECONDS = 64, 100.0, 5.0


def driven(folder: Path, quantity: str, size_m: float, noise: float = 2e-4, seed: int = 1) -> rom.Campaign:
    """Three records under multisines; the slider slips at ``SLIP`` of the largest motion, ``size_m``."""
    rng, records = np.random.default_rng(seed), {}
    for place, share in enumerate((1.0, 0.6, 0.8)):
        force, motion = _moved(share * size_m, size_m, rng)
        shown = motion[quantity]
        channels = {
            f"{quantity}_b": shown + noise * shown.std() * rng.normal(size=len(shown)),
            "force_b": force,
        }
        records[f"run_{place}.h5"] = ("driven", place == 2, channels, RATE_HZ)
    return campaign_of(folder, "b", "s", "linear", records, MASS_KG)


def _moved(
    wanted_m: float, size_m: float, rng: np.random.Generator
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Force at the samples, and motion under it; it runs smoothly between them."""
    time = np.arange(int(SECONDS * RATE_HZ * FINER)) / (RATE_HZ * FINER)
    lines, phases = np.arange(1.5, 7.0, 0.5), rng.uniform(0, 2 * np.pi, 11)
    unit = np.cos(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    spring = MASS_KG * (2 * np.pi * FREQUENCY_HZ) ** 2
    force = unit * spring * wanted_m / 12.0
    for _ in range(3):  # to the size that is wanted
        x, v = _integrated(force, spring, SLIP * size_m)
        force *= wanted_m / np.abs(x).max()
    x, v = _integrated(force, spring, SLIP * size_m)
    return force[::FINER], {"displacement": x[::FINER], "velocity": v[::FINER]}


def _integrated(force: FloatArray, spring: float, slip_m: float) -> tuple[FloatArray, FloatArray]:
    """Displacement and velocity by the leapfrog method; a share of the spring slips at a stretch."""
    step_s = 1 / (RATE_HZ * FINER)
    damping = 2 * RATIO * np.sqrt(spring * MASS_KG)
    x = v = stretch = 0.0
    found = np.empty((2, len(force)))
    for k, pull in enumerate(force.tolist()):
        found[:, k] = x, v
        restoring = (1 - SHARE) * spring * x + SHARE * spring * stretch + damping * v
        half = v + 0.5 * step_s * (pull - restoring) / MASS_KG
        moved = half * step_s
        x, stretch = x + moved, min(max(stretch + moved, -slip_m), slip_m)
        after = force[min(k + 1, len(force) - 1)]
        restoring = (1 - SHARE) * spring * x + SHARE * spring * stretch + damping * half
        v = half + 0.5 * step_s * (after - restoring) / MASS_KG
    return found[0], found[1]
