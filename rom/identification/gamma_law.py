"""The law gamma(T) of a campaign: fitted to gamma of each case, then to the losses by re-simulation.

Of another form that was declared, what scales the rate is refitted to the losses; exponents and thresholds,
which losses do not tell, stay as declared: `discovery.loop.impact_refits` fits them to tension histories.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.curve_fits import (
    FreeNumbers,
    LawFit,
    covariance_of,
    fit_law,
    gamma_curve,
    upright,
    with_limits,
)
from rom.identification.few_cases import few_cases
from rom.identification.form_selection import Form, fit_form, reference_tension, with_given
from rom.identification.gamma_per_case import GammaEstimate, LooseningCase, final_tensions, identify_gamma
from rom.identification.joint import tension_levels
from rom.model.expressions import is_linear_in
from rom.model.laws import Law, logistic_loosening, power_loosening
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty
from rom.progress import Progress

_REFINEMENTS: Numerical[int] = 3
_EVALUATIONS: Numerical[int] = 30  # of a refinement, at most; 4 are usual
_STEP: Numerical[float] = 1e-3  # of slopes, in units of FreeNumbers
_LEAST_LOSS_ERROR: Numerical[float] = 1e-9  # [N]
_LEAST_SCATTER: Numerical[float] = 1e-6  # of ln gamma
_LARGEST_SCATTER: Numerical[float] = 10.0


@dataclass(frozen=True)
class Loosening:
    """What loosening tests tell: gamma of every case, its fits over tension, and the law.

    `case_fit` is that to gamma of each case, `fit` its refinement; None where no case loosened.
    """

    gamma: tuple[GammaEstimate, ...]
    law: Law | None = None
    case_fit: LawFit | None = None
    fit: LawFit | None = None
    warnings: tuple[str, ...] = ()

    @property
    def rate_uncertainty(self) -> RateUncertainty | None:
        """How far one new test may be from the law; None where none was fitted, or to too few to tell."""
        if self.fit is None or len(self.fit.records) <= len(self.fit.free):
            return None
        fit, tests = self.fit, len(self.fit.records)
        return RateUncertainty.of(fit.free, fit.covariance, (fit.scatter, 0.0), tests - len(fit.free))


def loosening_law(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    progress: Progress | None = None,
    declared: Law | None = None,
) -> Loosening:
    """Return gamma per case and gamma(T), fitted to the net-loosening cases and refined by re-simulation.

    Parameters
    ----------
    model : Model
        With the links' laws.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window of the final tension [s], from and to.
    progress : callable
        Called with the number of cases whose gamma is found, and their total.
    declared : Law
        Form of the law in place of gamma(T), its numbers the start.
    """
    gamma = identify_gamma(model, cases, window_s, progress=progress)
    usable = [g for g in gamma if g.gamma > 0 and not g.at_bound and np.isfinite(g.log_error)]
    if not usable:
        return _without_loosening(gamma)
    case_fit, by_file = _fit_to_cases(usable), {case.file: case for case in cases}
    start = case_fit if declared is None else _start_of(declared, case_fit)
    fit = refine_gamma_law(model, [by_file[one.file] for one in usable], window_s, start)
    form = "gamma(T)" if declared is None else "the declared tension law"
    initial = np.array([one.initial for one in usable])
    fit, untold = (fit, ()) if declared is not None else _told_by_losses(fit, case_fit, initial)
    lines = untold + few_cases(form, fit, initial, declared=declared is not None)
    if not fit.settled:
        lines += (f"the fit of {form} by re-simulation had not settled when it ended",)
    return Loosening(gamma, fit.law, case_fit, fit, lines)


def _told_by_losses(fit: LawFit, case_fit: LawFit, tension: FloatArray) -> tuple[LawFit, tuple[str, ...]]:
    """Return the fit to gamma of each case where it tells more: any large rate lets a bolt fall to zero."""
    by_losses, by_cases = (float(np.max(one.log_error(tension))) for one in (fit, case_fit))
    if by_losses - by_cases < RULES.undetermined:
        return fit, ()
    text = "gamma(T): most bolts fell so far that their losses tell no rate; it is that of gamma of each case"
    return case_fit, (text,)


def fitted_numbers(law: Law) -> tuple[str, ...]:
    """Names of a law's numbers that were fitted: those with limits, or identified; all where none is."""
    numbers = law.parameters.items()
    fitted = (n for n, p in numbers if (p.low, p.high) != (None, None) or p.source == "identified")
    return tuple(fitted) or tuple(law.parameters)


def _start_of(law: Law, case_fit: LawFit) -> LawFit:
    """A declared law as the start of a fit to losses: what scales its rate is free, and keeps its sign."""
    fitted = fitted_numbers(law)
    scales = [n for n in fitted if is_linear_in(law.equation, n) and law.parameters[n].value != 0]
    free = tuple(scales or fitted)
    ranges = {n: (0.0, math.inf) if law.parameters[n].value > 0 else (-math.inf, 0.0) for n in scales}
    signed = {n: replace(law.parameters[n], bounds=bounds) for n, bounds in ranges.items()}
    start = replace(law, parameters={**law.parameters, **signed})
    return replace(case_fit, law=start, free=free, covariance=np.zeros((len(free), len(free))))


def _without_loosening(gamma: tuple[GammaEstimate, ...]) -> Loosening:
    """A bolt that no test loosened: dT/dt = 0, or one negative gamma near one tension."""
    certain = [g.gamma for g in gamma if g.gamma < 0 and not g.at_bound and g.log_error < RULES.undetermined]
    if not certain or tension_levels(np.array([g.initial for g in gamma])):
        return Loosening(gamma, warnings=("no case loosened: the tension law stays dT/dt = 0",))
    text = "no case loosened: the median of the negative gammas that tighten stands for all tensions"
    return Loosening(gamma, power_loosening(float(np.median(certain))), warnings=(text,))


def _fit_to_cases(usable: Sequence[GammaEstimate]) -> LawFit:
    tension = np.array([g.initial for g in usable])
    values = np.array([g.gamma for g in usable])
    covariance = np.diag([_case_error(g) ** 2 for g in usable])
    files, levels = [g.file for g in usable], tension_levels(tension)
    scales = tension.max() * np.geomspace(0.01, 1.0, 6)
    free: tuple[str, ...] = ("gamma_d", "gamma_i", "rho")
    if not levels:
        forms = _near_forms(tension, values, Form(_logistic_starts(scales, values), free))
        return fit_form(forms, tension, values, covariance, files, gamma_curve)
    if levels == RULES.curve_levels:  # two levels tell two parameters
        scales, free = np.sqrt([tension.min() * tension.max()]) / 2, free[:2]
    starts = _logistic_starts(scales, values)
    return fit_law(starts, free, tension, values, covariance, files, gamma_curve)


def _near_forms(tension: FloatArray, values: FloatArray, logistic: Form) -> list[Form]:
    """Return the forms of gamma(T) that tensions near to each other may tell: a constant, Eq. 13 with its
    steepness given, all of it.
    """
    constant = Form([power_loosening(float(np.exp(np.log(values).mean())))], ("gamma",))
    middle = reference_tension(tension)
    if middle is None:
        return [constant]
    (start,) = _logistic_starts(np.array([middle / 2]), values)
    return [constant, Form([with_given(start, "rho")], logistic.free[:2]), logistic]


def _logistic_starts(scales: FloatArray, values: FloatArray) -> list[Law]:
    """Return Eq. 13 between values of gamma, changing over scales of the tension [N]."""
    top, bottom = float(np.log10(values.max())), float(np.log10(values.min()))
    return [logistic_loosening(2 * top - bottom, 2 * (top - bottom), -1 / scale) for scale in scales]


def _case_error(case: GammaEstimate) -> float:
    """Return the standard error of ln gamma; a bolt that fell to the noise tells little more than a bound."""
    lost = case.final < RULES.lost_tension * case.loss_error
    return float(np.clip(case.log_error, 1.0 if lost else 0.0, 3.0))


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
    numbers, scatter = FreeNumbers(fit.law, fit.free), fit.scatter
    steps = np.ones(len(fit.free))

    known: dict[bytes, FloatArray] = {}  # a fit begins with the slopes that the one before ended with

    def loss(steps: FloatArray) -> FloatArray:
        here = steps.tobytes()
        if here not in known:
            final = final_tensions(model.with_tension_law(numbers.law_at(steps)), cases, window_s)
            known[here] = np.asarray(initial - np.where(np.isfinite(final), final, 0.0))
        return known[here]

    covariance = fit.covariance
    for _ in range(_REFINEMENTS):
        found = optimize.least_squares(
            partial(_loss_misfit, loss, measured, error, scatter), steps, xtol=1e-6, ftol=1e-8,
            diff_step=np.full(len(steps), _STEP), max_nfev=_EVALUATIONS, bounds=numbers.bounds,
        )  # fmt: skip
        steps, simulated = found.x, np.maximum(loss(found.x), _LEAST_LOSS_ERROR)
        by_noise, rough = error / simulated, max(scatter, RULES.discretised_rate)
        rows = np.hypot(scatter, by_noise) / np.hypot(rough, by_noise)
        covariance = covariance_of(np.asarray(found.jac) / numbers.unit * rows[:, None])
        scatter = _loss_scatter(measured, loss(steps), error, len(steps))
    law, turn = upright(numbers.law_at(steps), fit.free)
    covariance = turn @ covariance @ turn.T
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
    steps: FloatArray,
) -> FloatArray:
    return _standardised(measured, loss(steps), error, scatter)


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
