"""How well a fitted law does on records that it was not fitted to.

Records are left out by preload: all repeats at one preload leave together, for they share what is special
about it. They are scored by their log predictive density, the case-to-case scatter integrated out: a law
earns nothing for following it. How laws are then compared: `discovery.ranking.ordering`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.courses.fit import Fit, at_fit, by_other_tests, fit, fit_losses, log_predictive, predict
from discovery.courses.frozen_motion import NUISANCE_DIRECTIONS, FrozenMotion
from discovery.courses.marginal_likelihood import Problem
from discovery.criteria.criteria import CRITERIA
from discovery.criteria.ranking import RankingRules
from discovery.ranking.ordering import Index, tails
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

Fold = tuple[Index, Index]

_SHIFTS: Numerical[tuple[float, ...]] = tuple(
    float(shift) for shift in range(-14, 4)
)  # of ln rate, where modes are sought
_NUISANCE: Numerical[int] = NUISANCE_DIRECTIONS + 1  # of every case, its own rate too


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Scores on cases while their preload, or of several bolts their bolt, was left out of the fit.

    Attributes
    ----------
    scores : ndarray, shape (cases,)
        Log predictive density.
    loss_error_percent : ndarray, shape (cases,)
        ``100 |predicted - measured loss| / |measured loss|`` in the last bin, at the law's typical rate.
    of_known_bolt : ndarray, shape (cases,), optional
        The same at the rate that the other tests of its bolt tell, where there are several bolts.
    """

    scores: FloatArray
    loss_error_percent: FloatArray
    of_known_bolt: FloatArray | None = None


def groups_of(frozen: FrozenMotion) -> Index:
    """Number of what every case shares its chance with, (cases,): its bolt, of one bolt its preload."""
    return preload_groups(frozen) if frozen.bolts is None else frozen.bolts.index


def folds_of(frozen: FrozenMotion, groups: Index, seed: int = 0) -> list[Fold]:
    """Folds of cross-validation: by preload, or of several bolts each bolt left out.

    Parameters
    ----------
    frozen : FrozenMotion
        All cases.
    groups : ndarray, shape (cases,)
        As from `groups_of`.
    seed : int
        Of the order in which preloads are dealt.

    Returns
    -------
    list of (ndarray, ndarray)
        Places of the cases that are fitted, and of those left out.
    """
    if frozen.bolts is None:
        return preload_folds(groups, seed, frozen.criteria.ranking)
    return [(np.flatnonzero(groups != g), np.flatnonzero(groups == g)) for g in range(frozen.bolts.count)]


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

    Parameters
    ----------
    groups : ndarray, shape (cases,)
        Number of every case's preload.
    seed : int
        Of the order in which preloads are dealt.
    rules : RankingRules
        Folds at most.

    Returns
    -------
    list of (ndarray, ndarray)
        Places of the cases that are fitted, and of those left out.

    Raises
    ------
    ValueError
        If all cases have one preload.
    """
    from sklearn.model_selection import GroupKFold  # half a second that worker processes do not need

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
    """Refit without each fold's preloads, by the offsets of the full fit, and score those left out.

    Parameters
    ----------
    fitted : Fit
        To all cases.
    frozen : FrozenMotion
        All cases.
    folds : sequence of (ndarray, ndarray)
        As from `preload_folds`.
    parts : sequence of (FrozenMotion, FrozenMotion)
        The cases of every fold, as from `divide`.

    Returns
    -------
    CrossValidation
        Score and loss error of every case.
    """
    scores, errors, known = (np.empty(len(frozen)) for _ in range(3))
    for (kept, left), (training, unseen) in zip(folds, parts, strict=True):
        found = refit(fitted, training, kept)
        scores[left] = _log_density(found, unseen, fitted.offsets[left], fitted.deviations[left])
        predicted = (predict(found.candidate, unseen) + fitted.offsets[left])[:, -1]
        measured = unseen.change[:, -1]
        errors[left] = 100 * np.abs(predicted - measured) / np.maximum(np.abs(measured), 1e-12)
        if frozen.bolts is not None:
            b = by_other_tests(found, unseen, fitted.offsets[left])
            predicted = (predict(found.candidate, unseen, b) + fitted.offsets[left])[:, -1]
            known[left] = 100 * np.abs(predicted - measured) / np.maximum(np.abs(measured), 1e-12)
    scores = np.where(np.isfinite(scores), scores, -1e12)
    return CrossValidation(scores, errors, None if frozen.bolts is None else known)


def _log_density(found: Fit, unseen: FrozenMotion, offsets: FloatArray, deviations: FloatArray) -> FloatArray:
    """Log predictive density with modes of u sought from zero, and from the best of many places.

    Where a law takes all tension the search has no slope and is lost; the higher density is right.
    """
    problem = Problem(found.candidate, unseen, offsets)
    normal = problem.log_determinant + unseen.change.shape[1] * np.log(2 * np.pi)
    scatter, lowest, place = np.array(found.scatter), np.full(len(unseen), np.inf), deviations
    for shift in _SHIFTS:
        trial = problem.solve(problem.theta0, scatter, deviations + shift, steps=0)
        here = _of_whole_bolts(trial.by_case, unseen)
        place = np.where(here < lowest, trial.u, place)
        lowest = np.fmin(lowest, here)
    state = problem.solve(problem.theta0, scatter, place, steps=12)
    again = -0.5 * (np.fmin(lowest, _of_whole_bolts(state.by_case, unseen)) + normal)
    plain = log_predictive(found, unseen, offsets)
    return np.asarray(np.fmax(_of_whole_bolts(plain + 0.5 * normal, unseen) - 0.5 * normal, again))


def _of_whole_bolts(values: FloatArray, frozen: FrozenMotion) -> FloatArray:
    """Values by case, of several bolts each the mean over its bolt: tests of one bolt have one density."""
    return values if frozen.bolts is None else frozen.bolts.divided(frozen.bolts.sums(values))


def refit(fitted: Fit, part: FrozenMotion, index: Index) -> Fit:
    """Fit again to the cases ``index``, from the full fit and with its offsets; where lost, the full fit.

    Parameters
    ----------
    fitted : Fit
        To all cases.
    part : FrozenMotion
        Some of these cases.
    index : ndarray, shape (cases of the part,)
        Their places among all.

    Returns
    -------
    Fit
        Of the part.
    """
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

    Parameters
    ----------
    fitted : Fit
        The law.
    frozen : FrozenMotion
        The cases that it was fitted to.
    groups : ndarray, shape (cases,)
        Number of every case's preload.
    rng : numpy.random.Generator
        Source of the draws of preloads.
    spread : float
        c-hat, as from `dispersion`.

    Returns
    -------
    dict of str to (float, float)
        Lower and upper limit by name, in the parameter's unit.
    """
    if not fitted.free:
        return {}
    problem, state = at_fit(fitted, frozen)
    rules, count = frozen.criteria.ranking, int(groups.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), int(rules.resamples))
    steps = problem.resampled(state, drawn[:, groups].astype(float))
    low, high = np.quantile(steps, tails(rules), axis=0)
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
    residual = frozen.change - (predict(fitted.candidate, frozen, fitted.deviations) + fitted.offsets)
    whitener = np.linalg.inv(np.linalg.cholesky(frozen.covariance))
    square = float((np.einsum("cij,cj->ci", whitener, residual) ** 2).sum())
    cases, bins = residual.shape
    freedom = max(cases * (bins - _NUISANCE) - len(fitted.free), 1)
    return max(1.0, square / float(freedom))


def information_criterion(fitted: Fit, frozen: FrozenMotion, spread: float = 1.0) -> float:
    """``deviance / c-hat + free numbers ln n``; n counts means of bins, not cases: the stricter choice.

    Parameters
    ----------
    fitted : Fit
        The law.
    frozen : FrozenMotion
        The cases that it was fitted to.
    spread : float
        c-hat, as from `dispersion`.

    Returns
    -------
    float
        BIC of quasi-likelihood; lower is better.
    """
    return fitted.deviance / spread + len(fitted.free) * float(np.log(means_of_bins(frozen)))


def means_of_bins(frozen: FrozenMotion) -> int:
    """Return how many data there are: means of bins, less what every case has of its own."""
    cases, bins = frozen.change.shape
    return int(cases * (bins - _NUISANCE))


def evidence(fitted: Fit, frozen: FrozenMotion, spread: float = 1.0) -> FloatArray:
    """Share of every case in ``-BIC / 2``, up to a constant: likelihood over c-hat, less numbers' price.

    Parameters
    ----------
    fitted : Fit
        The law.
    frozen : FrozenMotion
        The cases that it was fitted to.
    spread : float
        c-hat, as from `dispersion`.

    Returns
    -------
    ndarray, shape (cases,)
        Higher is better.
    """
    _, state = at_fit(fitted, frozen)
    deviance = np.where(np.isfinite(state.by_case), state.by_case, 1e12)
    price = len(fitted.free) * np.log(means_of_bins(frozen)) / len(frozen)
    return np.asarray(-0.5 * (deviance / spread + price))
