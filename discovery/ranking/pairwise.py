"""Laws pair by pair: which of two the courses support, and which they do not tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from discovery.courses.fit import Fit, log_predictive, predict, within_bolts
from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.criteria import CRITERIA
from discovery.ranking.cross_validation import groups_of
from discovery.ranking.ordering import Index, beyond_chance, paired
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_STEP: Numerical[float] = 1e-4  # of ln rate


@dataclass(frozen=True)
class Pair:
    """Two laws, and whether the campaign tells them apart.

    Attributes
    ----------
    first, second : str
        Names; the first has the better score.
    score_difference, standard_error : float
        Sum over the cases of the differences of log scores, each cut as in the ranking so that no record
        decides, and its standard error, paired and from preload to preload.
    separation : float
        Expected log likelihood ratio of the two over all cases, if one of them were true: what the difference
        of their predicted courses amounts to beside noise and scatter of the rate.
    told_apart : bool
        Whether the difference is beyond chance, and both difference and separation reach `least`.
    least : float
        Log likelihood ratio that tells two laws apart.
    """

    first: str
    second: str
    score_difference: float
    standard_error: float
    separation: float
    told_apart: bool
    least: float = CRITERIA.ranking.log_odds

    @property
    def summary(self) -> str:
        """The result in one sentence."""
        score = f"log score {self.score_difference:+.1f} +- {self.standard_error:.1f}"
        if self.told_apart:
            return f"{self.first!r} is better than {self.second!r} ({score})"
        why = (
            "their predicted courses differ by less than noise and between-test variability"
            if self.separation < self.least
            else "the courses do not decide"
        )
        return f"{self.first!r} and {self.second!r} are not distinguished: {why} ({score})"


def compare_laws(
    fits: Sequence[Fit], frozen: FrozenMotion, scores: Mapping[str, FloatArray] | None = None
) -> tuple[Pair, ...]:
    """Compare laws pair by pair.

    Parameters
    ----------
    fits : sequence of Fit
        Fitted to the cases of ``frozen``, with different names.
    frozen : FrozenMotion
        Motion and measured courses.
    scores : mapping of str to ndarray, shape (cases,)
        Log scores of every case by law, cross-validated. Not given: log marginal likelihoods of the fits
        themselves, less half the logarithm of the number of cases for every free number.
    """
    own = {
        found.candidate.name: log_predictive(found, frozen, found.offsets)
        - 0.5 * np.log(len(frozen)) * len(found.free) / len(frozen)
        for found in fits
        if scores is None or found.candidate.name not in scores
    }
    known = {**own, **(scores or {})}
    groups = groups_of(frozen)
    return tuple(_pair(a, b, frozen, known, groups) for a, b in combinations(fits, 2))


def not_told_apart(pairs: Sequence[Pair], name: str) -> tuple[str, ...]:
    """Names of the laws that the campaign does not tell from this one."""
    return tuple(
        pair.second if pair.first == name else pair.first
        for pair in pairs
        if name in (pair.first, pair.second) and not pair.told_apart
    )


def _pair(a: Fit, b: Fit, frozen: FrozenMotion, scores: Mapping[str, FloatArray], groups: Index) -> Pair:
    rules = frozen.criteria.ranking
    total, error = paired(scores[a.candidate.name], scores[b.candidate.name], groups, rules)
    if total < 0:
        a, b, total = b, a, -total
    chance = beyond_chance(int(groups.max()) + 1, rules) * error
    apart = separation(a, b, frozen)
    clear = total > max(chance, rules.log_odds) and apart > rules.log_odds
    return Pair(a.candidate.name, b.candidate.name, total, error, apart, clear, rules.log_odds)


def separation(a: Fit, b: Fit, frozen: FrozenMotion) -> float:
    """Expected log likelihood ratio of two fitted laws over all cases, if the one or the other were true.

    The smaller of both ways, of normal courses whose covariance holds noise and scatter of the rate.

    Parameters
    ----------
    a, b : Fit
        Fitted to the cases of ``frozen``.
    frozen : FrozenMotion
        Motion and measured courses.

    Returns
    -------
    float
        Natural logarithm of the ratio.
    """
    (mean_a, cov_a), (mean_b, cov_b) = (_marginal(found, frozen) for found in (a, b))
    return min(_divergence(mean_a, cov_a, mean_b, cov_b), _divergence(mean_b, cov_b, mean_a, cov_a))


def _marginal(found: Fit, frozen: FrozenMotion) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the courses, linear in the deviations about their modes, bolts about theirs."""
    here = predict(found.candidate, frozen, found.deviations) + found.offsets
    ahead = predict(found.candidate, frozen, found.deviations + _STEP) + found.offsets
    slope = (ahead - here) / _STEP
    spread = found.tau(frozen.initial)[:, None] * slope
    return here - slope * within_bolts(found, frozen)[:, None], frozen.covariance + np.einsum(
        "ci,cj->cij", spread, spread
    )


def _divergence(mean: FloatArray, cov: FloatArray, other: FloatArray, other_cov: FloatArray) -> float:
    """Kullback-Leibler divergence of normal distributions, summed over the cases."""
    difference = (mean - other)[..., None]
    square = (difference * np.linalg.solve(other_cov, difference)).sum()
    trace = np.trace(np.linalg.solve(other_cov, cov), axis1=1, axis2=2).sum() - mean.size
    logs = (np.linalg.slogdet(other_cov)[1] - np.linalg.slogdet(cov)[1]).sum()
    return float(0.5 * (square + trace + logs))
