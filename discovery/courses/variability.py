"""Between-test variability: how the rate of loosening differs from one test to the next.

ln tau = a + b ln(T / 100 N),   u ~ N(0, tau^2) the deviation of the log rate
"""

from __future__ import annotations

import numpy as np

from discovery.criteria.courses import Courses
from rom.campaign.channels import FloatArray


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
    return np.asarray(np.log(np.maximum(initial, 1e-3) / 100.0))


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
