"""Campaigns of any kind and size, drawn from a seed: a chain of one to three bodies, free or driven.

Their sizes go over twelve decades; noise, declared masses, and an effect of the catalogue that is not
declared, or none, are drawn too. A seed tells one of `KINDS`; others are drawn where they are asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
OTHER_KINDS = ("mixed displacement", "ground displacement", "ground acceleration")
"""Ring-downs beside driven records, and bodies on a ground that moves."""
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
class Drive:
    """Of a record: its test, forces at `FINER` its rate, state at the start, and the ground by quantity."""

    test: str
    force: Mapping[str, FloatArray]
    start: tuple[Mapping[str, float], Mapping[str, float]]
    ground: Mapping[str, FloatArray]

    @property
    def for_simulation(self) -> dict[str, FloatArray]:
        """Forces whose course between two samples is a straight line."""
        return {body: for_straight_lines(course) for body, course in self.force.items()}

    def shown(self, response: Response, quantity: str) -> Iterator[tuple[str, FloatArray]]:
        """Motion of each body as a sensor shows it, at the samples of the record."""
        moved = self.ground.get(quantity, 0.0)
        for body, course in getattr(response, quantity).items():
            yield body, (course + moved)[::FINER]


@dataclass(frozen=True)
class Motion:
    """Of a campaign: its linear model, tests, rate, samples, size, lowest and highest frequency."""

    model: Model
    tests: Sequence[str]
    rate_hz: float
    samples: int
    size_m: float
    band_hz: tuple[float, float]

    def record(self, place: int, rng: np.random.Generator) -> Drive:
        """What moves a record; the largest motion is about a share of the size."""
        names, size_m, test = self.model.structure.body_names, SHARES[place] * self.size_m, self.tests[place]
        fine_hz, samples = FINER * self.rate_hz, FINER * self.samples
        if test == "free":
            start = {n: size_m * float(rng.uniform(0.3, 1)) for n in names}, dict.fromkeys(names, 0.0)
            return Drive(test, {names[0]: np.zeros(samples)}, start, {})
        time_s, still = np.arange(samples) / fine_hz, dict.fromkeys(names, 0.0)
        lines = np.linspace(0.3 * self.band_hz[0], 1.3 * self.band_hz[1], 60)
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        angles = 2 * np.pi * np.outer(time_s, lines) + phases
        unit, ground = np.cos(angles).sum(axis=1), {}
        force = {names[-1]: unit}
        if test == "ground":
            force = {body.name: -body.mass * unit for body in self.model.structure.bodies}
            ground = {"acceleration": unit, "displacement": -np.cos(angles) @ (2 * np.pi * lines) ** -2.0}
        moved = self.model.simulate(force, fine_hz, None, still, still)
        factor = size_m / max(float(np.abs(moved.displacement[n]).max()) for n in names)
        forces, grounds = ({n: factor * x for n, x in one.items()} for one in (force, ground))
        return Drive(test, forces, (still, still), grounds)


def drawn(
    seed: int,
    folder: Path,
    undeclared: Sequence[Effect] | None = None,
    noise_of: int = 0,
    kind: str = "",
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
    kind : str
        One of `KINDS` or `OTHER_KINDS`; if empty that of the seed.

    Raises
    ------
    EscapedError
        If what is hidden lets the motion escape.
    """
    rng = np.random.default_rng([seed, 39])
    kind = kind or KINDS[seed % len(KINDS)]
    test, quantity = kind.split()
    tests = ("free", "driven") * 2 if test == "mixed" else (test,) * len(SHARES)
    mass, first_hz, size_m = 10 ** rng.uniform(-5, 4), 10 ** rng.uniform(0, 3), 10 ** rng.uniform(-8, -1)
    model, band_hz = _chain(rng, int(rng.choice([1, 1, 2, 3])), mass, first_hz)
    rate_hz = band_hz[1] * float(rng.uniform(12, 25))
    samples = int(min(rng.uniform(20, 40) / band_hz[0] * rate_hz, MOST_SAMPLES))
    motion = Motion(model, tests, rate_hz, samples, size_m, band_hz)
    scale = Scale(mass * size_m * (2 * np.pi * first_hz) ** 2, size_m, size_m * 2 * np.pi * first_hz)
    hidden = drawn_effect(rng, model, scale, rate_hz) if rng.random() < 0.7 else None
    if undeclared is not None:
        hidden = next(iter(undeclared), None)
    plant = model if hidden is None else model.with_effect(hidden)
    runs = [motion.record(place, rng) for place in range(len(SHARES))]
    moved = [plant.simulate(run.for_simulation, FINER * rate_hz, None, *run.start) for run in runs]
    if any(one.status != "ok" for one in moved):
        raise EscapedError(f"seed {seed}: found a hidden effect that lets the motion escape")
    declared = test in ("free", "ground") or bool(rng.random() < 0.5)
    imitating = _imitating(model, [run.force for run in runs], moved, declared=declared)
    noise, felt, records = 10 ** rng.uniform(-4, -1.7), 0.0, {}
    rng = np.random.default_rng([seed, 39, noise_of]) if noise_of else rng
    for place, (run, response) in enumerate(zip(runs, moved, strict=True)):
        linear = imitating.simulate(run.for_simulation, FINER * rate_hz, None, *run.start)
        channels, of_record = _shown(run, response, linear, quantity, noise, rng)
        channels |= _shown_inputs(run, quantity, rng)
        records[f"records/{place}.h5"] = {name: Channel(name, y, rate_hz) for name, y in channels.items()}
        felt = max(felt, of_record)
    settings = _settings(model, kind, dict(zip(records, tests, strict=True)), rate_hz, declared=declared)
    write_campaign(folder, settings, records.items())
    return kind, hidden, felt


def _shown(
    run: Drive,
    response: Response,
    linear: Response,
    quantity: str,
    noise: float,
    rng: np.random.Generator,
) -> tuple[dict[str, FloatArray], float]:
    """Noisy channels of a motion, and how far it is from another one, in noise."""
    channels, felt, others = {}, 0.0, dict(run.shown(linear, quantity))
    for body, clean in run.shown(response, quantity):
        other = others[body]
        level = noise * float(np.sqrt(np.mean(clean**2)))
        felt = max(felt, float(np.sqrt(np.mean((clean - other) ** 2))) / level)
        channels[f"{quantity}_{body}"] = clean + level * rng.normal(size=len(clean))
    return channels, felt


def _shown_inputs(run: Drive, quantity: str, rng: np.random.Generator) -> dict[str, FloatArray]:
    """Noisy channels of forces, or of the ground."""
    if run.test == "free":
        return {}
    inputs = {f"force_{body}": force for body, force in run.force.items()}
    if run.ground:
        inputs = {f"{quantity}_ground": run.ground[quantity]}
    return {
        name: x[::FINER] + FORCE_NOISE * x.std() * rng.normal(size=len(x[::FINER]))
        for name, x in inputs.items()
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


def drawn_effect(
    rng: np.random.Generator, model: Model, scale: Scale, rate_hz: float, where: Sequence[str] = ()
) -> Effect:
    """Return an effect of the core at a place, about as strong there as in a lap joint or a flexure.

    No constant force: offsets of sensors and starts imitate it.

    Parameters
    ----------
    rng : Generator
        Of the campaign.
    model : Model
        Without the effect.
    scale : Scale
        Force, displacement and velocity of its places.
    rate_hz : float
        Of its records [Hz].
    where : sequence of str
        Links and bodies where it may enter; all of the model's if empty.
    """
    kinds = {at: kind for at, kind in places(model).items() if not where or at in where}
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
    model: Model, kind: str, tests: Mapping[str, str], rate_hz: float, *, declared: bool
) -> CampaignSettings:
    settings: dict[str, Any] = {"format": "boltlaw-campaign/1", "name": kind}
    body = [{"name": b.name, **({"mass_kg": b.mass} if declared else {})} for b in model.structure.bodies]
    link = [{"name": x.name, "between": [x.first, x.second], "law": "linear"} for x in model.structure.links]
    record = [
        {"file": file, "test": "driven" if test == "ground" else test, "hold_out": file == [*tests][-1]}
        for file, test in tests.items()
    ]
    sampling = {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0}
    parts = {"body": body, "link": link, "sampling": sampling, "record": record}
    return CampaignSettings.model_validate(settings | parts)
