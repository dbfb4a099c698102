"""Signals as a laboratory's file holds them: name, samples, and what it says of unit, rate and start."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from experiments.datasets.vectors import rate_of
from rom.campaign.channels import FloatArray

_TIME = re.compile(r"(?:^|[./])(?:t|[Tt]ime|TIME|[Zz]eit)(?![A-Za-z])[^./]*$")
_SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3}


@dataclass(frozen=True, eq=False)
class Signal:
    """One signal of a file; `unit` is empty and `rate_hz` None where the file does not tell."""

    name: str
    samples: npt.NDArray[np.generic]
    unit: str = ""
    rate_hz: float | None = None
    start_s: float = 0.0

    @property
    def is_time(self) -> bool:
        """Whether it is the time of other signals, by its name and unit."""
        return bool(_TIME.search(self.name)) and self.unit.strip(" []()") in _SECONDS

    def described(self) -> str:
        """Return name, unit and rate for a message."""
        rate = f" {self.rate_hz:g} Hz" if self.rate_hz else ""
        return f'"{self.name}" [{self.unit or "no unit"}]{rate}'


def timed(file: str, signals: Iterable[Signal]) -> list[Signal]:
    """Give every signal the rate and start of the time signal of its length, and leave the times out.

    A file with two rates has two times; where two of one length are at odds, neither tells anything.

    Raises
    ------
    SourceError
        If a time that is needed does not rise evenly.
    """
    signals = list(signals)
    times: dict[int, list[Signal]] = {}
    for signal in signals:
        if signal.is_time:
            times.setdefault(len(signal.samples), []).append(signal)
    clocks: dict[int, tuple[float, float]] = {}
    for length, own in times.items():
        if any(len(signal.samples) == length and not signal.is_time for signal in signals):
            found = {_clock(file, time) for time in own}
            if len(found) == 1:
                clocks[length] = found.pop()
    return [_with_clock(signal, clocks) for signal in signals if not signal.is_time]


def _clock(file: str, time: Signal) -> tuple[float, float]:
    seconds: FloatArray = _SECONDS[time.unit.strip(" []()")] * np.asarray(time.samples, dtype=np.float64)
    return rate_of(f"{file}: {time.name}", seconds), float(seconds[0])


def _with_clock(signal: Signal, clocks: dict[int, tuple[float, float]]) -> Signal:
    clock = clocks.get(len(signal.samples))
    return signal if clock is None else replace(signal, rate_hz=clock[0], start_s=clock[1])
