"""The closed loop on ring-downs without force: twins whose truth it is not told, and data of others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import rom
from discovery.loop.close_loop import close_loop
from rom.effects import CATALOGUE
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from tests.discovery import ring_down_twins as twins
from tests.shared import measured


@pytest.mark.parametrize("kind", ["displacement", pytest.param("acceleration", marks=pytest.mark.slow)])
def test_nothing_is_found_where_a_ring_down_lacks_nothing(tmp_path: Path, kind: str) -> None:
    found = close_loop(twins.free(tmp_path / "clean", kind=kind))
    assert found.verdict == "no-effect"
    assert found.model.parameter("s.stiffness.k").value == pytest.approx(twins.STIFFNESS, rel=1e-3)
    assert found.model.parameter("s.damping.c").value == pytest.approx(twins.DAMPING, rel=1e-2)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",  # cubic springs of driven bodies, of modes and of struck bodies are in every run
    ["coulomb-friction", "quadratic-damping", pytest.param("cubic-stiffness", marks=pytest.mark.variant)],
)
def test_what_a_ring_down_lacks_is_found(tmp_path: Path, effect: str) -> None:
    found = close_loop(twins.free(tmp_path / "twin", effect))
    first = found.effects[0]
    assert effect in (first.effect.name, *(one.name for one in first.look_alikes))
    held = [step.errors["hold_out"]["motion_nrmse"] for step in found.steps]
    assert held[-1] == pytest.approx(0.003, abs=0.002)
    assert first.effect.name in CATALOGUE


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("cubic-stiffness", {"k3": 4e6}),  # of three springs at the largest deflection this is two
        ("even-stiffness", {"k2": 2e4}),  # beyond the range that the linear model's motion tells
        ("one-sided-gap", {"k_g": 2000.0, "delta": 0.003, "side": 1.0}),
    ],
)
def test_an_effect_is_found_that_leaves_a_linear_model_out_of_phase(
    tmp_path: Path, effect: str, numbers: dict[str, float]
) -> None:
    found = close_loop(twins.free(tmp_path / "twin", effect, seconds=6.0, numbers=numbers, seed=1))
    before, after = (errors["hold_out"]["motion_nrmse"] for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    assert before > 0.5
    assert after == pytest.approx(0.003, abs=5e-4)
    (only,) = found.effects
    assert only.effect.name == effect
    for name, true in numbers.items():
        assert only.effect.parameters[name].value == pytest.approx(true, rel=5e-3)


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_softening_and_the_damping_that_comes_with_it_are_found_one_after_the_other(tmp_path: Path) -> None:
    """One form that holds both leads to its parts: hysteresis, which has both too, explains less."""
    found = close_loop(twins.free(tmp_path / "twin", "amplitude-stiffness"))
    names = {one.effect.name for one in found.effects}
    assert names in ({"microslip-softening", "displacement-damping"}, {"amplitude-stiffness"})
    assert found.verdict == "closed"
    before, after = (step.errors["hold_out"]["motion_nrmse"] for step in (found.steps[0], found.steps[-1]))
    assert before is not None
    assert after is not None
    assert after < 0.2 * before


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.variant  # the twin's softening is in every run
def test_a_measured_bolted_beam_softens_as_its_damping_rises() -> None:
    found = close_loop(rom.read_campaign(measured("others/bolted-double-beam")))
    assert {one.effect.name for one in found.effects} == {"microslip-softening", "displacement-damping"}
    held = found.steps[-1].errors["hold_out"]["motion_nrmse"]
    assert held is not None
    assert held < 1.15 * 0.028


@pytest.mark.parametrize(("folder", "most"), [("cart-free-decay", 0.115), ("bolted-double-beam", 0.30)])
def test_the_linear_model_of_measured_ring_downs(folder: str, most: float) -> None:
    campaign = rom.read_campaign(measured(f"others/{folder}"))
    judged = evaluate([rom.identify(campaign)], campaign)
    held = summarise(c for one in judged for c in one.comparisons if one.settings.hold_out)
    assert held["motion_nrmse"] is not None
    assert held["motion_nrmse"] < most


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
@pytest.mark.variant  # the twin's friction is in every run
def test_dry_friction_of_a_measured_cart() -> None:
    """By one record, beside the one that is held out."""
    whole = rom.read_campaign(measured("others/cart-free-decay"))
    two = [whole.settings.record[0], whole.settings.record[-1]]
    found = close_loop(replace(whole, settings=whole.settings.model_copy(update={"record": two})))
    first = found.effects[0].effect
    assert first.name == "coulomb-friction"
    assert first.parameters["F_c"].value == pytest.approx(0.087, rel=0.1)
    held = found.steps[1].errors["hold_out"]["motion_nrmse"]
    assert held is not None
    assert held < 1.15 * 0.035
    assert found.steps[-1].errors["hold_out"]["motion_nrmse"] < 0.015  # type: ignore[operator]
