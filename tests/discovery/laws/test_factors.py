from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from discovery.laws import factors
from discovery.laws.factors import Factor, Inner

X, V = np.array([1e-4, -2e-4, 0.0]), np.array([0.03, -0.05, 0.0])
F, D = np.array([10.0, -40.0, 0.0]), np.array([3.0, -5.0, 0.0])
T = np.array([-3.0, 0.0, 20.0, 500.0])

MOTION = [
    (factors.velocity_power(3.5), np.abs(V) ** 3.5),
    (factors.displacement_power(1.5), np.abs(X) ** 1.5),
    (factors.velocity_displacement(1.0, 2.0), np.abs(V) * X**2),
    (factors.dissipated_power(1.5), np.abs(D * V) ** 1.5),
    (factors.force_power(2.0), F**2),
    (factors.velocity_threshold(0.02, 0.1, 2.0), np.maximum(np.abs(V) - 0.02, 0) ** 2),
    (factors.displacement_threshold(1.5e-4, 1e-3, 1.0), np.maximum(np.abs(X) - 1.5e-4, 0)),
]
TENSION = [
    (factors.tension_power(), np.maximum(T, 0)),
    (factors.tension_power(0.5, free=True), np.sqrt(np.maximum(T, 0))),
    (factors.tension_exponential(300.0), np.maximum(T, 0) * np.exp(-np.maximum(T, 0) / 300)),
    (
        factors.tension_logistic(8.0, -0.004),
        np.maximum(T, 0) * 10 ** (-8.0 / (1 + np.exp(-0.004 * np.maximum(T, 0)))),
    ),
]


@pytest.mark.parametrize(("factor", "expected"), MOTION, ids=lambda value: getattr(value, "text", ""))
def test_a_motion_factor_is_its_formula(factor: Factor, expected: np.ndarray) -> None:
    np.testing.assert_allclose(factor.of_motion(X, V, F, D), expected, rtol=1e-12)


@pytest.mark.parametrize(("factor", "expected"), TENSION, ids=lambda value: getattr(value, "text", ""))
def test_a_tension_factor_is_its_formula_and_stops_at_no_tension(
    factor: Factor, expected: np.ndarray
) -> None:
    np.testing.assert_allclose(factor.of_tension(T), expected, rtol=1e-12)


@pytest.mark.parametrize("factor", [factor for factor, _ in MOTION], ids=lambda factor: factor.text)
@given(scale=st.floats(0.1, 10.0))
def test_the_unit_of_a_motion_factor_is_how_it_scales(factor: Factor, scale: float) -> None:
    """A metre taken `scale` times as long: every number in metres shrinks, thresholds too."""
    inner = {n: i.value / scale for n, i in factor.inner.items() if i.unit.startswith("m")}
    shrunk = Factor(
        factor.text,
        {n: Inner(inner.get(n, i.value), 0.0, 1e3, i.unit) for n, i in factor.inner.items()},
        factor.powers,
    )
    found = shrunk.of_motion(X / scale, V / scale, F, D)
    np.testing.assert_allclose(
        found, factor.of_motion(X, V, F, D) * scale ** -factor.dimension["m"], rtol=1e-9, atol=1e-300
    )


def test_values_are_cut_to_their_range_and_held_ones_are_not_free() -> None:
    held = factors.velocity_power().held(n=99.0)
    assert held.inner["n"].value == held.inner["n"].high
    assert not held.inner["n"].free
    assert factors.velocity_power().inner["n"].free


def test_the_key_tells_functions_apart_by_text_and_values() -> None:
    assert factors.velocity_power(3.0).key == factors.velocity_power(3.0).held(n=3.0).key
    assert factors.velocity_power(3.0).key != factors.velocity_power(3.5).key


def test_a_value_beyond_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"within \[0.0, 1.0\], got 2.0"):
        Inner(2.0, 0.0, 1.0, "1")


def test_an_unknown_inner_parameter_is_refused() -> None:
    with pytest.raises(KeyError):
        factors.velocity_power().with_values(q=2.0)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_ranges_of_the_tension_go_with_the_bolts_own(scale: float) -> None:
    """A bolt of 100 kN, or of 0.1 mN, has the grids of one of 100 N."""
    unit = factors.usual_unit(100.0 * scale)
    exponential = factors.tension_exponential(200.0 * scale, unit)
    logistic = factors.tension_logistic(8.0, -0.0036 / unit, unit)
    assert unit == pytest.approx(scale)
    assert np.allclose(
        exponential.inner["T_s"].grid, scale * np.array(factors.tension_exponential().inner["T_s"].grid)
    )
    assert np.allclose(
        scale * np.array(logistic.inner["rho"].grid), factors.tension_logistic().inner["rho"].grid
    )


def test_no_tension_is_far_from_the_middle_of_its_grids() -> None:
    """A bolt of 3 kN had the grids of one of 100 N: what fades at 4 kN was sought up to 2 kN."""
    for tension in np.geomspace(1e-9, 1e9, 200):
        assert 0.19 < tension / (100.0 * factors.usual_unit(tension)) < 5.1
