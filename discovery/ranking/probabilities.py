"""Probabilities of laws: shares of the evidence, in resamples of the tests to which all laws are refitted.

In every resample of the groups of tests (preloads; of several bolts, bolts) each law is fitted again by one
Gauss-Newton step at the variability of all tests, whose gain in deviance is that of a full refit to within a
quarter. The weight of a law is ``exp(-BIC / 2)`` of the resample over the sum of all, and its probability the
mean weight: the bagged posterior of J. Huggins and J. Miller, Bayesian Analysis 18, 79, 2023. Without
resamples it swings from one law to another with a single test where two are nearly as good.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discovery.courses.fit import Fit, at_fit
from discovery.courses.frozen_motion import FrozenMotion
from discovery.ranking.cross_validation import dispersion, means_of_bins
from discovery.ranking.ordering import Index
from rom.campaign.channels import FloatArray


def probabilities(
    fits: Sequence[Fit], frozen: FrozenMotion, groups: Index, rng: np.random.Generator
) -> FloatArray:
    """Probability of each law, (laws,), that it is the form that made these tests, were it one of them.

    Parameters
    ----------
    fits : sequence of Fit
        To all cases.
    frozen : FrozenMotion
        The cases.
    groups : ndarray, shape (cases,)
        Number of what every case shares its chance with.
    rng : numpy.random.Generator
        Source of the resamples.

    Returns
    -------
    ndarray, shape (laws,)
        Adding up to 1.
    """
    count, draws = int(groups.max()) + 1, int(frozen.criteria.ranking.resamples)
    drawn = rng.multinomial(count, np.full(count, 1 / count), draws)[:, groups].astype(float)
    spread = dispersion(min(fits, key=lambda found: found.deviance), frozen)
    price = np.log(means_of_bins(frozen))
    criteria = [resampled_deviance(found, frozen, drawn) / spread + len(found.free) * price for found in fits]
    logs = -0.5 * np.stack(criteria)
    weights = np.exp(logs - logs.max(axis=0))
    return np.asarray((weights / weights.sum(axis=0)).mean(axis=1))


def resampled_deviance(found: Fit, frozen: FrozenMotion, counts: FloatArray) -> FloatArray:
    """Deviance of a law refitted by one step to resamples in which cases count as often as given, (draws,).

    Numbers at a bound stay there, and so do those of a law that was fitted to the losses alone.

    Parameters
    ----------
    found : Fit
        To all cases.
    frozen : FrozenMotion
        The cases.
    counts : ndarray, shape (draws, cases)
        How often each counts.
    """
    problem, state = at_fit(found, frozen)
    deviance = counts @ np.where(np.isfinite(state.by_case), state.by_case, 1e12)
    low, high = problem.bounds
    inside = np.flatnonzero((state.theta > low) & (state.theta < high))
    if found.of_losses or not len(inside):
        return np.asarray(deviance)
    matrices, rights = problem.by_case(state)
    matrices, rights = matrices[:, inside][:, :, inside], rights[:, inside]
    scale = np.sqrt(np.maximum(np.diag(matrices.sum(axis=0)), 1e-300))
    left = np.einsum("dc,cpq->dpq", counts, matrices) / np.outer(scale, scale)
    right = counts @ rights / scale
    inverse = np.linalg.pinv(left, rcond=1e-8, hermitian=True)
    return np.asarray(deviance - np.einsum("dp,dpq,dq->d", right, inverse, right))
