"""Compile what tests call: ``python -m tests.compile`` before them, else each of their processes would do so.

Machine code stays on disk beside its source; where it is there already this takes seconds.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from discovery.courses.fit import refine
from discovery.loop.close_loop import close_loop
from experiments.rig.excitation import Hit
from experiments.rig.plant import Plant
from experiments.rig.simulation import run
from experiments.rig.undeclared import Undeclared
from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.effects import CATALOGUE
from rom.model.effect import Effect
from tests.discovery.synthetic import free_power, small


def effects() -> None:
    """Every force of the catalogue."""
    for member in CATALOGUE.values():
        effect = member.at(member.places[0], ground=member.places[0] == "ground")
        if isinstance(effect, Effect):
            assert effect.address


def plants() -> None:
    """The virtual rig's equations, with and without a further mass."""
    for hidden in ((), (Undeclared("extra-mode"),)):
        run(Plant(effects=hidden), Hit("lo", 1000.0, 0.001, 0.001), 100.0, 0.003)


def analysis() -> None:
    """Identification and the closed loop of a small campaign, and the fit of a tension law."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = rig.run(
            Path(scratch) / "campaign", cases=4, seed=1, jobs=1, duration_s=2.5, hold_out_every=3
        )
        close_loop(read_campaign(folder))
    refine(free_power(), small(), rounds=1)


if __name__ == "__main__":
    for part in (effects, plants, analysis):
        part()
