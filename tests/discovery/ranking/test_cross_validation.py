"""Folds by preload, paired comparison, chance of being the best of many, limits."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.courses.fit import fit, log_predictive
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.courses.marginal_likelihood import Problem
from discovery.criteria.criteria import CRITERIA
from discovery.laws.candidate import BASELINE, CONSTANT_QUARTIC, baseline, rivals_always_in_the_race
from discovery.ranking import cross_validation as validation
from discovery.ranking import ordering
from rom import paper_model
from tests.discovery.synthetic import known_fit, measured

GROUPS = np.repeat(np.arange(16), 3)


@pytest.fixture(scope="module")
def frozen() -> FrozenMotion:
    return freeze(paper_model(), measured(scatter=0.4, seed=3))


def test_preloads_within_a_few_percent_are_one_group(frozen: FrozenMotion) -> None:
    groups = validation.preload_groups(frozen)
    assert list(groups) == list(np.repeat(np.arange(8), 2))
    shuffled = frozen.subset([15, 0, 2, 1, 14])
    assert list(validation.preload_groups(shuffled)) == [2, 0, 1, 0, 2]


def test_folds_leave_whole_preloads_out_and_every_case_once() -> None:
    folds = validation.preload_folds(GROUPS, seed=1)
    assert len(folds) == CRITERIA.ranking.folds
    assert sorted(np.concatenate([left for _, left in folds])) == list(range(len(GROUPS)))
    for kept, left in folds:
        assert not set(GROUPS[kept]) & set(GROUPS[left])


def test_one_preload_cannot_be_cross_validated() -> None:
    with pytest.raises(ValueError, match="one preload only, expected two or more"):
        validation.preload_folds(np.zeros(5, dtype=np.int64))


def test_cases_left_out_score_less_than_cases_fitted(frozen: FrozenMotion) -> None:
    found = fit(baseline(), frozen)
    folds = validation.preload_folds(validation.preload_groups(frozen))
    check = validation.cross_validate(found, frozen, folds, validation.divide(frozen, folds))
    fitted = log_predictive(found, frozen)
    assert fitted.sum() - 30 < check.scores.sum() < fitted.sum()
    assert np.median(check.loss_error_percent) < 100


def test_limits_are_never_inside_those_of_the_likelihood(frozen: FrozenMotion) -> None:
    found = known_fit(baseline(), frozen)
    wide = validation.limits(found, frozen, validation.preload_groups(frozen), np.random.default_rng(0))
    for name, (low, high) in wide.items():
        own = found.limits(name)
        assert low <= own[0] + 1e-9 * abs(own[0])
        assert high >= own[1] - 1e-9 * abs(own[1])
    assert wide["gamma_i"][0] < 7.974 < wide["gamma_i"][1]


def test_one_step_to_resampled_preloads_is_where_a_refit_ends(frozen: FrozenMotion) -> None:
    found = known_fit(baseline(), frozen)
    problem = Problem(found.candidate, frozen, found.offsets)
    state = problem.solve(problem.theta0, np.array(found.scatter), found.deviations, steps=12)
    groups = validation.preload_groups(frozen)
    error = np.sqrt(np.diag(found.covariance))
    for drawn in np.random.default_rng(1).integers(0, groups.max() + 1, (3, groups.max() + 1)):
        index = np.concatenate([np.flatnonzero(groups == group) for group in drawn])
        counts = np.bincount(index, minlength=len(groups)).astype(float)
        again = validation.refit(found, frozen.subset(index), index)
        moved = validation.estimate(again) - validation.estimate(found)
        step = problem.resampled(state, counts[None])[0]
        assert (
            np.abs(step - moved).max() < 0.5 * np.abs(moved).max()
            or (np.abs(step - moved) < 0.5 * error).all()
        )


def test_dispersion_is_one_for_noise_as_declared_and_grows_with_it(frozen: FrozenMotion) -> None:
    found = fit(baseline(), frozen)
    assert validation.dispersion(found, frozen) < 1.4
    noisy = freeze(paper_model(), measured(scatter=0.4, seed=3, noise=1.0))
    rough = np.random.default_rng(0).multivariate_normal(np.zeros(9), noisy.covariance[0] * 8, len(noisy))
    object.__setattr__(noisy, "change", noisy.change + rough)
    assert validation.dispersion(fit(baseline(), noisy), noisy) > 2.0


def test_evidence_decides_among_laws_that_cross_validation_does_not_tell_apart() -> None:
    rng = np.random.default_rng(0)
    simple = rng.standard_normal(48)
    rich = simple + 0.3 * rng.standard_normal(48)
    better = simple + 1.0 + 0.5 * rng.standard_normal(48)
    none, much = np.zeros(48), np.full(48, 0.2)
    sizes = [(4, 20), (2, 10)]
    assert ordering.order(np.stack([rich, simple]), np.stack([none, much]), sizes, GROUPS) == [1, 0]
    assert ordering.order(np.stack([rich, simple]), np.stack([much, none]), sizes, GROUPS) == [0, 1]
    assert ordering.order(np.stack([better, simple]), np.stack([none, much]), sizes, GROUPS) == [0, 1]
    of_three = np.stack([simple, better, better - 0.01])
    of_all = np.stack([much, none, 0.5 * much])
    assert ordering.order(of_three, of_all, [(1, 9), (3, 9), (2, 9)], GROUPS) == [2, 1, 0]


@pytest.mark.parametrize(("errors", "first"), [(1.6, 1), (2.6, 0)])
def test_a_lead_counts_where_it_is_beyond_chance(errors: float, first: int) -> None:
    swing = np.repeat(np.tile([1.0, -1.0], 8), 3) / 3
    lead = errors * 4 * swing.reshape(16, 3).sum(axis=1).std(ddof=1)
    rich = np.zeros(48) + swing + lead / 48
    worth = np.stack([np.zeros(48), np.full(48, 0.2)])
    assert lead > 5  # odds far beyond 20 to 1
    assert ordering.order(np.stack([rich, np.zeros(48)]), worth, [(9, 20), (3, 9)], GROUPS)[0] == first


def test_of_laws_of_as_many_numbers_and_nearly_the_same_evidence_the_shortest_goes_first() -> None:
    scores = np.random.default_rng(0).standard_normal(48) + np.zeros((3, 1))
    worth = np.stack([np.full(48, 2.0 / 48), np.zeros(48), np.full(48, 1.0 / 48)])
    assert ordering.order(scores, worth, [(4, 20), (4, 10), (3, 5)], GROUPS) == [1, 0, 2]
    assert ordering.order(scores, 2 * worth, [(4, 20), (4, 10), (3, 5)], GROUPS) == [0, 2, 1]


def test_one_record_does_not_make_a_law_the_best() -> None:
    base = np.random.default_rng(0).standard_normal(48)
    steady, lucky = base + 0.5, base.copy()
    lucky[7] += 1e4
    scores, sizes = np.stack([lucky, steady, base]), [(3, 9)] * 3
    assert ordering.order(scores, scores, sizes, GROUPS) == [1, 0, 2]
    assert ordering.chosen(scores, scores, sizes, GROUPS, np.random.default_rng(1))[1] > 0.95
    worth = np.stack([steady, lucky])
    assert ordering.order(np.stack([base, base]), worth, sizes[:2], GROUPS) == [0, 1]


def test_evidence_is_the_information_criterion_case_by_case(frozen: FrozenMotion) -> None:
    laws = [rival for rival in rivals_always_in_the_race() if rival.name in (BASELINE, CONSTANT_QUARTIC)]
    fits = [fit(law, frozen) for law in laws]
    halves = [-2 * validation.evidence(one, frozen, 1.5).sum() for one in fits]
    criteria = [validation.information_criterion(one, frozen, 1.5) for one in fits]
    assert halves[1] - halves[0] == pytest.approx(criteria[1] - criteria[0], rel=1e-3)


def test_no_single_record_decides() -> None:
    calm = np.zeros(48)
    lucky = calm.copy()
    lucky[0] = 1e4
    p = ordering.p_values(lucky[None], calm, GROUPS, np.random.default_rng(0))
    assert p[0] == pytest.approx(0.5)


def test_steady_gain_is_beyond_chance_and_loss_is_not() -> None:
    rng = np.random.default_rng(1)
    base = rng.standard_normal(48)
    scores = np.stack([base + 0.5 + 0.3 * rng.standard_normal(48), base - 1.0, base])
    p = ordering.p_values(scores, base, GROUPS, rng)
    assert p[0] < 1e-3
    assert p[1] == 1.0
    assert p[2] == 1.0


@pytest.mark.parametrize("laws", [1, 30])
def test_best_of_many_equal_laws_is_rarely_called_better(laws: int) -> None:
    rng = np.random.default_rng(2)
    called = 0
    groups = np.repeat(np.arange(10), 3)
    for _ in range(200):
        shared = rng.standard_normal(30)
        scores = 0.5 * shared + rng.standard_normal((laws, 30))
        called += bool(ordering.p_values(scores, np.zeros(30), groups, rng).min() < 0.05)
    assert called / 200 < 0.10


def test_many_preloads_are_flipped_at_random() -> None:
    rng = np.random.default_rng(3)
    groups = np.arange(24)
    gain = 0.5 + 0.5 * rng.standard_normal(24)
    p = ordering.p_values(gain[None], np.zeros(24), groups, rng)
    assert 0 < p[0] < 0.01


def test_share_of_resamples_sums_to_one_and_favours_the_better() -> None:
    rng = np.random.default_rng(4)
    base = rng.standard_normal(48)
    scores = np.stack([base, base + 1.0 + 0.2 * rng.standard_normal(48)])
    share = ordering.chosen(scores, np.zeros_like(scores), [(1, 9), (1, 9)], GROUPS, rng)
    assert share.sum() == pytest.approx(1.0)
    assert share[1] > 0.95
