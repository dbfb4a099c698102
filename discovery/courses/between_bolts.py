"""Between-bolt deviation: what all tests of one bolt share of their deviations from a law, integrated out.

    u_i = b_g(i) + w_i,   b_g ~ N(0, sigma^2) from bolt to bolt,   w_i ~ N(0, tau_i^2) from test to test

Linear about the modes of u, test i tells u_i with information h_i. What it tells of its bolt, w_i integrated
out, is ``p_i = h_i / (1 + tau_i^2 h_i)``. With few bolts the maximum of the likelihood makes sigma too small,
since the law's typical rate is fitted to the same bolts: standard deviations are those of the restricted
likelihood, that rate integrated out as well (H. Patterson and R. Thompson, Biometrika 58, 545, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize

from discovery.courses.variability import log_limits, log_tension, of_logs
from discovery.criteria.courses import Courses
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

Index = npt.NDArray[np.int64]

_CLOSE: Numerical[float] = 0.005  # of a logarithm


@dataclass(frozen=True, eq=False)
class Bolts:
    """Which bolt every test is of, and the part of the likelihood that its tests share.

    Attributes
    ----------
    index : ndarray, shape (cases,)
        Number of the bolt, from zero.
    """

    index: Index

    @property
    def count(self) -> int:
        """Number of bolts."""
        return int(self.index.max()) + 1

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums over the tests of each bolt: (cases, ...) to (bolts, ...)."""
        found = np.zeros((self.count, *values.shape[1:]))
        np.add.at(found, self.index, values)
        return found

    def divided(self, values: FloatArray) -> FloatArray:
        """What is a bolt's, in equal parts to its tests: (bolts, ...) to (cases, ...)."""
        size = np.bincount(self.index)
        return np.asarray((values / size.reshape(-1, *[1] * (values.ndim - 1)))[self.index])

    def modes(self, u: FloatArray, tau2: FloatArray, sigma2: float) -> FloatArray:
        """b of every bolt at its mode for deviations u, (bolts,).

        Parameters
        ----------
        u, tau2 : ndarray, shape (cases,)
            Deviations of the log rate, and the variance between tests.
        sigma2 : float
            The variance between bolts.
        """
        return self.sums(u / tau2) / (1 / sigma2 + self.sums(1 / tau2))

    def newton(
        self, gradient: FloatArray, information: FloatArray, tau2: FloatArray, sigma2: float
    ) -> FloatArray:
        """Newton's step of u, (cases,), the prior's ``1 / tau^2`` and the bond within bolts in its matrix.

        Parameters
        ----------
        gradient, information, tau2 : ndarray, shape (cases,)
            Slope of the log density in u, information of the data on u, variance between tests.
        sigma2 : float
            The variance between bolts.
        """
        own = information + 1 / tau2
        alone = gradient / own
        told = 1 / sigma2 + self.sums(information / (1 + tau2 * information))
        return np.asarray(alone + (self.sums(alone / tau2) / told)[self.index] / (tau2 * own))

    def deviance(self, b: FloatArray, information: FloatArray, tau2: FloatArray, sigma2: float) -> FloatArray:
        """What b adds to -2 log marginal likelihood, in equal parts to the tests of a bolt, (cases,).

        Parameters
        ----------
        b : ndarray, shape (bolts,)
            At its modes.
        information, tau2 : ndarray, shape (cases,)
            Information of the data on u, variance between tests.
        sigma2 : float
            The variance between bolts.
        """
        told = self.sums(information / (1 + tau2 * information))
        return self.divided(b**2 / sigma2 + np.log1p(sigma2 * told))


@dataclass(frozen=True, eq=False)
class Variances:
    """The restricted likelihood of the standard deviations between bolts and between tests, linear in u.

    Attributes
    ----------
    bolts : Bolts
        Which bolt every test is of.
    information, seen : ndarray, shape (cases,)
        h, and what the data say of u times h.
    initial : ndarray, shape (cases,)
        Tension before the hit [N].
    rules : Courses
        Lowest and highest standard deviation, prior of b.
    """

    bolts: Bolts
    information: FloatArray
    seen: FloatArray
    initial: FloatArray
    rules: Courses

    def deviance(self, scatter: FloatArray) -> float:
        """-2 log restricted likelihood at (a, b, ln sigma), the prior of b with it."""
        low, high = log_limits(self.rules)
        tau2 = of_logs(scatter, log_tension(self.initial), low, high) ** 2
        sigma2 = float(np.exp(2 * np.clip(scatter[2], low, high)))
        spread = 1 + tau2 * self.information
        told, seen = self.bolts.sums(self.information / spread), self.bolts.sums(self.seen / spread)
        between = 1 + sigma2 * told
        within = np.log(spread) - tau2 / spread * self.seen**2
        across = np.log(between) - sigma2 / between * seen**2
        rate, pull = float((told / between).sum()), float((seen / between).sum())
        restricted = np.log(rate) - pull**2 / rate if rate > 0 else 0.0
        return float(within.sum() + across.sum() + restricted + (scatter[1] / self.rules.slope_prior) ** 2)

    def best(self, start: FloatArray, held: tuple[int, float] | None = None) -> FloatArray:
        """Find (a, b, ln sigma) of the highest restricted likelihood, one of them held if asked for.

        Parameters
        ----------
        start : ndarray, shape (3,)
            Where to begin.
        held : (int, float), optional
            Place and value of one that is held. One bolt alone holds ln sigma: it says nothing of it.
        """
        if held is None and self.bolts.count < 2:
            held = 2, float(start[2])
        place, value = held if held is not None else (3, 0.0)
        free = [k for k in range(3) if k != place]

        def full(part: FloatArray) -> FloatArray:
            scatter = np.full(3, value)
            scatter[free] = part
            return scatter

        def deviance(part: FloatArray) -> float:
            return self.deviance(full(part))

        found = optimize.minimize(
            deviance,
            start[free],
            method="Nelder-Mead",
            options={"xatol": 5e-3, "fatol": 5e-3, "maxiter": 240},
        )
        low, high = log_limits(self.rules)
        scatter = full(found.x)
        return np.array([np.clip(scatter[0], low, high), scatter[1], np.clip(scatter[2], low, high)])

    def limits(self, best: FloatArray, place: int, level: float) -> tuple[float, float]:
        """Ends of the profile of a standard deviation; 0 and infinity where it does not rise so far.

        Parameters
        ----------
        best : ndarray, shape (3,)
            As from `best`.
        place : int
            0 for that between tests at 100 N, 2 for that between bolts.
        level : float
            Rise of the restricted deviance at the ends.
        """
        ends, least = log_limits(self.rules), self.deviance(best)

        def rise(value: float) -> float:
            return self.deviance(self.best(best, (place, value))) - least - level

        found = []
        for end, open_end in zip(ends, (0.0, float("inf")), strict=True):
            crossed = abs(end - best[place]) > _CLOSE and rise(end) > 0
            at = float(optimize.brentq(rise, best[place], end, xtol=_CLOSE)) if crossed else None
            found.append(open_end if at is None else float(np.exp(at)))
        return found[0], found[1]
