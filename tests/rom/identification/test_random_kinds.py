"""Sound campaigns of random kinds, structures and scales: identified without a warning, nothing accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from rom.identification.identify import identify_campaign
from rom.signals.measured_records import screened, stored
from tests.rom.random_campaigns import random_campaign

SEEDS = range(20)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_any_sound_campaign_is_identified(seed: int, tmp_path: Path) -> None:
    """Warnings are errors here; stiffnesses are within 3 %, and within ten widths of their limits."""
    drawn = random_campaign(tmp_path / "c", seed)
    with stored(drawn.campaign) as campaign:
        told = screened(campaign)
        assert told.screening is not None
        assert not told.screening.suspicions
        found = identify_campaign(told)
    assert not found.set_aside
    for link, truth in drawn.stiffness.items():
        (number,) = found.model.link_laws[link].stiffness.parameters.values()
        assert number.value == pytest.approx(truth, rel=0.03), link
        if number.low is not None and number.high is not None:
            width = max(number.high - number.low, 1e-3 * truth)
            assert abs(number.value - truth) < 10 * width, link
