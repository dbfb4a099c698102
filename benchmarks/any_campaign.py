"""The closed loop on campaigns of any kind and size: ``python -m benchmarks.any_campaign --count 1000``.

A seed decides all of a campaign: its kind, a chain of one to three bodies, sizes over twelve decades, noise,
and which effect of the catalogue is undeclared, or none. Other kinds, which no seed tells, are drawn with
``--kind``: on a moving ground, mixed, modes, a cycled link, a bolt at rest. The table tells by kind how
often a closure was right, a second one how often the 95 % limits of a right name's numbers hold the truth,
and the lines above them what must never be: a traceback, a warning of a library, a number at an end of its
range without a word.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import drawn_beams, drawn_bolts, drawn_campaigns, drawn_links
from benchmarks.drawn_campaigns import KINDS, OTHER_KINDS, EscapedError
from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from rom.campaign.campaign import read_campaign
from rom.effects import ModelCorrection, look_alikes

CHOICES = (0.0, -1.0, 1.0)
"""Ends of a range that tell what an effect is: nothing of it, or a side."""
FELT = 3.0
"""Times noise: an effect is not felt that moves the motion less beyond what a linear model imitates."""


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


Draw = Callable[[int, Path], tuple[str, ModelCorrection | None, float]]
DRAWN: dict[str, Draw] = {
    **{kind: partial(drawn_campaigns.drawn, kind=kind) for kind in (*KINDS, *OTHER_KINDS)},
    "modes": drawn_beams.drawn,
    "cycled link": drawn_links.drawn,
    "bolt at rest": drawn_bolts.drawn,
}
"""What writes a campaign of a kind and a seed."""


def told(seed: int, kind: str = "") -> Told:
    """Draw the campaign of a seed, of its own kind if none is given, close the loop over it, and compare."""
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        kind, hidden = kind or KINDS[seed % len(KINDS)], ""
        try:
            kind, plant, felt = DRAWN[kind](seed, Path(folder) / "campaign")
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


def _numbers(closure: Closure, hidden: ModelCorrection) -> tuple[Number, ...]:
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
    return "listed" if is_listed(hidden, closure) else f"wrong name{warned}"


def is_listed(hidden: str, closure: Closure) -> bool:
    """Whether an effect is named at its place, or a look-alike of what is."""
    named = {one.effect.path for one in closure.effects}
    enters, _, name = hidden.rpartition(".")
    others = {f"{other.enters}.{other.name}" for one in closure.effects for other in one.look_alikes}
    alike = {f"{enters}.{other}" for other in look_alikes(name)}
    return hidden in named | others or bool(alike & named)


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
    parser.add_argument("--kind", choices=sorted(DRAWN), default="", help="that of each seed if not given")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given, console, rows = parser.parse_args(), Console(soft_wrap=True), list[Told]()
    with ProcessPoolExecutor(given.jobs) as pool:
        seeds = range(given.first, given.first + given.count)
        for row in pool.map(told, seeds, repeat(given.kind)):
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
