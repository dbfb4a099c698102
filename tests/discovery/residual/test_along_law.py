"""Motion traced along the law of loosening that was found: what made up for another one is dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import rom
from discovery import close_loop
from discovery.residual.output_error import starting
from discovery.residual.trajectory import read_measurements, trace_records
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.effects import CATALOGUE
from rom.identification.identify import identify_campaign

RATCHET = Undeclared("loosening-ratchet", "tension", {"r": 8.8213, "x_r": 0.0, "h_r": 0.9126})
SOFT = Undeclared("oscillating-tension-stiffness", "joint", {"a": 1e5, "b": 0.0})


def measured(folder: Path, *undeclared: Undeclared, cases: int, seed: int = 1299531697) -> rom.Campaign:
    rig.run(folder, cases, 1.0, seed, 1, duration_s=2.5, hold_out_every=5, undeclared=undeclared)
    return rom.read_campaign(folder)


def test_the_tension_of_a_trace_falls_by_the_law_that_was_found_to_where_it_was_measured(
    tmp_path: Path,
) -> None:
    campaign = measured(tmp_path / "campaign", cases=6)
    found = identify_campaign(campaign)
    slow = CATALOGUE["loosening-displacement"].at("tension").with_values(g_x=5.0, p_x=1.0, h_x=1.0)
    quartic = starting(found, found.model)
    changed = replace(quartic, model=quartic.model.with_effect(slow))
    records = [one for one in read_measurements(campaign) if one[0].test == "loosening"]
    window_s, hit_s = campaign.settings.windows.final_s, campaign.settings.sampling.pretrigger_s
    pairs = zip(*(trace_records(campaign, one, records) for one in (quartic, changed)), strict=True)
    for first, second in pairs:
        start, end = (int(time * first.rate_hz) for time in window_s)
        final = [one.tension[start:end].mean() for one in (first, second)]
        loss = first.tension[0] - final[0]
        assert final[1] == pytest.approx(final[0], abs=0.01 * loss)
        soon = int((hit_s + 0.05) * first.rate_hz)
        assert second.tension[soon] > first.tension[soon] + 0.02 * loss  # a slow law has most before it yet


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "cases"),
    [
        pytest.param((RATCHET,), 10, marks=pytest.mark.variant),
        pytest.param((RATCHET, SOFT), 10, marks=pytest.mark.variant),  # `test_redundant`: what is there stays
        pytest.param((RATCHET,), 20, marks=pytest.mark.variant),
        pytest.param((RATCHET, SOFT), 20, marks=pytest.mark.variant),
    ],
)
def test_only_what_is_needed_along_the_law_found_stays(
    tmp_path: Path, hidden: tuple[Undeclared, ...], cases: int
) -> None:
    """Along |v|^4 T the ratchet leaves what the stiffness at the oscillating tension explains."""
    closure = close_loop(measured(tmp_path / "campaign", *hidden, cases=cases))
    named = [one.effect.name for one in closure.effects]
    laws = [one for one in closure.effects if one.effect.enters == "tension"]
    assert closure.verdict == "closed"
    assert ("oscillating-tension-stiffness" in named) == (SOFT in hidden)
    assert len(laws) == 1
    assert len(closure.steps) == 1 + len(named)
    for rival in laws[0].look_alikes:
        assert "at a preload of" in rival.test or "none of the hits" in rival.test


@pytest.mark.variant
def test_a_law_that_is_plainly_another_comes_before_effects_in_the_motion(tmp_path: Path) -> None:
    """On a bolt that loosens with |v|^2 the motion is off by several times noise, the courses by far more."""
    rig.run(
        tmp_path / "campaign",
        8,
        1.0,
        4,
        1,
        duration_s=2.5,
        hold_out_every=5,
        law="power-2",
    )
    closure = close_loop(rom.read_campaign(tmp_path / "campaign"))
    assert closure.residual_before.total > 1.5
    assert closure.residual_after.total < 1.2
    assert closure.verdict == "closed"
    (law,) = closure.effects
    assert law.effect.enters == "tension"
    assert "loosening-power" in {law.effect.name, *(one.name for one in law.look_alikes)}
    if law.effect.name == "loosening-power":
        assert law.effect.parameters["q_v"].value == pytest.approx(-2.0, abs=0.2)
