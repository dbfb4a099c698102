"""Campaigns of any kind and size, drawn from a seed: a chain of one to three bodies, free or driven.

Their sizes go over twelve decades; noise, declared masses, and an effect of the catalogue that is not
declared, or none, are drawn too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import linalg, optimize

from discovery.criteria.criteria import CRITERIA
from discovery.explain.scales import Scale, at_scale
from rom.campaign.campaign import CampaignSettings, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.effects import CATALOGUE, Effect, places
from rom.identification.force_balance import OFFSET
from rom.model.assembly import Response
from rom.model.description import LinkLaws
from rom.model.laws import Parameter, constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.signals.filters import for_straight_lines

KINDS = (
    "free displacement",
    "free acceleration",
    "driven displacement",
    "driven velocity",
    "driven acceleration",
)
SHARES = (1.0, 0.5, 0.8, 0.7)
"""Amplitudes of the records beside the largest; the last one is held out."""
MOST_SAMPLES = 4_000
FORCE_NOISE = 1e-4
"""Of a force."""
FINER = 8
"""Samples of a true force to one of a record: it runs on between them, and not along a line."""


class EscapedError(ArithmeticError):
    """A campaign that cannot be drawn."""


@dataclass(frozen=True)
class Motion:
    """Of a campaign: its linear model, kind of test, rate, samples, size, lowest and highest frequency."""

    model: Model
    test: str
    rate_hz: float
    samples: int
    size_m: float
    band_hz: tuple[float, float]

    def record(self, share: float, rng: np.random.Generator) -> tuple[Mapping[str, FloatArray], Any]:
        """Force, `FINER` than a record, and start; the largest motion is about a share of the size."""
        names, size_m = self.model.structure.body_names, share * self.size_m
        fine_hz, samples = FINER * self.rate_hz, FINER * self.samples
        if self.test == "free":
            start = {n: size_m * float(rng.uniform(0.3, 1)) for n in names}, dict.fromkeys(names, 0.0)
            return {names[0]: np.zeros(samples)}, start
        time_s, start = np.arange(samples) / fine_hz, (dict.fromkeys(names, 0.0),) * 2
        lines = np.linspace(0.3 * self.band_hz[0], 1.3 * self.band_hz[1], 60)
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        unit = np.cos(2 * np.pi * np.outer(time_s, lines) + phases).sum(axis=1)
        moved = self.model.simulate({names[-1]: unit}, fine_hz, None, *start)
        factor = size_m / max(float(np.abs(moved.displacement[n]).max()) for n in names)
        return {names[-1]: factor * unit}, start


def drawn(
    seed: int, folder: Path, undeclared: Sequence[Effect] | None = None, noise_of: int = 0
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
    noise_of : int
        Which of many draws of the noise; all else stays.

    Raises
    ------
    EscapedError
        If what is hidden lets the motion escape.
    """
    rng = np.random.default_rng([seed, 39])
    kind = KINDS[seed % len(KINDS)]
    test, quantity = kind.split()
    mass, first_hz, size_m = 10 ** rng.uniform(-5, 4), 10 ** rng.uniform(0, 3), 10 ** rng.uniform(-8, -1)
    model, band_hz = _chain(rng, int(rng.choice([1, 1, 2, 3])), mass, first_hz)
    rate_hz = band_hz[1] * float(rng.uniform(12, 25))
    samples = int(min(rng.uniform(20, 40) / band_hz[0] * rate_hz, MOST_SAMPLES))
    motion = Motion(model, test, rate_hz, samples, size_m, band_hz)
    scale = Scale(mass * size_m * (2 * np.pi * first_hz) ** 2, size_m, size_m * 2 * np.pi * first_hz)
    hidden = _hidden(rng, model, scale, rate_hz) if rng.random() < 0.7 else None
    if undeclared is not None:
        hidden = next(iter(undeclared), None)
    plant = model if hidden is None else model.with_effect(hidden)
    runs = [motion.record(share, rng) for share in SHARES]
    moved = [plant.simulate(_for_simulation(force), FINER * rate_hz, None, *start) for force, start in runs]
    if any(one.status != "ok" for one in moved):
        raise EscapedError(f"seed {seed}: found a hidden effect that lets the motion escape")
    declared = test == "free" or bool(rng.random() < 0.5)
    imitating = _imitating(model, [force for force, _ in runs], moved, declared=declared)
    noise, felt, records = 10 ** rng.uniform(-4, -1.7), 0.0, {}
    rng = np.random.default_rng([seed, 39, noise_of]) if noise_of else rng
    for place, ((force, start), response) in enumerate(zip(runs, moved, strict=True)):
        linear = imitating.simulate(_for_simulation(force), FINER * rate_hz, None, *start)
        channels, of_record = _shown(response, linear, quantity, noise, rng)
        channels |= _shown_forces(force, rng) if test == "driven" else {}
        records[f"records/{place}.h5"] = {name: Channel(name, y, rate_hz) for name, y in channels.items()}
        felt = max(felt, of_record)
    write_campaign(folder, _settings(model, kind, records, rate_hz, declared=declared), records.items())
    return kind, hidden, felt


def _for_simulation(force: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {body: for_straight_lines(course) for body, course in force.items()}


def _shown(
    response: Response, linear: Response, quantity: str, noise: float, rng: np.random.Generator
) -> tuple[dict[str, FloatArray], float]:
    """Noisy channels of a motion, and how far it is from another one, in noise."""
    channels, felt = {}, 0.0
    for body, course in getattr(response, quantity).items():
        clean, other = course[::FINER], getattr(linear, quantity)[body][::FINER]
        level = noise * float(np.sqrt(np.mean(clean**2)))
        felt = max(felt, float(np.sqrt(np.mean((clean - other) ** 2))) / level)
        channels[f"{quantity}_{body}"] = clean + level * rng.normal(size=len(clean))
    return channels, felt


def _shown_forces(forces: Mapping[str, FloatArray], rng: np.random.Generator) -> dict[str, FloatArray]:
    """Noisy channels of forces."""
    return {
        f"force_{body}": force[::FINER] + FORCE_NOISE * force.std() * rng.normal(size=len(force[::FINER]))
        for body, force in forces.items()
    }


def _imitating(
    model: Model, forces: Sequence[Mapping[str, FloatArray]], moved: Sequence[Response], *, declared: bool
) -> Model:
    """The linear model that balances the forces along a motion best, with its masses where not declared."""
    names, links = model.structure.body_names, model.structure.links
    still, parts = np.zeros_like(next(iter(forces[0].values()))), []
    for force, response in zip(forces, moved, strict=True):
        of_links = [
            (link, one.get(link.first, still) - one.get(link.second, still))
            for link in links for one in (response.displacement, response.velocity)
        ]  # fmt: skip
        for body in names:
            pulls = [((link.first == body) - float(link.second == body)) * x for link, x in of_links]
            pushes = [float(other == body) * np.asarray(response.acceleration[body]) for other in names]
            parts.append(np.stack([*pulls, *pushes, force.get(body, still)], axis=1))
    *columns, force = np.concatenate(parts).T
    paths = [f"{link.name}.{number}" for link in links for number in ("stiffness.k", "damping.c")]
    masses = [f"body.{body}.mass" for body in names]
    if declared:
        known = [model.parameter(path).value for path in masses]
        force = force - np.array(known) @ np.array(columns[len(paths) :])
    paths += [] if declared else masses
    table = np.stack(columns[: len(paths)], axis=1)
    sizes = np.linalg.norm(table, axis=0)
    found, _ = optimize.nnls(table / sizes, force)
    return model.with_values(dict(zip(paths, (found / sizes).tolist(), strict=True)))


def _chain(
    rng: np.random.Generator, bodies: int, mass: float, first_hz: float
) -> tuple[Model, tuple[float, float]]:
    """Bodies one after the other from the ground, and their lowest and highest natural frequency [Hz]."""
    names = [f"b{k}" for k in range(bodies)]
    masses = [mass * float(rng.uniform(0.5, 2)) for _ in names]
    links, laws, matrix = [], {}, np.zeros((bodies, bodies))
    for k, (name, own) in enumerate(zip(names, masses, strict=True)):
        links.append(Link(f"s{k}", name, names[k - 1] if k else "ground", "linear"))
        stiffness = own * (2 * np.pi * first_hz * float(rng.uniform(1, 2) if k else 1.0)) ** 2
        damping = 2 * float(10 ** rng.uniform(-2.5, -1.3)) * np.sqrt(stiffness * own)
        laws[f"s{k}"] = LinkLaws(constant_stiffness(stiffness), constant_damping(damping))
        ends = np.eye(bodies)[k] - (np.eye(bodies)[k - 1] if k else 0.0)
        matrix += stiffness * np.outer(ends, ends)
    squares = linalg.eigh(matrix, np.diag(masses), eigvals_only=True)
    model = Model(Structure(tuple(map(Body, names, masses)), tuple(links)), laws)
    return model, (float(np.sqrt(squares[0])) / (2 * np.pi), float(np.sqrt(squares[-1])) / (2 * np.pi))


def _hidden(rng: np.random.Generator, model: Model, scale: Scale, rate_hz: float) -> Effect:
    """An effect of the core at a place of its own, about as strong there as in a lap joint or a flexure.

    No constant force: offsets of sensors and starts imitate it.
    """
    kinds = places(model)
    members = (m for m in CATALOGUE.values() if m.core and m.kind == "force" and m.name != OFFSET)
    forces = [(m, at) for m in members if not m.by_record for at, kind in kinds.items() if kind in m.places]
    while True:  # over all, and again for one that needs a bolt: a seed hides what it always has
        member, enters = forces[int(rng.integers(len(forces)))]
        if not member.tensioned:
            break
    effect = member.at(enters, ground=kinds[enters] == "ground")
    assert isinstance(effect, Effect)
    ground = kinds[effect.enters] != "joint"
    at = at_scale(member, effect, scale, ground=ground, pressed=False, criteria=CRITERIA.tension)
    factor = 10 ** rng.uniform(-0.5, 0.3)
    at = at.with_values(**{n: _in_band(p, rate_hz, rng) for n, p in at.parameters.items() if p.unit == "Hz"})
    strengths = {n: at.parameters[n] for n in member.strengths}
    return at.with_values(**{n: float(np.clip(factor * p.value, *p.bounds)) for n, p in strengths.items()})


def _in_band(frequency: Parameter, rate_hz: float, rng: np.random.Generator) -> float:
    """A frequency of an effect's own that a logger with a filter would let pass."""
    low, high = frequency.bounds
    return float(np.clip(10 ** rng.uniform(*np.log10([rate_hz / 25, rate_hz / 5])), low, high))


def _settings(
    model: Model, kind: str, records: Mapping[str, Any], rate_hz: float, *, declared: bool
) -> CampaignSettings:
    last, settings = len(records) - 1, {"format": "boltlaw-campaign/1", "name": kind}
    body = [{"name": b.name, **({"mass_kg": b.mass} if declared else {})} for b in model.structure.bodies]
    link = [{"name": x.name, "between": [x.first, x.second], "law": "linear"} for x in model.structure.links]
    test = kind.split()[0]
    record = [{"file": file, "test": test, "hold_out": k == last} for k, file in enumerate(records)]
    sampling = {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0}
    parts = {"body": body, "link": link, "sampling": sampling, "record": record}
    return CampaignSettings.model_validate(settings | parts)
