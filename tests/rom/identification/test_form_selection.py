"""Where tensions lie near to each other a curve has the form that values tell, and no more numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rom.campaign.channels import FloatArray
from rom.identification.curve_fits import LawFit
from rom.identification.form_selection import Form, fit_form, reference_tension
from rom.identification.gamma_law import loosening_law
from rom.identification.joint import near_forms
from rom.model.power_of_tension import power_stiffness
from tests.rom.identification.test_curve_fits import DAMPING, STIFFNESS
from tests.rom.identification.test_gamma import MODEL, WINDOW_S, with_true_losses

TENSION = np.repeat(np.geomspace(600.0, 1500.0, 5), 3)
CONTACTS = power_stiffness(8e5, 0.5, 1000.0)


def told(values: FloatArray, error: float, tension: FloatArray = TENSION, *, damping: bool = False) -> LawFit:
    forms = near_forms(tension, values, values)[damping]
    return fit_form(forms, tension, values, error**2 * np.eye(len(values)), ["one.h5"] * len(values))


def noisy(curve: Callable[[FloatArray], FloatArray], scatter: float, seed: int = 1) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.asarray(curve(TENSION) * np.exp(scatter * rng.standard_normal(len(TENSION))))


@pytest.mark.parametrize(("scatter", "error"), [(1e-3, 1e-3), (0.1, 1e-3)])
def test_a_constant_with_noise_or_scatter_stays_one(scatter: float, error: float) -> None:
    fits = [told(noisy(np.ones_like, scatter, seed), error) for seed in range(10)]
    assert sum(len(fit.free) > 1 for fit in fits) <= 3  # of two questions at 5 % each; 4 and 8 of 120 seeds


@pytest.mark.parametrize("error", [1e-4, 1e-2])
def test_a_power_of_the_tension_is_told_with_limits(error: float) -> None:
    fit = told(noisy(CONTACTS, error), error)
    exponent = fit.law.parameters["m"]
    assert fit.law.name == "power stiffness"
    assert exponent.low is not None
    assert exponent.high is not None
    assert exponent.low < 0.5 < exponent.high
    assert fit.law.parameters["T_r"].value == pytest.approx(np.sqrt(600.0 * 1500.0), rel=0.01)
    assert fit.law.parameters["T_r"].source == "assumed"


def test_scatter_hides_a_small_change() -> None:
    assert told(noisy(power_stiffness(8e5, 0.1, 1000.0), 0.2), 1e-4).law.name == "constant stiffness"


def test_the_papers_curves_are_told_where_they_bend() -> None:
    low = np.repeat(np.geomspace(30.0, 80.0, 5), 2)
    assert told(STIFFNESS(low), 1e-3, low).law.name == "logistic stiffness"
    fit = told(DAMPING(low), 1e-3, low, damping=True)
    assert fit.law.name == "logistic damping"
    np.testing.assert_allclose(fit.law(low), DAMPING(low), rtol=1e-3)


def test_a_curve_that_would_be_negative_for_a_loose_bolt_is_none() -> None:
    steep = TENSION - 500.0
    fit = told(steep, 1e-3, damping=True)
    assert fit.law.name == "power damping"
    assert fit.law(0.0) > 0.0


@pytest.mark.parametrize(
    "tension", [np.array([600.0, 1500.0]), np.full(9, 900.0), np.zeros(9), np.array([0.0] * 8 + [600.0])]
)
def test_too_little_tells_a_constant_alone(tension: FloatArray) -> None:
    values = np.geomspace(1.0, 2.0, len(tension))
    assert told(values, 1e-3, tension).free == ("k",)


def test_near_tensions_have_a_reference_in_their_middle() -> None:
    assert reference_tension(np.array([0.0, 400.0, 900.0])) == 600.0
    assert reference_tension(np.array([900.0, 905.0])) is None


@pytest.mark.parametrize(("loss_error", "numbers"), [(1e-3, 3), (0.1, 2), (10.0, 1)])
def test_losses_of_near_tensions_tell_more_of_gamma_the_better_they_are_known(
    loss_error: float, numbers: int
) -> None:
    """Of the paper's gamma, which falls by a factor of six from 600 to 1500 N."""
    tension = np.array([600.0, 760.0, 950.0, 1200.0, 1500.0])
    found = loosening_law(MODEL, with_true_losses(tension, loss_error=loss_error), WINDOW_S)
    assert found.fit is not None
    assert len(found.fit.free) == numbers
    if numbers == 2:
        steepness = found.fit.law.parameters["rho"]
        assert (steepness.bounds, steepness.low) == ((steepness.value, steepness.value), None)


def test_forms_with_as_many_numbers_as_values_are_not_asked() -> None:
    forms = [Form([power_stiffness(1.0, 0.0, 1e3)], ("k_r",)), Form([CONTACTS], ("k_r", "m"))]
    tension = np.array([600.0, 1500.0])
    found = fit_form(forms, tension, CONTACTS(tension), 1e-8 * np.eye(2), ["a.h5", "b.h5"])
    assert found.free == ("k_r",)
