"""Readings of a bolt at rest fitted to its lines, all their numbers together, noise renewed beside them.

Weights are those of the gauge's noise. A wander beside it makes the numbers less sure, not others:

    cov = B V B',   B = (J'J)^-1 J'

J: slopes of lines over the gauge's noise; V: their variance with the wander.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from discovery.decide.explanation import limited
from discovery.residual.at_rest import RestResidual
from discovery.residual.ends_of_ranges import on_ends
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection
from rom.model.laws import Z95, Parameter
from rom.signals.per_record_parameters import per_record_names

_RENEWED: Numerical[int] = 3  # times that noise and numbers are fitted in turn
_EVALUATIONS: Numerical[int] = 40
_INSIDE: Numerical[float] = 1e-9
_FEWEST: Numerical[int] = 3  # records that tell by how much they differ


@dataclass(frozen=True)
class _Number:
    """A number of an effect: its place, and whether it is fitted by its logarithm."""

    effect: int
    name: str
    parameter: Parameter
    logarithm: bool

    def to(self, value: float) -> float:
        """Coordinate of a value."""
        return float(np.log(value)) if self.logarithm else value / self.size

    def value(self, at: float) -> float:
        """Value at a coordinate, within the range."""
        value = float(np.exp(at)) if self.logarithm else at * self.size
        return float(np.clip(value, *self.parameter.bounds))

    @property
    def size(self) -> float:
        """What one is to the fit, of a number without logarithm."""
        return abs(self.parameter.value) or 1.0

    def error(self, at: float, error: float) -> float:
        """Standard error of the value from that of its coordinate."""
        return error * (self.value(at) if self.logarithm else self.size)


def fitted(residual: RestResidual, effects: Sequence[ModelCorrection]) -> RestResidual:
    """Return what effects leave over where their numbers suit the training records best, with 95 % limits.

    Parameters
    ----------
    residual : RestResidual
        For its records and its noise to start from.
    effects : sequence of ModelCorrection
        At their starts; those of the residual are not kept.

    Returns
    -------
    RestResidual
        With these effects alone.
    """
    if not effects:
        return residual.with_effects(())
    for _ in range(_RENEWED):
        effects, errors = _solved(residual, effects)
        residual = residual.with_effects(effects)
    with_limits = (_limited(e, errors[place], residual) for place, e in enumerate(effects))
    return replace(residual, effects=tuple(with_limits))


def _solved(
    residual: RestResidual, effects: Sequence[ModelCorrection]
) -> tuple[list[ModelCorrection], list[dict[str, float]]]:
    """Effects with the numbers that suit best, and their standard errors."""
    numbers = [
        _Number(place, name, p, p.bounds[0] > 0)
        for place, effect in enumerate(effects)
        for name, p in effect.parameters.items()
        if p.bounds[0] < p.bounds[1]
    ]
    training = [k for k, record in enumerate(residual.records) if not record.settings.hold_out]
    weights = [1 / np.sqrt(residual.noise[k]) for k in training]

    def at(point: FloatArray) -> list[ModelCorrection]:
        found = list(effects)
        for number, value in zip(numbers, point, strict=True):
            changed = {number.name: number.value(float(value))}
            found[number.effect] = found[number.effect].with_values(**changed)
        return found

    def weighted(point: FloatArray) -> FloatArray:
        readings, rows = at(point), []
        for k, weight in zip(training, weights, strict=True):
            record = residual.records[k]
            rows.append((record.measured - sum(record.of(reading) for reading in readings)) * weight)
        return np.concatenate(rows)

    low, high = (np.array([n.to(n.parameter.bounds[end]) for n in numbers]) for end in (0, 1))
    margin = _INSIDE * np.minimum(high - low, 1.0)
    start = np.clip([n.to(n.parameter.value) for n in numbers], low + margin, high - margin)
    found = optimize.least_squares(
        weighted, start, bounds=(low, high), x_scale="jac", max_nfev=_EVALUATIONS, ftol=1e-6
    )
    wander = np.concatenate([residual.variances[k] / residual.noise[k] for k in training])
    deviations = np.sqrt(np.sum(np.linalg.pinv(np.asarray(found.jac), rcond=1e-9) ** 2 * wander, axis=1))
    errors: list[dict[str, float]] = [{} for _ in effects]
    for number, value, deviation in zip(numbers, found.x.tolist(), deviations.tolist(), strict=True):
        errors[number.effect][number.name] = number.error(value, deviation)
    return at(on_ends(found.x, low, high)), errors


def _limited(effect: ModelCorrection, errors: dict[str, float], residual: RestResidual) -> ModelCorrection:
    """The effect with 95 % limits; of what is each record's own those of 95 % of the training records.

    Of one record it is not known by how much others differ.
    """
    limits = dict(limited(effect, errors).parameters)
    for name in per_record_names(effect):
        number = effect.parameters[name]
        step = number.value or number.bounds[1]
        unit = effect.with_values(**{name: step})
        apart = []
        for k, record in enumerate(residual.records):
            if not record.settings.hold_out:
                column, weight = record.of(unit) / step, 1 / residual.variances[k]
                apart.append(float((column * weight) @ residual.remainder[k] / ((column * weight) @ column)))
        half = Z95 * float(np.std(apart, ddof=1)) if len(apart) >= _FEWEST else None
        low, high = (None, None) if half is None else (number.value - half, number.value + half)
        limits[name] = replace(number, low=low, high=high)
    return replace(effect, parameters=limits)
