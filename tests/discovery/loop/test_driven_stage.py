"""Effects of driven bodies that balances of forces do not tell, and free simulations do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from discovery.loop.close_loop import close_loop
from discovery.loop.free_refits import _beside
from discovery.loop.result import Closure
from rom.effects import CATALOGUE
from tests.discovery import driven_twins as twins
from tests.shared import measured

pytestmark = pytest.mark.usefixtures("without_detection_limits")


def closed(folder: Path, friction: float, seed: int = 3) -> Closure:
    """A drive whose force ripples along its way by 6 N, of which no model knows, and some friction [N]."""

    def extra(x: twins.FloatArray, v: twins.FloatArray) -> twins.FloatArray:
        return 6.0 * np.sin(2 * np.pi * x / 1e-3) + friction * np.tanh(v / 2e-3)

    return close_loop(twins.driven(folder, extra=extra, sizes=(1.0,) * 3, seconds=3.0, seed=seed))


def test_friction_under_a_louder_ripple_shows_in_simulations(tmp_path: Path) -> None:
    found = closed(tmp_path / "friction", 1.0)  # of 0.5 N three of ten twins show any, each by another form
    (one,) = found.effects
    assert (one.effect.name, one.effect.enters, found.verdict) == ("coulomb-friction", "guide", "unexplained")
    strength = one.effect.parameters["F_c"]
    assert strength.low is not None
    assert strength.high is not None
    assert strength.low < 1.0 < strength.high
    before, after = (step.errors["hold_out"]["motion_nrmse"] for step in found.steps)
    assert before is not None
    assert after is not None
    assert after < 0.98 * before
    assert any("coulomb-friction shows in the motion" in line for line in found.warnings)


def test_a_ripple_alone_is_no_friction(tmp_path: Path) -> None:
    found = closed(tmp_path / "ripple", 0.0, seed=5)  # of seven twins one is named: docs/limits.md
    assert (found.effects, found.verdict) == ((), "unexplained")


def test_a_wider_form_takes_over_the_strength_of_the_special_case_that_is_dropped() -> None:
    coulomb = CATALOGUE["coulomb-friction"].at("guide").with_values(F_c=2.0)
    stribeck = CATALOGUE["stribeck-friction"].at("guide").with_values(F_c=0.1, F_d=0.5)
    cubic = CATALOGUE["cubic-stiffness"].at("guide")
    assert _beside(stribeck, coulomb).parameters["F_c"].value == pytest.approx(2.1)
    assert _beside(stribeck, coulomb).parameters["F_d"].value == 0.5
    assert _beside(cubic, coulomb) is cubic
    elsewhere = CATALOGUE["coulomb-friction"].at("other")
    assert _beside(stribeck, elsewhere) is stribeck


def test_emps_and_the_cart_of_others_are_met_better_beside_what_simulations_show(tmp_path: Path) -> None:
    """The best published simulation of the test record of EMPS errs by 4.6 mm, a black box's."""
    emps = twins.emps(measured("emps"), tmp_path / "emps")
    found = close_loop(emps)
    assert [one.effect.name for one in found.effects] == ["coulomb-friction", "position-friction"]
    friction = found.effects[0].effect.parameters["F_c"]
    assert friction.low is not None
    assert friction.high is not None
    assert friction.low < 20.4 < friction.high
    assert found.model.structure.bodies[0].mass == pytest.approx(95.1, rel=0.05)  # a flat valley
    period = found.effects[1].effect.parameters["p"]
    assert period.high == period.bounds[1]  # it reaches beyond the stroke
    after = found.after["hold_out"]["motion_nrmse"]
    motion = emps.load(emps.settings.record[-1]).channels["displacement_carriage"].samples
    assert after is not None
    assert after * np.sqrt(np.mean(motion**2)) < 4.6e-3
    cart = close_loop(rom.read_campaign(measured("others") / "cart-driven"))
    assert cart.effects[0].effect.name == "force-gain-signed"
    after = cart.after["hold_out"]["motion_nrmse"]
    assert after is not None
    assert after < 1.15 * 0.193
