"""A gauge's calibration told by the preloads that a campaign declares: what it shows of them before the hits.

    shown_i = T_0 + (1 + c_1) T_i + c_2 T_i^2 + e_i,   e_i ~ N(0, s^2 + (r T_i)^2)

T_i: declared preload of record i; the scatters s and r are those of the training records about the curve.
Laws follow whatever scale the tension has, so that nothing else in a campaign tells the scale. Preloads that
lie within a few per cent of a curve were set by what is as good as a gauge, unlike those of a torque wrench,
which scatter by 10 to 30 % (VDI 2230-1, 2015, table A8) and are no reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import optimize

from discovery.criteria.tension import Tension
from discovery.decide.explanation import Explanation, limited
from discovery.options import Options
from discovery.residual.output_error import WhitenedResidual
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, SensorFault, candidates_of
from rom.signals.sensor_correction import moves_levels

_LEAST_SCATTER: Numerical[FloatArray] = np.log([1e-3, 1e-4])  # [N], and of a preload

DISAGREE = (
    "the gauge and the preloads that the campaign declares disagree: the gauge is taken to be wrong, and all "
    "laws follow the declared preloads; if these were set by other means, check which of the two is right"
)


@dataclass(frozen=True, eq=False)
class _Shown:
    """Preloads that were declared and tensions that the gauge shows of them [N], (records,)."""

    files: tuple[str, ...]
    training: npt.NDArray[np.bool_]
    declared: FloatArray
    tension: FloatArray


@dataclass(frozen=True, eq=False)
class _Fit:
    """Numbers of a fault, their standard errors, and the scatter of every record [N].

    `columns`: what a fault of strength one adds.
    """

    columns: FloatArray
    sigma: FloatArray
    numbers: FloatArray
    errors: FloatArray


def explain(residual: WhitenedResidual, options: Options) -> tuple[Explanation, ...]:
    """Return what faults of the gauge explain of the tensions before the hits.

    None where preloads are not declared, are too few or no reference, or are near to what the gauge shows.

    Parameters
    ----------
    residual : WhitenedResidual
        Traces of all records; faults that its model holds are taken out of them.
    options : Options
        Criteria.
    """
    shown, criteria = _shown(residual), options.criteria.tension
    if _levels(shown.declared[shown.training], criteria.same_preload) < criteria.preload_levels:
        return ()
    found = (
        _explained(member, effect, shown, criteria)
        for member, effect in candidates_of(SensorFault, residual.baseline.model, ["tension"])
        if moves_levels(effect)
    )
    return tuple(one for one in found if one is not None)


def _shown(residual: WhitenedResidual) -> _Shown:
    both = [
        (trace.settings, declared, tension.initial)
        for trace in residual.traces
        if (tension := trace.measurement.tension) is not None
        and (declared := trace.measurement.preload_n or 0.0) > 0
    ]
    return _Shown(
        tuple(settings.file for settings, _, _ in both),
        np.array([not settings.hold_out for settings, _, _ in both], dtype=bool),
        np.array([declared for _, declared, _ in both]),
        np.array([shown for _, _, shown in both]),
    )


def _levels(declared: FloatArray, same: float) -> int:
    """Number of different preloads."""
    return len(np.unique(np.round(np.log(declared) / same)))


def _explained(member: Member, fault: SensorFault, shown: _Shown, criteria: Tension) -> Explanation | None:
    """The fault as the training records ask for it; None where the gauge shows what was declared."""
    fit = _fitted(_columns(member, fault, shown), shown, criteria.same_preload)
    if np.median((fit.sigma / shown.declared)[shown.training]) > criteria.preload_scatter:
        return None
    change = fit.columns @ fit.numbers
    allowed = criteria.gauge_zero_n + criteria.gauge_slope * shown.declared
    if not np.any(np.abs(change) > allowed, where=shown.training):
        return None
    low, high = np.array([fault.parameters[name].bounds for name in member.strengths]).T
    if np.any((fit.numbers < low) | (fit.numbers > high)):
        return None
    values, errors = (
        dict(zip(member.strengths, of.tolist(), strict=True)) for of in (fit.numbers, fit.errors)
    )
    off = shown.tension - shown.declared
    before, after = (((of / fit.sigma) ** 2).tolist() for of in (off, off - change))
    return Explanation(
        limited(fault.with_values(**values), errors),
        dict(zip(shown.files, before, strict=True)),
        dict(zip(shown.files, after, strict=True)),
        dict.fromkeys(shown.files, 1),
        frozenset(file for file, training in zip(shown.files, shown.training, strict=True) if not training),
        len(values),
        basis="what the gauge shows beside the declared preloads",
    )


def _columns(member: Member, fault: SensorFault, shown: _Shown) -> FloatArray:
    """What a fault of strength one adds to every declared preload, (records, numbers)."""
    none = fault.with_values(**dict.fromkeys(member.strengths, 0.0))
    added = [
        (none.with_values(**{name: size}).apply(shown.declared, 1.0) - shown.declared) / size
        for name, size in member.strengths.items()
    ]
    return np.stack(added, axis=1)


def _fitted(columns: FloatArray, shown: _Shown, same: float) -> _Fit:
    """Numbers and scatters of the training records, by maximum likelihood."""
    train, off = shown.training, shown.tension - shown.declared

    def at(scatter: FloatArray) -> _Fit:
        size = np.exp(np.maximum(scatter, _LEAST_SCATTER))
        sigma = np.hypot(size[0], size[1] * shown.declared)
        rows = (columns / sigma[:, None])[train]
        inverse = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
        numbers = inverse @ (rows.T @ (off / sigma)[train])
        return _Fit(columns, sigma, numbers, np.sqrt(np.diag(inverse)))

    def deviance(scatter: FloatArray) -> float:
        fit = at(scatter)
        residual = (off - columns @ fit.numbers) / fit.sigma
        return float(np.sum((2 * np.log(fit.sigma) + residual**2)[train]))

    start = np.log([0.1, 0.01])
    fit = at(optimize.minimize(deviance, start, method="Nelder-Mead").x)
    levels, free = _levels(shown.declared[train], same), columns.shape[1] + len(start)
    wider = np.sqrt(levels / (levels - free))  # numbers and scatters of few preloads suit them by chance
    return replace(fit, sigma=wider * fit.sigma, errors=wider * fit.errors)
