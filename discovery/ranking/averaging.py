"""Predictions averaged over laws by their probabilities, each law's numbers and deviations integrated out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import special

from discovery.courses.fit import Fit
from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.marginal_likelihood import Problem
from discovery.laws.candidate import Candidate
from discovery.ranking.cross_validation import estimate
from discovery.ranking.ordering import tails
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.model import Model

_NEGLIGIBLE: Numerical[float] = 0.002  # probability of a law that is not simulated


@dataclass(frozen=True, eq=False)
class AveragedPrediction:
    """Final tensions of new tests, averaged over laws.

    Attributes
    ----------
    final_tension, low, high : ndarray, shape (cases,)
        Mean and 95 % limits for one new test [N]: law, its numbers, and the deviation of the test. The mean
        counts a law of 1 % whose tension is far off, the limits leave it out, so it may lie beyond them.
    median : ndarray, shape (cases,)
        Which no such law moves, and which never lies beyond the limits [N].
    by_law : mapping of str to ndarray, shape (cases,)
        Mean under each law that has a part in it [N].
    """

    final_tension: FloatArray
    low: FloatArray
    high: FloatArray
    by_law: Mapping[str, FloatArray]
    median: FloatArray


@dataclass(frozen=True, eq=False)
class Weighted:
    """A fitted law, its name and its probability."""

    name: str
    fit: Fit
    probability: float


@dataclass(frozen=True, eq=False)
class NewTests:
    """Hits of which the final tension is asked; as the arguments of `Model.final_tension`."""

    forces: FloatArray
    rate_hz: float
    initial: FloatArray
    window_s: tuple[float, float] | None
    body: str | None
    signed: bool = False

    @classmethod
    def of(
        cls,
        forces: npt.ArrayLike,
        rate_hz: float,
        initial_tension: npt.ArrayLike,
        window_s: tuple[float, float] | None,
        body: str | None,
        signed: bool = False,
    ) -> NewTests:
        """As `Model.final_tension` takes them.

        Parameters
        ----------
        forces, rate_hz, initial_tension, window_s, body
            As there.
        signed : bool
            Whether tests may tighten.
        """
        initial = np.atleast_1d(np.asarray(initial_tension, dtype=float))
        return cls(np.atleast_2d(np.asarray(forces, dtype=float)), rate_hz, initial, window_s, body, signed)


def predicted(
    laws: Sequence[Weighted], model: Model, tests: NewTests, draws: int, seed: int
) -> AveragedPrediction:
    """Average over laws the final tensions of new tests, by full simulation.

    Parameters
    ----------
    laws : sequence of Weighted
        Fitted laws with their probabilities.
    model : Model
        The identified model.
    tests : NewTests
        The hits.
    draws : int
        Of a law's numbers and of a test's deviation.
    seed : int
        Of the draws.
    """
    rng = np.random.default_rng(seed)
    there = [law for law in laws if law.probability > _NEGLIGIBLE]
    samples = np.stack([_drawn(law.fit, model, tests, draws, rng) for law in there])
    finite = np.isfinite(samples)
    weights = np.array([law.probability for law in there])[:, None, None] * finite
    weights = weights / weights.sum(axis=(0, 1))
    samples = np.where(finite, samples, 0.0)
    means = (samples * finite).sum(axis=1) / np.maximum(finite.sum(axis=1), 1)
    flat, share = samples.reshape(-1, len(tests.initial)), weights.reshape(-1, len(tests.initial))
    low, high = (_quantile(flat, share, tail) for tail in tails(laws[0].fit.criteria.ranking))
    by_law = {law.name: mean for law, mean in zip(there, means, strict=True)}
    return AveragedPrediction((flat * share).sum(axis=0), low, high, by_law, _quantile(flat, share, 0.5))


def _drawn(found: Fit, model: Model, tests: NewTests, draws: int, rng: np.random.Generator) -> FloatArray:
    """Final tensions under one law, its numbers and the tests' deviations drawn, (draws, cases)."""
    link, cases = model.structure.bolted_links[0], len(tests.initial)
    acting = model.with_tension_law(found.candidate.law(), link)
    spread = np.hypot(found.tau(tests.initial), found.sigma)
    out = np.empty((draws, cases))
    for row, candidate in enumerate(drawn_laws(found, draws, rng)):
        numbers = {name: np.full(cases, p.value) for name, p in candidate.parameters.items()}
        u = spread * rng.standard_normal(cases)
        numbers |= candidate.rated(1.0 + u if tests.signed else np.exp(u))
        vary = {f"{link}.tension_rate.{name}": values for name, values in numbers.items()}
        out[row] = acting.final_tension(
            tests.forces, tests.rate_hz, tests.initial, vary, tests.window_s, tests.body
        )
    return out


def drawn_laws(found: Fit, draws: int, rng: np.random.Generator) -> list[Candidate]:
    """The law with its free numbers drawn from their normal distribution, inner ones within their ranges.

    Parameters
    ----------
    found : Fit
        The law.
    draws : int
        How many.
    rng : numpy.random.Generator
        Source of the draws.
    """
    if not found.free:
        return [found.candidate] * draws
    values, ranges = found.candidate.parameters, []
    for name in found.free:
        logarithmic = name in found.candidate.coefficient_names and values[name].value > 0
        ranges.append((logarithmic, values[name].bounds))
    vectors = rng.multivariate_normal(estimate(found), found.covariance, draws, check_valid="ignore")
    laws = []
    for vector in vectors:
        numbers = {
            name: float(np.exp(np.clip(x, -690, 690))) if logarithmic else float(np.clip(x, *bounds))
            for name, x, (logarithmic, bounds) in zip(found.free, vector, ranges, strict=True)
        }
        laws.append(found.candidate.with_values(numbers))
    return laws


def _quantile(values: FloatArray, share: FloatArray, tail: float) -> FloatArray:
    """Weighted quantile of every column."""
    order = np.argsort(values, axis=0)
    total = np.cumsum(np.take_along_axis(share, order, axis=0), axis=0)
    place = np.minimum((total < tail).sum(axis=0), len(values) - 1)
    return np.asarray(np.take_along_axis(np.take_along_axis(values, order, axis=0), place[None], axis=0)[0])


def log_densities(found: Fit, frozen: FrozenMotion) -> FloatArray:
    """Log predictive density of the courses of unseen tests, deviations and the law's numbers integrated out.

    As `log_predictive`, the law made linear in its numbers about the fit, which are normal with the fit's
    covariance.

    Parameters
    ----------
    found : Fit
        The law.
    frozen : FrozenMotion
        Motion and measured courses of the tests.

    Returns
    -------
    ndarray, shape (cases,)
        Natural logarithm of the density.
    """
    problem = Problem(found.candidate, frozen, np.zeros_like(frozen.change))
    state = problem.solve(problem.theta0, np.array(found.scatter), np.zeros(len(frozen)), steps=12)
    deviance = state.by_case + problem.log_determinant + frozen.change.shape[1] * np.log(2 * np.pi)
    if found.free:
        deviance += problem.of_uncertain_numbers(state, found.covariance)
    return np.asarray(-0.5 * deviance)


def averaged_log_density(laws: Sequence[Weighted], frozen: FrozenMotion) -> FloatArray:
    """Log density of unseen tests, (cases,), under the average of laws by their probabilities."""
    parts = np.stack([log_densities(law.fit, frozen) for law in laws])
    weights = np.array([law.probability for law in laws])
    return np.asarray(special.logsumexp(parts, axis=0, b=weights[:, None]))
