"""Numbers that are each record's own come from before its impact, and no further than noise allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom import Model
from rom.effects import CATALOGUE
from rom.evaluation.error_measures import compare
from rom.evaluation.replay import replay
from rom.parameters.he_2025 import paper_model
from rom.signals.per_record_parameters import own_numbers, per_record_names
from tests.rom.shown_records import SETTINGS, record

MODEL, HELD = paper_model(), {"joint": 200.0}


def held(name: str, enters: str, **values: float) -> Model:
    return CATALOGUE[name].at(enters).with_values(**values).added_to(MODEL)


def own(model: Model, measurement: object) -> list[float]:
    found, _ = own_numbers(model, measurement, HELD)  # type: ignore[arg-type]
    (effect,) = found.effects
    return [effect.parameters[name].value for name in per_record_names(effect)]


@pytest.mark.parametrize("channel", ["acceleration_so", "force_lo", "tension"])
def test_the_phase_of_hum_is_found(channel: str) -> None:
    true = CATALOGUE["hum"].at(f"sensor:{channel}").with_values(A=-0.3, B=0.2)
    shown = record(MODEL, [true], noise=1.0)  # type: ignore[list-item]
    within = 0.2 if channel == "tension" else 0.005
    assert own(held("hum", f"sensor:{channel}", A=0.0, B=0.0), shown) == pytest.approx(
        [-0.3, 0.2], abs=within
    )


def test_a_drift_is_found() -> None:
    true = held("tension-drift", "tension", d=1.2)
    shown = record(true, noise=0.2)
    model = held("tension-drift", "tension", d=0.0)
    assert own(model, shown) == pytest.approx([1.2], abs=0.1)
    found = compare(model, shown, SETTINGS.windows)
    assert found.simulated_final == pytest.approx(found.measured_final, abs=0.5)
    assert abs(compare(MODEL, shown, SETTINGS.windows).simulated_final - found.measured_final) > 2.0


def test_noise_alone_hardly_moves_them() -> None:
    model = held("tension-drift", "tension", d=0.05)
    away = [own(model, record(MODEL, noise=1.0, seed=seed))[0] - 0.05 for seed in range(20)]
    assert np.median(np.abs(away)) < 0.05  # a slope over half a second alone would scatter by 0.15
    assert np.count_nonzero(np.array(away) == 0.0) > 5


@pytest.mark.parametrize(("spread", "true", "within"), [(1e-3, 0.8, 1e-4), (10.0, 0.5, 0.4)])
def test_limits_of_the_model_tell_how_far_a_record_may_differ(
    spread: float, true: float, within: float
) -> None:
    """Told to be alike records share the model's number; told to differ each has what it shows."""
    model = held("tension-drift", "tension", d=0.8)
    (drift,) = model.effects
    number = replace(drift.parameters["d"], low=0.8 - 1.96 * spread, high=0.8 + 1.96 * spread)
    limited = replace(model, effects=(replace(drift, parameters={"d": number}),))
    shown = [record(held("tension-drift", "tension", d=true), noise=1.0, seed=seed) for seed in range(6)]
    found = [own(limited, one)[0] for one in shown]
    assert found == pytest.approx([true] * 6, abs=within)
    assert [own(model, one)[0] for one in shown] != pytest.approx(found, abs=1e-3)


def test_ground_motion_is_found_with_the_state_it_keeps_up() -> None:
    true = held("ground-motion", "body:lo", F_a=0.15, F_b=-0.1, f=11.0)
    shown = record(true, noise=1.0, peak_n=20.0)
    model = held("ground-motion", "body:lo", F_a=0.0, F_b=0.0, f=11.0)
    assert own(model, shown) == pytest.approx([0.15, -0.1], abs=0.03)
    with_it, without = (compare(m, shown, SETTINGS.windows).motion_nrmse["lo"] for m in (model, MODEL))
    assert with_it < 0.3 * without
    quiet = own_numbers(model, shown, HELD)[1]
    assert quiet is not None
    assert max(map(abs, quiet.displacement.values())) < 1e-5


def test_a_model_that_diverges_has_a_result_still() -> None:
    wild = held("ground-motion", "body:lo", f=11.0).with_values({"flexure_lo.stiffness.k": -1e12})
    assert not compare(wild, record(MODEL), SETTINGS.windows).finished


def test_nothing_before_the_impact_leaves_the_models_own() -> None:
    model = held("hum", "sensor:acceleration_so", A=0.03, B=0.04)
    shown = record(MODEL, [model.effects[0]], noise=1.0)  # type: ignore[list-item]
    assert own(model, replace(shown, impact_s=0.01)) == [0.03, 0.04]
    assert own(model, replace(shown, impact_s=None)) == [0.03, 0.04]
    assert own(held("hum", "sensor:force_so", A=0.03, B=0.04), shown) == [0.03, 0.04]  # no such channel


def test_a_model_without_such_numbers_is_left_as_it_is() -> None:
    model = held("coulomb-friction", "joint")
    assert own_numbers(model, record(MODEL), HELD) == (model, None)
    assert replay(model, record(MODEL)).model is model
