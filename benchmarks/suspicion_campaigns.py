"""Sound campaigns for a screening: of the virtual rig with something undeclared, and of other structures.

A seed decides all of a campaign: structure, noise, what is undeclared, which motion is measured, whether the
masses are declared, how many bits samples have. Half of the campaigns are the rig's, and each of its effects
has its turn. The other structures are linear, with sensors that have faults.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import linalg, signal

from experiments.studies import rig
from experiments.studies.drawn import run_drawn
from rom.campaign.campaign import CampaignSettings, Record, RecordSettings, read_campaign
from rom.campaign.channels import MOTIONS, FloatArray
from rom.campaign.record import Channel
from rom.signals.calibration import Calibration

RATE_HZ, TENSION_RATE_HZ, DURATION_S, HIT_S = 19200.0, 4800.0, 2.5, 0.5
NOISES = (0.3, 1.0, 3.0)
KINDS = ("rig", "block", "rig", "chain", "rig", "unequal")
"""Structures by turns: the paper's two bodies, one block, a chain of three, two bodies of unequal mass."""
PERCENT = {"fault": (0.5, 9.0), "reading": (0.5, 9.0)}
"""Influence [%] of sensors' faults, which is met to a tenth; of all else it is up to 60 %."""
SIZES = {"acceleration": 1.0, "velocity": 1e-4, "displacement": 1e-7}
"""Noise of sensors beside that of an accelerometer."""
BITS = (14, 16, 24)
"""Of the analyser, in three of ten campaigns."""
LATEST_S = 2e-4
"""Delay of sensors sampled in turn."""


@dataclass(frozen=True, eq=False)
class Sound:
    """A campaign in memory, and what it is: structure, noise, undeclared effect, measured motion."""

    settings: CampaignSettings
    records: tuple[Record, ...]
    structure: str
    noise: float
    effect: str
    motion: str

    @property
    def declared(self) -> bool:
        """Whether masses are declared."""
        return all(body.mass_kg is not None for body in self.settings.body)


def sound(seed: int) -> Sound:
    """Measure the campaign of a seed."""
    rng = np.random.default_rng([seed, 54])
    kind, noise = KINDS[seed % len(KINDS)], float(rng.choice(NOISES))
    made = _of_rig(rng, seed, noise) if kind == "rig" else _lumped(rng, kind, noise)
    made = made if rng.uniform() < 0.7 else _undeclared_masses(made)
    return made if rng.uniform() < 0.7 else _digitised(made, int(rng.choice(BITS)))


def _undeclared_masses(of: Sound) -> Sound:
    bodies = [body.model_copy(update={"mass_kg": None}) for body in of.settings.body]
    return replace(of, settings=of.settings.model_copy(update={"body": tuple(bodies)}))


def _digitised(of: Sound, bits: int) -> Sound:
    """The same behind an analyser that has one range for each channel in all records."""
    largest: dict[str, float] = {}
    for record in of.records:
        for name, channel in record.channels.items():
            largest[name] = max(largest.get(name, 0.0), float(np.abs(channel.samples).max()))

    def change(record: Record) -> Record:
        digit = {name: largest[name] / 2 ** (bits - 1) for name in record.channels}
        rows = {
            name: replace(channel, samples=digit[name] * np.round(channel.samples / digit[name]))
            for name, channel in record.channels.items()
        }
        return replace(record, channels=rows)

    return replace(of, records=tuple(map(change, of.records)))


def _of_rig(rng: np.random.Generator, seed: int, noise: float) -> Sound:
    every = [(name, place) for name, kind in rig.KINDS.items() for place in kind.allowed]
    turn = seed // 2
    name, place = every[turn % len(every)] if rng.uniform() < 0.8 else ("", "")
    hidden = (rig.Undeclared(name, place),) if name else ()
    percent = PERCENT.get(rig.KINDS[name].acts, (0.5, 60.0)) if name else (0.5, 60.0)
    cases, every_other = int(rng.integers(2, 5)), int(rng.choice([0, 3]))
    with tempfile.TemporaryDirectory() as scratch:
        folder = run_drawn(
            Path(scratch) / "campaign", hidden, percent, seed,
            cases=cases, noise=noise, duration_s=DURATION_S, hold_out_every=every_other,
        )  # fmt: skip
        campaign = read_campaign(folder, 1)
        records = tuple(campaign.load(record) for record in campaign.settings.record)
    made = Sound(campaign.settings, records, "rig", noise, f"{name}@{place}" if name else "", "acceleration")
    return _calibrated(made) if rng.uniform() < 0.5 else made


def _calibrated(of: Sound) -> Sound:
    """The same with tension [N] in place of strain."""
    assert of.settings.bolt is not None
    calibration = Calibration(tuple(of.settings.bolt.calibration or ()))

    def change(record: Record) -> Record:
        strain = record.channels.get("strain")
        if strain is None:
            return record
        tension = Channel("tension", calibration.tension(strain.samples), strain.rate_hz)
        others = {name: channel for name, channel in record.channels.items() if name != "strain"}
        return replace(record, channels=others | {"tension": tension})

    bolt = of.settings.bolt.model_copy(update={"calibration": None})
    return replace(
        of,
        settings=of.settings.model_copy(update={"bolt": bolt}),
        records=tuple(map(change, of.records)),
    )


@dataclass(frozen=True)
class _Lumped:
    """Masses [kg] by body; links by name: ends, stiffness [N/m], damping [N s/m]; the body that is struck."""

    masses: Mapping[str, float]
    links: Mapping[str, tuple[tuple[str, str], float, float]]
    struck: str


def _structure(rng: np.random.Generator, kind: str) -> _Lumped:
    def link(ends: tuple[str, str], mass: float, low_hz: float, high_hz: float, damping: float) -> Any:
        omega = 2 * np.pi * np.exp(rng.uniform(np.log(low_hz), np.log(high_hz)))
        return ends, mass * omega**2, 2 * damping * mass * omega * rng.uniform(0.5, 2.0)

    if kind == "block":
        mass = float(np.exp(rng.uniform(np.log(0.5), np.log(20.0))))
        return _Lumped({"block": mass}, {"joint": link(("block", "ground"), mass, 40, 250, 0.02)}, "block")
    if kind == "chain":
        apart = np.cumsum(rng.uniform(np.log(1.4), np.log(2.0), 3))  # or an exchange is two gains
        a, b, c = (float(m) for m in rng.permutation(0.4 * np.exp(apart)))
        links = {
            "wall": link(("a", "ground"), a + b + c, 8, 30, 0.005),
            "joint": link(("a", "b"), a * b / (a + b), 80, 250, 0.02),
            "end": link(("b", "c"), b * c / (b + c), 80, 250, 0.005),
        }
        return _Lumped({"a": a, "b": b, "c": c}, links, "b")
    heavy = float(np.exp(rng.uniform(np.log(2.0), np.log(20.0))))
    light = heavy / rng.uniform(5.0, 30.0)
    links = {
        "wall": link(("heavy", "ground"), heavy, 4, 20, 0.01),
        "leaf": link(("light", "ground"), light, 20, 60, 0.005),
        "joint": link(("heavy", "light"), light, 100, 300, 0.03),
    }
    return _Lumped({"heavy": heavy, "light": light}, links, "heavy")


def _lumped(rng: np.random.Generator, kind: str, noise: float) -> Sound:
    of, motion = _structure(rng, kind), str(rng.choice(MOTIONS, p=(0.7, 0.15, 0.15)))
    preloads = np.geomspace(20.0, 2000.0, int(rng.integers(2, 5)))
    tests: list[tuple[str, str, float | None]] = [
        (test, of.struck, float(preload)) for preload in preloads for test in ("coupled", "loosening")
    ]
    if rng.uniform() < 0.5:
        alone = [ends[0] for name, (ends, *_) in of.links.items() if ends[1] == "ground" and name != "joint"]
        tests += [("uncoupled", body, None) for body in alone]
    gauge = float(rng.uniform(0.9, 1.1))
    rows = [_test(rng, of, motion, test, body, preload, noise, gauge) for test, body, preload in tests]
    told = []
    for number, (test, body, preload) in enumerate(tests):
        entry: dict[str, Any] = {"file": f"records/{test}_{number}.h5", "test": test}
        entry |= {"bodies": [body]} if preload is None else {"preload_n": round(preload, 1)}
        entry |= {"hold_out": number % 6 == 4}
        told.append(RecordSettings.model_validate(entry))
    records = tuple(
        Record(record, channels, record.bodies or tuple(of.masses))
        for record, channels in zip(told, rows, strict=True)
    )
    effect = ""
    if rng.uniform() < 0.8:
        effect, records = _faulty(rng, records)
    return Sound(_declared(of, told), records, kind, noise, effect, motion)


def _declared(of: _Lumped, records: list[RecordSettings]) -> CampaignSettings:
    data = {
        "format": "boltlaw-campaign/1",
        "name": "impact tests",
        "body": [{"name": name, "mass_kg": mass} for name, mass in of.masses.items()],
        "link": [
            {"name": name, "between": ends, "law": "bolted" if name == "joint" else "linear"}
            for name, (ends, *_) in of.links.items()
        ],
        "bolt": {"link": "joint"},
        "sampling": {
            "motion_rate_hz": RATE_HZ, "tension_rate_hz": TENSION_RATE_HZ, "pretrigger_s": HIT_S,
        },
        "windows": {"initial_s": [0.0, 0.4], "final_s": [2.0, 2.5]},
        "record": [record.model_dump(exclude_none=True) for record in records],
    }  # fmt: skip
    return CampaignSettings.model_validate(data)


def _test(
    rng: np.random.Generator,
    of: _Lumped,
    motion: str,
    test: str,
    struck: str,
    preload: float | None,
    noise: float,
    gauge: float,
) -> dict[str, Channel]:
    """Channels of one test; a hard hit loosens the bolt by up to a fifth."""
    hard = test == "loosening"
    peak = (1500.0 if hard else 30.0) * rng.uniform(0.8, 1.2)
    length = (0.7e-3 if hard else 1.1e-3) * rng.uniform(0.95, 1.05)
    samples = round(DURATION_S * RATE_HZ)
    phase = (np.arange(samples) / RATE_HZ - HIT_S - rng.uniform(-2e-3, 2e-3)) / length
    force = np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)
    rows = {f"force_{struck}": force + 0.05 * noise * rng.standard_normal(samples)}
    level = (
        noise
        * (0.05 if hard else 0.003)
        * {"acceleration": 1.0, "velocity": 1e-4, "displacement": 1e-7}[motion]
    )
    for body, moved in _moved(of, struck, preload, force, motion).items():
        rows[f"{motion}_{body}"] = moved + level * rng.standard_normal(samples)
    channels = {name: Channel(name, row, RATE_HZ) for name, row in rows.items()}
    if preload is not None:
        time = np.arange(round(DURATION_S * TENSION_RATE_HZ)) / TENSION_RATE_HZ - HIT_S
        lost = (rng.uniform(0.0, 0.2) if hard else 0.0) * -np.expm1(-np.maximum(time, 0.0) / 0.05)
        tension = gauge * preload * (1 - lost) + noise * rng.standard_normal(time.size)
        channels["tension"] = Channel("tension", tension, TENSION_RATE_HZ)
    return channels


def _moved(
    of: _Lumped, struck: str, preload: float | None, force: FloatArray, motion: str
) -> dict[str, FloatArray]:
    """Motion of the bodies by modes in state space, exact for a force that is straight between samples."""
    bodies = [struck] if preload is None else list(of.masses)
    count = len(bodies)
    stiffness, damping = np.zeros((count, count)), np.zeros((count, count))
    for name, (ends, k, c) in of.links.items():
        row = np.array([float(body == ends[0]) - float(body == ends[1]) for body in bodies])
        if name == "joint":
            if preload is None:
                continue
            k, c = k * (1 - 0.4 * np.exp(-preload / 100)), c * (1 + 3 * np.exp(-preload / 300))
        elif preload is None and ends[1] != "ground":
            continue
        stiffness += k * np.outer(row, row)
        damping += c * np.outer(row, row)
    inverse = np.diag([1 / of.masses[body] for body in bodies])
    system = np.block([[np.zeros((count, count)), np.eye(count)], [-inverse @ stiffness, -inverse @ damping]])
    entry = np.concatenate([np.zeros(count), inverse[:, bodies.index(struck)]])
    poles, shapes = linalg.eig(system)
    shares = np.linalg.solve(shapes, entry.astype(complex))
    grown = np.exp(poles / RATE_HZ)
    state = np.zeros((2 * count, force.size))
    for pole, growth, shape, share in zip(poles, grown, shapes.T, shares, strict=True):
        whole = (growth - 1) / pole
        late = (whole - 1 / RATE_HZ) / pole * RATE_HZ  # of a ramp that ends at one
        filtered = signal.lfilter([late, whole - late], [1.0, -growth], force.astype(complex))
        state += np.outer(shape * share, filtered).real
    part = {
        "displacement": state[:count],
        "velocity": state[count:],
        "acceleration": system[count:] @ state + np.outer(entry[count:], force),
    }[motion]
    return dict(zip(bodies, part, strict=True))


Fault = Callable[[Record, Channel, float], FloatArray]
"""Change of a channel at a strength of one: of the record, of its samples."""


def _hum(record: Record, channel: Channel, strength: float) -> FloatArray:
    phase = sum(map(ord, record.file))
    time = np.arange(channel.samples.size) / channel.rate_hz
    return strength * np.cos(2 * np.pi * 50.0 * time + phase)


def _late(_: Record, channel: Channel, strength: float) -> FloatArray:
    places = np.arange(channel.samples.size)
    return np.interp(places - strength * channel.rate_hz, places, channel.samples) - channel.samples


def _coupled(_: Record, channel: Channel, strength: float) -> FloatArray:
    numerator, denominator = signal.bilinear([1.0, 0.0], [1.0, strength], channel.rate_hz)
    start = [channel.samples[0] * (1 - numerator[0])]
    return signal.lfilter(numerator, denominator, channel.samples, zi=start)[0] - channel.samples


def _crossed(record: Record, channel: Channel, strength: float) -> FloatArray:
    kind = channel.name.partition("_")[0]
    others = [c for n, c in record.channels.items() if n.startswith(kind) and n != channel.name]
    return strength * (others[0].samples if others else channel.samples)


FAULTS: Mapping[str, tuple[tuple[str, ...], Fault, float]] = {
    "gain": (("force", "motion"), lambda _, c, s: s * c.samples, 0.1),
    "skew": (("motion",), _late, LATEST_S),
    "tension-skew": (("tension",), _late, 4e-3),
    "ac-coupling": (("acceleration",), _coupled, 10.0),
    "hum": (("force", "motion", "tension"), _hum, np.inf),
    "bias": (("motion",), lambda _, c, s: np.full_like(c.samples, s), np.inf),
    "drift": (("tension",), lambda _, c, s: s * np.arange(c.samples.size) / c.samples.size, np.inf),
    "calibration": (("tension",), lambda _, c, s: s * c.samples, 0.1),
    "offset": (("tension",), lambda _, c, s: np.full_like(c.samples, s), np.inf),
    "cross-axis": (("motion",), _crossed, 0.1),
}
"""Faults of sensors: which channels may have them, the change, the largest strength."""


def _faulty(rng: np.random.Generator, records: tuple[Record, ...]) -> tuple[str, tuple[Record, ...]]:
    """Give one channel of a campaign a fault of an influence that is drawn, up to 9 %."""
    names = sorted({name for record in records for name in record.channels})
    name = str(rng.choice(list(FAULTS)))
    families, fault, most = FAULTS[name]
    motions = [n for n in names if n.partition("_")[0] in MOTIONS]
    of_family = {
        "motion": motions,
        "acceleration": [n for n in motions if n.startswith("acceleration")],
        "force": [n for n in names if n.startswith("force_")],
        "tension": [n for n in names if n == "tension"],
    }
    places = [n for family in families for n in of_family[family]]
    if not places:
        return "", records
    place, wanted = str(rng.choice(places)), float(np.exp(rng.uniform(np.log(0.005), np.log(0.09))))
    sign = 1.0 if name == "ac-coupling" else float(rng.choice([-1.0, 1.0]))
    small = min(most, 1e-4)
    felt = [_influence(r, fault(r, r.channels[place], small), place) for r in records if place in r.channels]
    strength = sign * min(most, small * wanted / max(float(np.mean(felt)), 1e-300))

    def change(record: Record) -> Record:
        channel = record.channels.get(place)
        if channel is None:
            return record
        samples = channel.samples + fault(record, channel, strength)
        return replace(record, channels={**record.channels, place: replace(channel, samples=samples)})

    return f"{name}@{place}", tuple(map(change, records))


def _influence(record: Record, change: FloatArray, place: str) -> float:
    return float(np.sqrt(np.mean(change**2) / np.mean(record.channels[place].samples ** 2)))
