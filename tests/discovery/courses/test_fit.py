from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rom
from discovery.courses.fit import Fit, fit, fit_losses, log_predictive, predict, refine, resimulate
from discovery.courses.frozen_motion import freeze
from discovery.laws.candidate import Candidate, Term, baseline, constant_power, no_loosening
from discovery.laws.factors import displacement_power, tension_power, velocity_power
from tests.discovery.synthetic import free_power, frozen, known_fit, measured, paper_model_of, with_power


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return refine(free_power(), frozen(), rounds=3)


def test_the_truth_is_within_the_limits(fitted: Fit) -> None:
    assert fitted.converged
    for name, truth in {"n": 4.0, "gamma_i": 7.974, "rho": -0.00362}.items():
        low, high = fitted.limits(name)
        assert low < truth < high
        assert high - low < 0.4 * abs(truth)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 50.0, 1e3, 1e6])
def test_a_bolt_of_any_tension_has_the_law_of_a_usual_one(unit: float) -> None:
    """Steps, floors and the tension at which tests differ go with the bolt: no fit stays at its start."""
    preloads = (20.0, 60.0, 300.0, 1000.0)
    found = {
        size: fit(
            free_power(size),
            freeze(
                paper_model_of(size),
                measured(with_power(4.0, size), preloads=preloads, scatter=0.3, unit=size),
            ),
        )
        for size in (1.0, unit)
    }
    usual, other = (found[size].candidate.parameters for size in (1.0, unit))
    assert other["n"].value == pytest.approx(usual["n"].value, rel=1e-3)
    assert other["gamma_i"].value == pytest.approx(usual["gamma_i"].value, rel=1e-3)
    assert other["rho"].value * unit == pytest.approx(usual["rho"].value, rel=1e-3)
    assert found[unit].deviance == pytest.approx(found[1.0].deviance, abs=0.05)


@pytest.mark.parametrize("n", [2.0, 3.0, 5.0])
def test_other_powers_are_found_from_the_papers(n: float) -> None:
    found = refine(free_power(), frozen(n, noise=0.3), rounds=3)
    low, high = found.limits("n")
    centre = found.candidate.parameters["n"].value
    assert found.converged
    assert abs(centre - n) < 3 * (high - low) / 3.92
    assert abs(centre - n) < 0.3


def test_without_noise_and_scatter_the_law_comes_back() -> None:
    found = refine(free_power(), freeze(rom.paper_model(), measured(noise=0.02)), rounds=4)
    values = {name: parameter.value for name, parameter in found.candidate.parameters.items()}
    assert values["n"] == pytest.approx(4.0, abs=0.01)
    assert values["gamma_i"] == pytest.approx(7.974, rel=0.01)
    assert np.exp(found.scatter[0]) < 0.03


def test_the_scatter_is_estimated() -> None:
    for scatter in (0.1, 0.6):
        found = fit(baseline(), frozen(scatter=scatter, length_s=1.0))
        typical = float(np.exp(np.mean(np.log(found.tau(np.array([20.0, 60.0, 150.0, 300.0]))))))
        assert 0.5 * scatter < typical < 2.0 * scatter


def test_frozen_courses_and_full_simulation_agree(fitted: Fit) -> None:
    whole = frozen()
    full = resimulate(fitted.candidate, whole, fitted.deviations)
    corrected = predict(fitted.candidate, whole, fitted.deviations) + fitted.offsets
    error = np.sqrt(np.array([np.diag(course.covariance) for course in whole.courses]))
    assert np.abs((corrected - full) / error).max() < 0.1
    plain = predict(fitted.candidate, whole, deviations=fitted.deviations)
    assert np.abs(plain[:, -1] / full[:, -1] - 1).max() < 0.05


def test_a_wrong_law_has_a_far_higher_deviance(fitted: Fit) -> None:
    wrong = Term(displacement_power(), tension_power())
    for rival in (constant_power(2.0, "quadratic"), no_loosening(), Candidate("x", (wrong,), (1e9,))):
        assert refine(rival, frozen()).deviance > fitted.deviance + 50


def test_the_fit_knows_neither_units_of_coefficients_nor_where_it_started(fitted: Fit) -> None:
    far = free_power().with_values({"gamma": 1e3, "n": 3.4, "gamma_i": 5.0})
    again = refine(far, frozen(), rounds=3)
    assert again.deviance == pytest.approx(fitted.deviance, abs=0.1)
    assert again.candidate.parameters["n"].value == pytest.approx(
        fitted.candidate.parameters["n"].value, abs=0.02
    )


def test_no_free_number_can_be_moved_to_a_better_place(fitted: Fit) -> None:
    values = {name: fitted.candidate.parameters[name].value for name in fitted.free}
    lowest = -2 * log_predictive(fitted, frozen(), fitted.offsets).sum()
    for name in fitted.free:
        low, high = fitted.limits(name)
        for moved in (values[name] + 0.5 * (high - values[name]), values[name] + 0.5 * (low - values[name])):
            other = replace(fitted, candidate=fitted.candidate.with_values({name: moved}))
            assert -2 * log_predictive(other, frozen(), fitted.offsets).sum() > lowest - 0.05


def test_the_deviance_is_the_log_density_but_for_a_constant(fitted: Fit) -> None:
    other = fit(baseline(), frozen(), fitted.offsets)
    difference = -2 * (
        log_predictive(other, frozen(), fitted.offsets) - log_predictive(fitted, frozen(), fitted.offsets)
    )
    assert difference.sum() == pytest.approx(other.deviance - fitted.deviance, abs=0.1)


def test_the_density_of_a_new_case_integrates_the_scatter_out() -> None:
    """Against the integral over u by brute force, for a case whose course is nearly straight in u."""
    whole = frozen().subset([9])
    found = fit(baseline(), frozen())
    tau = float(found.tau(whole.initial)[0])
    grid = np.linspace(-6 * tau, 6 * tau, 2001)
    densities = []
    sign, logarithm = np.linalg.slogdet(2 * np.pi * whole.covariance[0])
    for u in grid:
        residual = (whole.change - predict(found.candidate, whole, deviations=np.array([u])))[0]
        square = residual @ np.linalg.solve(whole.covariance[0], residual)
        densities.append(-0.5 * (square + logarithm + (u / tau) ** 2) - np.log(tau * np.sqrt(2 * np.pi)))
    exact = np.log(np.trapezoid(np.exp(np.array(densities) - max(densities)), grid)) + max(densities)
    assert sign > 0
    assert log_predictive(found, whole)[0] == pytest.approx(exact, abs=0.1)


def test_an_uncertainty_that_was_not_looked_for_is_not_a_number(fitted: Fit) -> None:
    assert np.isfinite(fitted.covariance).all()
    with pytest.raises(ValueError, match="with_uncertainty"):
        _ = fit(free_power(), frozen()).covariance


def test_no_loosening_is_a_fit_like_any_other() -> None:
    found = known_fit(no_loosening(), frozen())
    assert found.free == ()
    assert found.covariance.shape == (0, 0)
    expected = sum(
        change @ np.linalg.solve(covariance, change)
        for change, covariance in zip(frozen().change, frozen().covariance, strict=True)
    )
    assert found.deviance == pytest.approx(expected, rel=1e-9)


def test_a_coefficient_of_either_sign_finds_tightening() -> None:
    loosening = with_power(4.0)
    term = replace(loosening.terms[0], sign=0)
    tightening = Candidate("tightening", (term,), (0.5 * loosening.coefficients[0],))
    whole = freeze(rom.paper_model(), measured(tightening, scatter=0.1))
    start = replace(tightening, coefficients=(-1e-3 * tightening.coefficients[0],))
    found = fit(start, whole)
    assert found.candidate.coefficients[0] > 0
    assert found.deviance < fit(no_loosening(), whole).deviance - 100


def test_two_terms_share_the_loss() -> None:
    terms = (
        Term(velocity_power().held(n=4.0), tension_power()),
        Term(displacement_power().held(q=2.0), tension_power()),
    )
    truth = Candidate("both", terms, (2e7, 4e7))
    whole = freeze(rom.paper_model(), measured(truth, scatter=0.1))
    found = refine(replace(truth, coefficients=(1e6, 1e9)), whole, rounds=3)
    for name, value in zip(("gamma_1", "gamma_2"), truth.coefficients, strict=True):
        low, high = found.limits(name)
        assert low < value < high
    assert found.deviance < refine(replace(truth, terms=terms[:1], coefficients=(1e7,)), whole).deviance - 20


def test_losses_alone_decide_where_the_courses_cannot_be_followed() -> None:
    whole = frozen(2.0, length_s=1.0)
    quartic = replace(baseline(), name="quartic")
    of_courses, of_losses = fit(quartic, whole), fit_losses(quartic, whole)
    assert of_losses.of_losses
    assert not of_courses.of_losses
    measured_loss = -whole.change[:, -1]

    def error(found: Fit) -> float:
        return float(np.median(np.abs(-predict(found.candidate, whole)[:, -1] / measured_loss - 1)))

    assert error(of_losses) < 0.7 * error(of_courses)
    assert of_losses.deviance >= of_courses.deviance  # that of the courses, which it does not minimise
