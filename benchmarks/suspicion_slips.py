"""Slips that people make, put into a sound campaign: what changes in which records, what should be said."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g, lbf

from benchmarks.suspicion_campaigns import HIT_S, LATEST_S, Sound
from rom.campaign.campaign import Record
from rom.campaign.channels import MOTIONS, Channel, FloatArray
from rom.signals.damage import white_noise
from rom.signals.suspicions import Suspicion

FEW = 2
NEAR = 0.05
"""Share to which a factor, a delay, a rate is to be met beyond the gain of a sensor."""

Rng = np.random.Generator
Change = Callable[[Record, str, Rng], Record]
"""Of a record, given a body drawn for the whole campaign; the same record where the slip cannot be made."""


@dataclass(frozen=True)
class Slip:
    """One kind of slip.

    Attributes
    ----------
    likely : str
        What is to be named; "{motion}" stands for what is measured.
    change : callable
        What happens to a record; None where settings change (masses).
    factor : float, optional
        What would mend it.
    number : tuple of float, optional
        A number that the finding or the cause has to state, such as a delay [ms], and how far it may be off.
    scales : bool
        Whether declared masses are needed to tell it where all records share it.
    motions : tuple of str
        Motions that may be measured.
    bodies : int
        Fewest bodies.
    gauge : str
        The bolt's channel that is needed.
    ways : tuple of str
        In all records, in a few.
    """

    name: str
    likely: str
    change: Change | None
    factor: float | None = None
    number: tuple[float, float] | None = None
    scales: bool = False
    motions: tuple[str, ...] = MOTIONS
    bodies: int = 1
    gauge: str = ""
    ways: tuple[str, ...] = ("all", "few")

    def fits(self, of: Sound, way: str) -> bool:
        """Whether it can be made in a campaign, and be told at all."""
        gauges = {name for record in of.records for name in record.channels}
        most = sum(record.test != "uncoupled" for record in of.records) > 2 * FEW
        return (
            of.motion in self.motions
            and len(of.settings.body) >= self.bodies
            and (not self.gauge or self.gauge in gauges)
            and (not self.scales or of.declared or (way == "few" and most))
        )

    def names(self, one: Suspicion, of: Sound) -> bool:
        """Whether a suspicion names it, with the right number."""
        wanted = self.likely.format(motion=of.motion)
        if not one.likely.startswith(wanted):
            return False
        near = NEAR + (0.11 if "gain" in of.effect or "calibration" in of.effect else 0.0)
        if self.factor is not None and (
            one.factor is None
            or one.factor * self.factor <= 0
            or abs(np.log(one.factor / self.factor)) > near
        ):
            return False
        if self.number is None:
            return True
        stated, within = self.number
        within += 1e3 * LATEST_S if self.likely == "late by" and "skew" in of.effect else 0.0
        words = [word for word in f"{one.likely} {one.finding}".split() if _number(word) is not None]
        return any(abs(float(word) - stated) <= within for word in words)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


Spoilt = Mapping[str, frozenset[str]]
"""Channels that are wrong, by file."""


def made(of: Sound, slip: Slip, way: str, rng: Rng) -> tuple[Sound, Spoilt]:
    """Put a slip into a campaign; return it with what is wrong then."""
    if slip.change is None:
        bodies = [b.model_copy(update={"mass_kg": 1e3 * (b.mass_kg or 0.0)}) for b in of.settings.body]
        heavy = of.settings.model_copy(update={"body": tuple(bodies)})
        wrong = {r.file: frozenset(f"body:{body}" for body in r.bodies) for r in of.records}
        return replace(of, settings=heavy), wrong
    body = str(rng.choice([b.name for b in of.settings.body]))
    turned = [slip.change(record, body, rng) for record in of.records]
    able = [place for place, record in enumerate(turned) if record is not of.records[place]]
    if way == "few":
        able = [int(place) for place in rng.permutation(able)[:FEW]]
    records = tuple(turned[i] if i in able else record for i, record in enumerate(of.records))
    wrong = {of.records[i].file: _changed(of.records[i], turned[i]) for i in able}
    return replace(of, records=records), wrong


def _changed(before: Record, after: Record) -> frozenset[str]:
    return frozenset(name for name, channel in before.channels.items() if after.channels[name] is not channel)


def _with(record: Record, changed: dict[str, FloatArray]) -> Record:
    if not changed:
        return record
    new = {name: replace(record.channels[name], samples=y) for name, y in changed.items()}
    return replace(record, channels={**record.channels, **new})


def _motions(record: Record) -> list[str]:
    return [name for name in record.channels if name.partition("_")[0] in MOTIONS]


def scaled(prefix: str, factor: float) -> Change:
    """All channels whose names begin so, times a factor."""

    def change(record: Record, _: str, rng: Rng) -> Record:  # noqa: ARG001
        picked = {n: factor * c.samples for n, c in record.channels.items() if n.startswith(prefix)}
        return _with(record, picked)

    return change


def one_scaled(factor: float) -> Change:
    """The motion of one body, times a factor."""

    def change(record: Record, body: str, rng: Rng) -> Record:  # noqa: ARG001
        name = next((name for name in _motions(record) if name.endswith(f"_{body}")), None)
        return record if name is None else _with(record, {name: factor * record.channels[name].samples})

    return change


def _exchanged(record: Record, body: str, rng: Rng) -> Record:  # noqa: ARG001
    names = _motions(record)
    if len(names) < 2:
        return record
    first = next(i for i, name in enumerate(names) if name.endswith(f"_{body}"))
    one, other = names[first], names[(first + 1) % len(names)]
    return _with(record, {one: record.channels[other].samples, other: record.channels[one].samples})


def _of_motions(function: Callable[[FloatArray, FloatArray], FloatArray]) -> Change:
    """All motions, given samples and times."""

    def change(record: Record, _: str, rng: Rng) -> Record:  # noqa: ARG001
        rows = {name: record.channels[name] for name in _motions(record)}
        return _with(record, {n: function(c.samples, _time(c)) for n, c in rows.items()})

    return change


def _of_one(function: Callable[[FloatArray, FloatArray, Rng], FloatArray]) -> Change:
    """The motion of one body, given samples and times."""

    def change(record: Record, body: str, rng: Rng) -> Record:
        name = next((name for name in _motions(record) if name.endswith(f"_{body}")), None)
        if name is None:
            return record
        channel = record.channels[name]
        return _with(record, {name: function(channel.samples.copy(), _time(channel), rng)})

    return change


def _time(channel: Channel) -> FloatArray:
    return np.arange(channel.samples.size) / channel.rate_hz


def _in_digits(found: FloatArray, of: FloatArray) -> FloatArray:
    """What is measured, in the digits that a channel has."""
    values = np.unique(of)
    if values.size > of.size / 2:
        return found
    digit = float(np.diff(values).min())
    return digit * np.round(found / digit)


def _resampled(y: FloatArray, time: FloatArray, at: FloatArray) -> FloatArray:
    return _in_digits(np.interp(at, time, y), y)


def _late(y: FloatArray, time: FloatArray) -> FloatArray:
    return _resampled(y, time, time - 1e-3)


def _later(y: FloatArray, time: FloatArray) -> FloatArray:
    return _resampled(y, time, time - 12e-3)


def _one_late(y: FloatArray, time: FloatArray, _: Rng) -> FloatArray:
    return _late(y, time)


def _fast_clock(y: FloatArray, time: FloatArray) -> FloatArray:
    return _resampled(y, time, time / 1.0005)


def _other_rate(record: Record, _: str, rng: Rng) -> Record:  # noqa: ARG001
    channels = {name: replace(c, rate_hz=1.0005 * c.rate_hz) for name, c in record.channels.items()}
    return replace(record, channels=channels)


def _overload(y: FloatArray, _: FloatArray, rng: Rng) -> FloatArray:
    y[rng.integers(0, y.size, 4)] = 1e6 if np.abs(y).max() < 1e5 else 1e12
    return y


def _low_code(y: FloatArray, time: FloatArray, rng: Rng) -> FloatArray:
    late = np.flatnonzero(time > HIT_S + 0.05)
    y[rng.choice(late, 3, replace=False)] = rng.uniform(2.0, 4.0) * float(np.abs(y).max())
    return y


def _frozen(y: FloatArray, time: FloatArray, rng: Rng) -> FloatArray:
    start = int(np.searchsorted(time, HIT_S + rng.uniform(0.01, 0.2)))
    y[start : start + int(rng.integers(200, 2000))] = y[start]
    return y


def _rounded(y: FloatArray, time: FloatArray) -> FloatArray:
    return y * np.sin(np.pi * time / time[-1]) ** 2


def _wrapped(y: FloatArray, _: FloatArray, rng: Rng) -> FloatArray:  # noqa: ARG001
    half = 0.7 * float(np.abs(y).max())
    return (y + half) % (2 * half) - half


def _windowed(y: FloatArray, time: FloatArray) -> FloatArray:
    return y * np.exp(-2.0 * np.maximum(time - HIT_S, 0.0))


def _settling(y: FloatArray, time: FloatArray, rng: Rng) -> FloatArray:
    return _in_digits(y + float(rng.choice([-1.0, 1.0])) * 0.2 * np.abs(y).max() * np.exp(-time / 0.5), y)


def _stepped(y: FloatArray, time: FloatArray, rng: Rng) -> FloatArray:
    after = float(y[time > HIT_S].std())
    size = float(rng.choice([-1.0, 1.0])) * rng.uniform(1.0, 4.0) * after
    return _in_digits(y + np.where(time > HIT_S + rng.uniform(0.1, 0.5), size, 0.0), y)


def _dropped(record: Record, _: str, rng: Rng) -> Record:
    return _fallen(record, rng, 0.0)


def _nearly_dropped(record: Record, _: str, rng: Rng) -> Record:
    """To a few hundredths of the level, with the noise of an open input; noise near the level hides it."""
    fallen = _fallen(record, rng, 0.03)
    for name in ("tension", "strain"):
        channel = record.channels.get(name)
        if channel and white_noise(channel.samples) > 0.05 * abs(float(np.median(channel.samples))):
            return record
    return fallen


def _fallen(record: Record, rng: Rng, share: float) -> Record:
    name = next((name for name in ("tension", "strain") if name in record.channels), None)
    if name is None:
        return record
    samples = record.channels[name].samples.copy()
    for start in rng.integers(50, samples.size - 50, 2):
        level = share * float(np.median(samples))
        samples[start : start + 20] = level * (1 + 0.1 * rng.standard_normal(20))
    return _with(record, {name: samples})


def _no_force(record: Record, _: str, rng: Rng) -> Record:
    forces = {n: c for n, c in record.channels.items() if n.startswith("force_")}
    return _with(record, {n: 0.05 * rng.standard_normal(c.samples.size) for n, c in forces.items()})


def _still(record: Record, _: str, rng: Rng) -> Record:  # noqa: ARG001
    return _with(record, {name: np.zeros(record.channels[name].samples.size) for name in _motions(record)})


_G = ("acceleration",)
_FEW = ("few",)  # records are judged one by one
SLIPS: tuple[Slip, ...] = (
    Slip("acceleration in g", "acceleration in g", scaled("acceleration", 1 / g), g, scales=True, motions=_G),
    Slip("one body in g", "acceleration in g", one_scaled(1 / g), g, scales=True, motions=_G, bodies=2),
    Slip("force in kN", "force in kN", scaled("force", 1e-3), 1e3, scales=True),
    Slip("force in lbf", "force in lbf", scaled("force", 1 / lbf), lbf, scales=True),
    Slip("force in kgf", "force in kgf", scaled("force", 1 / g), g, scales=True),
    Slip("tension in kN", "tension in kN", scaled("tension", 1e-3), 1e3, gauge="tension"),
    Slip("tension in lbf", "tension in lbf", scaled("tension", 1 / lbf), lbf, gauge="tension", ways=("all",)),
    Slip("tension sign", "tension sign", scaled("tension", -1.0), -1.0, gauge="tension", ways=("all",)),
    Slip("in mg", "acceleration in mg", scaled("acceleration", 1e3 / g), g / 1e3, scales=True, motions=_G),
    Slip("strain in um/m", "strain in another unit", scaled("strain", 1e3), 1e-3, gauge="strain"),
    Slip("masses in g", "mass in g", None, scales=True, ways=("all",)),
    Slip("channels exchanged", "channels exchanged", _exchanged, scales=True, bodies=2),
    Slip("force sign", "force sign", scaled("force", -1.0), -1.0),
    Slip("sign of one motion", "{motion} sign", one_scaled(-1.0), -1.0, bodies=2),
    Slip("motion 1 ms late", "late by", _of_motions(_late), number=(1.0, 0.05)),
    Slip("one motion 1 ms late", "late by", _of_one(_one_late), number=(1.0, 0.2), bodies=2),
    Slip("motion 12 ms late", "late by", _of_motions(_later), number=(12.0, 0.5)),
    Slip("clock 500 ppm fast", "late by", _of_motions(_fast_clock), number=(0.25, 0.03)),
    Slip("rate off by 500 ppm", "sampling rate", _other_rate, 1.0005, ways=_FEW),
    Slip("overload code", "overload", _of_one(_overload), ways=_FEW),
    Slip("low overload code", "overload", _of_one(_low_code), ways=_FEW),
    Slip("channel frozen", "channel frozen", _of_one(_frozen), ways=_FEW),
    Slip("wrap-around", "wrap-around", _of_one(_wrapped), ways=_FEW),
    Slip("dropouts", "dropouts", _dropped, ways=_FEW),
    Slip("near dropouts", "dropouts", _nearly_dropped, ways=_FEW),
    Slip("Hann window", "Hann window", _of_motions(_rounded)),
    Slip("exponential window", "exponential window", _of_motions(_windowed), number=(2.0, 0.1)),
    Slip("sensor settling", "sensor still settling", _of_one(_settling), motions=_G, ways=_FEW),
    Slip("mean moves", "mean moves", _of_one(_stepped), motions=_G, ways=_FEW),
    Slip("force zero", "force not recorded", scaled("force", 0.0)),
    Slip("force noise alone", "force not recorded", _no_force, ways=_FEW),
    Slip("nothing moves", "nothing moves", _still, ways=_FEW),
)  # fmt: skip
