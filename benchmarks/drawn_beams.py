"""Campaigns of a structure of few modes and several sensors, drawn from a seed.

Modal bodies on springs to the ground stand for a beam or a frame; accelerometers show their sum by the mode
shapes. Force and sensor stand at one place. What is hidden acts in one mode.
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
from rom.model.assembly import Response
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.signals.filters import for_straight_lines

SENSORS, PERIODS, MOST_SAMPLES = 4, 25.0, 3_000


def drawn(
    seed: int, folder: Path, undeclared: Sequence[Effect] | None = None
) -> tuple[str, Effect | None, float]:
    """Write the campaign of a seed; return its kind, what is hidden, and how much of it is felt in noise.

    Parameters
    ----------
    seed : int
        Decides all of it.
    folder : Path
        Where to write it.
    undeclared : sequence of Effect, optional
        One effect, or none, to hide in place of the one that is drawn.

    Raises
    ------
    EscapedError
        If what is hidden lets the motion escape.
    """
    rng = np.random.default_rng([seed, 42])
    model, hz = _modes(rng)
    shapes = rng.uniform(0.3, 1, (SENSORS, len(hz))) * rng.choice([-1, 1], (SENSORS, len(hz)))
    shapes[0] = np.abs(shapes[0])  # the drive point
    shapes /= np.abs(shapes).max(axis=0)
    rate_hz = hz[-1] * float(rng.uniform(6, 12))
    samples, size_m = int(min(PERIODS / hz[0] * rate_hz, MOST_SAMPLES)), 10 ** rng.uniform(-6, -2)
    names = model.structure.body_names
    place = int(rng.integers(len(hz)))
    scale = Scale(model.structure.bodies[place].mass * size_m * (2 * np.pi * hz[place]) ** 2, size_m,
                  size_m * 2 * np.pi * hz[place])  # fmt: skip
    hidden = drawn_effect(rng, model, scale, rate_hz, (names[place],)) if rng.random() < 0.7 else None
    if undeclared is not None:
        hidden = next(iter(undeclared), None)
    plant, noise, felt = (
        model if hidden is None else model.with_effect(hidden),
        10 ** rng.uniform(-4, -1.7),
        0.0,
    )
    records, settings = {}, []
    for number, share in enumerate(SHARES):
        force = _force(rng, hz, rate_hz, samples)
        force *= share * size_m / _largest(_moved(model, shapes, force, rate_hz))
        response = _moved(plant, shapes, force, rate_hz)
        if response.status != "ok":
            raise EscapedError(f"seed {seed}: found a hidden effect that lets the motion escape")
        clean = _shown(response, shapes)
        level = noise * clean.std(axis=1)
        other = _shown(_moved(model, shapes, force, rate_hz), shapes)
        felt = max(felt, float(np.max(np.sqrt(np.mean((clean - other) ** 2, axis=1)) / level)))
        rows = clean + level[:, None] * rng.normal(size=clean.shape)
        channels = {f"acceleration_p{k}": row for k, row in enumerate(rows)}
        seen = force[::FINER]
        channels["force_p0"] = seen + FORCE_NOISE * force.std() * rng.normal(size=len(seen))
        file = f"records/{number}.h5"
        records[file] = {name: Channel(name, y, rate_hz) for name, y in channels.items()}
        settings.append({"file": file, "test": "driven", "hold_out": number == len(SHARES) - 1})
    campaign = CampaignSettings.model_validate({
        "format": "boltlaw-campaign/1", "name": "modes", "modes": {"count": len(hz)}, "record": settings,
        "band": {"low_hz": 0.4 * hz[0], "high_hz": min(1.6 * hz[-1], 0.4 * rate_hz)},
        "sampling": {"motion_rate_hz": rate_hz, "pretrigger_s": 0.0},
    })  # fmt: skip
    write_campaign(folder, campaign, records.items())
    return "modes", hidden, felt


def _modes(rng: np.random.Generator) -> tuple[Model, FloatArray]:
    """Two or three modal bodies, named as `identify` names modes, and their frequencies [Hz]."""
    count = int(rng.integers(2, 4))
    hz = 10 ** rng.uniform(0, 3) * np.cumprod([1.0, *rng.uniform(1.8, 4.0, count - 1)])
    bodies, links, laws = [], [], {}
    mass = 10 ** rng.uniform(-3, 3)
    for k, own_hz in enumerate(hz.tolist()):
        name, own = f"mode_{k + 1}", mass * float(rng.uniform(0.5, 2))
        stiffness = own * (2 * np.pi * own_hz) ** 2
        damping = 2 * float(10 ** rng.uniform(-2.5, -1.5)) * np.sqrt(stiffness * own)
        bodies.append(Body(name, own))
        links.append(Link(name, name, "ground", "linear"))
        laws[name] = LinkLaws(constant_stiffness(stiffness), constant_damping(damping))
    return Model(Structure(tuple(bodies), tuple(links)), laws), hz


def _force(rng: np.random.Generator, hz: FloatArray, rate_hz: float, samples: int) -> FloatArray:
    """Sum of lines within the band, `FINER` than a record."""
    lines = np.linspace(0.5 * hz[0], 1.3 * hz[-1], 100)
    time_s = np.arange(samples * FINER) / (FINER * rate_hz)
    return np.asarray(
        np.cos(2 * np.pi * np.outer(time_s, lines) + rng.uniform(0, 2 * np.pi, 100)).sum(axis=1)
    )


def _moved(model: Model, shapes: FloatArray, force: FloatArray, rate_hz: float) -> Response:
    names = model.structure.body_names
    forces = {name: for_straight_lines(shapes[0, k] * force) for k, name in enumerate(names)}
    still = dict.fromkeys(names, 0.0)
    return model.simulate(forces, FINER * rate_hz, None, still, still)


def _largest(response: Response) -> float:
    return max(float(np.abs(x).max()) for x in response.displacement.values())


def _shown(response: Response, shapes: FloatArray) -> FloatArray:
    """Accelerations at the sensors, (sensors, samples)."""
    return np.asarray(shapes @ np.stack([*response.acceleration.values()]))[:, ::FINER]
