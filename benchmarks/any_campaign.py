"""The closed loop on campaigns of any kind and size: ``python -m benchmarks.any_campaign --count 1000``.

A seed decides all of a campaign: its kind, a chain of one to three bodies, sizes over twelve decades, noise,
and which effect of the catalogue is undeclared, or none. The table tells by kind how often a closure was
right, and the lines above it what must never be: a traceback, a warning of a library, a number at an end of
its range without a word.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import linalg

from discovery.criteria.criteria import CRITERIA
from discovery.explain.scales import Scale, at_scale
from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from rom.campaign.campaign import CampaignSettings, read_campaign, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.effects import Effect, candidates, look_alikes, places
from rom.model.assembly import Response
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

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
FELT = 3.0
"""Times noise: a hidden effect that moves the motion less is not felt."""


class EscapedError(ArithmeticError):
    """A campaign that cannot be drawn."""


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


@dataclass(frozen=True)
class Motion:
    """Of a campaign: its linear model, kind of test, rate, samples, size, lowest and highest frequency."""

    model: Model
    test: str
    rate_hz: float
    samples: int
    size_m: float
    band_hz: tuple[float, float]

    def record(
        self, share: float, rng: np.random.Generator
    ) -> tuple[Mapping[str, FloatArray], Any, Response]:
        """Force and start of a record whose largest motion is about a share of the size, and the motion."""
        names, size_m = self.model.structure.body_names, share * self.size_m
        if self.test == "free":
            start = {n: size_m * float(rng.uniform(0.3, 1)) for n in names}, dict.fromkeys(names, 0.0)
            force: Mapping[str, FloatArray] = {names[0]: np.zeros(self.samples)}
            return force, start, self.model.simulate(force, self.rate_hz, None, *start)
        time_s, start = np.arange(self.samples) / self.rate_hz, (dict.fromkeys(names, 0.0),) * 2
        lines = np.linspace(0.3 * self.band_hz[0], 1.3 * self.band_hz[1], 60)
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        unit = np.cos(2 * np.pi * np.outer(time_s, lines) + phases).sum(axis=1)
        moved = self.model.simulate({names[-1]: unit}, self.rate_hz, None, *start)
        factor = size_m / max(float(np.abs(moved.displacement[n]).max()) for n in names)
        force = {names[-1]: factor * unit}
        return force, start, self.model.simulate(force, self.rate_hz, None, *start)


def drawn(seed: int, folder: Path) -> tuple[str, str, float]:
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
    hidden = _hidden(rng, model, scale) if rng.random() < 0.7 else None
    plant = model if hidden is None else model.with_effect(hidden)
    noise, felt, records = 10 ** rng.uniform(-4, -1.7), 0.0, {}
    for place, share in enumerate(SHARES):
        force, start, linear = motion.record(share, rng)
        response = plant.simulate(force, rate_hz, None, *start)
        if response.status != "ok":
            raise EscapedError(f"seed {seed}: found a hidden effect that lets the motion escape")
        shown = {}
        for body in model.structure.body_names:
            clean, other = (np.asarray(getattr(one, quantity)[body]) for one in (response, linear))
            level = noise * float(np.sqrt(np.mean(clean**2)))
            felt = max(felt, float(np.sqrt(np.mean((clean - other) ** 2))) / level)
            shown[f"{quantity}_{body}"] = clean + level * rng.normal(size=samples)
        if test == "driven":
            shown |= {f"force_{b}": f + 1e-4 * f.std() * rng.normal(size=samples) for b, f in force.items()}
        records[f"records/{place}.h5"] = {name: Channel(name, y, rate_hz) for name, y in shown.items()}
    declared = test == "free" or bool(rng.random() < 0.5)
    write_campaign(folder, _settings(model, kind, records, rate_hz, declared=declared), records.items())
    return kind, "" if hidden is None else hidden.path, felt


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


def _hidden(rng: np.random.Generator, model: Model, scale: Scale) -> Effect:
    """An effect of the core at a place of its own, about as strong there as in a lap joint or a flexure."""
    kinds = places(model)
    found = ((m, e) for m, e in candidates(model) if m.kind == "force" and not m.by_record)
    forces = [(m, e) for m, e in found if isinstance(e, Effect)]
    member, effect = forces[int(rng.integers(len(forces)))]
    at = at_scale(member, effect, scale, ground=kinds[effect.enters] != "joint", criteria=CRITERIA.tension)
    factor = 10 ** rng.uniform(-0.5, 0.3)
    strengths = {n: at.parameters[n] for n in member.strengths}
    return at.with_values(**{n: float(np.clip(factor * p.value, *p.bounds)) for n, p in strengths.items()})


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
            kind, hidden, felt = drawn(seed, Path(folder) / "campaign")
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
    outcome = _outcome(closure, hidden if felt > FELT else "")
    return Told(
        seed, kind, hidden, outcome, closure.verdict, found, _unsaid(closure), time.process_time() - started
    )


def _outcome(closure: Closure, hidden: str) -> str:
    """How a closure compares with what is hidden and felt."""
    named = [one.effect.path for one in closure.effects]
    warned = ", warned" if closure.verdict == "unexplained" else ""
    if not hidden:
        return f"false name{warned}" if named else f"nothing named{warned}"
    if not named:
        return f"missed{warned}"
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
        if p.value in p.bounds and p.value != 0.0 and not p.at_bound
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
                f"[{row.outcome}] {row.cpu_s:.0f} s {row.fault}", markup=False,
            )  # fmt: skip
    console.print(table(rows))


if __name__ == "__main__":
    main()
