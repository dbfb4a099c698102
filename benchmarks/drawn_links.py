"""Campaigns of a link that is cycled on its own, drawn from a seed: ``benchmarks.drawn_campaigns``.

Cycles swell and fade about a frequency; half of the campaigns are cut from longer runs, the others grow from
rest. The force of the link is that of a spring and a damper, and of what is hidden.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.drawn_campaigns import FINER, FORCE_NOISE, SHARES, EscapedError, drawn_effect
from discovery.explain.scales import Scale
from rom.campaign.campaign import CampaignSettings, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.effects import Effect
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

CYCLES, LEAD = 12.0, 4.0
"""Of a record, and before it."""


def drawn(seed: int, folder: Path) -> tuple[str, Effect | None, float]:
    """Write the campaign of a seed; return its kind, what is hidden, and how much of it is felt in noise.

    Raises
    ------
    EscapedError
        If what is hidden gives a force beyond all bounds.
    """
    rng = np.random.default_rng([seed, 40])
    stiffness, first_hz, size_m = (10 ** rng.uniform([1, -1.5, -8], [9, 1.5, -1])).tolist()
    damping = stiffness / (2 * np.pi * first_hz) * 10 ** rng.uniform(-2, -0.5)
    laws = {"s0": LinkLaws(constant_stiffness(stiffness), constant_damping(damping))}
    model = Model(Structure((Body("b0", 1.0),), (Link("s0", "b0", "ground", "linear"),)), laws)
    rate_hz = first_hz * float(rng.uniform(60, 200))
    scale = Scale(stiffness * size_m, size_m, size_m * 2 * np.pi * first_hz)
    hidden = drawn_effect(rng, model, scale, rate_hz, ("s0",)) if rng.random() < 0.7 else None
    plant = model if hidden is None else model.with_effect(hidden)
    cut, noise, felt = bool(rng.random() < 0.5), 10 ** rng.uniform(-4, -1.7), 0.0
    records, settings = {}, []
    for place, share in enumerate(SHARES):
        lead = int(LEAD * rate_hz / first_hz) * FINER if cut else 0
        x = share * size_m * _cycles(rng, first_hz, rate_hz, lead, grows=not cut)
        force = plant.link_force("s0", x, FINER * rate_hz)[lead::FINER]
        if not np.isfinite(force).all():
            raise EscapedError(f"seed {seed}: found a hidden effect whose force escapes")
        level = noise * float(force.std())
        felt = max(felt, _beyond_linear(x[lead:], FINER * rate_hz, force) / level)
        shown = {"link_displacement_s0": x[lead::FINER] + FORCE_NOISE * x.std() * rng.normal(size=len(force)),
                 "link_force_s0": force + level * rng.normal(size=len(force))}  # fmt: skip
        file = f"records/{place}.h5"
        records[file] = {name: Channel(name, y, rate_hz) for name, y in shown.items()}
        settings.append({"file": file, "test": "cycled", "hold_out": place == len(SHARES) - 1})
    write_campaign(folder, _settings(rate_hz, settings), records.items())
    return "cycled link", hidden, felt


def _cycles(
    rng: np.random.Generator, first_hz: float, rate_hz: float, lead: int, *, grows: bool
) -> FloatArray:
    """Displacement over its largest, `FINER` times as many samples as a record has, after some before it."""
    samples = lead + int(CYCLES * rate_hz / first_hz) * FINER
    phase = 2 * np.pi * first_hz * float(rng.uniform(0.8, 1.25)) * np.arange(samples) / (FINER * rate_hz)
    slow, at = rng.uniform(0, 2 * np.pi, 2)
    envelope = 0.8 + 0.2 * np.sin(0.17 * phase + slow)
    if grows:
        return np.asarray(envelope * np.tanh(phase / (2 * np.pi * 4)) * np.sin(phase))
    return np.asarray(envelope * np.sin(phase + at))


def _beyond_linear(x: FloatArray, fine_hz: float, force: FloatArray) -> float:
    """RMS of what a spring, a damper and an offset do not imitate of a force [N]."""
    columns = np.stack([x, np.gradient(x) * fine_hz, np.ones_like(x)], axis=1)[::FINER]
    size = np.linalg.norm(columns, axis=0)
    left = force - columns @ (np.linalg.lstsq(columns / size, force, rcond=None)[0] / size)
    return float(np.sqrt(np.mean(left**2)))


def _settings(rate_hz: float, record: Sequence[dict[str, object]]) -> CampaignSettings:
    return CampaignSettings.model_validate({
        "format": "boltlaw-campaign/1", "name": "cycled link", "record": record,
        "body": [{"name": "b0"}], "link": [{"name": "s0", "between": ["b0", "ground"], "law": "linear"}],
        "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0},
    })  # fmt: skip
