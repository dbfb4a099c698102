"""The benchmark of suspicions: a campaign of it, and what counts as named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.suspicion_campaigns import KINDS, sound
from benchmarks.suspicion_slips import SLIPS, made
from benchmarks.suspicions import judged, verdict
from rom.signals.suspicions import Suspicion

SEED = KINDS.index("block")
IN_KN = next(slip for slip in SLIPS if slip.name == "force in kN")


def test_a_sound_campaign_is_not_accused_and_a_slip_is_named() -> None:
    ways = (("force in kN", "all"), ("dropouts", "few"))
    found = judged(SEED, ways)
    assert (found.structure, found.accused) == ("block", ())
    assert set(found.slips) == set(ways)
    assert all(told.named and told.everywhere for told in found.slips.values())


@pytest.mark.parametrize(
    ("changed", "named", "everywhere"),
    [
        ({}, True, True),
        ({"factor": 900.0}, False, False),
        ({"likely": "mass in g"}, False, False),
        ({"channel": "acceleration_block"}, False, False),
    ],
)
def test_a_slip_is_named_by_cause_number_and_channel(
    changed: dict[str, str | float], named: bool, everywhere: bool
) -> None:
    of, wrong = made(sound(SEED), IN_KN, "few", np.random.default_rng(0))
    right = [Suspicion(file, "force_block", "", 1e3, "force in kN", 1.0) for file in wrong]
    told = verdict([replace(one, **changed) for one in right], of, IN_KN, wrong)
    assert (told.named, told.everywhere) == (named, everywhere)


def test_a_record_without_the_slip_that_is_accused_counts_against_all_its_records() -> None:
    of, wrong = made(sound(SEED), IN_KN, "few", np.random.default_rng(0))
    sane = next(record.file for record in of.records if record.file not in wrong)
    found = [Suspicion(file, "force_block", "", 1e3, "force in kN", 1.0) for file in (*wrong, sane)]
    told = verdict(found, of, IN_KN, wrong)
    assert told.named
    assert not told.everywhere
    assert told.instead == "force in kN"
