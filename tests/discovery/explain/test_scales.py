"""Ranges of the catalogue at other scales: what has no unit stays, the rest goes with the motion."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.explain.scales import OF_GROUND, OF_JOINT, Scale, at_scale, scale_of
from rom.effects import CATALOGUE


def test_every_force_of_the_catalogue_has_a_unit_that_scales() -> None:
    for member in CATALOGUE.values():
        if member.kind == "force":
            for number in member.parameters.values():
                assert OF_JOINT.over(OF_JOINT, number.unit) == 1.0


def test_a_cubic_spring_goes_with_force_over_displacement_cubed() -> None:
    member = CATALOGUE["cubic-stiffness"]
    scale = Scale(20 * OF_GROUND.force, 10 * OF_GROUND.displacement, 7 * OF_GROUND.velocity)
    spring, rules = member.at("spring", ground=True), CRITERIA.tension
    found = at_scale(member, spring, scale, ground=True, pressed=False, criteria=rules).parameters["k3"]
    known = member.ground["k3"]
    assert found.value == pytest.approx(known.value * 20 / 1000)
    assert found.bounds == pytest.approx(tuple(10 * bound * 20 / 1000 for bound in known.bounds))


def test_shares_and_coefficients_of_friction_stay() -> None:
    member = CATALOGUE["jenkins-slip"]
    slider, scale = member.at("contact"), Scale(2.0, 1e-2, 3.0)
    rules = CRITERIA.tension
    found = at_scale(member, slider, scale, ground=False, pressed=True, criteria=rules).parameters
    for name in ("kappa", "mu"):
        assert found[name].value == member.parameters[name].value
        assert found[name].bounds == member.ends[name]


def test_a_slider_that_nothing_presses_has_a_constant_limit() -> None:
    member, scale = CATALOGUE["jenkins-slip"], Scale(20 * OF_GROUND.force, 1e-2, 3.0)
    slider, rules = member.at("contact"), CRITERIA.tension
    found = at_scale(member, slider, scale, ground=False, pressed=False, criteria=rules).parameters
    assert found["F_s"].value == pytest.approx(20 * member.ground["F_s"].value)
    assert found["mu"].value == 0.0
    assert found["kappa"].value == member.parameters["kappa"].value


@pytest.mark.parametrize(("drive", "expected"), [(0.0, 6.0), (5.0, 5.0)])
def test_a_body_that_nobody_drives_is_pulled_as_hard_as_its_mass_resists(
    drive: float, expected: float
) -> None:
    wave = np.sqrt(2) * np.sin(2 * np.pi * np.arange(100) / 100)
    balance = SimpleNamespace(
        place="body:so", pulls={"flexure": 1.0}, terms={"force": drive * wave, "acceleration": 3.0 * wave}
    )
    record = SimpleNamespace(
        settings=SimpleNamespace(hold_out=False, given={}), motion={"flexure": np.stack([wave, wave])},
        balances=(balance,),
    )  # fmt: skip
    bodies = SimpleNamespace(body=(SimpleNamespace(name="so", mass_kg=2.0),))
    campaign: Any = SimpleNamespace(settings=bodies, records=(record,))
    scale = scale_of(campaign, "flexure")
    assert scale is not None
    assert scale.force == pytest.approx(expected)
