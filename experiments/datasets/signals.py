"""Signals as a laboratory's file holds them: name, samples, and what it says of unit, rate and start."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import SourceError
from experiments.datasets.times import (
    Clock,
    bracketed_unit,
    clock_of,
    is_count,
    is_time,
    label,
    rises_evenly,
    says_time,
)

NOT_UNDERSTOOD = 0.0  # among `readings`: a rate is stated, but nobody knows which
_AGREE = 0.01  # relative: rates that differ by less are one
_FIRST_COLUMN = re.compile(r"\(:,1\)|\(1,:\)|column 1")


@dataclass(frozen=True, eq=False)
class Signal:
    """One signal of a file; `unit` is empty, `rate_hz` and `start_s` None where the file does not tell.

    `readings` holds rates [Hz] that the file's statement might mean as well: a step without a unit. Without a
    `rate_hz` they are the rates of which one must be that of [sampling].
    `fault` says why there are no samples that can be used. One that is `derived` is a part of
    another, made for signals of fewer samples: people need not know it.
    """

    name: str
    samples: npt.NDArray[np.generic]
    unit: str = ""
    rate_hz: float | None = None
    start_s: float | None = None
    readings: tuple[float, ...] = ()
    fault: str = ""
    derived: bool = False

    def described(self) -> str:
        """Return name, unit and rate for a message."""
        if self.fault:
            return f'"{self.name}" ({self.fault.partition(",")[0]})'
        rate = f" {self.rate_hz:g} Hz" if self.rate_hz else ""
        return f'"{self.name}" [{self.unit or "no unit"}]{rate}'


def labelled(signal: Signal) -> Signal:
    """Give a signal the unit that its label tells where the file tells none."""
    bracketed = bracketed_unit(signal.name)
    return signal if signal.unit.strip() or bracketed is None else replace(signal, unit=bracketed[1])


@dataclass(frozen=True)
class TimeRule:
    """What the map says of a time: its unit, or the factor to s."""

    unit: str | None = None
    scale: float | None = None


class Clocks:
    """The times of a file, asked for the clock of one signal at a time: what nobody needs is not refused."""

    def __init__(
        self, file: str, signals: Iterable[Signal], given: Mapping[str, TimeRule], mapped: Iterable[str]
    ):
        self._file, self._given = file, given
        found, taken = list(signals), set(mapped)
        everything = [signal for signal in found if not signal.fault]
        self._lost = [signal for signal in found if signal.fault and says_time(signal.name)]
        self.times = [s for s in everything if s.name in given or (s.name not in taken and is_time(s))]
        times = {id(time) for time in self.times}
        self.signals = [signal for signal in everything if id(signal) not in times]
        self.apart: set[str] = set()  # times of one length and rate that start apart
        self._idle = [s for s in self.signals if s.name not in taken]

    def of(self, signal: Signal, usual_hz: float) -> Clock | None:
        """Return rate and start of a signal, None where the file tells neither.

        A time of its length goes before what the file states for the signal, a time of its own group or table
        before others. A time that the map names goes before all.

        Raises
        ------
        SourceError
            If a time that is needed is not understood.
        """
        own = [time for time in self.times if len(time.samples) == len(signal.samples)]
        own = [t for t in own if t.name in self._given] or own
        own = [t for t in own if _table(t.name) == _table(signal.name)] or own
        stated = None
        if signal.rate_hz:
            stated = Clock(signal.rate_hz, signal.start_s, "what the file states", signal.readings)
        if own:
            return self._agreed(signal, own, stated)
        if stated is not None:
            return stated
        if self.times and (fault := self._of_no_signal()):
            raise fault
        if clock := self._suspected(signal, usual_hz):
            return clock
        if self._lost:
            lost = self._lost[0]
            raise SourceError(f"{self._file}: {lost.name}: {lost.fault}; or give rate_hz in [channels]")
        return None

    def _agreed(self, signal: Signal, times: list[Signal], stated: Clock | None) -> Clock:
        clocks = [self._clock(time) for time in times]
        if all(abs(clock.rate_hz / clocks[0].rate_hz - 1) < _AGREE for clock in clocks):
            if len({clock.start_s for clock in clocks}) == 1:
                return clocks[0]
            self.apart.add(" and ".join(f'"{time.name}"' for time in times))
            return clocks[0]._replace(start_s=None)
        if stated is not None:
            return stated
        told = " and ".join(
            f'"{time.name}" ({clock.rate_hz:g} Hz)' for time, clock in zip(times, clocks, strict=True)
        )
        raise SourceError(
            f"{self._file}: {signal.name}: found times at odds, {told}, expected one of its length; "
            f'name it with "{times[0].name}" = {{channel = "time", unit = "s"}} or give rate_hz in [channels]'
        )

    def _clock(self, time: Signal) -> Clock:
        rule = self._given.get(time.name, TimeRule())
        return clock_of(self._file, time, rule.unit, rule.scale)

    def _of_no_signal(self) -> SourceError | None:
        """Return the fault of a time that fits no signal at all: it was meant for one."""
        lengths = {len(signal.samples) for signal in self.signals}
        for time in self.times:
            strong = time.name in self._given or says_time(time.name)
            if strong and len(time.samples) not in lengths and self.signals:
                return SourceError(
                    f"{self._file}: {time.name}: found {len(time.samples)} times, expected one a sample "
                    f"({', '.join(map(str, sorted(lengths)))}); give rate_hz in [channels]"
                )
        return None

    def _suspected(self, signal: Signal, usual_hz: float) -> Clock | None:
        """Return the clock of a first column that rises evenly; refuse what may be a time and is not told."""
        for other in self._idle:
            if len(other.samples) != len(signal.samples) or is_count(other) or not rises_evenly(other):
                continue
            clock = clock_of(self._file, replace(other, unit="s"))
            if _FIRST_COLUMN.search(other.name):
                return clock_of(self._file, replace(other, unit=""))
            if abs(clock.rate_hz / usual_hz - 1) > _AGREE:
                raise SourceError(
                    f"{self._file}: {other.name}: found even steps ({clock.rate_hz:g} Hz if a time in s), "
                    f"expected [sampling] ({usual_hz:g} Hz) to be told otherwise; give "
                    f'"{other.name}" = {{channel = "time", unit = "s"}} or rate_hz in [channels]'
                )
        return None


def _table(name: str) -> str:
    """Return what a name shares with those of its group, structure or matrix."""
    base = label(name)[0]
    return re.split(r"\(|[./][^./]*$", base)[0] if re.search(r"[./(]", base) else ""
