"""Whether effects are found at their detection limits: ``python -m benchmarks.detection_limits``.

Each campaign (`benchmarks.drawn_campaigns`) is closed with nothing hidden, which tells the limits of all
effects. Then some of these are hidden in the same campaign, with other noise: at the limit, where they are
to be found with a probability of 0.8, and at three tenths of it. Found is named, or a look-alike of what is.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.any_campaign import is_listed
from benchmarks.drawn_campaigns import KINDS, EscapedError, drawn
from discovery.detection.limit import DetectionLimit
from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from rom.campaign.campaign import read_campaign
from rom.effects import CATALOGUE, Effect

SHARES = (1.0, 0.3)
"""Of the limit."""


@dataclass(frozen=True)
class Clean:
    """What the closure of a campaign says that hides nothing: names, which are false, and its limits."""

    seed: int
    named: tuple[str, ...]
    limits: tuple[DetectionLimit, ...]


@dataclass(frozen=True)
class Trial:
    """An effect to be hidden in a campaign at a share of its limit, and which draw of noise that has."""

    seed: int
    limit: DetectionLimit
    share: float
    noise_of: int


@dataclass(frozen=True)
class Outcome:
    """What became of a trial: "found", "other name", "nothing" or "not drawn", and what was named."""

    trial: Trial
    outcome: str
    named: tuple[str, ...] = ()


def without_effect(seed: int) -> Clean:
    """Close the loop over the campaign of a seed with nothing hidden."""
    with tempfile.TemporaryDirectory() as folder:
        drawn(seed, Path(folder) / "campaign", ())
        closure = close_loop(read_campaign(Path(folder) / "campaign"), jobs=1)
    return Clean(seed, _named(closure), closure.detection_limits)


def tried(trial: Trial) -> Outcome:
    """Hide an effect, close the loop, and see whether it is found."""
    hidden = hidden_effect(trial.limit, trial.share)
    with tempfile.TemporaryDirectory() as folder:
        try:
            drawn(trial.seed, Path(folder) / "campaign", (hidden,), trial.noise_of)
        except EscapedError:
            return Outcome(trial, "not drawn")
        with patch.object(import_module("discovery.loop.close_loop"), "_detection_limits", lambda *_: ()):
            closure = close_loop(read_campaign(Path(folder) / "campaign"), jobs=1)
    named = _named(closure)
    found = "found" if is_listed(hidden.path, closure) else "other name" if named else "nothing"
    return Outcome(trial, found, named)


def hidden_effect(limit: DetectionLimit, share: float) -> Effect:
    """Return the effect of a limit at a share of it, in the limit's shape: a slider slips where it did."""
    assert limit.value is not None
    member = CATALOGUE[limit.name]
    effect = member.silent(limit.enters)
    assert isinstance(effect, Effect)
    shape = {name: value * (share if name in member.limits else 1.0) for name, value in limit.shape.items()}
    values = {**shape, limit.parameter: share * limit.value}
    numbers = {
        name: replace(number, value=values.get(name, number.value), bounds=(-np.inf, np.inf))
        for name, number in effect.parameters.items()
    }
    return replace(effect, parameters=numbers)


def _named(closure: Closure) -> tuple[str, ...]:
    return tuple(one.effect.path for one in closure.effects)


def trials(cleans: Iterable[Clean], each: int) -> Iterator[Trial]:
    """Yield some effects of each campaign at all shares of the limit: those that were taken least so far."""
    taken: Counter[str] = Counter()
    for clean in cleans:
        by_name: dict[str, list[DetectionLimit]] = {}
        for limit in clean.limits:
            if limit.value is not None and not limit.enters.startswith("sensor:"):
                by_name.setdefault(limit.name, []).append(limit)
        rng = np.random.default_rng(clean.seed)
        names = rng.permutation(sorted(by_name)).tolist()
        for place, name in enumerate(sorted(names, key=lambda one: taken[one])[:each]):
            taken[name] += 1
            limit = by_name[name][int(rng.integers(len(by_name[name])))]
            yield from (Trial(clean.seed, limit, share, 1 + place) for share in SHARES)


def table(outcomes: Iterable[Outcome], by: str) -> Table:
    """How often an effect is found at each share of its limit, by name or by kind of campaign."""
    found = Table(by, *(f"at {share:g} of the limit: found, other name, of" for share in SHARES), box=None)
    rows: dict[str, list[Outcome]] = {}
    for one in outcomes:
        key = one.trial.limit.name if by == "effect" else KINDS[one.trial.seed % len(KINDS)]
        rows.setdefault(key, []).append(one)
    for key in sorted(rows):
        found.add_row(key, *_counts(rows[key]))
    found.add_row("all", *_counts(one for own in rows.values() for one in own))
    return found


def _counts(outcomes: Iterable[Outcome]) -> list[str]:
    own = [one for one in outcomes if one.outcome != "not drawn"]
    counts = [Counter(one.outcome for one in own if one.trial.share == share) for share in SHARES]
    return [f"{one['found']}, {one['other name']}, {one.total()}" for one in counts]


def main() -> None:
    """Draw, close, hide, close, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="campaigns")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--each", type=int, default=4, help="effects hidden in each campaign")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given, console = parser.parse_args(), Console(soft_wrap=True)
    with ProcessPoolExecutor(given.jobs) as pool:
        cleans = []
        for clean in pool.map(without_effect, range(given.first, given.first + given.count)):
            cleans.append(clean)
            console.print(f"{clean.seed} nothing -> {', '.join(clean.named) or 'nothing'}", markup=False)
        outcomes = []
        for one in pool.map(tried, trials(cleans, given.each)):
            outcomes.append(one)
            trial, limit = one.trial, one.trial.limit
            console.print(
                f"{trial.seed} {limit.enters}.{limit.name} {trial.share:g}, felt "
                f"{trial.share * (limit.felt_percent or 0):.3g} % -> {one.outcome} {', '.join(one.named)}",
                markup=False,
            )
    false = sum(bool(clean.named) for clean in cleans)
    console.print(f"Named where nothing is hidden: {false} of {len(cleans)}.")
    console.print(table(outcomes, "effect"))
    console.print(table(outcomes, "campaign"))


if __name__ == "__main__":
    main()
