"""Flexures of a coupled structure stay near what the uncoupled tests say, whatever the model lacks."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from rom.identification.identify import Identification, identify_campaign
from rom.identification.priors import Misfit
from rom.identification.uncoupled_priors import as_uncoupled, constants, of_stiffness, unlikely, unsettled
from rom.model.laws import constant_stiffness
from rom.model.model import Model
from tests.rom.lumped import campaign, noisy, pulse, respond

RATE_HZ, SAMPLES, FINE = 4000.0, 10000, 4
MASSES = {"lo": 8.625, "so": 0.9888}
STIFF, WITH_BOLT = {"lo": 8150.0, "so": 76500.0}, {"lo": 1.1, "so": 1.2}
DAMPING = {"lo": 8.2, "so": 2.7}
JOINT = ("joint", ("lo", "so"), "bolted", 9e5, 900.0)


@cache
def identified(gain: float, *, uncoupled: bool = True) -> Identification:
    """Return what is identified where the hammer on `lo` reads wrong by a factor."""
    rng = np.random.default_rng(5)
    records = []
    for name, bodies in (("lo", ("lo",)), ("so", ("so",)), *((str(i), ("lo", "so")) for i in range(3))):
        struck, bolted = bodies[0], len(bodies) > 1
        links = [
            (f"flexure_{b}", (b, "ground"), "linear", STIFF[b] * (WITH_BOLT[b] if bolted else 1), DAMPING[b])
            for b in bodies
        ]
        force = pulse(30.0, FINE * SAMPLES, FINE * RATE_HZ, 0.4)
        motion = respond(
            {b: MASSES[b] for b in bodies}, [*links, *([JOINT] if bolted else [])], {struck: force},
            FINE * RATE_HZ,
        )  # fmt: skip
        channels = {
            f"acceleration_{b}": noisy(rng, motion[f"acceleration_{b}"][::FINE], 0.01) for b in bodies
        }
        channels[f"force_{struck}"] = force[::FINE] * (gain if struck == "lo" else 1.0)
        test = {"test": "coupled", "preload_n": 100.0} if bolted else {"test": "uncoupled", "bodies": [name]}
        if bolted or uncoupled:
            records.append(({"file": f"{name}.h5"} | test, channels))
    links = [(f"flexure_{b}", (b, "ground"), "linear", 0.0, 0.0) for b in MASSES]
    with TemporaryDirectory() as scratch:
        made = campaign(
            Path(scratch) / "c", MASSES, [*links, JOINT], records, RATE_HZ,
            bolt={"link": "joint", "calibration": [1.0, 0.0, 0.0]},
        )  # fmt: skip
        return identify_campaign(made)


def errors(model: Model) -> dict[str, float]:
    """Return ln of every identified stiffness of a flexure over its truth."""
    found = constants(model)
    with_bolt = {f"flexure_{b}.stiffness": k * WITH_BOLT[b] for b, k in STIFF.items()}
    truth = with_bolt | {f"flexure_{b}.stiffness.uncoupled": k for b, k in STIFF.items()}
    return {name: float(np.log(found[name] / value)) for name, value in truth.items()}


def test_a_sound_campaign_is_settled_and_its_ties_are_not_called_upon() -> None:
    found = identified(1.0)
    assert found.settled
    assert found.linear is not None
    assert len(found.linear.ties) == 5
    assert max(map(abs, errors(found.model).values())) < 0.05


@pytest.mark.parametrize("gain", [0.9, 1.1])
def test_flexures_stay_near_the_plant_under_a_wrong_force_gain(gain: float) -> None:
    found = identified(gain)
    assert found.linear is not None
    assert any(one.systematic > 0 for one in found.linear.misfits)
    assert found.settled
    assert max(map(abs, errors(found.model).values())) < 0.15


def test_a_model_that_went_astray_is_brought_back_to_the_uncoupled_tests() -> None:
    found = identified(1.0)
    assert found.linear is not None
    astray = found.model.with_values({f"flexure_{body}.stiffness.k": 1e-5 for body in MASSES})
    astray = astray.with_values({f"flexure_{body}.damping.c": 500.0 for body in MASSES})
    values = constants(as_uncoupled(astray, found.linear.ties))
    for body in MASSES:
        for name in ("stiffness", "stiffness.uncoupled"):
            assert values[f"flexure_{body}.{name}"] == pytest.approx(STIFF[body], rel=0.02)
        assert values[f"flexure_{body}.damping"] == pytest.approx(DAMPING[body], rel=0.2)
    joint = found.model.link_laws["joint"]
    assert as_uncoupled(astray, found.linear.ties).link_laws["joint"] == joint


def test_masses_stay_as_they_are_declared() -> None:
    assert {body.name: body.mass for body in identified(1.1).model.structure.bodies} == MASSES


def test_a_stiffness_far_from_the_uncoupled_test_is_unlikely() -> None:
    found = identified(1.0)
    assert found.linear is not None
    model, ties = found.model, found.linear.ties
    assert unlikely(model, ties) == ()
    laws = model.link_laws["flexure_lo"]
    soft = replace(laws, stiffness=constant_stiffness(0.02))
    (line,) = unlikely(replace(model, link_laws={**model.link_laws, "flexure_lo": soft}), ties)
    assert "flexure_lo" in line


def test_a_damping_is_unlikely_where_it_is_too_large_only() -> None:
    found = identified(1.0)
    assert found.linear is not None
    model, ties = found.model, found.linear.ties
    for factor, lines in ((0.05, 0), (5.0, 1)):
        laws = dict(model.link_laws)
        old = laws["flexure_lo"].damping
        laws["flexure_lo"] = replace(
            laws["flexure_lo"], damping=old.with_values(c=factor * old.parameters["c"].value)
        )
        both = replace(model, link_laws=laws, uncoupled_laws={})
        assert len(unlikely(both, ties)) == lines
    assert len(of_stiffness(ties)) == 3


def test_misfit_without_uncoupled_tests_leaves_a_fit_unsettled() -> None:
    found = identified(1.0, uncoupled=False)
    assert found.linear is not None
    assert found.settled
    large, small = (Misfit("coupled:lo,so:100", 0.8, 1e4, of_motion) for of_motion in (2e-2, 1e-4))
    (line,) = unsettled(found.model, replace(found.linear, misfits=(large,)))
    assert "80 %" in line
    assert not unsettled(found.model, replace(found.linear, misfits=(small,)))
