"""What a whole catalogue explains where nothing is missing: ``python -m benchmarks.false_alarms``.

Campaigns of the virtual rig without undeclared effect (20 preloads, records of 2.5 s, one preload in five
held out) at several levels of noise. The effects in the motion that promise most are fitted, whether or not a
closure would find them worth it, and all in the tension and its gauge; the table gives the largest gain in
cost of any of them, in units of what is left over and as a share of the cost, and in how many campaigns signs
of records drawn anew let it pass (``discovery.decide.chance``). The conditions of
``discovery.decide.acceptance`` have to
stand above. In the tension gains are too large, if anything: the rig's gauge has a reading of its own,
5 N/mm, which is an effect.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from discovery.criteria.criteria import CRITERIA
from discovery.decide.acceptance import is_accepted, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.motion import explain_effect, screen
from discovery.explain.motion_fit import refit
from discovery.explain.probes import by_chance
from discovery.explain.tension import explain as explain_tension
from discovery.options import Options
from discovery.residual.output_error import starting, whitened_residual_of
from discovery.residual.tension import TensionResidual
from discovery.residual.trajectory import read_measurements
from experiments.studies import rig
from experiments.studies.blind.trials import DURATION_S, HOLD_OUT_EVERY, PRELOADS
from rom.campaign.campaign import read_campaign
from rom.identification.identify import identify_campaign

PARTS = ("motion", "tension")
FITTED = 8
"""Effects in the motion, in the order of the screen."""


@dataclass(frozen=True)
class Null:
    """The effect of a catalogue that gains most where there is none, and how many would pass for sure."""

    effects: int
    name: str
    training: float
    hold_out: float
    share: float
    passes: bool
    sure: int


def null_of(explanations: Sequence[Explanation]) -> Null:
    """Summarise all fits of a catalogue to one campaign."""
    gains = [
        tuple(float(one.gains(hold_out=held).sum() / spread_of(one)) for held in (False, True))
        for one in explanations
    ]
    best = int(np.argmax([training for training, _ in gains]))
    first = explanations[best]
    return Null(
        len(gains), first.effect.path, *gains[best], first.share(),
        first.p_value is not None and first.p_value <= CRITERIA.chance.false_alarms,
        sum(is_accepted(e) for e in
        explanations),
    )  # fmt: skip


def nulls(noise: float, seed: int, folder: Path) -> tuple[Null, Null]:
    """Fit the catalogue to one campaign that lacks nothing: motion, tension."""
    rig.run(
        folder, cases=PRELOADS, duration_s=DURATION_S, hold_out_every=HOLD_OUT_EVERY, noise=noise, seed=seed
    )
    campaign = read_campaign(folder)
    found = identify_campaign(campaign)
    sound = read_measurements(campaign, frozenset(doubt.file for doubt in found.set_aside))
    evidence = refit(whitened_residual_of(campaign, starting(found, found.model), sound))
    screened = screen(evidence, Options())
    in_motion = [explain_effect(probes, evidence, by_chance(screened)) for probes in screened[:FITTED]]
    in_tension = explain_tension(TensionResidual(campaign, found, evidence.baseline.model), Options())
    return null_of(in_motion), null_of(in_tension)


def rows(noise: float, found: Sequence[tuple[Null, Null]]) -> Iterator[tuple[str, ...]]:
    """Rows of the table for one level of noise."""
    for part, ones in zip(PARTS, zip(*found, strict=True), strict=True):
        training = [one.training for one in ones]
        first = ones[int(np.argmax(training))]
        yield (
            f"{noise:g}", part, f"{len(ones)}", f"{np.median([one.effects for one in ones]):.0f}",
            f"{np.median(training):.1f}", f"{np.quantile(training, 0.9):.1f}",
            f"{first.training:.1f} ({first.name})", f"{first.hold_out:.1f}",
            f"{max(100 * one.share for one in ones):.2g} %", f"{sum(one.passes for one in ones)}",
            f"{sum(one.sure > 0 for one in ones)}",
        )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, a level of noise after the other."""
    parser = argparse.ArgumentParser("python -m benchmarks.false_alarms", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="campaigns at each level of noise")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed")
    parser.add_argument("--noise", type=float, nargs="+", default=(0.5, 1.0, 2.0), metavar="X")
    options = parser.parse_args(arguments)
    console = Console(width=140)
    table = Table(title="Gains in cost by chance: the largest of all effects in a campaign, training records")
    columns = ("noise x", "part", "campaigns", "fitted", "median", "90 %", "most", "held out then")
    for name in (*columns, "share", "by signs", "sure"):
        table.add_column(name)
    for noise in options.noise:
        found = []
        for seed in range(options.first, options.first + options.seeds):
            with tempfile.TemporaryDirectory() as scratch:
                found.append(nulls(noise, seed, Path(scratch) / "campaign"))
            for part, one in zip(PARTS, found[-1], strict=True):
                gains = f"{one.training:.1f}, {one.hold_out:.1f} held out"
                console.print(f"noise {noise:g}, seed {seed}, {part}: {one.name} {gains}")
        for row in rows(noise, found):
            table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    main()
