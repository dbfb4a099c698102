"""Curves of stiffness, damping and gamma over tension, fitted to per-record values with their covariance.

ln y_i = ln f(T_i; p) + e_i,  e ~ N(0, S + tau^2 I): S is what the records' own fits say, tau the case-to-case
scatter beyond it, chosen such that the weighted misfit equals its degrees of freedom (R. Paule and J. Mandel,
J. Res. NBS 87, 377, 1982). Limits rest on no less scatter than discretisation leaves. He et al. (2025) fits
Eqs. 5, 11 and 13 without weights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize, stats

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.model.expressions import is_linear_in
from rom.model.laws import Law, Parameter

Curve = Callable[[Law, FloatArray], FloatArray]
_TINY: Numerical[float] = 1e-300
_LEAST_SCALE: Numerical[float] = 1e-100  # its inverse can still be squared
_LEAST_INFORMATION: Numerical[float] = 1e-9  # of the best told direction of the parameters, to a direction
_MIRRORED = {"logistic damping": ("c_d", "c_i", "eta"), "logistic loosening": ("gamma_d", "gamma_i", "rho")}


@dataclass(frozen=True)
class LawFit:
    """A fitted law with 95 % limits on its parameters.

    `free` names the fitted parameters in the order of `covariance`; `scatter` is tau, a standard deviation of
    ln y; `r_squared` is that of y, as the paper reports it; `settled` tells whether the fit has ended.
    """

    law: Law
    free: tuple[str, ...]
    covariance: FloatArray
    scatter: float
    r_squared: float
    records: tuple[str, ...]
    curve: Curve
    settled: bool = True

    def log_error(self, tension: FloatArray) -> FloatArray:
        """Return the standard error of ln f at tensions [N], from the parameters' covariance."""
        jacobian = _log_jacobian(self.law, self.free, tension, self.curve)
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding, where parameters trade places


@dataclass(frozen=True)
class FreeNumbers:
    """The numbers of a law that a fit moves, in steps from 1: a fit then ends alike in all units.

    ``p = p_0 + (steps - 1) u``. The unit u is a number's own size; but 1 for a pure number such as a
    logarithm, which another unit of what it is of shifts.
    """

    law: Law
    free: tuple[str, ...]

    @cached_property
    def _first(self) -> FloatArray:
        return np.array([self.law.parameters[name].value for name in self.free])

    @cached_property
    def unit(self) -> FloatArray:
        """Sizes of the steps, (free,)."""
        equation, of = self.law.equation, self.law.parameters
        pure = [of[name].unit == "1" and not is_linear_in(equation, name) for name in self.free]
        return np.where(pure | (self._first == 0), 1.0, np.abs(self._first))

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the steps, low and high."""
        low, high = np.transpose([self.law.parameters[name].bounds for name in self.free])
        return 1 + (low - self._first) / self.unit, 1 + (high - self._first) / self.unit

    def law_at(self, steps: FloatArray) -> Law:
        """Return the law so many steps off; rounding leads no number past its bounds."""
        low, high = np.transpose([self.law.parameters[name].bounds for name in self.free])
        values = np.clip(self._first + (steps - 1) * self.unit, low, high)
        return self.law.with_values(**dict(zip(self.free, values.tolist(), strict=True)))


def link_curve(law: Law, tension: FloatArray) -> FloatArray:
    """Return a stiffness or damping law at tensions [N]."""
    return law(tension)


def gamma_curve(law: Law, tension: FloatArray) -> FloatArray:
    """Return gamma(T) = -(dT/dt) / (|v|^n T) of a loosening law: its rate at unit velocity."""
    return np.asarray(-law.rate(tension, 0.0, 1.0) / tension)


def fit_law(
    starts: Sequence[Law],
    free: Sequence[str],
    tension: FloatArray,
    values: FloatArray,
    log_covariance: FloatArray,
    records: Sequence[str],
    curve: Curve = link_curve,
) -> LawFit:
    """Fit a law's `free` parameters to positive `values` (n,) at `tension` (n,) [N] from several starts.

    Parameters
    ----------
    starts : sequence of Law
        Laws to start from.
    free : sequence of str
        Names of the parameters that are fitted.
    tension : ndarray, shape (n,)
        Tensions [N].
    values : ndarray, shape (n,)
        Positive values.
    log_covariance : ndarray, shape (n, n)
        Covariance of the logarithms of the values.
    records : sequence of str
        Files that the values come from.
    curve : callable
        ``f(law, tension)``: the values that a law gives.

    Returns
    -------
    LawFit
        The law with its limits.

    Raises
    ------
    ValueError
        If there are fewer values than free parameters, or a value is not positive.
    """
    if len(values) < len(free):
        raise ValueError(f"a fit of {len(free)} parameters needs as many values, instead got {len(values)}")
    if not np.all(values > 0):
        raise ValueError(
            f"a fit of logarithms needs positive values, instead got {float(np.min(values)):.3g}"
        )
    scatter, law = 0.0, starts[0]
    candidates: Sequence[Law] = starts
    for _ in range(8):
        whitener = _whitener(log_covariance, scatter)
        law, _ = min(
            (_least_squares(start, free, tension, values, whitener, curve) for start in candidates),
            key=lambda pair: float(pair[1] @ pair[1]),
        )
        update = excess_scatter(np.log(values) - _logarithm(law, tension, curve), log_covariance, len(free))
        settled = abs(update - scatter) <= 1e-3 * max(update, 1e-6)
        scatter, candidates = update, [law]
        if settled:
            break
    law, _ = upright(law, free)
    rough = RULES.discretised_rate if curve is gamma_curve else RULES.discretised_curve
    jacobian = _whitener(log_covariance, max(scatter, rough)) @ _log_jacobian(law, free, tension, curve)
    covariance = covariance_of(jacobian)
    fitted = curve(law, tension)
    spread = float(np.sum((values - values.mean()) ** 2))
    r_squared = 1 - float(np.sum((values - fitted) ** 2)) / spread if spread > 0 else float("nan")
    limited = with_limits(law, free, covariance, len(values) - len(free))
    return LawFit(limited, tuple(free), covariance, scatter, r_squared, tuple(records), curve)


def least_misfit(
    fit: LawFit, scatter: float, tension: FloatArray, values: FloatArray, log_covariance: FloatArray
) -> float:
    """Return the least weighted square that a fit's form leaves of values if they scatter so much.

    Parameters
    ----------
    fit : LawFit
        The form, and where to start.
    scatter : float
        Standard deviation of ln y beyond the covariance.
    tension, values : ndarray, shape (n,)
        Tensions [N] and positive values.
    log_covariance : ndarray, shape (n, n)
        Covariance of the logarithms of the values.

    Returns
    -------
    float
        About n less the free parameters where form and scatter are right.
    """
    whitener = _whitener(log_covariance, scatter)
    _, left = _least_squares(fit.law, fit.free, tension, values, whitener, fit.curve)
    return float(left @ left)


def covariance_of(jacobian: FloatArray) -> FloatArray:
    """Return (J^T J)^-1 of a whitened Jacobian (values, parameters); what no value tells has a huge variance.

    Columns are scaled first, for parameters may differ by ten orders of magnitude.
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), _LEAST_SCALE)
    _, size, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    spread = directions.T / np.maximum(size, _LEAST_INFORMATION * size.max()) / scale[:, None]
    return np.asarray(spread @ spread.T, dtype=np.float64)


def with_limits(law: Law, free: Sequence[str], covariance: FloatArray, degrees_of_freedom: int) -> Law:
    """Return the law with 95 % limits (Student's t) on its free parameters; none without degrees of freedom.

    Parameters
    ----------
    law : Law
        The law.
    free : sequence of str
        Names of the parameters that are fitted.
    covariance : ndarray, shape (free, free)
        Covariance of the free parameters.
    degrees_of_freedom : int
        Values less free parameters.

    Returns
    -------
    Law
        The law.
    """
    parameters: dict[str, Parameter] = dict(law.parameters)
    for name, variance in zip(free, np.diag(covariance), strict=True):
        found = replace(parameters[name], low=None, high=None, source="identified")
        if degrees_of_freedom > 0:
            half = float(stats.t.ppf(0.975, degrees_of_freedom)) * float(np.sqrt(variance))
            found = replace(found, low=found.value - half, high=found.value + half)
        parameters[name] = found
    return replace(law, parameters=parameters)


def upright(law: Law, free: Sequence[str]) -> tuple[Law, FloatArray]:
    """Return Eq. 11 or 13 written the paper's way, with a steepness below zero; other laws as they are.

    ``d - i / (1 + exp(r T))`` and ``(d - i) + i / (1 + exp(-r T))`` are one curve. Also returned is the
    matrix (free, free) that takes the free parameters there.
    """
    turn = np.eye(len(free))
    upper, depth, steepness = _MIRRORED.get(law.name, ("", "", ""))
    if steepness not in free or law.parameters[steepness].value <= 0:
        return law, turn
    rows = {name: place for place, name in enumerate(free)}
    turn[rows[upper], rows[depth]] = turn[rows[depth], rows[depth]] = turn[
        rows[steepness], rows[steepness]
    ] = -1
    values = turn @ np.array([law.parameters[name].value for name in free])
    return law.with_values(**dict(zip(free, values.tolist(), strict=True))), turn


def _logarithm(law: Law, tension: FloatArray, curve: Curve) -> FloatArray:
    return np.log(np.maximum(curve(law, tension), _TINY))


def _log_jacobian(law: Law, free: Sequence[str], tension: FloatArray, curve: Curve) -> FloatArray:
    """Return d ln f / d p by central differences: (tensions, free parameters)."""
    columns = []
    for name, unit in zip(free, FreeNumbers(law, tuple(free)).unit, strict=True):
        value, step = law.parameters[name].value, 1e-5 * unit
        upper = _logarithm(law.with_values(**{name: value + step}), tension, curve)
        lower = _logarithm(law.with_values(**{name: value - step}), tension, curve)
        columns.append((upper - lower) / (2 * step))
    return np.stack(columns, axis=1)


def _whitener(log_covariance: FloatArray, scatter: float) -> FloatArray:
    total = log_covariance + (scatter**2 + 1e-12) * np.eye(len(log_covariance))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def _least_squares(
    start: Law,
    free: Sequence[str],
    tension: FloatArray,
    values: FloatArray,
    whitener: FloatArray,
    curve: Curve,
) -> tuple[Law, FloatArray]:
    numbers, logarithms = FreeNumbers(start, tuple(free)), np.log(values)

    def residual(steps: FloatArray) -> FloatArray:
        logarithm = np.clip(_logarithm(numbers.law_at(steps), tension, curve), -50, 100)
        return np.asarray(whitener @ (logarithm - logarithms))

    with np.errstate(over="ignore"):
        fit = optimize.least_squares(residual, np.ones(len(free)), bounds=numbers.bounds)
    return numbers.law_at(fit.x), fit.fun


def excess_scatter(residual: FloatArray, log_covariance: FloatArray, parameters: int) -> float:
    """Return tau such that r^T (S + tau^2 I)^-1 r equals the degrees of freedom; 0 where S alone suffices.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Residual of the logarithms.
    log_covariance : ndarray, shape (n, n)
        Covariance of the logarithms of the values.
    parameters : int
        Number of fitted parameters.

    Returns
    -------
    float
        tau, of the logarithm.
    """
    freedom = len(residual) - parameters
    if freedom < 1:
        return 0.0

    def excess(tau: float) -> float:
        white = _whitener(log_covariance, tau) @ residual
        return float(white @ white) - freedom

    upper = float(np.sqrt(residual @ residual / freedom)) * 2 + 1e-12
    if excess(0.0) <= 0 or excess(upper) >= 0:
        return 0.0
    return float(optimize.brentq(excess, 0.0, upper, xtol=1e-9))
