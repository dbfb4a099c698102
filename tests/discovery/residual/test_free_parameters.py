"""What a misfit may do to the model's numbers: nothing beside noise is held, much beside a misfit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.loop.history import LoopHistory
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.motion_stage import in_motion
from discovery.loop.refits import Probes
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.output_error import WhitenedResidual
from rom.effects import CATALOGUE
from rom.identification.priors import PriorConstraint
from rom.model.laws import constant_stiffness
from rom.model.power_of_tension import power_stiffness

ROWS = 4000
NAMES = ("flexure_lo.stiffness", "flexure_so.stiffness")


def evidence(misfit: float, *, tied: bool = True) -> WhitenedResidual:
    """Return two numbers of which rows tell the sum well and the difference hardly, beside a misfit."""
    rng = np.random.default_rng(2)
    model = rom.paper_model()
    both, apart, wrong = (rng.normal(size=ROWS) for _ in range(3))
    stiffness = [float(model.link_laws[name.split(".")[0]].stiffness(0.0)) for name in NAMES]
    factors = dict(zip(NAMES, (1.0, -1.0), strict=True))
    tie = PriorConstraint(
        factors, float(np.log(stiffness[0] / stiffness[1])), 0.1, NAMES, "one flexure and the other"
    )
    jacobian = np.stack([100 * both + apart, 100 * both - apart], axis=1)
    residual = rng.normal(size=ROWS) + misfit * (wrong + 0.5 * apart) + 100 * 0.02 * both
    trace: Any = SimpleNamespace(settings=SimpleNamespace(hold_out=False, file="a"))
    return WhitenedResidual(
        traces=(trace,),
        baseline=FreeParameters(model, {}, (tie,) if tied else ()),
        floors={},
        parts=(),
        residual=residual,
        jacobian=jacobian,
        names=NAMES,
        owner=np.zeros(ROWS, dtype=np.int64),
    )


def test_an_error_of_the_tension_changes_the_joint_alone_and_as_its_laws_do() -> None:
    model = rom.paper_model()
    law, numbers = model.link_laws["joint"].stiffness, FreeParameters(model, {})
    share = numbers.change_with_tension("joint.stiffness@a", 20.0, 0.5)
    assert share == pytest.approx(float(law(20.5)) / float(law(20.0)) - 1, rel=0.05)
    assert numbers.change_with_tension("flexure_lo.stiffness", 20.0, 0.5) == 0.0


def test_a_damping_is_one_number_with_the_bolt_in_or_without() -> None:
    model = rom.paper_model()
    alone = {"flexure_lo": replace(model.link_laws["flexure_lo"], stiffness=constant_stiffness(8148.7))}
    first = FreeParameters(replace(model, uncoupled_laws=alone), {})
    moved = first.stepped({"flexure_lo.damping": -0.5, "flexure_lo.stiffness.uncoupled": 0.1}).model
    link, without = moved.link_laws["flexure_lo"], moved.uncoupled_laws["flexure_lo"]
    c = model.link_laws["flexure_lo"].damping.values[0]
    assert link.damping.values[0] == without.damping.values[0] == pytest.approx(0.5 * c)
    assert link.stiffness == model.link_laws["flexure_lo"].stiffness
    assert without.stiffness.values[0] == pytest.approx(1.1 * 8148.7)


def test_a_number_that_its_bounds_give_is_not_free() -> None:
    model = rom.paper_model()
    joint = replace(model.link_laws["joint"], stiffness=power_stiffness(9e5, 0.4, 950.0))
    numbers = FreeParameters(replace(model, link_laws={**model.link_laws, "joint": joint}), {})
    slopes = numbers.slopes("joint.stiffness@a", 1200.0)
    assert slopes["joint.stiffness:k_r"] == pytest.approx(1.0)
    assert slopes["joint.stiffness:m"] == pytest.approx(0.4 * np.log(1200.0 / 950.0), rel=1e-3)
    assert set(slopes) == {"joint.stiffness:k_r", "joint.stiffness:m"}


def test_ties_say_nothing_where_noise_alone_is_left() -> None:
    free, tied = evidence(0.0, tied=False), evidence(0.0)
    assert free.steps(free.residual) == tied.steps(tied.residual)
    assert np.array_equal(free.beyond(free.residual), tied.beyond(tied.residual))


def test_a_misfit_does_not_move_apart_what_the_rows_hardly_tell_apart() -> None:
    def moved(of: WhitenedResidual) -> tuple[float, float]:
        first, second = of.steps(of.residual).values()
        return first + second, first - second

    free, tied = moved(evidence(20.0, tied=False)), moved(evidence(20.0))
    assert free[1] > 5
    assert abs(tied[1]) < 0.5
    assert tied[0] == pytest.approx(0.02, abs=0.02)  # the sum is told as well as before
    assert free[0] == pytest.approx(0.02, abs=0.02)


def test_what_a_tie_holds_is_not_taken_off_a_residual() -> None:
    held, free = evidence(20.0), evidence(20.0, tied=False)
    assert len(held.beyond(held.residual)) == ROWS + 1
    apart = held.jacobian[:, 0] - held.jacobian[:, 1]
    both = held.jacobian.sum(axis=1)
    assert np.linalg.norm(free.beyond(apart)) < 1e-6 * np.linalg.norm(apart)
    assert np.linalg.norm(held.beyond(apart)) > 0.5 * np.linalg.norm(apart)
    assert np.linalg.norm(held.beyond(both)) < 1e-2 * np.linalg.norm(both)


def test_moved_numbers_keep_their_ties() -> None:
    baseline = evidence(0.0).baseline
    assert baseline.stepped({NAMES[0]: 0.1}).ties == baseline.ties


def test_what_a_link_s_own_test_says_of_it_holds_only_where_no_effect_acts_in_it() -> None:
    alike = evidence(0.0).baseline.ties
    masses = ("body.lo.mass", "body.so.mass")
    modes = tuple(
        PriorConstraint({name: 1.0, mass: -1.0}, 9.0, 0.02, (name,), name)
        for name, mass in zip(NAMES, masses, strict=True)
    )
    baseline = FreeParameters(rom.paper_model(), {}, modes + alike)
    assert baseline.believed == baseline.ties
    cubic = CATALOGUE["cubic-stiffness"].at("flexure_so", ground=True)
    further = CATALOGUE["extra-mode"].at("body:lo")
    assert replace(baseline, model=cubic.added_to(baseline.model)).believed == (modes[0], *alike)
    assert replace(baseline, model=further.added_to(baseline.model)).believed == (modes[1], *alike)


def test_an_effect_s_numbers_that_are_the_stiffness_law_s_own_move_with_it() -> None:
    effect = CATALOGUE["oscillating-tension-stiffness"].at("joint")
    moved = FreeParameters(effect.added_to(rom.paper_model()), {}).stepped({"joint.stiffness:alpha": 0.1})
    law = moved.model.link_laws["joint"].stiffness.parameters
    (own,) = (one.parameters for one in moved.model.effects)
    assert own["alpha"].value == law["alpha"].value == pytest.approx(0.9 * effect.parameters["alpha"].value)
    assert own["a"] == effect.parameters["a"]


def test_a_step_beyond_all_numbers_is_none() -> None:
    baseline = FreeParameters(rom.paper_model(), {})
    moved = baseline.stepped({"joint.stiffness:alpha": np.inf, "joint.stiffness:beta": 0.1})
    before, after = (one.model.link_laws["joint"].stiffness.parameters for one in (baseline, moved))
    assert after["alpha"].value == before["alpha"].value
    assert after["beta"].value == pytest.approx(1.1 * before["beta"].value)


@dataclass(frozen=True, eq=False)
class Screening(ImpactRefits):
    """Fits that note along which slopes effects are screened, and find none."""

    asked: list[bool] = field(default_factory=list)

    def screen(self, residual: Residual) -> Probes:
        assert isinstance(residual, WhitenedResidual)
        self.asked.append(residual.from_afar)
        return ()


def test_slopes_from_afar_are_asked_only_far_from_the_structure_and_those_nearby_then_too() -> None:
    def asked_at(*misfits: float, criteria: Criteria = CRITERIA) -> list[bool]:
        nothing: Any = None
        refits = Screening(nothing, nothing, Options(criteria=criteria))
        states = tuple(State(rom.paper_model(), evidence(misfit), nothing) for misfit in misfits)
        in_motion(refits, LoopHistory(states, criteria=criteria))
        return refits.asked

    assert asked_at(0.0) == asked_at(1.0) == [False]
    assert asked_at(20.0) == [True, False]
    assert asked_at(60.0, 5.0) == [False]  # next to nothing of what was there
    assert asked_at(20.0, criteria=Criteria().changed(closing={"far_from_structure": 1e4})) == [False]
