"""Steps of a least-squares fit whose residual stays large."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from rom.identification.secant_steps import Normal, Secant, box, decrease, step_within

TIMES = np.linspace(0.0, 3.0, 40)
UNIT = np.ones(2)


def misfit(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measured less modelled, and slopes of the model: a decaying cosine beside what it lacks."""
    decay, pulse = np.exp(-at[0] * TIMES), at[1] * TIMES
    slopes = np.stack([-TIMES * decay * np.cos(pulse), -TIMES * decay * np.sin(pulse)], axis=1)
    return np.exp(-TIMES) * np.cos(4 * TIMES) + np.cos(9 * TIMES) - decay * np.cos(pulse), slopes


def steps_to_the_minimum(corrected: bool) -> int:
    """Full steps until they are small; 60 where they never are."""
    at, secant = np.array([0.8, 3.8]), Secant(np.zeros((2, 2)))
    left, slopes = misfit(at)
    for count in range(60):
        normal = Normal(slopes.T @ slopes, slopes.T @ left, float(left @ left), UNIT)
        hessian = secant.of(normal) if corrected else normal.hessian
        step = step_within(hessian, normal.gradient, -UNIT, UNIT)
        if np.abs(step).max() < 1e-6:
            best = minimize(lambda x: float(np.sum(misfit(x)[0] ** 2)), at, tol=1e-12)
            assert at == pytest.approx(best.x, abs=1e-4)
            return count
        new_left, new = misfit(at + step)
        trial = Normal(new.T @ new, new.T @ new_left, float(new_left @ new_left), UNIT)
        secant = secant.after(step, normal, trial, (normal.gradient, trial.gradient, slopes.T @ new_left))
        at, left, slopes = at + step, new_left, new
    return 60


def test_beside_a_large_residual_fewer_steps_lead_to_the_minimum() -> None:
    assert steps_to_the_minimum(corrected=True) <= 0.6 * steps_to_the_minimum(corrected=False)


def test_a_step_is_the_minimum_within_the_box() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        root, gradient = rng.normal(size=(4, 4)), 3 * rng.normal(size=4)
        hessian, low, high = root @ root.T + 0.1 * np.eye(4), -rng.random(4), rng.random(4)
        found = step_within(hessian, gradient, low, high)

        def rise(step: np.ndarray, of: np.ndarray = hessian, along: np.ndarray = gradient) -> float:
            return -decrease(of, along, step)

        best = minimize(rise, np.zeros(4), bounds=list(zip(low, high, strict=True)), tol=1e-12)
        assert rise(found) <= best.fun + 1e-6
        assert np.all((found >= low) & (found <= high))


@pytest.mark.parametrize(
    ("value", "positive", "down", "up"),
    [
        (2.0, True, -0.6, 1.0),
        (2e-6, True, 0.0, 5e5),  # come to nothing: it falls no more, and half of its start is one step away
        (0.1, False, -1.0, 1.0),
        (-20.0, False, -40.0, 40.0),
    ],
)
def test_how_far_a_coefficient_may_step(value: float, positive: bool, down: float, up: float) -> None:
    values, starts, units = np.array([[value], [2.0], [value if positive else 0.5]])
    low, high = box(values, starts, units, np.array([positive]))
    assert (low[0], high[0]) == pytest.approx((down, up))
