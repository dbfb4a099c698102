"""Bands of a predicted final tension, against simulations of rates that are drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rom.effects import CATALOGUE
from rom.evaluation.error_measures import Comparison, compare_all
from rom.evaluation.replay import replay
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty
from rom.model_file import load_model
from rom.signals.filters import for_straight_lines
from rom.signals.processing import tension_record
from tests.rom.evaluation.test_error_measures import (
    FORCE,
    RATE_HZ,
    SAMPLES,
    WINDOWS,
    measurement,
    model,
    seen,
    tension,
)

TENSION_N, GAMMA, TESTS = 200.0, 4e4, 12
PATH = "joint.tension_rate.gamma"


def known(variance: float = 0.0, between_tests: float = 0.0, slope: float = 0.0) -> RateUncertainty:
    return RateUncertainty.of(("gamma",), [[variance]], (between_tests, slope), TESTS)


def predicted(uncertainty: RateUncertainty | None, noise: float = 0.0) -> Comparison:
    one = replace(model(GAMMA), rate_uncertainty=uncertainty)
    shown = replace(tension(np.full(SAMPLES, TENSION_N)), initial_error=noise, final_error=noise)
    record = measurement("loosening", seen("displacement"), tension=shown)
    return compare_all([one], record, WINDOWS, bands=True)[0]


def ends_of(found: Comparison) -> tuple[float, float]:
    return found.band.low, found.band.high


def final(gammas: np.ndarray) -> np.ndarray:
    count = len(gammas)
    return model(GAMMA).final_tension(
        np.tile(for_straight_lines(FORCE), (count, 1)),
        RATE_HZ,
        np.full(count, TENSION_N),
        {PATH: gammas},
        WINDOWS.final_s,
        "a",
    )


@pytest.mark.parametrize("slope", [0.0, -0.5])
def test_rates_that_differ_from_test_to_test(slope: float) -> None:
    """Ends of the band: the law at both quantiles of the rate."""
    found = predicted(known(between_tests=0.3, slope=slope))
    half = stats.t.ppf(0.975, TESTS) * 0.3 * (TENSION_N / 100.0) ** slope
    assert ends_of(found) == pytest.approx(tuple(final(GAMMA * np.exp([half, -half]))), abs=1e-4)
    assert TENSION_N - found.simulated_final > 5.0


def test_a_number_that_is_known_so_well() -> None:
    found = predicted(known(variance=(0.1 * GAMMA) ** 2))
    half = stats.t.ppf(0.975, TESTS) * 0.1
    ends = final(GAMMA * np.exp([half, -half]))
    assert ends_of(found) == pytest.approx(tuple(ends), abs=0.06 * float(np.ptp(ends)))


def test_a_number_of_a_change_of_the_law_that_is_known_so_well() -> None:
    """Another power of the velocity: both ends of the band are simulated with it at its limits."""
    change = CATALOGUE["loosening-power"].at("tension").with_values(q_v=0.0)
    changed = change.added_to(model(GAMMA))
    uncertain = RateUncertainty.of((f"{change.path}.q_v",), [[0.2**2]], (0.0, 0.0), TESTS)
    record = measurement("loosening", seen("displacement"), tension=tension(np.full(SAMPLES, TENSION_N)))
    found = compare_all([replace(changed, rate_uncertainty=uncertain)], record, WINDOWS, bands=True)[0]
    half = stats.t.ppf(0.975, TESTS) * 0.2
    ends = [
        compare_all([changed.with_values({f"{change.path}.q_v": end})], record, WINDOWS)[0].simulated_final
        for end in (-half, half)
    ]
    assert ends_of(found) == pytest.approx(sorted(ends), abs=0.1 * float(np.ptp(ends)))
    assert np.ptp(ends) > 1.0


def test_drawn_rates_lie_within_the_band_as_often_as_it_says() -> None:
    variance, between = (0.15 * GAMMA) ** 2, 0.2
    chance = np.random.default_rng(1)
    drawn = (GAMMA + np.sqrt(variance) * chance.normal(size=400)) * np.exp(between * chance.normal(size=400))
    many = replace(known(variance, between), degrees_of_freedom=10_000)
    low, high = ends_of(predicted(many))
    tensions = final(np.maximum(drawn, 0.0))
    assert np.mean((tensions >= low) & (tensions <= high)) == pytest.approx(0.95, abs=0.025)


def test_means_are_measured_with_noise() -> None:
    found = predicted(known(), noise=0.5)
    half = 1.96 * np.hypot(0.5, 0.5)
    assert ends_of(found) == pytest.approx((found.simulated_final - half, found.simulated_final + half))


def test_nothing_is_said_of_a_law_of_which_nothing_is_known() -> None:
    assert np.isnan(ends_of(predicted(None))).all()


def test_another_law_or_other_numbers_of_it_are_not_that_well_known() -> None:
    one = replace(model(GAMMA), rate_uncertainty=known(between_tests=0.3))
    assert one.with_values({"ga.stiffness.k": 8000.0}).rate_uncertainty is not None
    assert one.with_values({PATH: 2 * GAMMA}).rate_uncertainty is None
    law = one.link_laws["joint"].tension_rate
    assert law is not None
    assert one.with_tension_law(law).rate_uncertainty is None


def test_a_file_keeps_it(tmp_path: Path) -> None:
    one: Model = replace(model(GAMMA), rate_uncertainty=known(1.0, 0.3, -0.1))
    one.save(tmp_path / "model.json")
    assert load_model(tmp_path / "model.json") == one


@pytest.mark.parametrize(("covariance", "between"), [([[1.0, 0.0]], 0.1), ([[1.0]], -0.1)])
def test_what_cannot_be_is_refused(covariance: list[list[float]], between: float) -> None:
    with pytest.raises(ValueError, match="must"):
        RateUncertainty(("gamma",), tuple(map(tuple, covariance)), between)


@pytest.mark.parametrize(("of_rates", "low", "high"), [(1.0, 0.85, 1.0), (4.0, 0.2, 0.6)])
def test_courses_lie_within_their_band_as_often_as_the_rates_do(
    of_rates: float, low: float, high: float
) -> None:
    """Rates that differ as the model says, and four times as much; gauge noise on each course."""
    between, noise_n = 0.2, 0.5
    law = replace(model(GAMMA), rate_uncertainty=replace(known(0.0, between), degrees_of_freedom=10_000))
    shares = []
    for seed, u in enumerate(stats.norm.ppf((np.arange(10) + 0.5) / 10)):
        still = measurement("loosening", seen("displacement"), tension=tension(np.full(SAMPLES, TENSION_N)))
        course = replay(model(GAMMA * np.exp(of_rates * between * u)), still).response.tension
        noise = noise_n * np.random.default_rng(seed).standard_normal(SAMPLES)
        shown = tension_record(course + noise, RATE_HZ, WINDOWS, impact_s=0.3, first_mode_hz=20.0)
        shares.append(
            compare_all([law], replace(still, tension=shown), WINDOWS, bands=True)[0].band.course_within
        )
    assert low <= np.mean(shares) <= high
