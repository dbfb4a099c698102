"""What effects add to held-out ring-downs, and fits of effects that are weak beside their ranges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.decide.acceptance import OVER_NOISE
from discovery.detection.simulation import DecayMeter
from discovery.explain.simulation_fit import together
from discovery.loop.free_refits import FreeRefits
from discovery.loop.history import LoopHistory
from discovery.options import Options, no_progress
from discovery.residual.base import cost, level
from discovery.residual.simulation import SimulationResidual, over_noise
from rom.campaign.campaign import Campaign
from rom.effects import CATALOGUE
from tests.discovery import ring_down_twins as twins


def started(campaign: Campaign) -> SimulationResidual:
    refits = FreeRefits.of(campaign, Options(1, no_progress, 0, CRITERIA))
    return refits.own(refits.start().residual)


def test_an_effect_may_show_in_what_is_measured_alone(tmp_path: Path) -> None:
    """Where slow noise makes most of the errors of integrated accelerations."""
    campaign = twins.free(tmp_path / "clean", kind="acceleration")
    state = FreeRefits.of(campaign, Options(1, no_progress, 0, CRITERIA)).start()
    training = state.residual.residual[state.residual.training]
    unseen, seen = state.material
    assert seen[OVER_NOISE] == pytest.approx(np.sqrt(np.mean(training**2)))
    assert unseen[OVER_NOISE] == pytest.approx(over_noise(state.residual.residual[~state.residual.training]))
    plainer = replace(state, material=({**unseen, OVER_NOISE: 0.97 * (unseen[OVER_NOISE] or 0.0)}, seen))
    assert LoopHistory((state,)).improves(plainer)
    assert not LoopHistory((state,)).improves(state)


@pytest.mark.parametrize("kind", ["displacement", "acceleration"])
def test_a_response_tells_what_an_effect_leaves_of_training_and_of_held_out_records(
    tmp_path: Path, kind: str
) -> None:
    """A cubic spring shows far less in a record of smaller amplitude than in proportion to its motion."""
    clean = started(twins.free(tmp_path / "clean", kind=kind))
    meter = DecayMeter(clean, {file: {"m": 0.003} for file, _ in clean.held_out})
    cubic = CATALOGUE["cubic-stiffness"].at("s", ground=True)
    (response,) = meter.responses([cubic.with_values(k3=2e4)])
    hiding = started(twins.free(tmp_path / "hiding", "cubic-stiffness", kind, numbers={"k3": 2e4}))
    costs = hiding.costs(hiding.residual)
    rows = clean.costs(np.ones(len(clean.residual)))
    left = {held: sum(costs[f] - rows[f] for f, h in hiding.held_out if h is held) for held in (False, True)}
    assert response is not None
    assert response.square > 1000
    assert response.square == pytest.approx(left[False], rel=0.2)
    assert response.hold_out.sum() == pytest.approx(left[True], rel=0.25)
    (change,) = response.changes["motion_nrmse"]
    (error,) = meter.background.errors["motion_nrmse"]
    assert change > error
    held = np.array([ring.hold_out for ring in clean.rings])[clean.owner]
    ((noise,), (added,)) = (one[OVER_NOISE] for one in (meter.background.errors, response.changes))
    assert np.hypot(noise, added) == pytest.approx(over_noise(hiding.residual[held]), rel=0.12)
    assert response.phases_by_chance[OVER_NOISE] == pytest.approx(held.sum() ** -0.5)


def test_a_slider_that_is_weak_beside_its_range_is_fitted_and_not_put_to_zero(tmp_path: Path) -> None:
    """Its limit of 0.9 mN, of a range up to 200 N, was said to be at the end, zero."""
    numbers = {"kappa": 5e-4, "F_s": 9e-4, "mu": 0.0}
    residual = started(
        twins.free(tmp_path / "weak", "jenkins-slip", noise=1e-4, seconds=4.0, numbers=numbers)
    )
    slider = CATALOGUE["jenkins-slip"].at("s", ground=True)
    wide = {n: replace(p, bounds=(0.0, max(p.bounds[1], 200.0))) for n, p in slider.parameters.items()}
    start = replace(slider, parameters=wide).with_values(kappa=7e-4, F_s=7e-4, mu=0.0)
    after = together(replace(residual, model=residual.model.with_effect(start)))
    assert cost(after) < 0.7 * cost(residual)
    assert level(after) < CRITERIA.acceptance.noise_level
    found = after.model.effects[-1].parameters
    for name in ("kappa", "F_s"):
        assert found[name].value == pytest.approx(numbers[name], rel=0.1)
