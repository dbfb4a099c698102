"""Small campaigns of the virtual rig that several files of tests look at: made and identified once."""

from __future__ import annotations

import rom
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.state import State
from discovery.options import Options
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.identification.identify import Identification, identify_campaign
from tests.shared import Shared, once_per_run


@once_per_run
def identified(
    *undeclared: Undeclared, cases: int = 4, seed: int = 1, hold_out_every: int = 3
) -> tuple[rom.Campaign, Identification]:
    """A campaign with something undeclared, records of 2.5 s, and what is identified from it."""
    folder = Shared.here.new_folder() / "campaign"
    rig.run(folder, cases, 1.0, seed, 1, duration_s=2.5, hold_out_every=hold_out_every, undeclared=undeclared)
    campaign = rom.read_campaign(folder)
    return campaign, identify_campaign(campaign)


def refits(*undeclared: Undeclared) -> ImpactRefits:
    """Fits of such a campaign."""
    return ImpactRefits(*identified(*undeclared), Options())


@once_per_run
def start(*undeclared: Undeclared) -> State:
    """Its declared model refitted."""
    return refits(*undeclared).start()
