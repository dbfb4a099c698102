"""Probabilities of laws and predictions averaged by them: steps are refits, averages are averages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import special

from discovery.courses.fit import Fit, Uncertainty, log_predictive
from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.likelihood_steps import step
from discovery.courses.marginal_likelihood import Problem
from discovery.laws.candidate import baseline, constant_power, no_loosening
from discovery.ranking.averaging import (
    NewTests,
    Weighted,
    averaged_log_density,
    drawn_laws,
    log_densities,
    predicted,
)
from discovery.ranking.probabilities import probabilities, resampled_deviance
from rom.parameters.he_2025 import nominal_impact, paper_model
from tests.discovery.synthetic import free_power, frozen, known_fit

GROUPS = np.repeat(np.arange(8), 2)


@pytest.fixture(scope="module")
def tests() -> FrozenMotion:
    return frozen(scatter=0.3, seed=3, length_s=1.0)


@pytest.fixture(scope="module")
def free(tests: FrozenMotion) -> Fit:
    return known_fit(free_power(), tests)


def test_one_step_leads_to_the_deviance_of_a_refit(free: Fit, tests: FrozenMotion) -> None:
    """At the scatter of all tests, in resamples of the preloads."""
    rng = np.random.default_rng(0)
    drawn = rng.multinomial(8, np.full(8, 1 / 8), 6)[:, GROUPS]
    before = resampled_deviance(replace(free, of_losses=True), tests, drawn.astype(float))
    after = resampled_deviance(free, tests, drawn.astype(float))
    found = []
    for counts in drawn:
        index = np.repeat(np.arange(len(tests)), counts)
        problem = Problem(free.candidate, tests.subset(index), free.offsets[index])
        state = problem.solve(problem.theta0, np.array(free.scatter), free.deviations[index], 12)
        damping = 1e-3
        for _ in range(20):
            trial, damping = step(problem, state, damping)
            if trial is None:
                break
            state = trial
        found.append(state.deviance)
    assert before - after == pytest.approx(before - np.array(found), rel=0.25, abs=0.3)


def test_probabilities_add_up_and_go_to_the_law_that_made_the_tests(tests: FrozenMotion, free: Fit) -> None:
    fits = [free, known_fit(baseline(), tests), known_fit(constant_power(2.0, "quadratic"), tests)]
    fits.append(known_fit(no_loosening(), tests))
    shares = probabilities(fits, tests, GROUPS, np.random.default_rng(1))
    assert shares.sum() == pytest.approx(1.0)
    assert shares[1] > 0.4  # as good as the free power, which has a number more
    assert shares[1] > shares[0] > shares[2:].max()
    assert shares[2:].max() < 1e-3


def test_laws_that_fit_alike_share_equally_but_for_their_numbers(tests: FrozenMotion, free: Fit) -> None:
    shares = probabilities([free, free], tests, GROUPS, np.random.default_rng(1))
    assert shares == pytest.approx([0.5, 0.5])
    richer = replace(free, free=(*free.free, "more"))
    poorer, rich = (len(one.free) for one in (free, richer))
    assert rich == poorer + 1


def test_uncertain_numbers_are_integrated_out(free: Fit) -> None:
    """The mean density over draws of the numbers, where they are well enough known to be linear."""
    unseen = frozen(scatter=0.3, seed=8, length_s=1.0)
    zero = np.zeros_like(unseen.change)
    rng = np.random.default_rng(0)
    draws = np.array(
        [log_predictive(replace(free, candidate=law), unseen, zero) for law in drawn_laws(free, 400, rng)]
    )
    mean = special.logsumexp(draws, axis=0) - np.log(400)
    plain = log_predictive(free, unseen, zero)
    error = np.abs(log_densities(free, unseen) - mean)
    assert np.abs(mean - plain).max() > 0.15
    assert error.max() < 0.4 * np.abs(mean - plain).max()


def test_an_average_lies_between_its_laws(free: Fit) -> None:
    unseen = frozen(scatter=0.3, seed=8, length_s=1.0)
    other = replace(free, candidate=free.candidate.with_values({"n": 3.6}))
    laws = [Weighted("a", free, 0.7), Weighted("b", other, 0.3)]
    mixed = averaged_log_density(laws, unseen)
    parts = np.stack([log_densities(law.fit, unseen) for law in laws])
    assert (mixed <= parts.max(axis=0)).all()
    assert (mixed >= parts.min(axis=0)).all()
    assert mixed == pytest.approx(np.log(0.7 * np.exp(parts[0]) + 0.3 * np.exp(parts[1])))


def test_new_tests_are_predicted_with_the_scatter_and_the_laws_in_their_limits(free: Fit) -> None:
    force = nominal_impact(1600.0, 4800.0, 1.0)
    hits = NewTests.of(force, 4800.0, [150.0, 300.0][:1], None, "lo")
    exactly = Uncertainty(np.zeros_like(free.covariance), free.between_tests)
    sure = replace(free, uncertainty=exactly, scatter=(np.log(0.01), 0.0))
    exact = paper_model().with_tension_law(sure.candidate.law()).final_tension(force[None], 4800.0, [150.0])
    one = predicted([Weighted("a", sure, 1.0)], paper_model(), hits, 60, 0)
    assert one.final_tension == pytest.approx(exact, abs=0.02)
    scattered = predicted([Weighted("a", free, 1.0)], paper_model(), hits, 200, 0)
    loss, spread = 150.0 - exact[0], float(free.tau(np.array([150.0]))[0])
    assert scattered.low[0] == pytest.approx(150 - loss * np.exp(1.96 * spread), abs=0.25 * loss)
    assert scattered.high[0] == pytest.approx(150 - loss * np.exp(-1.96 * spread), abs=0.25 * loss)
    laws = [Weighted("a", sure, 0.5), Weighted("none", fit_of_none(sure), 0.5)]
    both = predicted(laws, paper_model(), hits, 60, 0)
    assert both.final_tension[0] == pytest.approx(150 - loss / 2, abs=0.05)
    assert both.by_law["none"][0] == pytest.approx(150.0)
    assert both.low[0] < 150 - 0.9 * loss
    assert both.high[0] == pytest.approx(150.0)
    fast = {"gamma": 1e4 * sure.candidate.parameters["gamma"].value}
    slack = replace(sure, candidate=sure.candidate.with_values(fast))
    rare = predicted([Weighted("a", sure, 0.99), Weighted("b", slack, 0.01)], paper_model(), hits, 60, 0)
    assert rare.final_tension[0] < rare.low[0]  # the one in a hundred that loses all
    assert rare.low[0] <= rare.median[0] <= rare.high[0]
    assert rare.median == pytest.approx(one.median, abs=0.02)


def fit_of_none(like: Fit) -> Fit:
    return replace(
        like, candidate=no_loosening(), free=(), uncertainty=Uncertainty(np.zeros((0, 0)), like.between_tests)
    )
