"""Numbers of effects that are each record's own, such as the phase of the mains, from before its impact.

``signal = level + sum of b_i column_i + noise``, by least squares over the samples before the impact, where
the columns are what an effect of strength one does to the signal; all such numbers enter linearly. What comes
out is drawn towards the model's own value b_0. Where the model tells by how much records differ, in limits
that hold 95 % of them, ``b_0 + S (S + C)^-1 (b - b_0)``, S their variance and C that of the noise in b; else
as far as noise alone could have moved it, ``b_0 + max(0, 1 - n / chi^2) (b - b_0)``, ``chi^2 = (b - b_0)'
C^-1 (b - b_0)`` for n numbers. Where a record has nothing before an impact the model's values stand: nothing
after it is looked at, on training records neither, so that errors mean the same on both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE
from rom.model.effect import Effect, ModelCorrection, Motion, Reading, SensorFault
from rom.model.laws import Z95
from rom.model.model import Model
from rom.signals.processing import Measurement
from rom.signals.sensor_correction import corrected

_Kind = TypeVar("_Kind", bound=ModelCorrection)
_GUARD_S: Numerical[float] = 2e-3  # before the impact: its onset is known no better
_FEWEST: Numerical[int] = 64  # samples before the impact
_BATCHES: Numerical[int] = 8
_STILL: Numerical[float] = 1e-9  # share of the largest singular value below which a direction is not told


@dataclass(frozen=True)
class OwnState:
    """State of the bodies at a record's first sample, by body [m], [m/s]."""

    displacement: Mapping[str, float]
    velocity: Mapping[str, float]


def own_numbers(
    model: Model, measurement: Measurement, tension: Mapping[str, float] | None
) -> tuple[Model, OwnState | None]:
    """Return the model with a record's own numbers, and the motion it had at its first sample.

    The motion is estimated only with a force that goes on before the impact; None: the bodies rest.

    Parameters
    ----------
    model : Model
        The model as it is in the record: of the bodies that move.
    measurement : Measurement
        The record as processed, its faults uncorrected.
    tension : mapping of str to float
        Tension [N] by bolted link at which the bodies move before the impact.
    """
    if measurement.impact_s is None:
        return model, None
    for effect in model.effects:
        if per_record_names(effect) and isinstance(effect, SensorFault):
            model = _of_fault(model, measurement, effect)
    state = None
    seen = corrected(measurement, model)
    for effect in model.effects:
        if per_record_names(effect) and isinstance(effect, Reading):
            model = _of_reading(model, seen, effect)
        elif per_record_names(effect) and isinstance(effect, Effect):
            model, state = _of_force(model, seen, effect, tension)
    return model, state


def per_record_names(effect: ModelCorrection) -> tuple[str, ...]:
    """Return the parameters of an effect that are each record's own."""
    return CATALOGUE[effect.name].by_record if effect.name in CATALOGUE else ()


def quiet_samples(measurement: Measurement, rate_hz: float) -> int:
    """Return the number of samples before the impact, at a rate [Hz]."""
    return max(int(((measurement.impact_s or 0.0) - _GUARD_S) * rate_hz), 0)


def as_measured(measurement: Measurement, channel: str) -> tuple[FloatArray, float]:
    """Return samples and rate [Hz] of a channel as it was measured; none where the record does not have it.

    Of a hammer's force those before the impact.
    """
    if channel == "tension" and measurement.tension is not None:
        return measurement.tension.samples, measurement.tension.rate_hz
    for body, motion in measurement.motion.items():
        if channel == f"{motion.kind}_{body}":
            return motion.samples, measurement.rate_hz
    for body, still in measurement.still_force.items():
        if channel == f"force_{body}":
            return still, measurement.rate_hz
    return np.zeros(0), measurement.rate_hz


def _of_fault(model: Model, measurement: Measurement, fault: SensorFault) -> Model:
    samples, rate = as_measured(measurement, fault.channel)
    quiet = samples[: quiet_samples(measurement, rate)]
    if len(quiet) < _FEWEST:
        return model
    if np.ptp(quiet) == 0:  # a channel that is gated shows nothing of a fault, whatever its size
        return _with(model, fault, np.zeros(len(per_record_names(fault))))
    true = np.zeros(len(quiet))
    columns = np.stack([unit.apply(true, rate) - none.apply(true, rate) for unit, none in _units(fault)])
    return _with(model, fault, _fit(quiet[None], _per_one(fault, columns), _own(fault), _spread(fault)))


def _of_reading(model: Model, measurement: Measurement, reading: Reading) -> Model:
    tension = measurement.tension
    count = 0 if tension is None else quiet_samples(measurement, tension.rate_hz)
    if tension is None or count < _FEWEST:
        return model
    rest = at_rest(count, tension.rate_hz, measurement)
    columns = np.stack([unit.added(rest) - none.added(rest) for unit, none in _units(reading)])
    found = _fit(tension.samples[None, :count], _per_one(reading, columns), _own(reading), _spread(reading))
    return _with(model, reading, found)


def _of_force(
    model: Model, measurement: Measurement, effect: Effect, tension: Mapping[str, float] | None
) -> tuple[Model, OwnState | None]:
    """Columns are simulations before the impact: of each number, and of each body's displacement and velocity
    at the first sample, which the record has as well.
    """
    count, bodies = quiet_samples(measurement, measurement.rate_hz), model.structure.body_names
    if count < _FEWEST or not measurement.motion:
        return model, None
    silent = model.with_values({f"{effect.path}.{name}": 0.0 for name in per_record_names(effect)})
    force = {bodies[0]: np.zeros(count)}
    rest = dict(model.equilibrium(tension) or dict.fromkeys(bodies, 0.0))

    def shown(of: Model, displacement: Mapping[str, float], velocity: Mapping[str, float]) -> FloatArray:
        response = of.simulate(force, measurement.rate_hz, tension, displacement, velocity)
        return np.stack([getattr(response, m.kind)[body] for body, m in measurement.motion.items()])

    still = shown(silent, rest, {})
    units = _least(effect)
    columns = [
        (shown(silent.with_values({f"{effect.path}.{name}": unit}), rest, {}) - still) / unit
        for name, unit in units.items()
    ]
    size = {"displacement": 1e-7, "velocity": 1e-5}
    columns += [
        (shown(silent, {**rest, body: rest[body] + size["displacement"]}, {}) - still) / size["displacement"]
        for body in bodies
    ]
    columns += [(shown(silent, rest, {body: size["velocity"]}) - still) / size["velocity"] for body in bodies]
    signals = np.stack([m.samples[:count] for m in measurement.motion.values()]) - still
    if not np.isfinite(signals).all() or not np.isfinite(columns).all():  # the model diverges as it is
        return model, None
    own = np.concatenate([_own(effect), np.zeros(2 * len(bodies))])
    found = _fit(signals, np.stack(columns), own, _spread(effect), drawn=len(units))
    displacement, velocity = np.split(found[len(units) :], 2)
    state = OwnState(
        {body: rest[body] + float(value) for body, value in zip(bodies, displacement, strict=True)},
        dict(zip(bodies, velocity.tolist(), strict=True)),
    )
    return _with(model, effect, found[: len(units)]), state


def at_rest(count: int, rate_hz: float, measurement: Measurement) -> Motion:
    """Return the motion of bodies at rest, at the first samples of a tension.

    Parameters
    ----------
    count : int
        Number of samples of the tension.
    rate_hz : float
        Sampling rate [Hz].
    measurement : Measurement
        The record as processed.

    Returns
    -------
    Motion
        The motion.
    """
    time, still = np.arange(count) / rate_hz, np.zeros(count)
    bodies = dict.fromkeys(measurement.motion, still) or {"": still}
    return Motion(time, measurement.impact_s or 0.0, still, still, bodies)


def _own(effect: ModelCorrection) -> FloatArray:
    """The model's values of a record's own numbers."""
    return np.array([effect.parameters[name].value for name in per_record_names(effect)])


def _spread(effect: ModelCorrection) -> FloatArray | None:
    """Standard deviations of a record's own numbers about the model's; None where it does not tell them."""
    limits = [
        (effect.parameters[name].low, effect.parameters[name].high) for name in per_record_names(effect)
    ]
    told = [(high - low) / (2 * Z95) for low, high in limits if low is not None and high is not None]
    return np.array(told) if len(told) == len(limits) else None


def _units(effect: _Kind) -> list[tuple[_Kind, _Kind]]:
    """The effect with each of the record's own numbers at its least strength, and with all of them zero."""
    none = effect.with_values(**dict.fromkeys(per_record_names(effect), 0.0))
    return [(none.with_values(**{name: value}), none) for name, value in _least(effect).items()]


def _per_one(effect: ModelCorrection, columns: FloatArray) -> FloatArray:
    """Columns (numbers, 1, samples) of numbers of one, from those of the least strengths."""
    return np.asarray(columns[:, None] / np.array(list(_least(effect).values()))[:, None, None])


def _least(effect: ModelCorrection) -> Mapping[str, float]:
    strengths = CATALOGUE[effect.name].strengths
    return {name: strengths[name] for name in per_record_names(effect)}


def _with(model: Model, effect: ModelCorrection, found: FloatArray) -> Model:
    values = {}
    for name, value in zip(per_record_names(effect), found, strict=True):
        low, high = effect.parameters[name].bounds
        values[f"{effect.path}.{name}"] = float(np.clip(value, low, high))
    return model.with_values(values)


def _fit(
    signals: FloatArray,
    columns: FloatArray,
    own: FloatArray,
    spread: FloatArray | None,
    drawn: int | None = None,
) -> FloatArray:
    """Coefficients of columns (numbers, channels, samples) in signals (channels, samples), a level each.

    The first ``drawn`` are drawn towards ``own``, about which they differ by ``spread``. Noise that is not
    white counts for as many times its variance as the means of batches tell.
    """
    signals = signals - signals.mean(axis=1, keepdims=True)
    columns = columns - columns.mean(axis=2, keepdims=True)
    weight = 1 / np.maximum(signals.std(axis=1), 1e-300)
    table = (columns * weight[:, None]).reshape(len(columns), -1).T
    target = (signals * weight[:, None]).ravel()
    scale = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    left, singular, right = np.linalg.svd(table / scale, full_matrices=False)
    told = singular > _STILL * singular.max()
    inverse = np.where(told, 1 / np.where(told, singular, 1.0), 0.0)
    found = np.asarray(right.T @ (inverse * (left.T @ target)) / scale)
    residual = (target - table @ found).reshape(signals.shape)
    factors = (right.T * inverse) / scale[:, None]
    covariance = np.asarray(factors @ factors.T) * _noise(residual)
    n = len(own) if drawn is None else drawn
    away = found[:n] - own[:n]
    if spread is not None:
        variance = np.diag(spread**2)
        kept = variance @ np.linalg.pinv(variance + covariance[:n, :n]) @ away
        return np.concatenate([own[:n] + kept, found[n:]])
    chi_square = float(away @ np.linalg.pinv(covariance[:n, :n]) @ away)
    share = max(0.0, 1 - n / chi_square) if chi_square > 0 else 0.0
    return np.concatenate([own[:n] + share * away, found[n:]])


def _noise(residual: FloatArray) -> float:
    """Variance of the residual (channels, samples), as white noise of its slow part would have it."""
    size = residual.shape[1] // _BATCHES
    means = residual[:, : size * _BATCHES].reshape(len(residual), _BATCHES, size).mean(axis=2)
    return float(max(residual.var(), size * means.var()))
