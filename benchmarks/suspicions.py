"""Is a sound campaign accused, and is a slip named? ``python -m benchmarks.suspicions``.

Campaigns of the virtual rig and of other structures, with all levels of noise and something undeclared
(`benchmarks.suspicion_campaigns`), are screened as the commands do. The first table counts those of which
anything is suspected. Then every slip (`benchmarks.suspicion_slips`) is put into the same campaigns, in all
records or in a few. It is "named" where the cause that most records show is the right one, with its number;
in "all its records" where it is named in every record that has it and nothing is in the others.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from rich.console import Console
from rich.table import Table

from benchmarks.suspicion_campaigns import Sound, sound
from benchmarks.suspicion_slips import SLIPS, Slip, Spoilt, made
from rom.campaign.campaign import Record
from rom.one_thread import one_threaded
from rom.signals.quality import assess
from rom.signals.suspicions import Evidence, Suspicion, evidence, suspicions

SHOWN_EVERY = 50
"""Campaigns after which the second table is printed as far as it is."""
Way = tuple[str, str]
"""Name of a slip, and whether in all records or a few."""
WAYS: tuple[Way, ...] = tuple((slip.name, way) for slip in SLIPS for way in slip.ways)


@dataclass(frozen=True)
class Told:
    """Whether a slip is named, and in all its records alone; else what it is taken for."""

    named: bool
    everywhere: bool
    instead: str


@dataclass(frozen=True)
class Judged:
    """One campaign: what it is, what is suspected of it as it is, and with each slip."""

    seed: int
    structure: str
    noise: float
    effect: str
    accused: tuple[str, ...]
    slips: Mapping[Way, Told]


def looked_at(record: Record, of: Sound) -> Evidence:
    """What the commands keep of a record."""
    return evidence(record, of.settings, assess(record, of.settings))


@one_threaded
def judged(seed: int, ways: Sequence[Way]) -> Judged:
    """Screen the campaign of a seed, then with each slip that can be made in it."""
    of = sound(seed)
    kept = {record: looked_at(record, of) for record in of.records}
    accused = tuple(
        f"{one.record} {one.channel}: {one.likely or 'no name'}, {one.finding}"
        for one in suspicions(list(kept.values()), of.settings)
    )
    told = {}
    for slip in SLIPS:
        for way in slip.ways:
            if (slip.name, way) in ways and slip.fits(of, way):
                spoilt, wrong = made(of, slip, way, np.random.default_rng([seed, 55]))
                if wrong:
                    told[slip.name, way] = _told(spoilt, kept, slip, wrong)
    return Judged(seed, of.structure, of.noise, of.effect, accused, told)


def _told(spoilt: Sound, kept: Mapping[Record, Evidence], slip: Slip, wrong: Spoilt) -> Told:
    again = slip.change is None
    seen = [
        kept[record] if record in kept and not again else looked_at(record, spoilt)
        for record in spoilt.records
    ]
    return verdict(suspicions(seen, spoilt.settings), spoilt, slip, wrong)


def verdict(found: Sequence[Suspicion], of: Sound, slip: Slip, wrong: Spoilt) -> Told:
    """Compare what is said with the slip that was made.

    Parameters
    ----------
    found : sequence of Suspicion
        What is said.
    of : Sound
        The campaign with the slip.
    slip : Slip
        The slip.
    wrong : mapping of str to frozenset of str
        The channels that have it, by file.
    """
    right = {one.record for one in found if _is_right(one, of, slip, wrong)}
    others = {(s.record, s.likely or "no name") for s in found if not _is_right(s, of, slip, wrong)}
    told = {one.record for one in found}
    instead = Counter(likely for _, likely in others)
    most = max(instead.values(), default=0)
    instead["nothing"] = len(wrong.keys() - told)
    return Told(
        2 * len(right) > len(wrong) and len(right) >= most,
        right == wrong.keys() and not others,
        instead.most_common(1)[0][0],
    )


def _is_right(one: Suspicion, of: Sound, slip: Slip, wrong: Spoilt) -> bool:
    return one.channel in wrong.get(one.record, ()) and slip.names(one, of)


def campaigns(sound_count: int, slip_count: int, first: int, jobs: int) -> Iterator[Judged]:
    """Screen as many sound campaigns, and each slip as often, as asked.

    Parameters
    ----------
    sound_count, slip_count : int
        How many.
    first : int
        The first seed.
    jobs : int
        Processes.
    """
    done: Counter[Way] = Counter()
    seed, batch = first, 4 * jobs
    while seed < first + sound_count or (slip_count and any(done[way] < slip_count for way in WAYS)):
        open_ways = [way for way in WAYS if done[way] < slip_count]
        for one in Parallel(n_jobs=jobs)(delayed(judged)(seed + i, open_ways) for i in range(batch)):
            done.update(list(one.slips))
            yield one
        seed += batch


def sound_table(found: Sequence[Judged]) -> Table:
    """How many campaigns are accused, by structure and noise."""
    table = Table("structure", "noise", "campaigns", "accused", title="Sound campaigns")
    groups: dict[tuple[str, float], list[Judged]] = defaultdict(list)
    for one in found:
        groups[one.structure, one.noise].append(one)
    for (structure, noise), ones in sorted(groups.items()):
        table.add_row(structure, f"{noise:g}", f"{len(ones)}", f"{sum(bool(one.accused) for one in ones)}")
    table.add_row("all", "", f"{len(found)}", f"{sum(bool(one.accused) for one in found)}")
    return table


def slip_table(found: Sequence[Judged], most: int) -> Table:
    """How often each slip is named, and what it is taken for otherwise."""
    columns = ("slip", "in", "campaigns", "named", "in all its records", "taken for")
    table = Table(*columns, title="Slips")
    for way in WAYS:
        ones = [one.slips[way] for one in found if way in one.slips][:most]
        instead = Counter(one.instead for one in ones if not one.everywhere)
        named, everywhere = sum(one.named for one in ones), sum(one.everywhere for one in ones)
        table.add_row(
            *way, f"{len(ones)}", f"{named}", f"{everywhere}",
            ", ".join(f"{what} {count}" for what, count in instead.most_common(4)),
        )  # fmt: skip
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both tables, and before them each accusation and each slip that is not named."""
    parser = argparse.ArgumentParser("python -m benchmarks.suspicions", description=__doc__)
    parser.add_argument("--sound", type=int, default=500, metavar="N", help="sound campaigns")
    parser.add_argument("--slips", type=int, default=100, metavar="N", help="campaigns for each slip")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes")
    options = parser.parse_args(arguments)
    console = Console(width=140, highlight=False)
    found = []
    for one in campaigns(options.sound, options.slips, options.first, options.jobs):
        found.append(one)
        what = f"seed {one.seed}, {one.structure}, noise {one.noise:g}, {one.effect or 'nothing undeclared'}"
        for line in one.accused if one.seed < options.first + options.sound else ():
            console.print(f"{what}: {line}", soft_wrap=True)
        for way, told in one.slips.items():
            if not told.everywhere:
                kind = "named in part" if told.named else "not named"
                console.print(f"{what}: {' in '.join(way)}: {kind}, {told.instead}", soft_wrap=True)
        if len(found) % SHOWN_EVERY == 0:
            console.print(f"{len(found)} campaigns")
            console.print(slip_table(found, options.slips))
    console.print(sound_table([one for one in found if one.seed < options.first + options.sound]))
    console.print(slip_table(found, options.slips))


if __name__ == "__main__":
    from benchmarks import suspicions as importable  # what workers get by name, not by value

    importable.main()
