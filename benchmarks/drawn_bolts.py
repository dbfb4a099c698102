"""Campaigns of a bolt at rest, drawn from a seed: ``benchmarks.drawn_campaigns``.

The tension stays, creeps, relaxes or drifts, under white noise; own equations.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.drawn_campaigns import SHARES
from rom.campaign.campaign import CampaignSettings, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.effects import CATALOGUE, ModelCorrection

CURVES = ("relaxation-log", "relaxation-stretched", "tension-drift")


def drawn(seed: int, folder: Path) -> tuple[str, ModelCorrection | None, float]:
    """Write the campaign of a seed; return its kind, what is hidden, and how much of it is felt in noise."""
    rng = np.random.default_rng([seed, 41])
    tension_n, rate_hz = 10 ** rng.uniform(2, 6), 10 ** rng.uniform(-1, 3)
    samples = int(rng.uniform(600, 4000))
    noise_n = tension_n * 10 ** rng.uniform(-4.5, -2.5)
    name = CURVES[int(rng.integers(len(CURVES)))]
    numbers = _numbers(rng, name, noise_n * 10 ** rng.uniform(0.3, 1.5), samples / rate_hz)
    hidden = _effect(name, numbers) if rng.random() < 0.7 else None
    records, settings, felt = {}, [], 0.0
    for place, share in enumerate(SHARES):
        time_s = np.arange(int(samples * (1.5 - 0.5 * share))) / rate_hz
        change = np.zeros_like(time_s) if hidden is None else _curve(hidden, time_s)
        felt = max(felt, float(change.std()) / noise_n)
        shown = tension_n * (1 + 0.1 * rng.normal()) + change + noise_n * rng.normal(size=len(time_s))
        file = f"records/{place}.h5"
        records[file] = {"tension": Channel("tension", shown, rate_hz)}
        settings.append({"file": file, "test": "hold", "hold_out": place == len(SHARES) - 1})
    campaign = CampaignSettings.model_validate({
        "format": "boltlaw-campaign/1", "name": "bolt at rest",
        "sampling": {"tension_rate_hz": rate_hz}, "record": settings,
    })  # fmt: skip
    write_campaign(folder, campaign, records.items())
    return "bolt at rest", hidden, felt


def _numbers(rng: np.random.Generator, name: str, size_n: float, length_s: float) -> dict[str, float]:
    """Of a curve that changes by about a size [N] over a record."""
    time_s = length_s * 10 ** rng.uniform(-1.5, -0.3)
    if name == "relaxation-log":
        return {"A": size_n / np.log1p(length_s / time_s), "t_0": time_s}
    if name == "relaxation-stretched":
        return {"A": size_n, "tau": time_s, "b": float(rng.uniform(0.5, 1.0))}
    return {"d": size_n / length_s * float(rng.choice([-1.0, 1.0]))}


def _effect(name: str, numbers: dict[str, float]) -> ModelCorrection:
    effect = CATALOGUE[name].at("tension")
    wide = {n: replace(p, bounds=(-np.inf, np.inf)) for n, p in effect.parameters.items()}
    return replace(effect, parameters=wide).with_values(**numbers)


def _curve(effect: ModelCorrection, time_s: FloatArray) -> FloatArray:
    """Change of the tension [N] since the start."""
    p = {name: number.value for name, number in effect.parameters.items()}
    if effect.name == "relaxation-log":
        return np.asarray(-p["A"] * np.log1p(time_s / p["t_0"]))
    if effect.name == "relaxation-stretched":
        return np.asarray(p["A"] * np.expm1(-((time_s / p["tau"]) ** p["b"])))
    return np.asarray(p["d"] * time_s)
