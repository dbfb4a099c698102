"""A calibration told by declared preloads: found where they are a reference, and only there."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.decide.acceptance import is_accepted
from discovery.decide.explanation import Explanation
from discovery.explain.calibration import explain
from discovery.options import Options
from rom.campaign.channels import FloatArray

PRELOADS = np.repeat(np.geomspace(6.0, 3000.0, 20), 2)
NOTHING: tuple[float, float, float] = (0.0, 0.0, 0.0)


def shown(
    wrong: tuple[float, float, float] = NOTHING,
    *,
    scatter: float = 0.002,
    declared: FloatArray = PRELOADS,
    seed: int = 0,
) -> Any:
    """Residual of records whose gauge shows T_0 + (1 + c_1) T + c_2 T^2; one preload in five is held out."""
    generator = np.random.default_rng(seed)
    true = declared * (1 + scatter * generator.standard_normal(declared.size))
    tension = wrong[0] + (1 + wrong[1]) * true + wrong[2] * true**2
    tension += 0.02 * generator.standard_normal(declared.size)
    traces = [
        SimpleNamespace(
            settings=SimpleNamespace(file=f"{k}.h5", hold_out=k // 2 % 5 == 2),
            measurement=SimpleNamespace(preload_n=float(preload), tension=SimpleNamespace(initial=float(at))),
        )
        for k, (preload, at) in enumerate(zip(declared, tension, strict=True))
    ]
    return SimpleNamespace(traces=traces, baseline=SimpleNamespace(model=rom.paper_model()))


def sure(evidence: Any) -> list[Explanation]:
    return [one for one in explain(evidence, Options()) if is_accepted(one)]


@pytest.mark.parametrize("scatter", [0.0, 0.002, 0.02, 0.1])
@pytest.mark.parametrize("seed", range(5))
def test_a_gauge_that_is_right_has_no_fault(seed: int, scatter: float) -> None:
    assert not sure(shown(scatter=scatter, seed=seed))


@pytest.mark.parametrize("wrong", [(-10.0, 0.0, 5e-5), (1.5, -0.06, 0.0), (0.0, 0.3, 0.0)])
@pytest.mark.parametrize("scatter", [0.002, 0.015])
def test_a_wrong_calibration_is_found_with_its_limits(
    wrong: tuple[float, float, float], scatter: float
) -> None:
    (found,) = sure(shown(wrong, scatter=scatter))
    assert found.effect.path == "sensor:tension.calibration-error"
    for name, true in zip(("T_0", "c_1", "c_2"), wrong, strict=True):
        number = found.effect.parameters[name]
        assert number.low is not None
        assert number.high is not None
        assert number.value == pytest.approx(true, abs=2 * (number.high - number.low))


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("levels", [8, 10, 14])
def test_few_preloads_that_scatter_hardly_ever_pass_for_a_reference(levels: int, scatter: float) -> None:
    declared = np.geomspace(10.0, 1000.0, levels)
    named = [bool(sure(shown(scatter=scatter, declared=declared, seed=seed))) for seed in range(40)]
    assert sum(named) <= 2


def test_a_narrow_range_hides_no_wrench() -> None:
    declared = np.repeat(np.linspace(800.0, 1300.0, 12), 4)
    named = [bool(sure(shown((0.0, 0.15, 0.0), scatter=0.1, declared=declared, seed=s))) for s in range(40)]
    assert sum(named) <= 1


def test_a_zero_beyond_its_range_is_not_named_by_half() -> None:
    assert not sure(shown((-80.0, 0.0, 0.0)))


def test_limits_hold_as_often_as_they_say() -> None:
    wrong, held = (-3.0, 0.2, 0.0), 0
    for seed in range(60):
        (found,) = sure(shown(wrong, scatter=0.005, seed=seed))
        number = found.effect.parameters["c_1"]
        assert number.low is not None
        assert number.high is not None
        held += number.low < wrong[1] < number.high
    assert held >= 51  # 95 % of 60, less three standard errors


def test_preloads_of_a_torque_wrench_are_no_reference() -> None:
    assert not sure(shown((0.0, 0.2, 0.0), scatter=0.15))


def test_preloads_that_were_rounded_make_no_fault() -> None:
    evidence = shown(scatter=0.0)
    for trace in evidence.traces:
        trace.measurement.preload_n = float(np.round(trace.measurement.preload_n))
    assert not sure(evidence)


def test_what_settings_and_zeros_may_be_off_by_is_no_fault() -> None:
    assert not sure(shown((0.2, -0.03, 0.0)))


@pytest.mark.parametrize("declared", [np.repeat(100.0, 10), np.repeat(np.geomspace(10.0, 1000.0, 7), 2)])
def test_few_different_preloads_tell_nothing(declared: FloatArray) -> None:
    assert not sure(shown((-10.0, 0.0, 0.0), declared=declared))


def test_campaigns_that_declare_none_tell_nothing() -> None:
    evidence = shown((-10.0, 0.0, 0.0))
    for trace in evidence.traces:
        trace.measurement.preload_n = None
    assert explain(evidence, Options()) == ()


def test_a_fault_that_the_model_holds_is_not_looked_for_again() -> None:
    evidence = shown((-10.0, 0.0, 0.0))
    (found,) = sure(evidence)
    evidence.baseline.model = found.effect.added_to(evidence.baseline.model)
    assert explain(evidence, Options()) == ()
