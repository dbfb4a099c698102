"""A folder of one file and its map: what `boltlaw import` makes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import rom
from experiments.cli import run

FloatArray = npt.NDArray[np.float64]
HZ, N = 25600, 2560
CHANNELS = {
    "F": '{channel = "force_m", unit = "N"}',
    "A": '{channel = "acceleration_m", unit = "m/s2"}',
}


@dataclass(frozen=True)
class Outcome:
    """Exit code, the lines of a refusal, and rates and samples of what came through."""

    code: int
    line: str
    out: str = ""
    rates: Mapping[str, float] = field(default_factory=dict)
    samples: Mapping[str, FloatArray] = field(default_factory=dict)


def force_and_acceleration(samples: int = N) -> tuple[FloatArray, FloatArray]:
    """Return two signals that rise by no even steps."""
    force, acceleration = np.random.default_rng(5).standard_normal((2, samples))
    return force, acceleration


def clock(samples: int = N, rate_hz: float = HZ) -> FloatArray:
    """Return times [s]."""
    return np.arange(samples) / rate_hz


def map_of(
    ending: str, channels: Mapping[str, str], motion_hz: float = 19200, tension_hz: float = 4800
) -> str:
    """Return a map of one driven body with a tension beside it."""
    lines = "\n".join(f'"{name}" = {rule}' for name, rule in channels.items())
    return f"""
format = "boltlaw-import/1"
name = "one body"
body = [{{name = "m"}}]
link = [{{name = "joint", between = ["m", "ground"], law = "bolted"}}]
bolt = {{link = "joint"}}
windows = {{initial_s = [0, 0.01], final_s = [0.05, 0.1]}}
sampling = {{motion_rate_hz = {motion_hz}, tension_rate_hz = {tension_hz}, pretrigger_s = 0}}
[channels]
{lines}
[[record]]
file = "*.{ending}"
test = "driven"
"""


def imported(
    capfd: Any,
    folder: Path,
    form: str,
    channels: Mapping[str, str],
    motion_hz: float = 19200,
    tension_hz: float = 4800,
) -> Outcome:
    """Run the command on the only file of a folder."""
    (source,) = folder.iterdir()
    (folder / "import.toml").write_text(
        map_of(source.suffix[1:], channels, motion_hz, tension_hz), encoding="utf-8"
    )
    new = folder.parent / "new"
    before = set(folder.parent.rglob("*"))
    capfd.readouterr()
    code = run(["import", form, str(folder), str(new), "--jobs", "1"])
    told = capfd.readouterr()
    if code:
        assert told.out == ""
        assert set(folder.parent.rglob("*")) == before
        return Outcome(code, told.err)
    campaign = rom.read_campaign(new)
    channels_ = campaign.load(campaign.settings.record[0]).channels
    return Outcome(
        code, told.err, told.out,
        {name: channel.rate_hz for name, channel in channels_.items()},
        {name: channel.samples for name, channel in channels_.items()},
    )  # fmt: skip


FORCE, ACCELERATION = force_and_acceleration()
Put = Callable[..., Outcome]


def with_time(name: str, unit: str, factor: float, start: float = 0.0) -> dict[str, Any]:
    """Return F, A and a time with its unit."""
    return {
        "F": (FORCE, {}, "run"),
        "A": (ACCELERATION, {}, "run"),
        name: (start + factor * clock(), {"unit_string": unit} if unit else {}, "run"),
    }


def refused(found: Outcome, *words: str) -> None:
    """Require one line with these words."""
    assert found.code == 2, found
    assert len(found.line.splitlines()) == 1, found.line
    assert all(word in found.line for word in words), found.line


def at_rate(found: Outcome, rate_hz: float = HZ) -> None:
    """Require both channels at a rate."""
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": rate_hz, "acceleration_m": rate_hz}, rel=1e-6)
    np.testing.assert_array_equal(found.samples["force_m"], FORCE)
