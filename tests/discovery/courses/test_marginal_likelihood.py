"""Steps of the fit: as far as the courses ask for, and within the ranges of the numbers."""

from __future__ import annotations

import numpy as np
import pytest

import rom
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.courses.likelihood_steps import climbed, least_within
from discovery.courses.marginal_likelihood import Problem
from discovery.courses.tension_likelihood import course, law_candidate, law_problem, resimulated
from discovery.laws.candidate import Candidate
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE
from tests.discovery.synthetic import measured

_SCATTER = np.array([np.log(0.5), 0.0])


@pytest.mark.parametrize("seed", range(10))
def test_no_change_within_its_range_lowers_the_square_further(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((9, 5)) * 10.0 ** rng.uniform(-3, 3, 5)
    matrix, right = root.T @ root, root.T @ rng.standard_normal(9)
    free = np.linalg.solve(matrix, right)
    high = np.where(rng.random(5) < 0.5, np.inf, np.abs(free) / 2)
    found = least_within(matrix, right, -high, high)
    assert (np.abs(found) <= high * (1 + 1e-9)).all()
    slope = (right - matrix @ found) / np.sqrt(np.diag(matrix))
    inside = np.abs(found) < high * (1 - 1e-9)
    assert slope[inside] == pytest.approx(0.0, abs=1e-6)
    assert (slope * np.sign(found))[~inside].min(initial=0.0) >= 0  # only ever pushed against its end


def test_a_law_is_found_from_far_where_a_number_is_at_the_end_of_its_range() -> None:
    """Much more than noise is left at the start, and the threshold of the ratchet is at zero."""
    effect = CATALOGUE["loosening-ratchet"].at("tension").with_values(r=8.8, x_r=0.0, h_r=0.9)
    true = law_candidate(rom.paper_model(), effect, ("gamma_d", "gamma_i", "rho"), 0)
    preloads = (8.0, 15.0, 30.0, 60.0, 100.0, 150.0, 300.0, 700.0, 1500.0, 3000.0)
    held = freeze(rom.paper_model(), measured(true, preloads=preloads, strengths=(1.0,)))
    still = np.zeros(len(held))
    offsets = resimulated(true, held, still, held.model) - course(true, held, still)

    def fitted(**values: float) -> float:
        problem = law_problem(true.with_values(values), held, offsets)
        start = problem.solve(problem.theta0, _SCATTER, still, 12)
        return climbed(problem, start, 0.05, 20)[0].deviance

    least = fitted()
    for far, more in ((4.0, 2.0), (1.0, 2.0), (20.0, 8.0)):  # the last is 23 off by plain Gauss-Newton steps
        assert fitted(loosening_ratchet_r=far, gamma_d=12.7, gamma_i=8.8) < least + more


@pytest.mark.parametrize("steps", [0, 1, 2, 12])
def test_what_is_kept_of_a_case_is_of_the_deviation_that_it_has(steps: int) -> None:
    """Cases come to their modes one after the other, and are not followed any more from there on."""
    true = law_candidate(rom.paper_model(), None, ("gamma_d",), 0)
    held = freeze(
        rom.paper_model(), measured(true, preloads=(15.0, 60.0, 300.0, 1500.0), strengths=(1.0, 0.5))
    )
    asked: list[int] = []

    def counted(candidate: Candidate, frozen: FrozenMotion, u: FloatArray) -> FloatArray:
        asked.append(int(np.isfinite(u).sum()))
        return course(candidate, frozen, u)

    problem = Problem(true, held, np.zeros_like(held.change), counted)
    away = np.linspace(-0.5, 0.5, len(held))
    state = problem.solve(problem.theta0, _SCATTER, away, steps)
    assert asked == sorted(asked, reverse=True)
    assert steps < 12 or asked[-1] < len(held)
    whole = problem.solve(problem.theta0, _SCATTER, state.u, 0)
    np.testing.assert_allclose(state.residual, whole.residual, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state.slope, whole.slope, rtol=1e-9, atol=1e-9)
    assert state.deviance == pytest.approx(whole.deviance)
    if steps == 12:
        further = problem.solve(problem.theta0, _SCATTER, state.u, 1)
        assert state.deviance == pytest.approx(further.deviance, abs=1e-4)
