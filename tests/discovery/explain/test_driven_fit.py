"""Numbers of a model of driven bodies, fitted by simulation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.decide.acceptance import meets_worse
from discovery.explain.driven_fit import fitted_by_simulation, standard_error
from discovery.explain.simulation_fit import errors_of
from discovery.loop.balance_refits import BalanceRefits
from discovery.options import Options
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE
from rom.model.laws import Parameter
from rom.signals.measured_records import measured_record
from tests.discovery import driven_twins as twins

TRUTH = {"body.mass.mass": 2.0, "guide.stiffness.k": 8000.0, "guide.damping.c": 6.0}


def friction(_x: FloatArray, v: FloatArray) -> FloatArray:
    return 5.0 * np.tanh(v / 2e-3)


def refits_of(folder: Path, extra: Callable[[FloatArray, FloatArray], FloatArray]) -> BalanceRefits:
    return BalanceRefits.of(twins.driven(folder, extra=extra, sizes=(1.0,) * 3, seconds=3.0), Options())


def test_numbers_that_are_off_are_brought_to_the_truth_and_shapes_are_held(tmp_path: Path) -> None:
    refits = refits_of(tmp_path / "c", friction)
    model = refits.start().model
    coulomb = CATALOGUE["coulomb-friction"].at("guide", ground=True).with_values(F_c=4.0, mu=0.0, v_s=2e-3)
    wrong = {path: 1.05 * value for path, value in TRUTH.items()}
    start = model.without_effects_of("force").with_effect(coulomb).with_values(wrong)
    training = [measured_record(refits.campaign, r).measurement for r in refits.sound if not r.hold_out]
    found = fitted_by_simulation(start, tuple(TRUTH), training, CRITERIA)
    assert found is not None
    fitted, numbers, _ = found
    for path, true in (TRUTH | {"guide.coulomb-friction.F_c": 5.0}).items():
        assert fitted.parameter(path).value == pytest.approx(true, rel=0.01), path
        low, high = numbers[path].low, numbers[path].high
        assert low is not None
        assert high is not None
        assert low - 1e-3 * true < true < high + 1e-3 * true, path
    assert fitted.parameter("guide.coulomb-friction.v_s").value == 2e-3
    assert set(numbers) == {*TRUTH, "guide.coulomb-friction.F_c"}


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_shapes_and_states_are_fitted_where_that_leaves_noise_alone(tmp_path: Path, seed: int) -> None:
    """Held at what noisy motion told of them they make the other numbers wrong."""
    width, stiffness = 3e-3, 2e4

    def stop(x: FloatArray, _v: FloatArray) -> FloatArray:
        knee = 0.01 * width
        beyond = np.maximum(x - width + knee / 2, 0.0)
        return stiffness * np.where(beyond > knee, beyond - knee / 2, beyond**2 / (2 * knee))

    noisy = {"noise_m": 1e-4, "sizes": (1.0,) * 3, "seconds": 3.0, "seed": seed}
    refits = BalanceRefits.of(twins.driven(tmp_path / "c", extra=stop, **noisy), Options())
    gap = CATALOGUE["one-sided-gap"].at("guide", ground=True)
    gap = gap.with_values(k_g=0.97 * stiffness, delta=0.98 * width, side=1.0)
    start = refits.start().model.without_effects_of("force").with_values(TRUTH).with_effect(gap)
    training = [measured_record(refits.campaign, r).measurement for r in refits.sound if not r.hold_out]
    found = fitted_by_simulation(start, tuple(TRUTH), training, CRITERIA)
    assert found is not None
    for name, true, near in (("k_g", stiffness, 0.01), ("delta", width, 0.002)):
        number = found.numbers[f"guide.one-sided-gap.{name}"]
        assert abs(number.value - true) < min(3 * standard_error(number), near * true)


def test_a_start_that_first_samples_tell_is_told_anew_with_the_fitted_model(tmp_path: Path) -> None:
    """Where the model is far off, so is the start that it reads from them, and what is fitted with that."""
    campaign = twins.driven(tmp_path / "c", sizes=(1.0,) * 3, seconds=3.0)
    refits = BalanceRefits.of(campaign, Options())
    wrong = {"body.mass.mass": 1.4, "guide.stiffness.k": 6000.0, "guide.damping.c": 20.0}
    model = refits.start().model.without_effects_of("force").with_values(wrong)
    training = [measured_record(refits.campaign, r).measurement for r in refits.sound if not r.hold_out]
    found = fitted_by_simulation(model, tuple(TRUTH), training, CRITERIA)
    assert found is not None
    again = fitted_by_simulation(found.model, tuple(TRUTH), training, CRITERIA)
    assert again is not None
    assert again.level == pytest.approx(found.level, rel=0.02)


def test_a_number_that_shows_next_to_nothing_has_an_error_without_an_end() -> None:
    """Its slopes are below the smallest normal number: warnings are errors here."""
    rows = np.random.default_rng(1).normal(size=50)
    slopes = np.stack([np.ones(50), np.full(50, 1e-310) * np.sign(rows)], axis=1)
    model = SimpleNamespace(parameter=lambda _: Parameter(0.0, "1"))
    residual = SimpleNamespace(pieces=np.arange(50) // 10, model=model)
    fit: Any = SimpleNamespace(slopes=slopes, rows=rows, residual=residual, paths=("seen", "unseen"))
    errors = errors_of(fit)
    assert errors["seen"] == pytest.approx(1 / np.sqrt(50), rel=0.5)
    assert errors["unseen"] == np.inf


def test_records_that_nothing_drives_are_fitted_to_nothing(tmp_path: Path) -> None:
    refits = refits_of(tmp_path / "c", twins.nothing)
    assert fitted_by_simulation(refits.start().model, tuple(TRUTH), [], CRITERIA) is None


@pytest.mark.parametrize(("extra", "gains"), [(twins.nothing, True), (friction, False)])
def test_the_model_has_the_numbers_that_meet_the_motion_better_by_far(
    tmp_path: Path,
    extra: Callable[[FloatArray, FloatArray], FloatArray],
    gains: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Simulations tell the numbers better; where friction is missing neither fit meets the motion."""
    refits = refits_of(tmp_path / "c", extra)
    after = refits.start()
    monkeypatch.setattr(BalanceRefits, "_by_simulation", lambda _self, state: state)
    before = refits_of(tmp_path / "again", extra).start()
    was, now = (state.errors["training"]["motion_nrmse"] for state in (before, after))
    assert was is not None
    assert now is not None
    assert any("fitted by simulation" in line for line in after.warnings) is gains
    assert (now < 0.5 * was) if gains else now == was
    assert not meets_worse(before.errors["hold_out"], after.errors["hold_out"])
    assert after.residual.residual == pytest.approx(before.residual.residual)
    masses = [state.model.structure.bodies[0].mass for state in (before, after)]
    for state, mass in zip((before, after), masses, strict=True):
        assert any(f"its mass {mass:.4g} +-" in line for line in state.warnings)
    if gains:
        off = [abs(state.model.parameter("guide.damping.c").value - 6.0) for state in (before, after)]
        assert off[1] < 0.2 * off[0]
