"""Gamma per case against a global search, and gamma(T) from losses made with it: the model alone, no rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from rom.criteria.identification import RULES
from rom.effects import CATALOGUE
from rom.identification.curve_fits import LawFit, fit_law, gamma_curve
from rom.identification.gamma_law import refine_gamma_law
from rom.identification.gamma_per_case import (
    GammaEstimate,
    LooseningCase,
    final_tensions,
    identify_gamma,
    matching_factors,
    own_rate,
)
from rom.model.laws import logistic_loosening, no_loosening, power_loosening
from rom.model.model import Model
from rom.parameters import he_2025

RATE_HZ, WINDOW_S = 9600.0, (0.75, 0.8)
PULSE = he_2025.nominal_impact(1608.7, RATE_HZ, 0.8)
MODEL = he_2025.paper_model()
TRUE = MODEL.link_laws["joint"].tension_rate
FREE = ("gamma_d", "gamma_i", "rho")


def case(initial: float, final: float, loss_error: float = 0.03, strength: float = 1.0) -> LooseningCase:
    """Return a hit of the paper's size."""
    return LooseningCase(f"case {initial:g}", "lo", strength * PULSE, RATE_HZ, initial, final, loss_error)


def with_true_losses(tension: np.ndarray, loss_error: float = 0.0) -> list[LooseningCase]:
    """Return cases that lost what Eqs. 12 and 13 make them lose."""
    strength = 1 + 0.05 * np.cos(7 * np.arange(len(tension)))
    blank = [case(t, t, strength=s) for t, s in zip(tension, strength, strict=True)]
    final = final_tensions(MODEL, blank, WINDOW_S)
    return [replace(c, final=float(f), loss_error=loss_error) for c, f in zip(blank, final, strict=True)]


def searched(initial: float, final: float) -> float:
    """Return gamma by the paper's way: a global search for the least miss of the final tension."""
    path = "joint.tension_rate.gamma"
    trial = _with_power_law(1.0)

    def miss(place: np.ndarray) -> float:
        found = trial.final_tension(PULSE[None], RATE_HZ, [initial], {path: np.sinh(place)}, WINDOW_S)[0]
        return abs(float(found) - final) if np.isfinite(found) else 1e12

    limit = float(np.arcsinh(RULES.gamma_bound))
    found = optimize.direct(
        miss, optimize.Bounds([-limit], [limit]), maxfun=300, eps=1e-8, locally_biased=True, vol_tol=0
    )
    return float(np.sinh(found.x[0]))


def _with_power_law(gamma: float) -> Model:
    return MODEL.with_tension_law(power_loosening(gamma))


@pytest.mark.parametrize(
    ("initial", "loss"),
    [(6.4, 1.3), (61.3, 6.0), (152.7, 11.53), (317.0, 3.17), (2999.3, 0.6), (99.0, -2.5)],
)
def test_the_root_is_what_a_global_search_finds(initial: float, loss: float) -> None:
    (estimate,) = identify_gamma(MODEL, [case(initial, initial - loss)], WINDOW_S)
    assert not estimate.at_bound
    assert np.sign(estimate.gamma) == np.sign(loss)
    assert estimate.gamma == pytest.approx(searched(initial, initial - loss), rel=2e-3)
    (simulated,) = final_tensions(
        _with_power_law(1.0), [case(initial, 0.0)], WINDOW_S, np.array([estimate.gamma])
    )
    assert simulated == pytest.approx(initial - loss, abs=1e-6)


@pytest.mark.parametrize("initial", [6.4, 152.7, 2999.3])
def test_final_tension_falls_with_gamma(initial: float) -> None:
    """What a bracketing root-finder rests on, up to where the bolt is lost or grows beyond all bounds."""
    gamma = np.sinh(np.linspace(-18.0, 23.0, 60))
    final = final_tensions(_with_power_law(1.0), [case(initial, 0.0)] * 60, WINDOW_S, gamma)
    finite = final[np.isfinite(final)]
    assert len(finite) > 40
    assert np.all(np.isfinite(final[gamma >= 0]))
    assert np.all(np.diff(finite) < 1e-9 * initial)
    assert finite[0] > initial > finite[-1]


@pytest.mark.parametrize("initial", [30.0, 81.87, 150.0, 600.0])
def test_a_loss_does_not_depend_on_the_sample_at_which_the_hit_falls(initial: float) -> None:
    """Whatever the grid of the integrator: a hit between two of its nodes is a hit."""
    rate_hz = 2 * RATE_HZ
    pulse = he_2025.nominal_impact(1608.7, rate_hz, 0.8)
    forces = np.stack([np.roll(pulse, shift) for shift in range(256)])
    loss = initial - MODEL.final_tension(forces, rate_hz, np.full(256, initial))
    np.testing.assert_allclose(loss, np.median(loss), rtol=5e-3)


def test_order_of_cases_does_not_matter() -> None:
    cases = with_true_losses(np.array([20.0, 200.0, 2000.0]), 0.03)
    forward, backward = identify_gamma(MODEL, cases, WINDOW_S), identify_gamma(MODEL, cases[::-1], WINDOW_S)
    for one, other in zip(forward, backward[::-1], strict=True):
        assert one.file == other.file
        assert one.gamma == pytest.approx(other.gamma, rel=1e-9)


def test_the_factor_on_a_changed_law_is_found_by_the_final_tension() -> None:
    """Of the paper's law with a loosening by displacement beside it, not of a power of the velocity."""
    beside = CATALOGUE["loosening-displacement"].at("tension").with_values(g_x=0.05, p_x=1.5, h_x=0.3)
    changed = MODEL.with_effect(beside)
    blank = [case(initial, initial) for initial in (20.0, 150.0, 900.0)]
    factors = [0.3, 1.0, 2.5]
    final = [
        float(final_tensions(changed.with_effect(own_rate(factor)), [one], WINDOW_S)[0])
        for factor, one in zip(factors, blank, strict=True)
    ]
    cases = [replace(one, final=lost) for one, lost in zip(blank, final, strict=True)]
    found, at_bound = matching_factors(changed, cases, WINDOW_S)
    np.testing.assert_allclose(found, factors, rtol=1e-6)
    assert not at_bound.any()
    alone, _ = matching_factors(MODEL, cases, WINDOW_S)
    assert np.all(alone > 1.01 * np.array(factors))  # the paper's law alone has to be faster


def test_no_loss_is_gamma_zero() -> None:
    (estimate,) = identify_gamma(MODEL, [case(152.7, 152.7)], WINDOW_S)
    assert abs(estimate.gamma) < 1.0  # 1e8 is what a loss of a few newtons takes
    assert not estimate.at_bound


def test_progress_is_told_for_as_long_as_gammas_are_sought() -> None:
    told: list[tuple[int, int]] = []
    cases = [case(152.7, final) for final in (150.0, 147.0)]
    identify_gamma(MODEL, cases, WINDOW_S, progress=lambda done, total: told.append((done, total)))
    assert (told[0], told[-1]) == ((0, 2), (2, 2))
    assert len(told) > 4


def test_a_final_tension_out_of_reach_is_flagged_at_the_bound() -> None:
    """Beside hits, a weak touch cannot take half of the tension away, nor add half, whatever gamma."""
    weak = [replace(case(500.0, final), force=1e-3 * PULSE) for final in (250.0, 750.0)]
    hits = with_true_losses(np.array([20.0, 100.0, 500.0]))
    *_, lost, gained = identify_gamma(MODEL, [*hits, *weak], WINDOW_S)
    assert lost.at_bound
    assert lost.gamma == pytest.approx(RULES.gamma_bound)
    assert gained.at_bound
    assert gained.gamma == pytest.approx(-RULES.gamma_bound)


def test_a_case_that_cannot_be_simulated_is_flagged_after_few_simulations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def diverged(_model: Model, cases: list[LooseningCase], *_rest: object) -> np.ndarray:
        asked.append(len(cases))
        return np.full(len(cases), np.nan)

    monkeypatch.setattr("rom.identification.gamma_per_case.final_tensions", diverged)
    found, at_bound = matching_factors(MODEL, [case(152.7, 147.0)] * 3, WINDOW_S)
    assert at_bound.all()
    np.testing.assert_allclose(found, RULES.gamma_bound)
    assert len(asked) <= 20


def test_cases_of_other_lengths_and_rates_go_together() -> None:
    short = case(152.7, 147.0)
    slow_force = he_2025.nominal_impact(1608.7, 2 * RATE_HZ, 0.9)
    other = replace(short, file="other", force=slow_force, rate_hz=2 * RATE_HZ)
    together = identify_gamma(MODEL, [short, other, short], WINDOW_S)
    alone = [identify_gamma(MODEL, [c], WINDOW_S)[0] for c in (short, other, short)]
    for one, single in zip(together, alone, strict=True):
        assert one.gamma == pytest.approx(single.gamma, rel=1e-9)
    assert identify_gamma(MODEL, [], WINDOW_S) == ()


def test_error_of_gamma_is_that_of_the_loss() -> None:
    """Where a loss is small, gamma goes with it: ln gamma has the loss's relative error."""
    (estimate,) = identify_gamma(MODEL, [case(2000.0, 1999.5, loss_error=0.05)], WINDOW_S)
    assert estimate.loss == pytest.approx(0.5)
    assert estimate.log_error == pytest.approx(0.1, rel=0.01)


def law_of(cases: list[LooseningCase]) -> tuple[LawFit, LawFit]:
    """Return gamma(T) fitted to gamma per case, and refined by re-simulation."""
    gamma = [g for g in identify_gamma(MODEL, cases, WINDOW_S) if g.gamma > 0 and not g.at_bound]
    starts = [logistic_loosening(11.0, 7.0, -1 / scale) for scale in (50.0, 200.0, 800.0)]
    per_case = fit_law(
        starts, FREE, np.array([g.initial for g in gamma]), np.array([g.gamma for g in gamma]),
        np.diag([g.log_error**2 for g in gamma]), [g.file for g in gamma], gamma_curve,
    )  # fmt: skip
    model = MODEL.with_tension_law(no_loosening())
    used = {g.file for g in gamma}
    return per_case, refine_gamma_law(model, [c for c in cases if c.file in used], WINDOW_S, per_case)


@pytest.mark.parametrize("evaluations", [1, 30])
def test_a_refinement_that_had_to_stop_says_so(monkeypatch: pytest.MonkeyPatch, evaluations: int) -> None:
    monkeypatch.setattr("rom.identification.gamma_law._EVALUATIONS", evaluations)
    _, refined = law_of(with_true_losses(np.geomspace(10.0, 3000.0, 12), 1e-4))
    assert refined.settled == (evaluations > 1)


def test_gamma_of_tension_comes_back_exactly_only_by_resimulation() -> None:
    """Gamma rises as the tension falls: gamma per case, set at the initial tension, is biased."""
    assert TRUE is not None
    tension = np.geomspace(10.0, 3000.0, 12)
    per_case, refined = law_of(with_true_losses(tension, 1e-4))
    for name in FREE:
        assert refined.law.parameters[name].value == pytest.approx(TRUE.parameters[name].value, rel=2e-4)
    true = gamma_curve(TRUE, tension)
    bias = np.abs(gamma_curve(per_case.law, tension) / true - 1).max()
    assert np.abs(gamma_curve(refined.law, tension) / true - 1).max() < 0.05 * bias


def noisy_fit(seed: int, loss_error: float, scatter: float = 0.0) -> LawFit:
    """Return gamma(T) from losses with noise."""
    random = np.random.default_rng(seed)
    true = with_true_losses(np.geomspace(10.0, 3000.0, 12), loss_error)
    factor = np.exp(scatter * random.standard_normal(len(true)))
    noise = loss_error * random.standard_normal(len(true))
    return law_of(
        [
            replace(c, final=float(c.initial - f * (c.initial - c.final) + e))
            for c, f, e in zip(true, factor, noise, strict=True)
        ]
    )[1]


def test_scatter_from_case_to_case_is_seen() -> None:
    assert noisy_fit(1, 0.005).scatter < 0.05
    assert 0.1 < noisy_fit(1, 0.005, scatter=0.3).scatter < 0.6


@pytest.mark.slow
def test_small_losses_do_not_bias_gamma() -> None:
    """Above 1000 N the noise is half of the loss: logarithms of measured losses raise gamma by a tenth."""
    assert TRUE is not None
    grid = np.array([1000.0, 3000.0])
    found = [gamma_curve(noisy_fit(seed, 0.2).law, grid) / gamma_curve(TRUE, grid) for seed in range(24)]
    assert np.all(np.abs(np.mean(np.log(found), axis=0)) < 0.06)


@pytest.mark.slow
def test_limits_of_gamma_hold_the_truth_as_often_as_they_say() -> None:
    assert TRUE is not None
    grid = np.array([20.0, 100.0, 300.0, 1000.0, 3000.0])
    held: list[bool] = []
    for seed in range(25):
        fit = noisy_fit(seed, 0.03)
        width = stats.t.ppf(0.975, len(fit.records) - len(FREE))
        miss = np.abs(np.log(gamma_curve(fit.law, grid) / gamma_curve(TRUE, grid)))
        held.extend(miss <= width * fit.log_error(grid))
        held.extend(_holds(fit, name) for name in FREE)
    assert 0.85 <= np.mean(held) <= 0.99


def _holds(fit: LawFit, name: str) -> bool:
    assert TRUE is not None
    limits = fit.law.parameters[name]
    assert limits.low is not None
    assert limits.high is not None
    return limits.low <= TRUE.parameters[name].value <= limits.high


def test_estimates_say_what_they_are() -> None:
    estimate = GammaEstimate("a", 100.0, 103.0, 0.1, -1e6, 0.03, False)
    assert estimate.loss == -3.0


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_gamma_of_motions_of_any_size_is_found(size: float) -> None:
    """Forces a thousandth as large move a structure of the same masses by a thousandth: gamma 1e12 times."""
    cases = with_true_losses(np.array([20.0, 200.0]))
    usual = identify_gamma(MODEL, cases, WINDOW_S)
    scaled = identify_gamma(MODEL, [replace(c, force=size * c.force) for c in cases], WINDOW_S)
    for one, other in zip(usual, scaled, strict=True):
        assert not other.at_bound
        assert other.gamma == pytest.approx(one.gamma / size**4, rel=1e-6)
        assert other.log_error == pytest.approx(one.log_error, rel=1e-3)
