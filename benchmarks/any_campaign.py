"""The closed loop on campaigns of any kind and size: ``python -m benchmarks.any_campaign --count 1000``.

A seed decides all of a campaign: its kind, a chain of one to three bodies, sizes over twelve decades, noise,
and which effect of the catalogue is undeclared, or none. The table tells by kind how often a closure was
right, a second one how often the 95 % limits of a right name's numbers hold the truth, and the lines above
them what must never be: a traceback, a warning of a library, a number at an end of its range without a word.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import linalg, optimize

from discovery.criteria.criteria import CRITERIA
from discovery.explain.scales import Scale, at_scale
from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from rom.campaign.campaign import CampaignSettings, read_campaign, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.effects import CATALOGUE, Effect, look_alikes, places
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
CHOICES = (0.0, -1.0, 1.0)
"""Ends of a range that tell what an effect is: nothing of it, or a side."""
FELT = 3.0
"""Times noise: an effect is not felt that moves the motion less beyond what a linear model imitates."""


class EscapedError(ArithmeticError):
    """A campaign that cannot be drawn."""


@dataclass(frozen=True)
class Number:
    """A number of an effect that was named rightly: its true value, that found, and its 95 % limits."""

    effect: str
    true: float
    value: float
    low: float
    high: float

    @property
    def is_held(self) -> bool:
        """Whether the limits hold the true value."""
        return self.low <= self.true <= self.high


@dataclass(frozen=True)
class Told:
    """What a closure says of a campaign: how that compares with what is hidden, and what must never be."""

    seed: int
    kind: str
    hidden: str
    outcome: str
    verdict: str
    found: str
    fault: str
    cpu_s: float
    numbers: tuple[Number, ...] = ()


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


def drawn(seed: int, folder: Path) -> tuple[str, Effect | None, float]:
    """Write the campaign of a seed; return its kind, what is hidden, and how much of it is felt in noise."""
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
    plant = model if hidden is None else model.with_effect(hidden)
    runs = [motion.record(share, rng) for share in SHARES]
    moved = [plant.simulate(_for_simulation(force), FINER * rate_hz, None, *start) for force, start in runs]
    if any(one.status != "ok" for one in moved):
        raise EscapedError(f"seed {seed}: found a hidden effect that lets the motion escape")
    declared = test == "free" or bool(rng.random() < 0.5)
    imitating = _imitating(model, [force for force, _ in runs], moved, declared=declared)
    noise, felt, records = 10 ** rng.uniform(-4, -1.7), 0.0, {}
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


def told(seed: int) -> Told:
    """Draw the campaign of a seed, close the loop over it, and compare."""
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        kind, hidden = KINDS[seed % len(KINDS)], ""
        try:
            kind, plant, felt = drawn(seed, Path(folder) / "campaign")
            hidden = "" if plant is None else plant.path
            closure = close_loop(read_campaign(Path(folder) / "campaign"), jobs=1)
        except EscapedError as error:
            return Told(seed, kind, hidden, "not drawn", "", str(error), "", time.process_time() - started)
        except ValueError as error:
            known = type(error).__module__.startswith(("rom", "discovery", "experiments"))
            in_lines = known or "expected" in str(error)
            fault = "" if in_lines else traceback.format_exc()
            return Told(seed, kind, hidden, "refused", "", str(error), fault, time.process_time() - started)
        except Exception:  # whatever it is, it is counted
            fault = traceback.format_exc()
            return Told(seed, kind, hidden, "traceback", "", "", fault, time.process_time() - started)
    found = ", ".join(one.effect.path for one in closure.effects)
    outcome = _outcome(closure, hidden, felt)
    numbers = () if plant is None else _numbers(closure, plant)
    cpu_s = time.process_time() - started
    return Told(seed, kind, hidden, outcome, closure.verdict, found, _unsaid(closure), cpu_s, numbers)


def _numbers(closure: Closure, hidden: Effect) -> tuple[Number, ...]:
    """Numbers of the hidden effect that have limits, where it was named; none that is zero in truth."""
    return tuple(
        Number(hidden.name, hidden.parameters[name].value, p.value, p.low, p.high)
        for one in closure.effects
        if one.effect.path == hidden.path
        for name, p in one.effect.parameters.items()
        if hidden.parameters[name].value and p.low is not None and p.high is not None and not p.at_bound
    )


def _outcome(closure: Closure, hidden: str, felt: float) -> str:
    """How a closure compares with what is hidden; to be silent of what is not felt is no fault."""
    named = [one.effect.path for one in closure.effects]
    warned = ", warned" if closure.verdict == "unexplained" else ""
    if not named:
        return f"missed{warned}" if felt > FELT else f"nothing named{warned}"
    if not hidden:
        return f"false name{warned}"
    if named[0] == hidden:
        return "first"
    enters, _, name = hidden.rpartition(".")
    others = {f"{other.enters}.{other.name}" for one in closure.effects for other in one.look_alikes}
    alike = {f"{enters}.{other}" for other in look_alikes(name)}
    return "listed" if hidden in {*named, *others} or alike & set(named) else f"wrong name{warned}"


def _unsaid(closure: Closure) -> str:
    """Numbers at an end of their range that are not said to be there; a zero is said as such."""
    numbers = ((one.effect.path, n, p) for one in closure.effects for n, p in one.effect.parameters.items())
    return ", ".join(
        f"{path}.{name} = {p.value:.4g}, at an end of its range, unsaid"
        for path, name, p in numbers
        if p.value in p.bounds and p.value not in CHOICES and not p.at_bound
    )


def table(rows: Iterable[Told]) -> Table:
    """Outcomes by kind, and the median of the time."""
    rows, outcomes = list(rows), sorted({row.outcome for row in rows})
    found = Table("kind", "campaigns", *outcomes, "CPU [s], median", box=None)
    for kind in dict.fromkeys(row.kind for row in rows):
        own = [row for row in rows if row.kind == kind]
        counts = [str(sum(row.outcome == outcome for row in own)) for outcome in outcomes]
        found.add_row(kind, str(len(own)), *counts, f"{np.median([row.cpu_s for row in own]):.0f}")
    return found


def limits_table(rows: Iterable[Told]) -> Table:
    """By effect how often 95 % limits hold the truth, median error and half of the limits' width."""
    numbers = [number for row in rows for number in row.numbers]
    found = Table("effect", "held", "error [%], median", "half-width [%], median", box=None)
    for name in [*sorted({number.effect for number in numbers}), "all"]:
        own = [number for number in numbers if name in (number.effect, "all")]
        error = [abs(n.value / n.true - 1) for n in own]
        width = [(n.high - n.low) / (2 * abs(n.true)) for n in own]
        held = f"{sum(n.is_held for n in own)} of {len(own)}"
        found.add_row(name, held, *(f"{100 * np.median(x):.2g}" if x else "" for x in (error, width)))
    return found


def main() -> None:
    """Draw, close, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000, help="campaigns")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given, console, rows = parser.parse_args(), Console(soft_wrap=True), list[Told]()
    with ProcessPoolExecutor(given.jobs) as pool:
        for row in pool.map(told, range(given.first, given.first + given.count)):
            rows.append(row)
            console.print(
                f"{row.seed} {row.kind}: {row.hidden or 'nothing'} -> {row.verdict} {row.found} "
                f"[{row.outcome}] {_held(row)}{row.cpu_s:.0f} s {row.fault}", markup=False,
            )  # fmt: skip
    console.print(table(rows))
    console.print(limits_table(rows))


def _held(row: Told) -> str:
    """Numbers held by their limits, and those that are not, as text; empty where none has limits."""
    missed = "".join(f", {n.value:.4g} ({n.low:.4g} to {n.high:.4g}) for {n.true:.4g}"
                     for n in row.numbers if not n.is_held)  # fmt: skip
    held = sum(number.is_held for number in row.numbers)
    return f"held {held} of {len(row.numbers)}{missed}; " if row.numbers else ""


if __name__ == "__main__":
    main()
