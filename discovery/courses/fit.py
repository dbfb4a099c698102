"""Fitting a candidate law to the tension courses of many tests at once, case-to-case scatter included.

One bolt loosens faster than the next at the same preload and hit: every case has its own factor exp(u) on the
rate, a random effect, and no law earns credit for following it. Courses are solved along frozen exposures;
``refine`` adds the difference to full re-simulation, and fits again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discovery.courses.between_bolts import Index
from discovery.courses.fitted import Fit, Uncertainty
from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.likelihood_steps import climbed
from discovery.courses.marginal_likelihood import Problem, State
from discovery.courses.prediction import predict, resimulate
from discovery.laws.candidate import Candidate
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

__all__ = ["Fit", "fit", "fit_losses", "log_predictive", "predict", "refine", "resimulate"]

_ITERATIONS: Numerical[int] = 30
_RESTRICTED: Numerical[int] = 5  # steps from the likelihood's place to that of the restricted one
_SETTLED: Numerical[float] = 0.01  # of the deviance
ROUNDS: Numerical[int] = 3  # of correction by re-simulation
_SAME_NOISE: Numerical[float] = 0.05
_SAME_CHANGE: Numerical[float] = 1e-4  # of corrections: far below what can be told


def refine(candidate: Candidate, frozen: FrozenMotion, rounds: int = ROUNDS) -> Fit:
    """Fit, re-simulate in full, correct the frozen courses by the difference, and fit again.

    Until the corrections stay the same, to a small part of the noise.

    Parameters
    ----------
    candidate : Candidate
        Its numbers are the start.
    frozen : FrozenMotion
        Motion and measured courses.
    rounds : int
        Corrections at most.

    Returns
    -------
    Fit
        Not converged where a re-simulation diverged.
    """
    found = fit(candidate, frozen)
    for _ in range(0 if candidate.holds else rounds):
        offsets = correction(found, frozen)
        if not np.isfinite(offsets).all():
            found = replace(found, converged=False)
            break
        if unchanged(offsets, found, frozen):
            break
        found = fit(found.candidate, frozen, offsets, found)
    return with_uncertainty(found, frozen)


def at_fit(found: Fit, frozen: FrozenMotion) -> tuple[Problem, State]:
    """The likelihood of the cases of a fit, and its state there."""
    problem = Problem(found.candidate, frozen, found.offsets)
    return problem, problem.solve(problem.theta0, np.array(found.scatter), found.deviations, steps=12)


def correction(found: Fit, frozen: FrozenMotion) -> FloatArray:
    """Full re-simulation minus frozen course, (cases, bins) [N]; not finite where it diverged."""
    full = resimulate(found.candidate, frozen, found.deviations)
    return full - predict(found.candidate, frozen, found.deviations)


def unchanged(offsets: FloatArray, found: Fit, frozen: FrozenMotion) -> bool:
    """Whether corrections are those of a fit, to a small part of the noise or of the change.

    Parameters
    ----------
    offsets : ndarray, shape (cases, bins)
        Corrections to the frozen courses [N].
    found : Fit
        With the corrections that it was made with.
    frozen : FrozenMotion
        Motion and measured courses.

    Returns
    -------
    bool
        True if they are the same.
    """
    noise = np.sqrt(np.stack([np.diag(c.covariance)[-frozen.change.shape[1] :] for c in frozen.courses]))
    change = predict(found.candidate, frozen, found.deviations) + found.offsets
    near = _SAME_NOISE * noise + _SAME_CHANGE * np.abs(change)
    return bool((np.abs(offsets - found.offsets) <= near).all())


def fit(
    candidate: Candidate, frozen: FrozenMotion, offsets: FloatArray | None = None, start: Fit | None = None
) -> Fit:
    """Fit the free numbers of a candidate by marginal maximum likelihood along the frozen motion.

    Parameters
    ----------
    candidate : Candidate
        Its numbers are the start; coefficients of known sign are first scaled to the measured losses.
    frozen : FrozenMotion
        Motion and measured courses.
    offsets : ndarray, shape (cases, bins)
        ModelCorrection to every predicted course [N].
    start : Fit
        Scatter and deviations to start from, of the same cases.

    Returns
    -------
    Fit
        Its uncertainty is found by `with_uncertainty`.
    """
    problem = Problem(candidate, frozen, np.zeros_like(frozen.change) if offsets is None else offsets)
    state = problem.first(start)
    state, converged = climbed(problem, state, _SETTLED, 1 if candidate.holds else _ITERATIONS)
    return _fit_at(problem, state, problem.at(state.theta), converged or candidate.holds)


def with_uncertainty(found: Fit, frozen: FrozenMotion) -> Fit:
    """The fit with the covariance of its numbers and the variability between tests."""
    part, offsets = (frozen.last_bin(), found.offsets[:, -1:]) if found.of_losses else (frozen, found.offsets)
    problem = Problem(found.candidate, part, offsets)
    state = problem.solve(problem.theta0, np.array(found.scatter), found.deviations, steps=0)
    return replace(found, uncertainty=_uncertainty_at(problem, state))


def known_fit(problem: Problem, state: State, candidate: Candidate) -> Fit:
    """Return the fit that ends at a place, with its uncertainty.

    Parameters
    ----------
    problem : Problem
        The fit.
    state : State
        The place.
    candidate : Candidate
        The law there.
    """
    found = _fit_at(problem, state, candidate, converged=True)
    return replace(found, uncertainty=_uncertainty_at(problem, state))


def _fit_at(problem: Problem, state: State, candidate: Candidate, converged: bool) -> Fit:
    return Fit(
        candidate, candidate.free, state.deviance, tuple(state.scatter.tolist()), problem.offsets, state.u,
        converged, criteria=problem.frozen.criteria,
    )  # fmt: skip


def _uncertainty_at(problem: Problem, state: State) -> Uncertainty:
    """Covariance and variability by the restricted likelihood."""
    restricted, _ = climbed(problem, state, _SETTLED, _RESTRICTED, restricted=True)
    a, b = restricted.scatter[:2].tolist()
    return Uncertainty(problem.covariance(restricted), (a, b))


def fit_losses(candidate: Candidate, frozen: FrozenMotion, offsets: FloatArray | None = None) -> Fit:
    """Fit to the changes in the last bin alone, as He et al. (2025), Section 3.5, to final tensions.

    For a law whose courses are not those measured: the shape of the courses, which it cannot follow, would
    otherwise decide its numbers, at the cost of the losses. The deviance is still that of the courses.
    Its uncertainty is found by `with_uncertainty`.

    Parameters
    ----------
    candidate : Candidate
        Its numbers are the start.
    frozen : FrozenMotion
        Motion and measured courses.
    offsets : ndarray, shape (cases, bins), optional
        Corrections to every predicted course [N]; zero if not given.

    Returns
    -------
    Fit
        With ``of_losses``.
    """
    whole = Problem(candidate, frozen, np.zeros_like(frozen.change) if offsets is None else offsets)
    found = fit(candidate, frozen.last_bin(), whole.offsets[:, -1:])
    after = Problem(found.candidate, frozen, whole.offsets)
    state = after.solve(after.theta0, np.array(found.scatter), found.deviations, steps=12)
    return replace(found, deviance=state.deviance, offsets=whole.offsets, of_losses=True)


def within_bolts(found: Fit, frozen: FrozenMotion) -> FloatArray:
    """Deviation of every case less what its bolt's tests share, at the mode, (cases,)."""
    if frozen.bolts is None:
        return found.deviations
    b = frozen.bolts.modes(found.deviations, found.tau(frozen.initial) ** 2, found.sigma**2)
    return np.asarray(found.deviations - b[frozen.bolts.index])


def by_other_tests(found: Fit, frozen: FrozenMotion, offsets: FloatArray) -> FloatArray:
    """Deviation of every case's bolt as its other tests tell it, linear about the modes, (cases,).

    Parameters
    ----------
    found : Fit
        Of several bolts; these need not be among them.
    frozen : FrozenMotion
        Motion and measured courses of the cases.
    offsets : ndarray, shape (cases, bins)
        Corrections to every predicted course [N].
    """
    problem = Problem(found.candidate, frozen, offsets)
    state = problem.solve(problem.theta0, np.array(found.scatter), np.zeros(len(frozen)), steps=12)
    told, seen = told_of_bolts(state, found.tau(frozen.initial))
    bolts = frozen.bolts
    if bolts is None:
        raise ValueError("found the tests of one bolt, expected those of several")
    others, by_others = (bolts.sums(part)[bolts.index] - part for part in (told, seen))
    return np.asarray(by_others / (1 / found.sigma**2 + others))


def told_of_bolts(state: State, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information of every test on its bolt's deviation, and that times what it says of it, (cases,) each."""
    information = (state.slope**2).sum(axis=1)
    seen = (state.slope * state.residual).sum(axis=1) + information * state.u
    spread = 1 + tau**2 * information
    return information / spread, seen / spread


def deviation_of_bolt(found: Fit, state: State, initial: FloatArray, cases: Index) -> tuple[float, float]:
    """Deviation of the bolt that some cases are of: its prior from the population, and what they say.

    Parameters
    ----------
    found : Fit
        Fitted to several bolts.
    state : State
        At the fit.
    initial : ndarray, shape (all cases,)
        Tensions before the hits [N].
    cases : ndarray of int
        Places of the bolt's cases.

    Returns
    -------
    tuple of float
        Deviation of ln rate, and its standard deviation.
    """
    told, seen = (part[cases].sum() for part in told_of_bolts(state, found.tau(initial)))
    variance = 1 / (1 / found.sigma**2 + told)
    return float(variance * seen), float(np.sqrt(variance))


def log_predictive(fitted: Fit, frozen: FrozenMotion, offsets: FloatArray | None = None) -> FloatArray:
    """Log marginal density of the courses of each case under a fitted law, (cases,): also of unseen cases.

    Parameters
    ----------
    fitted : Fit
        The law, and its scatter from test to test.
    frozen : FrozenMotion
        Motion and measured courses of the cases.
    offsets : ndarray, shape (cases, bins), optional
        Corrections to every predicted course [N]; zero if not given.

    Returns
    -------
    ndarray, shape (cases,)
        Natural logarithm of the density.
    """
    problem = Problem(fitted.candidate, frozen, np.zeros_like(frozen.change) if offsets is None else offsets)
    state = problem.solve(problem.theta0, np.array(fitted.scatter), np.zeros(len(frozen)), steps=12)
    normal = problem.log_determinant + frozen.change.shape[1] * np.log(2 * np.pi)
    return np.asarray(-0.5 * (state.by_case + normal))
