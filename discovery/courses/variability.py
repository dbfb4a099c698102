"""Between-test variability: how the rate of loosening differs from one test to the next.

ln tau = a + b ln(T / 100 N),   u ~ N(0, tau^2) the deviation of the log rate

A law's numbers follow some of the deviations. What is left of them makes tau too small, by half where ten
tests tell three numbers; the restricted likelihood allows for that (H. D. Patterson and R. Thompson,
Biometrika 58, 545, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from discovery.criteria.courses import Courses
from discovery.laws.factors import usual_unit
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_LEAST_N: Numerical[float] = 1e-3  # a bolt without tension, or with next to none
_LEAST_SHARE: Numerical[float] = 1e-5  # of the largest tension: the same of a small bolt
_TINY_N: Numerical[float] = 1e-100
_RIDGE: Numerical[float] = 1e-10  # of a matrix whose diagonal is 1: numbers that nothing tells cost nothing


def tau(scatter: FloatArray, initial: FloatArray, rules: Courses) -> FloatArray:
    """Between-test standard deviation of the log rate at tensions [N], (cases,).

    Parameters
    ----------
    scatter : ndarray, shape (2,)
        a and b of ``ln tau = a + b ln(T / 100 N)``.
    initial : ndarray, shape (cases,)
        Tensions [N].
    rules : Courses
        Lowest and highest standard deviation.
    """
    return of_logs(scatter, log_tension(initial), *log_limits(rules))


def sigma(scatter: FloatArray, rules: Courses) -> float:
    """Between-bolt standard deviation of the log rate; 0 where there is one bolt."""
    return float(np.exp(np.clip(scatter[2], *log_limits(rules)))) if len(scatter) > 2 else 0.0


def log_limits(rules: Courses) -> tuple[float, float]:
    """Logarithms of the lowest and the highest standard deviation."""
    return float(np.log(rules.least_variability)), float(np.log(rules.largest_variability))


def log_tension(initial: FloatArray) -> FloatArray:
    """``ln(T / 100 N)``, (cases,)."""
    least = min(_LEAST_N, _LEAST_SHARE * float(np.max(initial, initial=0.0)))
    return np.asarray(np.log(np.maximum(initial, max(least, _TINY_N)) / 100.0))


def of_logs(scatter: FloatArray, logs: FloatArray, low: float, high: float) -> FloatArray:
    """The same as `tau` from ``ln(T / 100 N)`` and the logarithms of the limits.

    Parameters
    ----------
    scatter : ndarray, shape (2,)
        a and b of ``ln tau = a + b ln(T / 100 N)``.
    logs : ndarray, shape (cases,)
        ``ln(T / 100 N)``.
    low, high : float
        Lowest and highest ln tau.

    Returns
    -------
    ndarray, shape (cases,)
        tau.
    """
    logs = scatter[0] + scatter[1] * logs
    return np.asarray(np.exp(np.minimum(np.maximum(logs, low), high)))


@dataclass(frozen=True, eq=False)
class BetweenTests:
    """The likelihood of a and b, linear in u and in the law's numbers: restricted where these are given.

    Attributes
    ----------
    initial : ndarray, shape (cases,)
        Tension before the hit [N].
    information, seen : ndarray, shape (cases,)
        Information h of the data on u, and what they say of u times h.
    cross : ndarray, shape (cases, numbers)
        Information that the law's numbers share with u; without columns for the likelihood itself.
    numbers : ndarray, shape (numbers, numbers)
        Information of the data on the law's numbers, u known.
    rules : Courses
        Lowest and highest standard deviation, prior of b.
    """

    initial: FloatArray
    information: FloatArray
    seen: FloatArray
    cross: FloatArray
    numbers: FloatArray
    rules: Courses

    def best(self, start: FloatArray) -> FloatArray:
        """Find (a, b) of the highest likelihood, the prior of b with it.

        It is sought at the tension of these tests: a at 100 N is far away for a bolt of 100 kN.
        """
        middle = float(np.log(usual_unit(float(np.median(self.initial)))))
        logs, square = log_tension(self.initial) - middle, self.seen**2
        low, high = log_limits(self.rules)
        scale = np.sqrt(np.maximum(np.diag(self.numbers), np.finfo(float).tiny))
        numbers, cross = self.numbers / np.outer(scale, scale), self.cross / scale
        numbers = numbers + _RIDGE * np.eye(len(scale))

        def deviance(scatter: FloatArray) -> float:
            tau2 = of_logs(scatter, logs, low, high) ** 2
            spread = 1 + tau2 * self.information
            share = tau2 / spread
            of_numbers = np.linalg.slogdet(numbers - (cross.T * share) @ cross)[1] if len(scale) else 0.0
            likelihood = (np.log(spread) - share * square).sum() + of_numbers
            return float(likelihood + (scatter[1] / self.rules.slope_prior) ** 2)

        found = optimize.minimize(
            deviance,
            [start[0] + start[1] * middle, start[1]],
            method="Nelder-Mead",
            options={"xatol": 5e-3, "fatol": 5e-3, "maxiter": 120},
        )
        return np.array([np.clip(found.x[0], low, high) - found.x[1] * middle, found.x[1]])
