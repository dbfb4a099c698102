"""Records that can be read, whose samples are not what they should be: for ``benchmarks.fuzz``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from rom.campaign.channels import Channel, FloatArray
from rom.campaign.record import read_channels, write_channels

Change = Callable[[FloatArray, Random], Any]


def _at_one(value: float) -> Change:
    def change(y: FloatArray, random: Random) -> FloatArray:
        y[random.randrange(len(y))] = value
        return y

    return change


def _from(y: FloatArray, random: Random) -> FloatArray:
    y[random.randrange(len(y)) :] = 0.0
    return y


def _noise(y: FloatArray, random: Random) -> FloatArray:
    return y.std() * np.random.default_rng(random.randrange(2**32)).standard_normal(len(y))


CHANGES: dict[str, Change] = {
    "zero": lambda y, _: 0 * y,
    "constant": lambda y, random: np.full(len(y), random.choice((1.0, -1.0, 1e-300, 1e300, y[0], y.max()))),
    "nan": _at_one(np.nan),
    "infinity": _at_one(np.inf),
    "spike": _at_one(1e6),
    "largest number": _at_one(1.7e308),
    "other unit": lambda y, random: y * 10.0 ** random.choice((-12, -6, -3, 3, 6, 12)),
    "vanishing": lambda y, _: y * 1e-200,
    "beyond": lambda y, _: y * 1e200,
    "denormal": lambda y, _: np.sign(y) * 5e-324,
    "sign": lambda y, _: -y,
    "backwards": lambda y, _: y[::-1].copy(),
    "offset": lambda y, random: y + random.choice((1.0, -1.0)) * 10.0 ** random.randint(-3, 12),
    "ramp": lambda y, _: y + np.linspace(0, 100 * y.std(), len(y)),
    "two levels": lambda y, _: np.where(y > np.median(y), y.max(), y.min()),
    "clipped": lambda y, random: np.clip(
        y, *np.quantile(y, [0.5 - (q := random.uniform(0.01, 0.49)), 0.5 + q])
    ),
    "late": lambda y, random: np.roll(y, random.randrange(len(y))),
    "stops": _from,
    "noise": _noise,
    "whole numbers": lambda y, _: y.round(),
    "single precision": lambda y, _: y.astype(np.float32).astype(float),
}


def spoil_record(path: Path, random: Random) -> str:
    """Change one or all channels of a record, its lengths or rates, in place; return what was done."""
    channels = dict(read_channels(path, 400.0, 100.0))
    names = sorted(channels)
    how = random.random()
    if how < 0.08:
        share = random.choice((0.5, 0.1, 0.02, 0.0))
        changed = {
            n: (c.samples[: max(1, round(share * len(c.samples)))], c.rate_hz) for n, c in channels.items()
        }
        said = f"cut to {share:g}"
    elif how < 0.16:
        factor = random.choice((0.01, 0.5, 2.0, 1e3, 1e6, 1e-6))
        changed = {n: (c.samples, c.rate_hz * factor) for n, c in channels.items()}
        said = f"rates times {factor:g}"
    elif how < 0.24 and len(names) > 1:
        one, other = random.sample(names, 2)
        changed = {n: (c.samples, c.rate_hz) for n, c in channels.items()}
        changed[one], changed[other] = changed[other], changed[one]
        said = f"{one} and {other} exchanged"
    else:
        kind = random.choice(sorted(CHANGES))
        chosen = names if random.random() < 0.25 else [random.choice(names)]
        with np.errstate(all="ignore"):
            changed = {
                n: (CHANGES[kind](c.samples.copy(), random) if n in chosen else c.samples, c.rate_hz)
                for n, c in channels.items()
            }
        said = f"{kind}: {', '.join(chosen)}"
    path.unlink()  # it may be one file with the sound one
    made = {n: Channel(n, np.asarray(y, float), rate) for n, (y, rate) in changed.items()}
    try:
        write_channels(path, made)
    except ValueError:  # a table cannot hold every pair of rates
        path.write_text("time_s,force_lo\n")
    return said
