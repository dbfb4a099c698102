"""Gamma of every loosening case, and the law gamma(T), by re-simulation.

The final tension falls monotonically with gamma, so that a bracketing root-finder finds what the pattern
search of He et al. (2025), Section 3.5, finds: the gamma whose simulated final tension is the measured one,
negative for net tightening.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import optimize
from scipy.optimize import elementwise

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.effects import LawChange
from rom.identification.curve_fits import LawFit, covariance_of, gamma_curve, with_limits
from rom.model.effect import SensorFault
from rom.model.laws import Parameter, power_loosening
from rom.model.model import Model
from rom.signals.sensor_correction import true_hit
from rom.signals.tension_bins import TensionCourse

Progress = Callable[[int, int], None]
_REFINEMENTS: Numerical[int] = 3
_EVALUATIONS: Numerical[int] = 30  # of a refinement, at most; 4 are usual
_PROBE: Numerical[float] = 100.0  # loosens by a small share, yet far above rounding
_LEAST_EXPOSURE: Numerical[float] = 1e-30  # a touch so weak that the probe's loss is lost in rounding
_LEAST_LOSS_ERROR: Numerical[float] = 1e-9  # [N]
_LEAST_SCATTER: Numerical[float] = 1e-6  # of ln gamma
_LARGEST_SCATTER: Numerical[float] = 10.0
_BRACKETS: Numerical[int] = 16  # at most
_HALVINGS: Numerical[int] = 80  # at most; so many steps end within 1e-3 of the bound, in asinh(gamma)
_LOSS_TOLERANCE: Numerical[float] = 1e-10  # [N]
_NEVER: Numerical[float] = 1e12  # stands for the tension of a simulation that tightened beyond all bounds [N]


@dataclass(frozen=True, eq=False)
class LooseningCase:
    """One impact, the tension before and after [N], and the standard error of the loss."""

    file: str
    body: str
    force: FloatArray
    rate_hz: float
    initial: float
    final: float
    loss_error: float

    @classmethod
    def of(cls, course: TensionCourse, hammer_faults: Sequence[SensorFault]) -> LooseningCase:
        """The case of a tension history, its hit [N] without faults of the hammer."""
        force, error = true_hit(course.force, course.rate_hz, hammer_faults), course.final_error
        final = max(course.final, error)
        return cls(course.file, course.body, force, course.rate_hz, course.initial, final, error)


@dataclass(frozen=True)
class GammaEstimate:
    """Gamma of one case [s^3/m^4]; `log_error` is the standard error of ln |gamma|."""

    file: str
    initial: float
    final: float
    loss_error: float
    gamma: float
    log_error: float
    at_bound: bool

    @property
    def loss(self) -> float:
        """Initial minus final tension [N]."""
        return self.initial - self.final


def final_tensions(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    gamma: FloatArray | None = None,
    path: str | None = None,
) -> FloatArray:
    """Return simulated final tensions [N], (cases,): means over the final window; nan where it diverged.

    ``gamma``, one a case, stands for the law's own, or for another number of the model at ``path``.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    gamma : ndarray, shape (cases,)
        A value for each case; None for the law's own.
    path : str
        Parameter that ``gamma`` stands for; None for the law's own gamma.

    Returns
    -------
    ndarray
        Shape (cases,) [N].
    """
    out = np.empty(len(cases))
    path = path or f"{model.structure.bolted_links[0]}.tension_rate.gamma"
    keys = [(case.body, case.rate_hz, len(case.force)) for case in cases]
    for key in dict.fromkeys(keys):
        index = [i for i, other in enumerate(keys) if other == key]
        out[index] = model.final_tension(
            np.stack([cases[i].force for i in index]),
            key[1],
            np.array([cases[i].initial for i in index]),
            vary=None if gamma is None else {path: gamma[index]},
            window_s=window_s,
            body=key[0],
        )
    return out


def identify_gamma(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    exponent: float = 4.0,
    progress: Progress | None = None,
) -> tuple[GammaEstimate, ...]:
    """Return gamma per case such that simulated and measured final tension agree; bounds +-1e10.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    exponent : float
        Power of the velocity in the law.
    progress : callable
        Called with the number of cases that are solved and their total.

    Returns
    -------
    tuple
        One for each case.
    """
    if not cases:
        return ()
    trial = _with_power(model, exponent)
    gamma, at_bound = matching_gammas(model, cases, window_s, exponent, progress=progress)
    step = 1e-3 * np.abs(gamma)
    slope = np.abs(
        final_tensions(trial, cases, window_s, gamma + step)
        - final_tensions(trial, cases, window_s, gamma - step)
    ) / (2e-3)
    error = np.array([case.loss_error for case in cases]) / np.maximum(slope, 1e-12)
    return tuple(
        GammaEstimate(c.file, c.initial, c.final, c.loss_error, float(g), float(e), bool(b))
        for c, g, e, b in zip(cases, gamma, error, at_bound, strict=True)
    )


def matching_gammas(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    exponent: float = 4.0,
    tolerance: float = 1e-10,
    progress: Progress | None = None,
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return gammas [s^3/m^4] to a tolerance of asinh(gamma), (cases,), and which of them are at a bound.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    exponent : float
        Power of the velocity in the law.
    tolerance : float
        Tolerance of the root.
    progress : callable
        Called with the number of cases that are solved and their total.

    Returns
    -------
    tuple
        Gammas, shape (cases,), and whether each is at a bound.
    """
    trial = _with_power(model, exponent)
    near = _small_loss_gamma(trial, cases, window_s)
    return _matching(trial, None, cases, window_s, near, tolerance, progress)


def own_rate(factor: float) -> LawChange:
    """One test's own factor on the rate of loosening, after all other changes of the law."""
    return LawChange("own-rate", "tension", "factor * rate", {"factor": Parameter(factor, "1")})


def matching_factors(
    model: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float], tolerance: float = 1e-10
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return factors on a model's own rate of loosening, (cases,), and which of them are at a bound.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    tolerance : float
        Tolerance of the root.

    Returns
    -------
    tuple
        Factors, shape (cases,), and whether each is at a bound.
    """
    own = own_rate(1.0)
    path = f"{own.path}.factor"
    return _matching(model.with_effect(own), path, cases, window_s, np.ones(len(cases)), tolerance)


def _matching(
    trial: Model,
    path: str | None,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    near: FloatArray,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the values at a path near some with which the final tensions are the measured ones."""
    measured = np.array([case.final for case in cases])

    def miss(place: FloatArray, index: FloatArray) -> FloatArray:
        rows = index.astype(int).ravel()
        if progress is not None:  # only cases that are not solved are asked for
            progress(len(cases) - len(rows), len(cases))
        final = final_tensions(trial, [cases[i] for i in rows], window_s, np.sinh(place.ravel()), path)
        final = np.where(np.isfinite(final), final, _NEVER)
        return np.asarray((final - measured[rows]).reshape(place.shape))

    index = np.arange(len(cases), dtype=float)
    guess, limit = np.arcsinh(near), float(np.arcsinh(RULES.gamma_bound))
    bracket = elementwise.bracket_root(
        miss, np.clip(guess - 1, -limit, limit - 1), np.clip(guess + 1, 1 - limit, limit), xmin=-limit,
        xmax=limit, args=(index,), maxiter=_BRACKETS,
    )  # fmt: skip
    root = elementwise.find_root(
        miss,
        bracket.bracket,
        args=(index,),
        tolerances={"xatol": 0.0, "xrtol": tolerance, "fatol": _LOSS_TOLERANCE, "frtol": 0.0},
        maxiter=_HALVINGS,
    )
    if progress is not None:
        progress(len(cases), len(cases))
    at_bound = ~np.asarray(bracket.success)
    ends = np.where(guess > 0, limit, -limit)
    return np.sinh(np.where(at_bound, ends, root.x)), at_bound


def _with_power(model: Model, exponent: float) -> Model:
    """The model with ``gamma |v|^n T`` for its tension's law."""
    return model.with_tension_law(power_loosening(1.0, exponent))


def _small_loss_gamma(
    trial: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float]
) -> FloatArray:
    """Return ln(T_0 / T_1) / integral |v|^n dt: gamma as if the falling tension left the motion alone."""
    probe = np.full(len(cases), _PROBE)
    initial = np.array([case.initial for case in cases])
    exposure = np.log(initial / final_tensions(trial, cases, window_s, probe)) / probe
    final = np.maximum([case.final for case in cases], 1e-3 * initial)
    return np.asarray(np.log(initial / final) / np.maximum(np.nan_to_num(exposure), _LEAST_EXPOSURE))


def refine_gamma_law(
    model: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float], fit: LawFit
) -> LawFit:
    """Refit a law to the losses of `cases` by re-simulation, for gamma moves while the tension falls.

    r_i = [asinh(tau m_i / s_i) - asinh(tau l_i / s_i)] / tau: measured loss m, simulated loss l, standard
    error s of the loss, scatter tau of ln gamma. It is (m - l) / s where a loss is small and ln(m / l) / tau
    where it is large, with unit variance in between, so that small losses neither bias the law nor drop out.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    fit : LawFit
        The law as fitted to gamma of each case.

    Returns
    -------
    LawFit
        The law refitted; not ``settled`` where the last fit had not ended.
    """
    initial = np.array([case.initial for case in cases])
    measured = initial - np.array([case.final for case in cases])
    error = np.maximum([case.loss_error for case in cases], _LEAST_LOSS_ERROR)
    scatter, values = fit.scatter, np.array([fit.law.parameters[name].value for name in fit.free])

    known: dict[bytes, FloatArray] = {}  # a fit begins with the slopes that the one before ended with

    def loss(parameters: FloatArray) -> FloatArray:
        here = parameters.tobytes()
        if here not in known:
            law = fit.law.with_values(**dict(zip(fit.free, parameters, strict=True)))
            final = final_tensions(model.with_tension_law(law), cases, window_s)
            known[here] = np.asarray(initial - np.where(np.isfinite(final), final, 0.0))
        return known[here]

    covariance = fit.covariance
    for _ in range(_REFINEMENTS):
        found = optimize.least_squares(
            partial(_loss_misfit, loss, measured, error, scatter), values, xtol=1e-6, ftol=1e-8,
            x_scale=np.maximum(np.abs(values), 1e-9), diff_step=np.full(len(values), 1e-4),
            max_nfev=_EVALUATIONS,
        )  # fmt: skip
        values, covariance = found.x, covariance_of(np.asarray(found.jac))
        scatter = _loss_scatter(measured, loss(values), error, len(values))
    law = fit.law.with_values(**dict(zip(fit.free, values, strict=True)))
    limited = with_limits(law, fit.free, covariance, len(cases) - len(fit.free))
    files = tuple(case.file for case in cases)
    return replace(
        fit, law=limited, covariance=covariance, scatter=scatter, records=files, curve=gamma_curve,
        settled=bool(found.status),
    )  # fmt: skip


def _loss_misfit(
    loss: Callable[[FloatArray], FloatArray],
    measured: FloatArray,
    error: FloatArray,
    scatter: float,
    values: FloatArray,
) -> FloatArray:
    return _standardised(measured, loss(values), error, scatter)


def _standardised(measured: FloatArray, loss: FloatArray, error: FloatArray, scatter: float) -> FloatArray:
    """Return misfits of losses in standard deviations of noise and scatter together."""
    share = max(scatter, _LEAST_SCATTER)
    return np.asarray((np.arcsinh(share * measured / error) - np.arcsinh(share * loss / error)) / share)


def _loss_scatter(measured: FloatArray, loss: FloatArray, error: FloatArray, parameters: int) -> float:
    """Return the scatter at which the misfit equals its degrees of freedom; 0 where the noise suffices."""
    freedom = len(measured) - parameters

    def excess(scatter: float) -> float:
        misfit = _standardised(measured, loss, error, scatter)
        return float(misfit @ misfit) - freedom

    if freedom < 1 or excess(0.0) <= 0:
        return 0.0
    if excess(_LARGEST_SCATTER) >= 0:
        return _LARGEST_SCATTER
    return float(optimize.brentq(excess, 0.0, _LARGEST_SCATTER, xtol=1e-9))
