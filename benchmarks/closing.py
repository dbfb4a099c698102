"""How long a closed loop takes: ``python -m benchmarks.closing``.

Campaigns of the virtual rig with one undeclared effect each, or none, are closed in one process and thread,
after one whose time does not count: it compiles. The table gives seconds of CPU, and the ratio to those that
``--baseline`` holds, a file that ``--out`` wrote with other code on the same machine.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from discovery.loop.close_loop import close_loop
from discovery.loop.result import Closure
from experiments.studies import rig
from rom.campaign.campaign import read_campaign

EFFECTS = (
    "none", "cubic-stiffness@flexure_lo", "coulomb-friction@joint", "two-sided-gap@joint",
    "bouc-wen@flexure_lo", "extra-mode@body:so", "acceleration-gain@sensor:acceleration_lo",
)  # fmt: skip


def closed(effect: str, seed: int, cases: int, duration_s: float) -> tuple[float, Closure]:
    """Measure a campaign on the rig and close it.

    Parameters
    ----------
    effect : str
        ``NAME@PLACE``, or ``"none"``.
    seed : int
        Of the campaign and of the effect's strength.
    cases : int
        Preloads.
    duration_s : float
        Length of a record [s].

    Returns
    -------
    seconds : float
        CPU time of the loop [s].
    closure : Closure
    """
    name, _, place = effect.partition("@")
    undeclared = () if effect == "none" else (rig.draw(np.random.default_rng(seed), name, place),)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        rig.run(
            folder, cases=cases, duration_s=duration_s, seed=seed, jobs=1, hold_out_every=4,
            undeclared=undeclared,
        )  # fmt: skip
        campaign, start = read_campaign(folder), time.process_time()
        closure = close_loop(campaign)
        return time.process_time() - start, closure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.closing", description=__doc__)
    parser.add_argument("--effects", nargs="+", default=EFFECTS, metavar="NAME@PLACE")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, default=8, help="preloads")
    parser.add_argument("--duration", type=float, default=2.5, metavar="S", help="length of a record")
    parser.add_argument("--out", type=Path, help="file for the seconds")
    parser.add_argument("--baseline", type=Path, help="file of other seconds to compare with")
    options = parser.parse_args(arguments)
    before = json.loads(options.baseline.read_text()) if options.baseline else {}
    closed("none", options.seed, 4, 2.5)
    table, seconds = Table("effect", "CPU s", "before", "ratio", "verdict", "found"), dict[str, float]()
    for effect in options.effects:
        seconds[effect], closure = closed(effect, options.seed, options.cases, options.duration)
        old = before.get(effect)
        compared = ("", "") if old is None else (f"{old:.1f}", f"{seconds[effect] / old:.2f}")
        found = ", ".join(f"{one.effect.name}@{one.effect.enters}" for one in closure.effects)
        table.add_row(effect, f"{seconds[effect]:.1f}", *compared, closure.verdict, found)
    Console(width=140).print(table)
    if options.out:
        options.out.write_text(json.dumps(seconds, indent=1) + "\n")


if __name__ == "__main__":
    main()
