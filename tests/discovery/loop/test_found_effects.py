"""How an effect that was found is described."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rom
from discovery.explain.motion import explanation
from discovery.explain.motion_fit import refit
from discovery.loop.close_loop import _with_their_limits
from discovery.loop.history import Selection
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.output_error import starting, whiten, whitened_residual_of
from discovery.residual.trajectory import read_measurements
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.effects import CATALOGUE
from rom.identification.identify import identify_campaign
from rom.parameters.he_2025 import paper_model
from tests.discovery.sound_closure import friction


def half_width(parameter: rom.Parameter) -> float:
    assert parameter.low is not None
    assert parameter.high is not None
    assert parameter.low < parameter.value < parameter.high
    return 0.5 * (parameter.high - parameter.low)


def test_limits_of_a_force_are_those_about_the_last_model(tmp_path: Path) -> None:
    hidden = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})
    rig.run(tmp_path / "c", 4, 1.0, 1, 1, duration_s=2.5, hold_out_every=4, undeclared=(hidden,))
    campaign = rom.read_campaign(tmp_path / "c")
    found = identify_campaign(campaign)
    before = refit(whitened_residual_of(campaign, starting(found, found.model), read_measurements(campaign)))
    member = CATALOGUE["cubic-stiffness"]
    cubic = member.at("flexure_lo", ground=True)
    early = explanation(cubic.with_values(k3=3e8), member, before)  # a step of the fit that is far off
    model = cubic.with_values(k3=1e9).added_to(before.baseline.model)
    last = refit(whiten(before.traces, replace(before.baseline, model=model), before.floors))
    nothing: Any = None
    refits = ImpactRefits(campaign, found, Options())
    told = refits.described(Selection(early), State(last.baseline.model, last, nothing)).effect
    (own,) = last.baseline.model.effects
    assert told.parameters["k3"].value == own.parameters["k3"].value
    width = half_width(told.parameters["k3"])
    assert width < 0.5 * half_width(early.effect.parameters["k3"])
    assert told.parameters["k3"].value == pytest.approx(1e9, rel=0.05)


def test_effects_of_the_refined_model_have_the_limits_with_which_they_were_found() -> None:
    found = friction()
    bare = {name: replace(number, low=None, high=None) for name, number in found.effect.parameters.items()}
    model = replace(found.effect, parameters=bare).added_to(paper_model())
    (effect,) = _with_their_limits(model, (found,)).effects
    assert effect.parameters == found.effect.parameters
