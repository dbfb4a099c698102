"""Selection of the form of a curve over tension, where tensions lie near to each other.

The forms are a constant, then two numbers, then three. One with more numbers is taken where what it takes
from the misfit of the others is not chance: by the F ratio where values scatter beyond their errors, by
chi-squared where the errors are all there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.identification.curve_fits import Curve, LawFit, fit_law, least_misfit, link_curve
from rom.model.laws import Law


@dataclass(frozen=True)
class Form:
    """A form of a curve: laws to start from, and the parameters that are fitted."""

    starts: Sequence[Law]
    free: tuple[str, ...]


def with_given(law: Law, name: str) -> Law:
    """The law with a parameter that keeps its value in all fits."""
    value = law.parameters[name].value
    given = replace(law.parameters[name], bounds=(value, value), source="assumed")
    return replace(law, parameters={**law.parameters, name: given})


def reference_tension(tension: FloatArray) -> float | None:
    """Return the middle of tensions [N], to three digits; None where they hold less than two levels."""
    held = tension[tension > 0]
    if len(held) < RULES.curve_levels or np.log(held.max() / held.min()) <= RULES.level_step:
        return None
    return float(f"{np.sqrt(held.min() * held.max()):.3g}")


def fit_form(
    forms: Sequence[Form],
    tension: FloatArray,
    values: FloatArray,
    log_covariance: FloatArray,
    records: Sequence[str],
    curve: Curve = link_curve,
) -> LawFit:
    """Fit the simplest form that the values do not contradict.

    Parameters
    ----------
    forms : sequence of Form
        A constant first; more numbers later.
    tension, values : ndarray, shape (n,)
        Tensions [N] and positive values.
    log_covariance : ndarray, shape (n, n)
        Covariance of the logarithms of the values.
    records : sequence of str
        Files that the values come from.
    curve : callable
        ``f(law, tension)``: the values that a law gives.

    Returns
    -------
    LawFit
        With limits on its free parameters.
    """

    data = (tension, values, log_covariance)

    def fitted(form: Form) -> LawFit:
        return fit_law(form.starts, form.free, *data, records, curve)

    constant, *others = forms
    selected = fitted(constant)
    for numbers in sorted({len(form.free) for form in others}):
        if numbers >= len(values):  # no value is left to contradict it
            break
        rivals = [fit for fit in (fitted(f) for f in others if len(f.free) == numbers) if _is_positive(fit)]
        if not rivals:
            continue
        least = min(fit.scatter for fit in rivals)
        richer = min(rivals, key=lambda fit: least_misfit(fit, least, *data))
        if _chance(selected, richer, *data) < RULES.curve_chance:
            selected = richer
    return selected


def _is_positive(fit: LawFit) -> bool:
    """Whether a curve stays above zero for a bolt that comes loose."""
    return bool(fit.curve(fit.law, np.array([1e-3]))[0] > 0)


def _chance(
    simple: LawFit, richer: LawFit, tension: FloatArray, values: FloatArray, log_covariance: FloatArray
) -> float:
    """Return the probability that values on the simple curve favour the richer one as much."""
    before, after = (
        least_misfit(fit, richer.scatter, tension, values, log_covariance) for fit in (simple, richer)
    )
    more, freedom = len(richer.free) - len(simple.free), len(values) - len(richer.free)
    if richer.scatter == 0.0:
        return float(stats.chi2.sf(before - after, more))
    return float(stats.f.sf((before - after) / more, more, freedom))
