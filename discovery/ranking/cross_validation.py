"""How well a fitted law does on records it was not fitted to, and how surely it beats another one.

Records are left out by preload: all repeats at one preload leave together, for they share what is special
about it. Laws are compared record by record by their log predictive density, the case-to-case scatter
integrated out: a law earns nothing for following it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import stats
from sklearn.model_selection import GroupKFold

from discovery.courses.fit import Fit, fit, fit_losses, log_predictive, predict
from discovery.courses.frozen_motion import NUISANCE_DIRECTIONS, FrozenMotion
from discovery.courses.marginal_likelihood import Problem
from discovery.criteria.criteria import CRITERIA
from discovery.criteria.number import Numerical
from discovery.criteria.ranking import RankingRules
from rom.campaign.channels import FloatArray

Index = npt.NDArray[np.int64]
Fold = tuple[Index, Index]

_SHIFTS: Numerical[tuple[float, ...]] = tuple(
    float(shift) for shift in range(-14, 4)
)  # of ln rate, where modes are sought
_EXHAUSTIVE: Numerical[int] = 16  # groups up to which every flip of signs is tried
_NUISANCE: Numerical[int] = NUISANCE_DIRECTIONS + 1  # of every case, its own rate too


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Scores on cases while their preload was left out of the fit.

    Attributes
    ----------
    scores : ndarray, shape (cases,)
        Log predictive density.
    loss_error_percent : ndarray, shape (cases,)
        ``100 |predicted - measured loss| / |measured loss|`` in the last bin, at the law's typical rate.
    """

    scores: FloatArray
    loss_error_percent: FloatArray


def preload_groups(frozen: FrozenMotion) -> Index:
    """Number of the preload of every case, (cases,); nearly equal preloads are the same."""
    same = frozen.criteria.ranking.same_preload
    preloads = np.maximum([course.preload for course in frozen.courses], 1e-9)
    order = np.argsort(preloads, kind="stable")
    groups = np.zeros(len(preloads), dtype=np.int64)
    number, first = 0, preloads[order[0]]
    for place in order:
        if preloads[place] > first * (1 + same):
            number, first = number + 1, preloads[place]
        groups[place] = number
    return groups


def preload_folds(groups: Index, seed: int = 0, rules: RankingRules = CRITERIA.ranking) -> list[Fold]:
    """Indices of fitted and left-out cases, fold by fold; no preload is in both.

    Raises
    ------
    ValueError
        If all cases have one preload.
    """
    count = len(np.unique(groups))
    if count < 2:
        raise ValueError(
            "found loosening records at one preload only, expected two or more to cross-validate"
        )
    splitter = GroupKFold(n_splits=min(int(rules.folds), count), shuffle=True, random_state=seed)
    return list(splitter.split(groups, groups=groups))


def divide(frozen: FrozenMotion, folds: Sequence[Fold]) -> list[tuple[FrozenMotion, FrozenMotion]]:
    """Fitted and left-out cases of every fold."""
    return [(frozen.subset(kept), frozen.subset(left)) for kept, left in folds]


def cross_validate(
    fitted: Fit,
    frozen: FrozenMotion,
    folds: Sequence[Fold],
    parts: Sequence[tuple[FrozenMotion, FrozenMotion]],
) -> CrossValidation:
    """Refit without each fold's preloads, by the offsets of the full fit, and score those left out."""
    scores, errors = np.empty(len(frozen)), np.empty(len(frozen))
    for (kept, left), (training, unseen) in zip(folds, parts, strict=True):
        found = refit(fitted, training, kept)
        scores[left] = _log_density(found, unseen, fitted.offsets[left], fitted.deviations[left])
        predicted = predict(found.candidate, unseen, fitted.offsets[left])[:, -1]
        measured = unseen.change[:, -1]
        errors[left] = 100 * np.abs(predicted - measured) / np.maximum(np.abs(measured), 1e-12)
    return CrossValidation(np.where(np.isfinite(scores), scores, -1e12), errors)


def _log_density(found: Fit, unseen: FrozenMotion, offsets: FloatArray, deviations: FloatArray) -> FloatArray:
    """Log predictive density with modes of u sought from zero, and from the best of many places.

    Where a law takes all tension the search has no slope and is lost; the higher density is right.
    """
    problem = Problem(found.candidate, unseen, offsets)
    normal = problem.log_determinant + unseen.change.shape[1] * np.log(2 * np.pi)
    scatter, lowest, place = np.array(found.scatter), np.full(len(unseen), np.inf), deviations
    for shift in _SHIFTS:
        trial = problem.solve(problem.theta0, scatter, deviations + shift, steps=0)
        place = np.where(trial.by_case < lowest, trial.u, place)
        lowest = np.fmin(lowest, trial.by_case)
    state = problem.solve(problem.theta0, scatter, place, steps=12)
    again = -0.5 * (np.fmin(lowest, state.by_case) + normal)
    return np.asarray(np.fmax(log_predictive(found, unseen, offsets), again))


def refit(fitted: Fit, part: FrozenMotion, index: Index) -> Fit:
    """Fit again to the cases ``index``, from the full fit and with its offsets; where lost, the full fit."""
    if fitted.of_losses:
        return fit_losses(fitted.candidate, part, fitted.offsets[index])
    start = replace(fitted, deviations=fitted.deviations[index])
    found = fit(fitted.candidate, part, fitted.offsets[index], start)
    return start if lost(found, fitted.deviance) else found


def lost(found: Fit, deviance: float) -> bool:
    """Whether a fit ended far above a deviance that it started near."""
    rules = found.criteria.courses
    return not found.deviance < rules.lost_times * deviance + rules.lost_beyond


def estimate(fitted: Fit) -> FloatArray:
    """Free numbers as their covariance has them: ln coefficients, inner numbers."""
    values = fitted.candidate.parameters
    found = []
    for name in fitted.free:
        value = values[name].value
        found.append(np.log(value) if name in fitted.candidate.coefficient_names and value > 0 else value)
    return np.array(found)


def limits(
    fitted: Fit, frozen: FrozenMotion, groups: Index, rng: np.random.Generator, spread: float = 1.0
) -> dict[str, tuple[float, float]]:
    """95 % limits of every free number.

    From the likelihood's covariance times c-hat, or from the bootstrap over preloads, whichever is wider at
    each end: the second needs no model of the noise.
    """
    if not fitted.free:
        return {}
    problem = Problem(fitted.candidate, frozen, fitted.offsets)
    state = problem.solve(problem.theta0, np.array(fitted.scatter), fitted.deviations, steps=12)
    rules, count = frozen.criteria.ranking, int(groups.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), int(rules.resamples))
    steps = problem.resampled(state, drawn[:, groups].astype(float))
    low, high = np.quantile(steps, _tails(rules), axis=0)
    errors = np.sqrt(spread * np.maximum(np.diag(fitted.covariance), 0.0))
    half = fitted.criteria.chance.normal_quantile * errors
    widest = np.stack([np.minimum(low, -half), np.maximum(high, half)], axis=1)
    found = {}
    for name, value, ends in zip(fitted.free, estimate(fitted), widest, strict=True):
        both = value + ends
        if name in fitted.candidate.coefficient_names and fitted.candidate.parameters[name].value > 0:
            both = np.exp(np.clip(both, -690, 690))
        found[name] = (float(both[0]), float(both[1]))
    return found


def dispersion(fitted: Fit, frozen: FrozenMotion) -> float:
    """Mean square of whitened residuals over degrees of freedom, 1 at least: c-hat of quasi-likelihood.

    More than 1 where motion and noise are less well known than their covariance says: differences of
    deviance are divided by it, so that small terms that make up for it earn little.
    """
    residual = frozen.change - predict(fitted.candidate, frozen, fitted.offsets, fitted.deviations)
    whitener = np.linalg.inv(np.linalg.cholesky(frozen.covariance))
    square = float((np.einsum("cij,cj->ci", whitener, residual) ** 2).sum())
    cases, bins = residual.shape
    freedom = max(cases * (bins - _NUISANCE) - len(fitted.free), 1)
    return max(1.0, square / float(freedom))


def information_criterion(fitted: Fit, frozen: FrozenMotion, spread: float = 1.0) -> float:
    """``deviance / c-hat + free numbers ln n``; n counts means of bins, not cases: the stricter choice."""
    return fitted.deviance / spread + len(fitted.free) * float(np.log(_size(frozen)))


def _size(frozen: FrozenMotion) -> int:
    cases, bins = frozen.change.shape
    return int(cases * (bins - _NUISANCE))


def _tails(rules: RankingRules) -> tuple[float, float]:
    """Probabilities of the two ends of a confidence interval."""
    tail = (1.0 - rules.confidence) / 2
    return tail, 1.0 - tail


def bounded_difference(
    scores: FloatArray, other: FloatArray, rules: RankingRules = CRITERIA.ranking
) -> FloatArray:
    """Difference of scores, (..., cases), bounded on both sides: no single record decides."""
    return np.asarray(np.clip(scores - other, -rules.record_bound, rules.record_bound))


def by_group(values: FloatArray, groups: Index) -> FloatArray:
    """Sums over the cases of each group: (..., cases) to (..., groups)."""
    return np.stack([values[..., groups == g].sum(axis=-1) for g in np.unique(groups)], axis=-1)


def paired(
    scores: FloatArray, other: FloatArray, groups: Index, rules: RankingRules = CRITERIA.ranking
) -> tuple[float, float]:
    """Bounded advantage of one law over another, summed over preloads, and its standard error.

    The error is infinite where all cases have one preload.
    """
    sums = by_group(bounded_difference(scores, other, rules), groups)
    error = np.sqrt(len(sums)) * sums.std(ddof=1) if len(sums) > 1 else np.inf
    return float(sums.sum()), float(error)


def evidence(fitted: Fit, frozen: FrozenMotion, spread: float = 1.0) -> FloatArray:
    """Share of every case in ``-BIC / 2``, up to a constant: likelihood over c-hat, less numbers' price."""
    problem = Problem(fitted.candidate, frozen, fitted.offsets)
    state = problem.solve(problem.theta0, np.array(fitted.scatter), fitted.deviations, steps=12)
    deviance = np.where(np.isfinite(state.by_case), state.by_case, 1e12)
    price = len(fitted.free) * np.log(_size(frozen)) / len(frozen)
    return np.asarray(-0.5 * (deviance / spread + price))


def beyond_chance(groups: int, rules: RankingRules = CRITERIA.ranking) -> float:
    """Standard errors within which chance keeps a mean over groups, by Student's t."""
    return float(stats.t.ppf(_tails(rules)[1], max(groups - 1, 1)))


def order(
    scores: FloatArray,
    worth: FloatArray,
    complexity: Sequence[tuple[int, int]],
    groups: Index,
    rules: RankingRules = CRITERIA.ranking,
) -> list[int]:
    """Laws from first to last, by (laws, cases) of cross-validated scores and of `evidence`.

    The best in cross-validation is the law that no other leads by bounded differences of the scores, or that
    is led by least where each is led. A law that is not behind it beyond chance, from preload to preload at
    95 %, or by odds of less than 20 to 1, is not told from it. Of these the evidence decides, which knows a
    law's price in numbers and is far sharper, differences bounded as well; of laws of as many numbers within
    odds of 20 to 1 of the most evidence, the shortest goes first. The others follow as they are behind.
    `complexity` is a law's count of free numbers and the length of its equation.
    """
    return _ordered(*_compared(scores, worth, groups, rules), np.asarray(complexity), rules)


def _compared(
    scores: FloatArray, worth: FloatArray, groups: Index, rules: RankingRules
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sums by preload of scores, and of bounded differences of any two laws: (laws, laws, groups), twice."""
    pairs = [
        by_group(bounded_difference(each[:, None], each[None, :], rules), groups) for each in (scores, worth)
    ]
    return by_group(scores, groups), pairs[0], pairs[1]


def _ordered(
    sums: FloatArray,
    pairs: FloatArray,
    worth: FloatArray,
    complexity: npt.NDArray[np.int64],
    rules: RankingRules,
) -> list[int]:
    totals = sums.sum(axis=1)  # they only part laws that are as far behind, at the bound on every record
    leads = pairs.sum(axis=-1)
    best = max(range(len(totals)), key=lambda k: (leads[k].min(), totals[k]))
    lead, behind = leads[best], worth[best].sum(axis=-1)
    error = np.sqrt(sums.shape[1]) * pairs[best].std(axis=1, ddof=1)
    equal = lead <= np.maximum(beyond_chance(sums.shape[1], rules) * error, rules.log_odds)
    equal[best] = True
    numbers, lengths = complexity.T
    most = min(np.flatnonzero(equal), key=lambda k: behind[k])
    as_good = equal & (numbers == numbers[most]) & (behind <= behind[most] + rules.log_odds)
    return sorted(
        range(len(totals)),
        key=lambda k: (
            not as_good[k],
            not equal[k],
            lengths[k] if as_good[k] else 0,
            behind[k] if equal[k] else lead[k],
            -totals[k],
        ),
    )


def chosen(
    scores: FloatArray,
    worth: FloatArray,
    complexity: Sequence[tuple[int, int]],
    groups: Index,
    rng: np.random.Generator,
    rules: RankingRules = CRITERIA.ranking,
) -> FloatArray:
    """How often each law comes first when preloads are drawn again with replacement, (laws,)."""
    sums, pairs, prices = _compared(scores, worth, groups, rules)
    counts, draws = np.zeros(len(scores)), int(rules.resamples)
    for _ in range(draws):
        drawn = rng.integers(0, sums.shape[1], sums.shape[1])
        of_draw = sums[:, drawn], pairs[..., drawn], prices[..., drawn]
        counts[_ordered(*of_draw, np.asarray(complexity), rules)[0]] += 1
    return counts / draws


def p_values(
    scores: FloatArray,
    baseline: FloatArray,
    groups: Index,
    rng: np.random.Generator,
    rules: RankingRules = CRITERIA.ranking,
) -> FloatArray:
    """Chance of so great an advantage over the baseline where no law is better, (laws,).

    The advantage over each preload is as likely gain as loss where a law is no better: signs are flipped,
    of all laws alike, and the smallest p among all laws is what each law's p is compared with (P. Westfall
    and S. Young, Resampling-Based Multiple Testing, 1993, min-p): the best of many is not credited for there
    being many.
    """
    gains = by_group(bounded_difference(scores, baseline, rules), groups)
    signs = _flips(gains.shape[1], rng)
    flipped = gains @ signs.T
    single = np.empty_like(flipped)
    for row, values in enumerate(flipped):
        ordered = np.sort(values)
        single[row] = (len(values) - np.searchsorted(ordered, values - 1e-9, side="left")) / len(values)
    smallest = single.min(axis=0)
    found = np.array([np.mean(smallest <= own + 1e-12) for own in single[:, 0]])
    return np.asarray(np.where(gains.sum(axis=1) > 0, found, 1.0))


def _flips(groups: int, rng: np.random.Generator) -> FloatArray:
    """Signs, (flips, groups); none flipped in the first row."""
    if groups <= _EXHAUSTIVE:
        codes = np.arange(2**groups)[:, None] >> np.arange(groups) & 1
        return np.asarray(1.0 - 2.0 * codes)
    signs = rng.choice([-1.0, 1.0], (2**_EXHAUSTIVE, groups))
    signs[0] = 1.0
    return np.asarray(signs)
