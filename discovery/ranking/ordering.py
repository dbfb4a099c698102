"""Laws in order by their scores, and how surely one is ahead: differences from preload to preload.

Cases of one preload share what is special about it, so chance is judged over preloads, not over cases.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import stats

from discovery.criteria.criteria import CRITERIA
from discovery.criteria.ranking import RankingRules
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

Index = npt.NDArray[np.int64]

_EXHAUSTIVE: Numerical[int] = 16  # groups up to which every flip of signs is tried


def bounded_difference(
    scores: FloatArray, other: FloatArray, rules: RankingRules = CRITERIA.ranking
) -> FloatArray:
    """Difference of scores, (..., cases), bounded on both sides: no single record decides.

    Parameters
    ----------
    scores, other : ndarray, shape (..., cases)
        Log scores of two laws.
    rules : RankingRules
        The bound.

    Returns
    -------
    ndarray, shape (..., cases)
        Positive where the first law is better.
    """
    return np.asarray(np.clip(scores - other, -rules.record_bound, rules.record_bound))


def by_group(values: FloatArray, groups: Index) -> FloatArray:
    """Sums over the cases of each group: (..., cases) to (..., groups)."""
    return np.stack([values[..., groups == g].sum(axis=-1) for g in np.unique(groups)], axis=-1)


def paired(
    scores: FloatArray, other: FloatArray, groups: Index, rules: RankingRules = CRITERIA.ranking
) -> tuple[float, float]:
    """Bounded advantage of one law over another, summed over preloads, and its standard error.

    The error is infinite where all cases have one preload.

    Parameters
    ----------
    scores, other : ndarray, shape (cases,)
        Log scores of two laws.
    groups : ndarray, shape (cases,)
        Number of every case's preload.
    rules : RankingRules
        The bound of a record.

    Returns
    -------
    advantage, error : float
        In units of the log score.
    """
    sums = by_group(bounded_difference(scores, other, rules), groups)
    error = np.sqrt(len(sums)) * sums.std(ddof=1) if len(sums) > 1 else np.inf
    return float(sums.sum()), float(error)


def tails(rules: RankingRules) -> tuple[float, float]:
    """Probabilities of the two ends of a confidence interval."""
    tail = (1.0 - rules.confidence) / 2
    return tail, 1.0 - tail


def beyond_chance(groups: int, rules: RankingRules = CRITERIA.ranking) -> float:
    """Standard errors within which chance keeps a mean over groups, by Student's t."""
    return float(stats.t.ppf(tails(rules)[1], max(groups - 1, 1)))


def order(
    scores: FloatArray,
    evidence: FloatArray,
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

    Parameters
    ----------
    scores : ndarray, shape (laws, cases)
        Log scores of cross-validation.
    evidence : ndarray, shape (laws, cases)
        Evidence.
    complexity : sequence of (int, int)
        A law's count of free numbers and the length of its equation.
    groups : ndarray, shape (cases,)
        Number of every case's preload.
    rules : RankingRules
        Bound of a record, odds, confidence.

    Returns
    -------
    list of int
        Places of the laws, the first law's first.
    """
    return _ordered(*_compared(scores, evidence, groups, rules), np.asarray(complexity), rules)


def _compared(
    scores: FloatArray, evidence: FloatArray, groups: Index, rules: RankingRules
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sums by preload of scores, and of bounded differences of any two laws: (laws, laws, groups), twice."""
    pairs = [
        by_group(bounded_difference(each[:, None], each[None, :], rules), groups)
        for each in (scores, evidence)
    ]
    return by_group(scores, groups), pairs[0], pairs[1]


def _ordered(
    sums: FloatArray,
    pairs: FloatArray,
    evidence: FloatArray,
    complexity: npt.NDArray[np.int64],
    rules: RankingRules,
) -> list[int]:
    totals = sums.sum(axis=1)  # they only part laws that are as far behind, at the bound on every record
    leads = pairs.sum(axis=-1)
    best = max(range(len(totals)), key=lambda k: (leads[k].min(), totals[k]))
    lead, behind = leads[best], evidence[best].sum(axis=-1)
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
    evidence: FloatArray,
    complexity: Sequence[tuple[int, int]],
    groups: Index,
    rng: np.random.Generator,
    rules: RankingRules = CRITERIA.ranking,
) -> FloatArray:
    """How often each law comes first when preloads are drawn again with replacement, (laws,).

    Parameters
    ----------
    scores, evidence, complexity, groups
        As for `order`.
    rng : numpy.random.Generator
        Source of the draws.
    rules : RankingRules
        Draws, and what `order` takes.

    Returns
    -------
    ndarray, shape (laws,)
        Shares of the draws.
    """
    sums, pairs, prices = _compared(scores, evidence, groups, rules)
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

    Parameters
    ----------
    scores : ndarray, shape (laws, cases)
        Log scores of cross-validation.
    baseline : ndarray, shape (cases,)
        Those of the baseline.
    groups : ndarray, shape (cases,)
        Number of every case's preload.
    rng : numpy.random.Generator
        Source of the signs, where preloads are too many for all to be tried.
    rules : RankingRules
        The bound of a record.

    Returns
    -------
    ndarray, shape (laws,)
        1 for a law that is not ahead.
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
