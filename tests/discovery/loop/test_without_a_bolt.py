"""The closed loop without a bolt: twins whose truth it is not told, and data that others measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.explain.force_balance import best_fit
from discovery.explain.force_balance_screen import candidates_in_balances, screen, starts_of
from discovery.loop.balance_refits import BalanceRefits
from discovery.loop.close_loop import close_loop
from discovery.loop.history import LoopHistory
from discovery.loop.result import Closure
from discovery.options import Options
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, ModelCorrection, SensorFault
from rom.identification.force_balance import balances_of
from tests.discovery import driven_twins as twins
from tests.shared import measured


def coulomb(_x: FloatArray, v: FloatArray) -> FloatArray:
    return 5.0 * np.tanh(v / 2e-3)


def cubic(x: FloatArray, _v: FloatArray) -> FloatArray:
    return 2e7 * x**3


def numbers(closure: Closure) -> tuple[dict[str, float], dict[str, float]]:
    """Errors beside those of the contract, before and after."""
    return dict(closure.residual_before.numbers), dict(closure.residual_after.numbers)


def test_nothing_is_found_where_a_driven_oscillator_lacks_nothing(tmp_path: Path) -> None:
    found = close_loop(twins.driven(tmp_path / "clean"))
    assert (found.verdict, found.effects) == ("no-effect", ())
    assert found.residual_before.total == pytest.approx(1.0, abs=0.15)
    (force,) = found.residual_before.forces
    assert (force.place, force.level) == ("body mass", pytest.approx(1.0, abs=0.15))
    assert force.explained < 0.05
    assert force.explained_p > 0.01
    assert found.model.structure.bodies[0].mass == pytest.approx(2.0, rel=2e-3)
    assert found.model.parameters["guide.stiffness.k"].value == pytest.approx(8000.0, rel=2e-3)


def test_nothing_is_found_where_a_floating_mass_lacks_nothing(tmp_path: Path) -> None:
    found = close_loop(twins.driven(tmp_path / "clean", stiffness=0.0, offset=0.5))
    assert (found.verdict, found.effects) == ("no-effect", ())
    offset = found.model.parameters["body:mass.constant-force.F_0"]
    assert offset.low is not None
    assert offset.high is not None
    assert offset.value == pytest.approx(0.5, abs=0.02)


def test_nothing_is_found_where_a_cycled_link_lacks_nothing(tmp_path: Path) -> None:
    found = close_loop(twins.cycled(tmp_path / "clean", friction=0.0, seconds=15.0))
    assert (found.verdict, found.effects) == ("no-effect", ())
    assert found.model.parameters["contact.stiffness.k"].value == pytest.approx(2e4, rel=1e-3)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.variant)])
def test_few_cycles_leave_a_multiple_of_the_noise_at_times(tmp_path: Path, seed: int) -> None:
    """Eight rows: their mean square is 1.3 times the noise for the first seed."""
    found = close_loop(twins.cycled(tmp_path / "clean", friction=0.0, seconds=8.0, seed=seed))
    assert (found.verdict, found.effects) == ("no-effect", ())


@pytest.mark.usefixtures("without_detection_limits")
def test_cubic_stiffness_of_a_driven_oscillator_is_named(tmp_path: Path) -> None:
    found = close_loop(twins.driven(tmp_path / "cubic", extra=cubic))
    assert [(one.effect.name, one.effect.enters) for one in found.effects] == [("cubic-stiffness", "guide")]
    assert found.verdict == "closed"
    assert found.effects[0].effect.parameters["k3"].value == pytest.approx(2e7, rel=0.05)
    (force,) = found.residual_before.forces
    assert force.explained > 0.4
    assert force.elastic > 0.9
    assert force.level_positive == pytest.approx(force.level_negative, rel=0.2)
    before, after = (errors["hold_out"]["motion_nrmse"] for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    assert after < before / 5


@pytest.mark.usefixtures("without_detection_limits")
def test_chance_is_drawn_from_blocks_of_driven_records_where_these_are_enough(tmp_path: Path) -> None:
    campaign = twins.driven(tmp_path / "cubic", extra=cubic, sizes=(0.3,) * 4)
    few = Criteria().changed(chance={"blocks": 2})
    (drawn,), (nominal,) = (close_loop(campaign, criteria=one).effects for one in (CRITERIA, few))
    assert (drawn.effect.name, nominal.effect.name) == ("cubic-stiffness", "cubic-stiffness")
    assert (drawn.chance, nominal.chance) == ("drawn", "likelihood ratio")
    assert drawn.p_value == 0.001
    assert nominal.p_value < 1e-6


@pytest.mark.usefixtures("without_detection_limits")
def test_criteria_that_are_handed_over_decide_what_is_named(tmp_path: Path) -> None:
    campaign = twins.driven(tmp_path / "cubic", extra=cubic, sizes=(0.3,) * 4)
    none = close_loop(campaign, criteria=Criteria().changed(acceptance={"training_gain_motion": 1e9}))
    assert (none.verdict, none.effects, len(none.steps)) == ("unexplained", (), 1)
    anything = close_loop(campaign, criteria=Criteria().changed(acceptance={"noise_level": 1e3}))
    assert anything.verdict == "closed"
    assert none.residual_before.total == anything.residual_before.total


@pytest.mark.usefixtures("without_detection_limits")
def test_a_gain_of_the_force_sensor_is_named_where_the_mass_is_given(tmp_path: Path) -> None:
    found = close_loop(twins.driven(tmp_path / "gain", given_kg=2.0, gain=-0.1))
    (one,) = found.effects
    assert (one.effect.name, one.effect.enters) == ("force-gain", "sensor:force_mass")
    gain = one.effect.parameters["g"]
    assert gain.value == pytest.approx(-0.1, abs=2e-3)
    assert gain.low is not None
    assert gain.high is not None
    assert gain.low < -0.1 < gain.high
    assert found.verdict == "closed"
    assert found.model.parameters["guide.stiffness.k"].value == pytest.approx(8000.0, rel=5e-3)


@pytest.mark.usefixtures("without_detection_limits")
def test_a_gain_that_an_added_mass_imitates_is_among_what_cannot_be_told_from_it(tmp_path: Path) -> None:
    (one,) = close_loop(twins.driven(tmp_path / "gain", given_kg=2.0, gain=0.1)).effects
    assert "force-gain" in {one.effect.name, *(other.name for other in one.look_alikes)}


def test_no_gain_of_the_force_sensor_is_offered_where_all_numbers_are_free(tmp_path: Path) -> None:
    free, given = (
        BalanceRefits.of(twins.driven(tmp_path / name, given_kg=mass, gain=-0.1), Options())
        for name, mass in (("free", None), ("given", 2.0))
    )
    offered = [
        {probes[0].effect.name for probes in refits.screen(refits.start().residual)}
        for refits in (free, given)
    ]
    assert "force-gain" not in offered[0]
    assert "force-gain" in offered[1]
    found = close_loop(free.campaign)
    assert (found.verdict, found.effects) == ("no-effect", ())
    assert found.model.structure.bodies[0].mass == pytest.approx(1.8, rel=5e-3)


def test_a_force_sensor_that_no_record_has_is_no_suspect(tmp_path: Path) -> None:
    """A body that nothing drives has a balance too; noise in its motion asked for less of its own force."""
    campaign = twins.driven(tmp_path / "given", given_kg=2.0)
    residual = BalanceRefits.of(campaign, Options()).start().residual
    assert isinstance(residual, ForceBalanceResidual)
    records = tuple(
        replace(record, balances=tuple(
            replace(one, terms={**one.terms, "force": 0 * one.terms["force"]}) for one in record.balances
        ))
        for record in residual.balances.records
    )  # fmt: skip
    undriven = replace(residual, balances=replace(residual.balances, records=records))
    faults = [
        {effect.path for _, effect in candidates_in_balances(one) if isinstance(effect, SensorFault)}
        for one in (residual, undriven)
    ]
    assert faults[0]
    assert not faults[1]


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_what_noise_hides_from_the_balances_is_found_by_simulation(tmp_path: Path) -> None:
    def drag(_x: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(3.0 * np.abs(v) * v)

    found = close_loop(twins.driven(tmp_path / "drag", noise_m=1e-5, extra=drag))
    (one,) = found.effects
    assert (found.verdict, one.effect.path) == ("closed", "guide.quadratic-damping")
    assert one.effect.parameters["c2"].value == pytest.approx(3.0, rel=0.01)


@pytest.mark.usefixtures("without_detection_limits")
def test_coulomb_friction_of_a_floating_mass_is_named(tmp_path: Path) -> None:
    found = close_loop(twins.driven(tmp_path / "coulomb", stiffness=0.0, extra=coulomb))
    assert [(one.effect.name, one.effect.enters) for one in found.effects] == [("coulomb-friction", "guide")]
    assert found.effects[0].effect.parameters["F_c"].value == pytest.approx(5.0, rel=0.05)
    (force,) = found.residual_before.forces
    assert force.explained > 0.7
    assert force.elastic < 0.1
    assert found.model.structure.bodies[0].mass == pytest.approx(2.0, rel=0.02)


@pytest.mark.usefixtures("without_detection_limits")
def test_the_loop_goes_on_until_nothing_helps(tmp_path: Path) -> None:
    def four(x: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(3e5 * x**2 + 200.0 * np.abs(v) * v + 3.0 * np.tanh(v / 2e-3) + cubic(x, v))

    found = close_loop(twins.driven(tmp_path / "four", extra=four))
    told = [{one.effect.name, *(other.name for other in one.look_alikes)} for one in found.effects]
    assert [one.effect.name for one in found.effects[:3]] == [
        "even-stiffness", "quadratic-damping", "coulomb-friction",
    ]  # fmt: skip
    assert "cubic-stiffness" in told[3]
    assert len(found.steps) == len(told) + 1 == 5
    assert found.verdict == "closed"


@pytest.mark.variant
def test_slip_under_a_measured_normal_force_is_named(tmp_path: Path) -> None:
    found = close_loop(twins.cycled(tmp_path / "slip", friction=0.06))
    assert found.effects[0].effect.name == "jenkins-slip"
    assert found.effects[0].effect.parameters["mu"].value == pytest.approx(0.06, rel=0.05)
    after = found.after["hold_out"]["link_force_nrmse"]
    assert after is not None
    assert after < 0.02


def cycled_with(
    folder: Path, force: Callable[[FloatArray, FloatArray, FloatArray], FloatArray], seconds: float = 8.0
) -> Campaign:
    """The cycled link without a slider; its force one of that, of displacement and of normal force."""
    campaign, records = twins.cycled(folder / "right", friction=0.0, seconds=seconds), {}
    for record in campaign.settings.record:
        shown = {name: c.samples for name, c in campaign.load(record).channels.items()}
        seen = (f"{quantity}_contact" for quantity in ("link_force", "link_displacement", "normal_force"))
        shown["link_force_contact"] = force(*(shown[name] for name in seen))
        records[record.file] = ("cycled", record.hold_out, shown, twins.CYCLED_HZ)
    return twins.campaign_of(folder / "other", "slider", "contact", "linear", records)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.usefixtures("without_detection_limits")
def test_friction_in_proportion_to_a_measured_normal_force_is_named(tmp_path: Path) -> None:
    def rubbed(force: FloatArray, x: FloatArray, normal: FloatArray) -> FloatArray:
        speed = np.gradient(np.convolve(x, np.ones(5) / 5, mode="same"), 1 / twins.CYCLED_HZ)
        return np.asarray(force + 0.3 * normal * np.tanh(speed / 1e-4))

    (one,) = close_loop(cycled_with(tmp_path, rubbed)).effects
    assert one.effect.name == "coulomb-friction"
    assert one.effect.parameters["mu"].value == pytest.approx(0.3, rel=0.05)
    assert one.effect.parameters["F_c"].value < 0.05


@pytest.mark.variant
def test_many_sliders_of_rising_limits_are_a_class_of_slip_and_no_other_hysteresis(tmp_path: Path) -> None:
    def slipping(force: FloatArray, x: FloatArray, normal: FloatArray) -> FloatArray:
        del normal
        sliders, total = np.zeros(60), np.empty_like(force)
        limits = np.linspace(0.005, 0.6, 60) / 60
        for k, step in enumerate(np.diff(x, prepend=x[0])):
            sliders = np.clip(sliders + 1e4 / 60 * step, -limits, limits)
            total[k] = sliders.sum()
        return np.asarray(force + total)

    found = close_loop(cycled_with(tmp_path, slipping, seconds=30.0))
    assert found.verdict == "closed"
    assert found.effects[0].effect.name == "iwan-slip"


@pytest.mark.usefixtures("without_detection_limits")
def test_a_force_that_the_catalogue_does_not_have_is_a_free_form(tmp_path: Path) -> None:
    def outside(x: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(1e4 * x * np.abs(v))

    found = close_loop(twins.driven(tmp_path / "outside", extra=outside))
    assert found.verdict == "closed"
    (one,) = found.effects
    assert (one.effect.name, one.source, one.effect.enters) == ("free-form", "free-form", "guide")
    assert "x * abs(v)" in one.effect.equation
    before, after = (errors["hold_out"]["motion_nrmse"] for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    assert after < before / 5


@pytest.mark.usefixtures("without_detection_limits")
def test_a_force_of_the_wrong_sign_is_told(tmp_path: Path) -> None:
    found = close_loop(cycled_with(tmp_path, lambda force, *_: -force))
    assert any("turn its sign round" in line for line in found.warnings)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.variant  # the twin with cubic stiffness is in every run
@pytest.mark.parametrize("parts", [(0, 1, 2, 3, 10), range(11)])
def test_silverbox_lacks_cubic_stiffness(tmp_path: Path, parts: Sequence[int]) -> None:
    found = close_loop(twins.silverbox(measured("silverbox"), tmp_path / "silverbox", parts))
    assert (found.effects[0].effect.name, found.verdict) == ("cubic-stiffness", "closed")
    before, after = numbers(found)
    assert before["simulation_rms_m in part_00.h5"] == pytest.approx(14e-3, rel=0.05)
    assert after["simulation_rms_m in part_00.h5"] < 0.6e-3
    assert before["simulation_rms_m in part_10.h5"] > 5e-3
    assert after["simulation_rms_m in part_10.h5"] < 0.4e-3
    assert any("only the ratios of all numbers to the mass" in line for line in found.warnings)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.variant  # the twin's full slip is in every run
@pytest.mark.parametrize(("share", "left"), [(0.3, 0.1), (1.0, 0.056)])
def test_the_tribometer_lacks_slip_under_its_normal_force(tmp_path: Path, share: float, left: float) -> None:
    """Less data leave more: a few cycles of the first part are held out."""
    found = close_loop(twins.tribometer(measured("tribometer"), tmp_path / "tribometer", share))
    assert found.effects[0].effect.name == "jenkins-slip"
    before, after = (errors["hold_out"]["link_force_nrmse"] for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    assert before > 0.2
    assert after < left
    named = {like.name for like in found.effects[0].look_alikes}
    assert not named & {"coulomb-friction", "cubic-stiffness"}


@pytest.mark.variant
def test_no_friction_without_memory_explains_the_tribometer(tmp_path: Path) -> None:
    """By name, each fitted beside all numbers of the model: held-out balance of forces."""
    balances, _ = balances_of(twins.tribometer(measured("tribometer"), tmp_path / "tribometer"))
    declared = ForceBalanceResidual(balances, (), dict.fromkeys(balances.names, 0.0)).with_numbers()
    probes = {one[0].effect.name: one for one in screen(declared, Options())}
    unseen = ~balances.training

    def error(state: ForceBalanceResidual) -> float:
        left = (state.residual * balances.noise)[unseen]
        return float(np.linalg.norm(left) / np.linalg.norm(balances.force[unseen]))

    def best(name: str) -> ForceBalanceResidual:
        return best_fit(starts_of(probes[name], declared))[0]

    names = ("jenkins-slip", "coulomb-friction", "cubic-stiffness")
    errors = {name: error(best(name)) for name in names}
    assert errors["jenkins-slip"] < 0.05
    assert errors["coulomb-friction"] == pytest.approx(error(declared), rel=0.01)
    assert errors["cubic-stiffness"] > 0.9 * error(declared)


def test_a_mass_or_a_stiffness_at_zero_is_a_doubt_a_damping_only_if_it_would_be_negative(
    tmp_path: Path,
) -> None:
    refits = BalanceRefits.of(twins.driven(tmp_path / "clean"), Options())
    first = refits.start()
    assert isinstance(first.residual, ForceBalanceResidual)
    offset = next(name for name in first.residual.values if name.endswith("F_0"))
    values = {**first.residual.values, offset: 0.1}
    first = replace(first, residual=replace(first.residual, values=values))

    def doubts(name: str, *effects: ModelCorrection) -> list[str]:
        values = {**first.residual.values, name: 0.0}  # type: ignore[attr-defined]
        last = replace(first, residual=replace(first.residual, values=values, effects=effects))  # type: ignore[type-var]
        return [line.partition(":")[0] for line in refits.doubts(LoopHistory((first, last)))]

    friction = CATALOGUE["coulomb-friction"].at("guide", ground=True)
    mass, stiffness, damping = "body.mass.mass", "guide.stiffness.k", "guide.damping.c"
    assert doubts(mass) == [mass]
    assert doubts(stiffness) == [stiffness]
    assert doubts(damping) == []
    assert doubts(offset) == []
    assert doubts(damping, friction.with_values(F_c=10.0)) == [damping]
