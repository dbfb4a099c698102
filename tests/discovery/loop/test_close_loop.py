"""The closed loop on small campaigns of the virtual rig whose truth it is not told.

That it closes on a cubic flexure is told with the tutorial's campaign, in `tests/documents/test_pages.py`.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.criteria.criteria import CRITERIA
from discovery.explain.effect_outputs import output_of
from discovery.explain.motion import explain_effect, explanation, screen
from discovery.explain.motion_fit import reestimate_noise, refit, with_effects
from discovery.localisation.localise import localise
from discovery.loop.close_loop import _warnings, close_loop
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.motion_stage import _restarted
from discovery.loop.result import Closure
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import level
from discovery.residual.output_error import WhitenedResidual, starting, whiten, whitened_residual_of
from discovery.residual.trajectory import read_measurements
from discovery.separating_tests.effects import separating_tests
from experiments.studies.rig import Undeclared
from rom.effects import CATALOGUE, register
from rom.effects.link_friction import Array
from rom.effects.member import Member, parameter
from tests.discovery.rig_campaigns import identified, refits, start
from tests.shared import once_per_run

GAIN = Undeclared("acceleration-gain", "sensor:acceleration_so", {"g": 0.1})
CUBIC = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})


@once_per_run
def evidence(*undeclared: Undeclared) -> WhitenedResidual:
    """What the declared model leaves over."""
    campaign, found = identified(*undeclared)
    return refit(whitened_residual_of(campaign, starting(found, found.model), read_measurements(campaign)))


@once_per_run
def closed(*undeclared: Undeclared) -> Closure:
    return close_loop(identified(*undeclared)[0])


def whitened(state: State) -> WhitenedResidual:
    assert isinstance(state.residual, WhitenedResidual)
    return state.residual


def test_nothing_but_noise_is_left_where_nothing_is_missing() -> None:
    found = evidence()
    left = found.left_over(found.residual)
    assert np.mean(left[found.training] ** 2) == pytest.approx(1.0, abs=0.2)
    assert np.mean(left[~found.training] ** 2) == pytest.approx(1.0, abs=0.2)


def test_where_a_residual_lives_is_told_by_the_criteria_that_it_carries() -> None:
    found = evidence()
    often = replace(found, criteria=CRITERIA.changed(localisation={"chance": 0.5}))
    usual, told = (dict(localise(one).white) for one in (found, often))
    assert told["line_correlation_coupled_chance"] < usual["line_correlation_coupled_chance"]


def test_a_missing_effect_stands_out_where_it_acts() -> None:
    before, after = localise(evidence()), localise(evidence(CUBIC))
    assert dict(after.by_frequency)["0 to 30 Hz"] > 3 * dict(before.by_frequency)["0 to 30 Hz"]
    assert dict(after.by_test)["loosening"] > 1.5
    assert dict(after.by_test)["coupled"] < 1.2
    assert after.whiteness_p < 1e-6
    for view in (before.by_time, before.by_place, before.by_sign):
        assert view
        assert all(square == pytest.approx(1.0, abs=0.5) for _, square in view), view
    assert dict(after.by_time)["0 to 0.1 s"] > 1.5
    assert dict(after.by_harmonic)["3rd harmonic"] > 1.5 * dict(after.by_harmonic)["2nd harmonic"]
    lacking = {one.place: one for one in after.forces}["body lo"]
    assert lacking.explained > 0.1
    assert lacking.explained_p <= 0.01
    assert lacking.elastic > 0.8
    assert {one.place: one.explained_p > 0.01 for one in before.forces} == dict.fromkeys(
        ("joint", "body lo", "body so"), True
    )
    json.dumps(after.as_dict(), allow_nan=False)


def test_the_true_effect_explains_the_residual_and_its_strength_comes_out() -> None:
    found = evidence(CUBIC)
    first, second = screen(found, Options())[:2]
    assert (first[0].effect.name, first[0].effect.enters) == ("cubic-stiffness", "flexure_lo")
    assert first[0].gain > second[0].gain
    fitted = explain_effect(first, found)
    strength = fitted.effect.parameters["k3"]
    assert strength.low is not None
    assert strength.high is not None
    assert strength.value == pytest.approx(1e9, rel=0.05)
    assert strength.high - strength.low < 0.1 * strength.value
    assert fitted.share(hold_out=True) > 0.2
    assert fitted.cost(hold_out=False) < sum(
        cost for file, cost in fitted.before.items() if file not in fitted.hold_out
    )


# ruff: noqa: ARG001 - an effect has the arguments of its place
def own_cubic(
    t: float, x: float, v: float, T: float, k: float, c: float, s: Array, p: Array, ds: Array, dT: Array
) -> float:
    return p[0] * x * x * x


def test_an_effect_of_ones_own_is_screened_and_fitted_as_the_catalogue_is() -> None:
    found, strength = evidence(CUBIC), {"q": parameter(5e8, "N/m3", 0.0, 2e10)}
    register(
        Member("own-cubic", ("ground",), "F = q * x ** 3", strength, {"q": 1e8}, ("own",), "", own_cubic)
    )
    try:
        own = next(p for p in screen(found, Options()) if p[0].effect.name == "own-cubic")
        assert own[0].effect.enters == "flexure_lo"
        fitted = explain_effect(own, found)
    finally:
        rom.effects._members.pop("own-cubic")
    assert fitted.effect.parameters["q"].value == pytest.approx(1e9, rel=0.05)
    assert fitted.share(hold_out=True) > 0.2


def test_an_effect_of_zero_strength_changes_nothing() -> None:
    found = evidence()
    silent = CATALOGUE["cubic-stiffness"].silent("flexure_lo", ground=True)
    assert not output_of(silent, found).any()


def test_what_the_model_s_numbers_imitate_is_no_evidence() -> None:
    found = evidence()
    stiffer = found.jacobian[:, found.names.index("flexure_lo.stiffness")]
    assert np.linalg.norm(found.beyond(stiffer)) < 1e-6 * np.linalg.norm(stiffer)
    assert found.steps(0.01 * stiffer)["flexure_lo.stiffness"] == pytest.approx(0.01, rel=1e-6)


def test_a_step_along_the_measured_motion_is_right_from_afar_where_one_along_the_model_s_is_not() -> None:
    near = evidence()
    far = whiten(near.traces, near.baseline.stepped({"flexure_lo.stiffness": 0.3}), near.floors)
    back, short = (
        replace(far, from_afar=along).steps(far.residual)["flexure_lo.stiffness"] for along in (True, False)
    )
    assert back == pytest.approx(1 / 1.3 - 1, abs=0.01)
    assert short != pytest.approx(1 / 1.3 - 1, abs=0.05)


@pytest.mark.parametrize(
    "hidden",
    [
        Undeclared("one-sided-gap", "flexure_lo", {"k_g": 51e3, "delta": 3.35e-4, "side": 1.0}),
        pytest.param(
            Undeclared("extra-mode", "body:so", {"m3": 0.05, "f3": 166.0, "zeta3": 0.013}),
            marks=pytest.mark.variant,
        ),
    ],
)
def test_an_effect_that_leads_the_first_fit_far_astray_is_told_by_what_holds_from_afar(
    hidden: Undeclared,
) -> None:
    found = replace(evidence(hidden), from_afar=True)
    assert level(found) > 100
    first = screen(found, Options())[0]
    assert (first[0].effect.name, first[0].effect.enters) == (hidden.name, hidden.enters)
    assert explain_effect(first, found).share() > 0.95


def test_a_test_is_proposed_that_tells_two_effects_apart_and_none_for_one_and_the_same() -> None:
    found = evidence(CUBIC)
    cubic = CATALOGUE["cubic-stiffness"].at("flexure_lo", ground=True).with_values(k3=1e9)
    gap = CATALOGUE["two-sided-gap"].at("flexure_lo", ground=True).with_values(k_g=1000.0, delta=4e-4)
    apart, same = separating_tests(cubic, [gap, cubic], found)
    expected = r"hit lo .* with \d+ N.*: a difference in chi-square of (\d+) is expected, (\S+) is enough"
    told = re.fullmatch(expected, apart)
    assert told, apart
    assert float(told[1]) > float(told[2]) >= 12.0
    assert same.startswith("none of"), same


def test_the_same_effect_elsewhere_is_told_though_the_model_has_it_here() -> None:
    found = evidence(CUBIC)
    lo, so = (
        CATALOGUE["cubic-stiffness"].at(f"flexure_{body}", ground=True).with_values(k3=1e9)
        for body in ("lo", "so")
    )
    model = lo.added_to(found.baseline.model)
    refined = with_effects(whiten(found.traces, replace(found.baseline, model=model), found.floors))
    (told,) = separating_tests(lo, [so], refined)
    assert told.startswith("hit "), told


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.variant  # a driven body's free form and the stage that decides on one are in every run
@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        (Undeclared("outside-fractional-drag", "flexure_lo", {"c_f": 60.0}), "free-form"),
        (Undeclared("quadratic-damping", "flexure_lo", {"c2": 60.0}), "quadratic-damping"),
    ],
)
def test_a_form_that_is_not_the_true_one_gives_way_to_a_free_one(hidden: Undeclared, named: str) -> None:
    closure = closed(hidden)
    assert closure.verdict == "closed"
    assert [(one.effect.name, one.effect.enters) for one in closure.effects] == [(named, "flexure_lo")]


@pytest.mark.variant
def test_the_loop_closes_on_a_wrong_gain_and_tells_it_exactly() -> None:
    closure = closed(GAIN)
    (found,) = closure.effects
    assert (found.effect.name, found.effect.enters) == ("acceleration-gain", "sensor:acceleration_so")
    assert found.effect.parameters["g"].value == pytest.approx(0.1, rel=0.01)
    assert closure.verdict == "closed"
    assert closure.residual_after.total < 1.2 < closure.residual_before.total


@pytest.mark.variant
def test_a_start_without_stiffness_is_left_for_the_uncoupled_tests() -> None:
    flexures = {f"flexure_{body}.stiffness.k": 1e-5 for body in ("lo", "so")}
    campaign, found = identified(GAIN, cases=6)
    astray = replace(found, model=found.model.with_values(flexures))
    far = refit(whitened_residual_of(campaign, starting(astray, astray.model), read_measurements(campaign)))
    near = ImpactRefits(campaign, astray, Options()).start()
    assert near.level < 0.7 * level(far)
    assert near.model.parameter("flexure_so.stiffness.k").value == pytest.approx(91800, rel=0.2)
    assert screen(whitened(near), Options())[0][0].effect.name == "acceleration-gain"


def test_a_fit_that_was_stuck_goes_on_from_where_one_with_a_further_effect_ended() -> None:
    fits, first = refits(CUBIC), start(CUBIC)
    declared, cubic = whitened(first), CATALOGUE["cubic-stiffness"].at("flexure_lo", ground=True)
    drag = CATALOGUE["quadratic-damping"].at("joint").with_values(c2=1e-3)

    def weighed(model: rom.Model) -> WhitenedResidual:
        return whiten(declared.traces, replace(declared.baseline, model=model), declared.floors)

    right = refit(weighed(cubic.with_values(k3=1e9).added_to(first.model))).baseline.model
    off = {"flexure_lo.stiffness.k": 0.99 * right.parameter("flexure_lo.stiffness.k").value}
    stuck, beside = weighed(right.with_values(off)), weighed(drag.added_to(right))
    far = replace(first, model=stuck.baseline.model, residual=stuck)
    path = LoopHistory((first,)).extended(
        Selection(explanation(cubic, CATALOGUE["cubic-stiffness"], declared)), far
    )
    further = Selection(explanation(drag, CATALOGUE["quadratic-damping"], stuck))
    freed, told = _restarted(fits, path, further, beside)
    assert far.level > 1.2 > freed.last.level
    assert [effect.name for effect in freed.last.model.effects] == ["cubic-stiffness"]
    assert len(freed.states) == len(path.states)
    assert told.best.share() < 0.01  # the credit is not its own
    assert _restarted(fits, freed, further, beside) == (freed, further)  # no better than it is
    alone = LoopHistory((far,))
    assert _restarted(fits, alone, further, beside)[0].last is far  # only beside effects found before


def test_noise_of_a_body_struck_alone_is_told_anew_once_friction_had_passed_for_it() -> None:
    numbers = {"F_c": 0.2, "mu": 0.0, "v_s": 1e-3}
    first = start(Undeclared("coulomb-friction", "flexure_so", numbers))
    friction = CATALOGUE["coulomb-friction"].at("flexure_so", ground=True).with_values(**numbers)
    declared = whitened(first)
    told = replace(declared.baseline, model=friction.added_to(first.model))
    beside = refit(whiten(declared.traces, told, declared.floors))
    sharp = reestimate_noise(beside)
    alone = ("uncoupled", ("so",))
    assert sharp.floors[alone].sensor.max() < 0.1 * declared.floors[alone].sensor.max()
    assert level(sharp) < 1.25  # 34 before; 4 is left in the body struck alone, nothing elsewhere
    assert reestimate_noise(sharp) is sharp
    assert reestimate_noise(declared) is declared


def test_hits_that_come_too_soon_to_tell_noise_by_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("discovery.residual.output_error.quiet_seconds", lambda _: 0.0)
    campaign, found = identified()
    with pytest.raises(ValueError, match=r"at least 0\.22 s, or two periods .* longer pre-trigger"):
        whitened_residual_of(campaign, starting(found, found.model), read_measurements(campaign))


def test_a_bolt_that_its_gauge_shows_slack_tells_of_no_loosening() -> None:
    wrong_zero = Undeclared("calibration-error", "sensor:tension", {"T_0": -10.0, "c_1": 0.0, "c_2": 0.0})
    campaign, found = identified(wrong_zero)
    left = refit(whitened_residual_of(campaign, starting(found, found.model), read_measurements(campaign)))
    (lowest,) = [r.file for r in campaign.select("loosening") if r.preload_n == 6.0]
    assert [line for line in found.warnings if line.startswith(f"{lowest}: the gauge shows -")]
    assert lowest not in [course.file for course in found.courses]
    assert min(estimate.tension for estimate in found.joint) == 0.0
    assert lowest in [trace.settings.file for trace in left.traces]  # its motion tells as much as before
    assert np.isfinite(left.residual).all()


@pytest.mark.parametrize("found", [(), ("an effect",)])
def test_beside_a_refined_model_warnings_of_the_declared_one_say_so(found: tuple[str, ...]) -> None:
    """Those of records hold for every model."""
    record, links = "records/a.h5: late", "the fit of the linear links had not settled"
    settings = SimpleNamespace(record=[SimpleNamespace(file="records/a.h5")])
    refits: Any = SimpleNamespace(
        campaign=SimpleNamespace(settings=settings), of_declared=(record, links), warnings=("not followed",)
    )
    last = SimpleNamespace(warnings=("of the last fit",))
    history: Any = SimpleNamespace(selections=found, last=last, remarks=lambda: ["said"])
    marked = f"of the declared model: {links}" if found else links
    told = list(_warnings(refits, history, ["doubtful"]))
    assert told == ["of the last fit", record, marked, "not followed", "doubtful", "said"]
