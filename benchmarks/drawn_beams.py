"""Campaigns of a structure by its modes, drawn from a seed: ``benchmarks.drawn_campaigns``.

Two to six modal bodies on springs to the ground stand for a beam or a frame; sensors of one quantity show
their sum by the mode shapes. The force acts where the first sensor stands; in half of the campaigns decays
stand beside the driven records. What is hidden acts in one mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from rom.signals.filters import for_straight_lines

KIND = "modes"
PERIODS, MOST_SAMPLES = 25.0, 4_000
QUANTITIES = ("acceleration", "acceleration", "velocity", "displacement")


@dataclass(frozen=True)
class Beam:
    """Modal bodies, their frequencies [Hz], shapes (sensors, modes), rate and samples of a record."""

    model: Model
    hz: FloatArray
    shapes: FloatArray
    rate_hz: float
    samples: int
    quantity: str

    def moved_by(self, test: str, size_m: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Force at the finer rate, and displacements at the start; the largest motion is about a size."""
        still, lines = np.zeros(len(self.hz)), np.linspace(0.5 * self.hz[0], 1.3 * self.hz[-1], 100)
        angles = 2 * np.pi * np.outer(np.arange(self.samples * FINER) / (FINER * self.rate_hz), lines)
        force = np.cos(angles + rng.uniform(0, 2 * np.pi, 100)).sum(axis=1)
        if test == "free":
            return 0 * force, size_m * rng.uniform(0.3, 1, len(still)) / (1 + np.arange(len(still)))
        moved = self.shown(self.model, force, still, "displacement")
        return np.asarray(force * size_m / float(np.abs(moved).max())), still

    def shown(self, model: Model, force: FloatArray, start: FloatArray, quantity: str = "") -> FloatArray:
        """What the sensors show of a quantity, at the finer rate, (sensors, samples).

        Raises
        ------
        EscapedError
            If the motion escapes.
        """
        names, still = model.structure.body_names, dict.fromkeys(model.structure.body_names, 0.0)
        forces = {n: for_straight_lines(by * force) for n, by in zip(names, self.shapes[0], strict=True)}
        at = dict(zip(names, start.tolist(), strict=True))
        moved = model.simulate(forces, FINER * self.rate_hz, None, at, still)
        if moved.status != "ok":
            raise EscapedError("found a hidden effect that lets the motion escape")
        rows = getattr(moved, quantity or self.quantity)
        return np.asarray(self.shapes @ np.stack([rows[n] for n in names]))


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
    rng = _generator(seed)
    beam, size_m = _beam(rng), 10 ** rng.uniform(-6, -2)
    place = int(rng.integers(len(beam.hz)))
    omega, body = 2 * np.pi * float(beam.hz[place]), beam.model.structure.bodies[place]
    scale = Scale(body.mass * size_m * omega**2, size_m, size_m * omega)
    wanted = bool(rng.random() < 0.7)
    hidden = drawn_effect(rng, beam.model, scale, beam.rate_hz, (body.name,)) if wanted else None
    if undeclared is not None:
        hidden = next(iter(undeclared), None)
    plant = beam.model if hidden is None else beam.model.with_effect(hidden)
    noise, felt = 10 ** rng.uniform(-4, -1.7), 0.0
    tests = ("free", "driven") * 2 if rng.random() < 0.5 else ("driven",) * 4
    records, settings = {}, []
    for number, (share, test) in enumerate(zip(SHARES, tests, strict=True)):
        force, start = beam.moved_by(test, share * size_m, rng)
        clean, linear = (beam.shown(m, force, start)[:, ::FINER] for m in (plant, beam.model))
        level = noise * clean.std(axis=1)
        felt = max(felt, float(np.max(np.sqrt(np.mean((clean - linear) ** 2, axis=1)) / level)))
        rows = clean + level[:, None] * rng.normal(size=clean.shape)
        channels = {f"{beam.quantity}_p{k}": row for k, row in enumerate(rows)}
        if test == "driven":
            seen = force[::FINER]
            channels["force_p0"] = seen + FORCE_NOISE * force.std() * rng.normal(size=len(seen))
        file = f"records/{number}.h5"
        records[file] = {name: Channel(name, y, beam.rate_hz) for name, y in channels.items()}
        settings.append({"file": file, "test": test, "hold_out": number == len(SHARES) - 1})
    write_campaign(folder, _settings(beam, settings), records.items())
    return KIND, hidden, felt


def drawn_beam(seed: int) -> Beam:
    """The structure of a seed's campaign."""
    return _beam(_generator(seed))


def _generator(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 42])


def _beam(rng: np.random.Generator) -> Beam:
    """Modal bodies, named as `identify` names modes, and sensors: one more than modes at least."""
    count = int(rng.integers(2, 7))
    hz = 10 ** rng.uniform(0, 3) * np.cumprod([1.0, *rng.uniform(1.3, 3.0, count - 1)])
    bodies, links, laws, mass = [], [], {}, 10 ** rng.uniform(-3, 3)
    for k, own_hz in enumerate(hz.tolist()):
        name, own = f"mode_{k + 1}", mass * float(rng.uniform(0.5, 2))
        stiffness = own * (2 * np.pi * own_hz) ** 2
        damping = 2 * float(10 ** rng.uniform(-2.5, -1.5)) * np.sqrt(stiffness * own)
        bodies.append(Body(name, own))
        links.append(Link(name, name, "ground", "linear"))
        laws[name] = LinkLaws(constant_stiffness(stiffness), constant_damping(damping))
    sensors = count + int(rng.integers(1, 3))
    shapes = rng.uniform(0.3, 1, (sensors, count)) * rng.choice([-1, 1], (sensors, count))
    shapes /= shapes[np.abs(shapes).argmax(axis=0), np.arange(count)]  # 1 where largest, as `identify` has it
    rate_hz = float(hz[-1]) * float(rng.uniform(6, 12))
    samples = int(min(PERIODS / hz[0] * rate_hz, MOST_SAMPLES))
    model = Model(Structure(tuple(bodies), tuple(links)), laws)
    return Beam(model, hz, shapes, rate_hz, samples, str(rng.choice(QUANTITIES)))


def _settings(beam: Beam, record: Sequence[dict[str, Any]]) -> CampaignSettings:
    high_hz = min(1.6 * float(beam.hz[-1]), 0.4 * beam.rate_hz)
    return CampaignSettings.model_validate({
        "format": "boltlaw-campaign/1", "name": KIND, "modes": {"count": len(beam.hz)}, "record": record,
        "band": {"low_hz": 0.4 * float(beam.hz[0]), "high_hz": high_hz},
        "sampling": {"motion_rate_hz": beam.rate_hz, "pretrigger_s": 0.0},
    })  # fmt: skip
