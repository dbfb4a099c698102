"""What tests of one bolt share: numbers of dense normal theory, and variances that are found again."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.courses.between_bolts import Bolts, Variances
from discovery.courses.fit import by_other_tests, fit, log_predictive, within_bolts
from discovery.courses.frozen_motion import FrozenMotion, freeze, freeze_bolts
from discovery.courses.marginal_likelihood import Problem
from discovery.criteria.criteria import CRITERIA
from rom.campaign.channels import FloatArray
from rom.parameters.he_2025 import paper_model
from tests.discovery.bolts import bolts_of
from tests.discovery.synthetic import free_power, measured, with_power

RULES = CRITERIA.courses
LEVEL = CRITERIA.chance.normal_quantile**2
INDEX = np.array([0, 0, 0, 1, 1, 2, 2, 2, 2])


def random_tests(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Information, what it says of u, and both variances."""
    rng = np.random.default_rng(seed)
    size = len(INDEX)
    return np.exp(rng.normal(2, 1, size)), rng.standard_normal(size), np.exp(rng.normal(-2, 0.5, size)), 0.3


def covariance(tau2: FloatArray, sigma2: float) -> FloatArray:
    return np.asarray(np.diag(tau2) + sigma2 * np.equal.outer(INDEX, INDEX))


@pytest.mark.parametrize("seed", range(3))
def test_modes_step_and_deviance_are_those_of_the_dense_covariance(seed: int) -> None:
    information, u, tau2, sigma2 = random_tests(seed)
    dense, bolts = covariance(tau2, sigma2), Bolts(INDEX)
    b = bolts.modes(u, tau2, sigma2)
    own = u - b[INDEX]
    np.testing.assert_allclose(own / tau2, np.linalg.solve(dense, u), rtol=1e-10)
    gradient = np.random.default_rng(seed + 9).standard_normal(len(u))
    step = bolts.newton(gradient, information, tau2, sigma2)
    whole = np.linalg.inv(dense) + np.diag(information)
    np.testing.assert_allclose(step, np.linalg.solve(whole, gradient), rtol=1e-9)
    added = own**2 / tau2 + np.log1p(tau2 * information) + bolts.deviance(b, information, tau2, sigma2)
    exact = u @ np.linalg.solve(dense, u) + np.linalg.slogdet(np.eye(len(u)) + dense * information)[1]
    assert added.sum() == pytest.approx(exact)


def test_restricted_likelihood_is_that_of_normal_means() -> None:
    information, means, _, _ = random_tests(4)
    initial = np.full(len(means), 100.0)
    variances = Variances(Bolts(INDEX), information, information * means, initial, RULES)

    def exact(scatter: FloatArray) -> float:
        total = covariance(np.full(len(means), np.exp(2 * scatter[0])), float(np.exp(2 * scatter[2])))
        total += np.diag(1 / information)
        inverse = np.linalg.inv(total)
        rate = inverse.sum()
        square = means @ inverse @ means - (inverse @ means).sum() ** 2 / rate
        return float(np.linalg.slogdet(total)[1] + np.log(rate) + square)

    one, other = np.array([-1.0, 0.0, -0.5]), np.array([-2.0, 0.0, -3.0])
    difference = variances.deviance(one) - variances.deviance(other)
    assert difference == pytest.approx(exact(one) - exact(other), rel=1e-9)


def of_eight_bolts(rng: np.random.Generator, sigma: float, tau: float) -> Variances:
    """Eight bolts of six tests each, every rate measured to 5 %."""
    index = np.repeat(np.arange(8), 6)
    u = sigma * rng.standard_normal(8)[index] + tau * rng.standard_normal(48)
    seen = (u + 0.05 * rng.standard_normal(48)) / 0.05**2
    tensions = np.tile(100 * np.geomspace(0.3, 3.0, 6), 8)
    return Variances(Bolts(index), np.full(48, 1 / 0.05**2), seen, tensions, RULES)


@pytest.mark.slow
def test_variances_of_eight_bolts_are_found_and_their_limits_hold_them() -> None:
    rng, sigma, tau = np.random.default_rng(0), 0.47, 0.3
    found = []
    for _ in range(50):
        variances = of_eight_bolts(rng, sigma, tau)
        best = variances.best(np.array([-1.0, 0.0, -1.0]))
        (low, high), (least, most) = (variances.limits(best, place, LEVEL) for place in (2, 0))
        found.append((np.exp(best[2]), low <= sigma <= high, np.exp(best[0]), least <= tau <= most))
    between, held, within, held_too = np.array(found).T
    # three standard errors of the mean of 50 variances of 7 and of 40 degrees of freedom
    assert np.mean(between**2) == pytest.approx(sigma**2, rel=0.23)
    assert np.mean(within**2) == pytest.approx(tau**2, rel=0.1)
    assert np.median(between) == pytest.approx(0.952 * sigma, abs=0.07)  # of chi2_7; 0.89 by full likelihood
    assert held.mean() >= 0.84  # 94 % of 50, less three standard errors
    assert held_too.mean() >= 0.84


def test_limits_are_open_where_the_records_say_nothing() -> None:
    rng = np.random.default_rng(1)
    alike = of_eight_bolts(rng, 0.0, 0.3)
    best = alike.best(np.array([-1.0, 0.0, -3.0]))
    assert alike.limits(best, 2, LEVEL)[0] == 0.0
    one = Variances(Bolts(np.zeros(48, dtype=np.int64)), alike.information, alike.seen, alike.initial, RULES)
    kept = one.best(np.array([-1.0, 0.0, -0.7]))
    assert kept[2] == -0.7
    assert one.limits(kept, 2, LEVEL) == (0.0, np.inf)


@pytest.fixture(scope="module")
def several() -> FrozenMotion:
    """Four bolts of four tests each."""
    return freeze_bolts(bolts_of(with_power(4.0), [-0.6, 0.0, 0.2, 0.7], scatter=0.2))


def test_bolts_of_one_test_each_are_tests_of_more_scatter(several: FrozenMotion) -> None:
    """Where every test has its own bolt, tau^2 + sigma^2 is all that counts."""
    object.__setattr__(each := several.subset(range(len(several))), "bolt", np.arange(len(several)))
    object.__setattr__(alone := several.subset(range(len(several))), "bolt", None)
    law, zero = with_power(4.0), np.zeros(len(several))
    offsets = np.zeros_like(several.change)
    parted = Problem(law, each, offsets)
    whole = Problem(law, alone, offsets)
    one = parted.solve(parted.theta0, np.array([np.log(0.4), 0.0, np.log(0.3)]), zero, 12)
    other = whole.solve(whole.theta0, np.array([np.log(0.5), 0.0]), zero, 12)
    np.testing.assert_allclose(one.u, other.u, atol=1e-6)
    np.testing.assert_allclose(one.by_case, other.by_case, rtol=1e-9)
    for mine, theirs in zip(parted.normal_equations(one), whole.normal_equations(other), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-6 * np.abs(theirs).max())


def test_a_fit_of_several_bolts_knows_what_their_tests_share(several: FrozenMotion) -> None:
    found = fit(free_power(), several)
    assert found.candidate.parameters["n"].value == pytest.approx(4.0, abs=0.4)
    assert found.sigma > 0.3
    bolts = several.bolts
    assert bolts is not None
    b = found.deviations - within_bolts(found, several)
    by_bolt = bolts.sums(b) / 4
    assert by_bolt == pytest.approx(np.array([-0.6, 0.0, 0.2, 0.7]) - 0.075, abs=0.35)
    told = bolts.sums(by_other_tests(found, several, found.offsets)) / 4
    assert np.abs(told - by_bolt).max() < 0.3 * np.ptp(by_bolt)


def test_tests_of_one_bolt_are_likelier_together_than_apart(several: FrozenMotion) -> None:
    found = fit(free_power(), several)
    first = several.subset(range(4))
    together = log_predictive(found, first).sum()
    apart = sum(log_predictive(found, first.subset([case])).sum() for case in range(4))
    assert together > apart + 1.0


def test_histories_in_other_bins_are_refused() -> None:
    longer = measured(with_power(4.0), preloads=(60.0,), length_s=1.0)
    pair = [*bolts_of(with_power(4.0), [0.0]), (paper_model(), longer)]
    with pytest.raises(ValueError, match=r"bins of time that differ .*expected records of equal length"):
        freeze_bolts(pair)


def test_motion_of_several_bolts_is_each_ones_own() -> None:
    pair = bolts_of(with_power(4.0), [0.0, 0.5])
    k = pair[1][0].parameters["flexure_so.stiffness.k"].value
    other = pair[1][0].with_values({"flexure_so.stiffness.k": 1.1 * k})
    together = freeze_bolts([pair[0], (other, pair[1][1])])
    apart = [freeze(paper_model(), pair[0][1]), freeze(other, pair[1][1])]
    np.testing.assert_array_equal(together.nodes, np.concatenate([one.nodes for one in apart], axis=1))
    assert [model is other for model, _ in together.by_bolt()] == [False, True]
