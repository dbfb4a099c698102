"""A fitted candidate law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from discovery.courses.variability import sigma, tau
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.laws.candidate import Candidate
from rom.campaign.channels import FloatArray
from rom.model.rate_uncertainty import RateUncertainty


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How well the numbers of a fit are known, and how far a new test may be from it.

    Attributes
    ----------
    covariance : ndarray, shape (numbers, numbers)
        Of ln coefficients (of coefficients that may have either sign: as they are) and of inner parameters.
    between_tests : tuple of float
        a and b of ln tau by the restricted likelihood: how a new test differs.
    """

    covariance: FloatArray
    between_tests: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted candidate.

    Attributes
    ----------
    candidate : Candidate
        With its refined numbers.
    free : tuple of str
        What was fitted.
    deviance : float
        -2 log marginal likelihood of the cases fitted.
    scatter : tuple of float
        a and b of ln tau; of several bolts also ln sigma, sigma their standard deviation of the log rate.
        By it laws are compared.
    offsets : ndarray, shape (cases, bins)
        Full re-simulation minus frozen course [N].
    deviations : ndarray, shape (cases,)
        u at its mode.
    of_losses : bool
        Whether it was fitted to the losses alone, the courses left aside.
    criteria : Criteria
        Those of the fit.
    uncertainty : Uncertainty or None
        None where it was not looked for: it is half of the work of a fit.
    """

    candidate: Candidate
    free: tuple[str, ...]
    deviance: float
    scatter: tuple[float, ...]
    offsets: FloatArray
    deviations: FloatArray
    converged: bool
    of_losses: bool = False
    criteria: Criteria = CRITERIA
    uncertainty: Uncertainty | None = None

    @property
    def _known(self) -> Uncertainty:
        if self.uncertainty is None:
            raise ValueError("the fit has no uncertainty yet: take `discovery.courses.fit.with_uncertainty`")
        return self.uncertainty

    @property
    def covariance(self) -> FloatArray:
        """See `Uncertainty`; ValueError where it was not looked for."""
        return self._known.covariance

    @property
    def between_tests(self) -> tuple[float, float]:
        """See `Uncertainty`; ValueError where it was not looked for."""
        return self._known.between_tests

    def tau(self, initial: FloatArray) -> FloatArray:
        """Between-test standard deviation of the log rate at tensions [N], (cases,)."""
        return tau(np.array(self.scatter), initial, self.criteria.courses)

    @property
    def sigma(self) -> float:
        """Between-bolt standard deviation of the log rate; 0 where there is one bolt."""
        return sigma(np.array(self.scatter), self.criteria.courses)

    @property
    def rate_uncertainty(self) -> RateUncertainty:
        """How far the rate of one new test may be from the law's; covariance of the numbers as they are."""
        numbers, scales = self.candidate.parameters, self.candidate.coefficient_names
        values = [numbers[name].value if name in scales else 1.0 for name in self.free]
        factors = np.array([value if value > 0 else 1.0 for value in values])
        a, b = self.between_tests
        covariance = self.covariance * np.outer(factors, factors)
        tests = len(self.deviations) - len(self.free)
        return RateUncertainty.of(self.free, covariance, (float(np.exp(a)), b), tests, self.sigma)

    def limits(self, name: str) -> tuple[float, float]:
        """95 % limits of a fitted number."""
        half = self.criteria.chance.normal_quantile
        error = float(np.sqrt(max(self.covariance[self.free.index(name)][self.free.index(name)], 0.0)))
        value = self.candidate.parameters[name].value
        if name in self.candidate.coefficient_names and value > 0:
            return value * float(np.exp(-half * error)), value * float(np.exp(half * error))
        return value - half * error, value + half * error
