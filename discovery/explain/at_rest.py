"""Faults of sensors that show while nothing moves, told by what precedes the hits: an offset, the mains.

The noise floor comes from there too (`rom.identification.noise_spectrum`), so what is always there would
pass for noise.

    theta_i = (C'C)^-1 C' y_i,   gain_i = (theta_i' theta_i - |theta_i - found_i|^2) / s^2

y_i: samples of record i before its hit; C: what the fault of strength one adds to them. A number that all
records share is ``found`` in the training records, and s is what it scatters by from one to the next. One of
each record's own, such as the phase of the mains, is ``found`` in the first half of these samples and judged
in the second, and s is what the same fault finds where there is none: beside its frequency, which all
records share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import optimize

from discovery.criteria.tension import Tension
from discovery.decide.explanation import Explanation, limited
from discovery.explain.motion import motion_channels
from discovery.options import Options
from discovery.residual.output_error import MEDIAN_SQUARE, WhitenedResidual
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, ModelCorrection, SensorFault, candidates_of
from rom.signals.per_record_parameters import as_measured, per_record_names, quiet_samples

_STEP_HZ: Numerical[float] = 0.05
_BESIDE_STEP_HZ: Numerical[float] = 2.0


@dataclass(frozen=True, eq=False)
class _Still:
    """Samples of a channel before the hits, (records, samples), as many of each record as all have."""

    files: tuple[str, ...]
    training: npt.NDArray[np.bool_]
    samples: FloatArray
    rate_hz: float


def explain(residual: WhitenedResidual, options: Options) -> tuple[Explanation, ...]:
    """Return what every fault that shows at rest explains, the noise of all records before the hits known.

    Parameters
    ----------
    residual : WhitenedResidual
        Traces of all records; faults that its model holds are taken out of them.
    options : Options
        Criteria.
    """
    model, found, criteria = residual.baseline.model, [], options.criteria.tension
    for member, effect in candidates_of(SensorFault, model, motion_channels(residual)):
        if not _shows(member, effect):
            continue
        still = _before_hits(residual, effect.channel, criteria.quiet_s)
        if still is not None and still.training.sum() >= criteria.quiet_records:
            fitted = (
                _of_each(member, effect, still, criteria)
                if per_record_names(effect)
                else _of_all(member, effect, still)
            )
            if _is_material(fitted.effect, member, residual, criteria):
                found.append(fitted)
    return tuple(found)


def about_hz(criteria: Tension) -> FloatArray:
    """Distances from its nominal frequency at which a line is looked for [Hz], (frequencies,)."""
    steps = round(criteria.line_reach_hz / _STEP_HZ)
    return np.asarray(_STEP_HZ * np.arange(-steps, steps + 1), dtype=np.float64)


def _beside_hz(criteria: Tension) -> FloatArray:
    """Distances from a line at which noise alone is seen [Hz], on either side of it."""
    above = np.arange(criteria.beside_from_hz, criteria.beside_to_hz + _BESIDE_STEP_HZ / 2, _BESIDE_STEP_HZ)
    return np.concatenate([-above[::-1], above])


def _shows(member: Member, effect: SensorFault) -> bool:
    """Whether a channel at rest would show the fault."""
    zero = np.zeros(64)
    return bool(not effect.other and np.any(effect.with_values(**member.strengths).apply(zero, 1e3)))


def _is_material(
    fault: ModelCorrection, member: Member, residual: WhitenedResidual, criteria: Tension
) -> bool:
    """Whether a fault is more than any amplifier has, and more than next to nothing of the weakest hit."""
    least = criteria.fault_at_rest
    if all(abs(fault.parameters[name].value) < least * size for name, size in member.strengths.items()):
        return False
    quantity, _, body = fault.enters.partition(":")[2].partition("_")
    if quantity != "force":
        return True
    peaks = [np.abs(t.measurement.force[body]).max() for t in residual.traces if body in t.measurement.force]
    size = np.linalg.norm([fault.parameters[name].value for name in per_record_names(fault)])
    weakest = min((peak for peak in peaks if peak > 0), default=0.0)
    return bool(size > criteria.fault_of_hit * weakest)


def _before_hits(residual: WhitenedResidual, channel: str, shortest_s: float) -> _Still | None:
    """Samples of a channel; not of records that show nothing there, not even noise."""
    found = []
    for trace in residual.traces:
        samples, rate_hz = as_measured(trace.measurement, channel)
        before = np.asarray(samples[: quiet_samples(trace.measurement, rate_hz)], dtype=np.float64)
        if len(before) >= shortest_s * rate_hz and np.ptp(before) > 0:
            found.append((trace, before))
    if len({trace.measurement.rate_hz for trace, _ in found}) != 1:
        return None
    shortest = min(len(samples) for _, samples in found)
    return _Still(
        tuple(trace.settings.file for trace, _ in found),
        np.array([not trace.settings.hold_out for trace, _ in found]),
        np.stack([samples[:shortest] for _, samples in found]),
        found[0][0].measurement.rate_hz,
    )


def _columns(fault: SensorFault, units: Mapping[str, float], still: _Still) -> FloatArray:
    """What a fault of strength one adds, a row for each of its numbers, (numbers, samples)."""
    none, zero = fault.with_values(**dict.fromkeys(units, 0.0)), np.zeros(still.samples.shape[1])
    return np.stack([none.with_values(**{n: s}).apply(zero, still.rate_hz) / s for n, s in units.items()])


def _coefficients(
    fault: SensorFault, units: Mapping[str, float], still: _Still, part: slice = slice(None)
) -> FloatArray:
    """Numbers of a fault that suit the samples of a part best, by least squares, (records, numbers)."""
    return np.asarray(still.samples[:, part] @ np.linalg.pinv(_columns(fault, units, still)[:, part]))


def _of_all(member: Member, effect: SensorFault, still: _Still) -> Explanation:
    table = _coefficients(effect, member.strengths, still)
    train = table[still.training]
    mean, scatter = train.mean(axis=0), np.maximum(train.std(axis=0, ddof=1), 1e-300)
    before, after = ((((table - at) / scatter) ** 2).sum(axis=1) for at in (0.0, mean))
    values = dict(zip(member.strengths, mean.tolist(), strict=True))
    errors = dict(zip(member.strengths, (scatter / np.sqrt(len(train))).tolist(), strict=True))
    return _explanation(member, limited(effect.with_told_values(**values), errors), still, before, after)


def _of_each(member: Member, effect: SensorFault, still: _Still, criteria: Tension) -> Explanation:
    own = per_record_names(effect)
    (inner,) = [name for name in effect.parameters if name not in own]
    level = replace(still, samples=still.samples - still.samples.mean(axis=1, keepdims=True))
    middle = still.samples.shape[1] // 2
    units = {name: member.strengths[name] for name in own}

    def lines(of: _Still, at: float, part: slice = slice(None)) -> FloatArray:
        return _coefficients(effect.with_values(**{inner: at}), units, of, part)

    def without(at: float) -> FloatArray:
        return level.samples - lines(level, at) @ _columns(effect.with_values(**{inner: at}), units, still)

    def remaining(at: float) -> float:
        return float((without(at).var(axis=1) / variance)[still.training].sum())

    variance = level.samples.var(axis=1)
    grid = [float(nominal + step) for nominal in member.inner[inner] for step in about_hz(criteria)]
    rough = min(grid, key=remaining)
    variance = without(rough).var(axis=1)
    reach = (rough - _STEP_HZ, rough + _STEP_HZ)
    at = float(optimize.minimize_scalar(remaining, bounds=reach, method="bounded").x)
    bare = replace(level, samples=without(at))
    ends, far = slice(middle, None), _beside_hz(criteria)
    beside = np.concatenate([lines(bare, at + hz, ends) for hz in far], axis=1)
    noise = np.median(beside**2, axis=1) / MEDIAN_SQUARE
    first, second = (lines(level, at, part) for part in (slice(middle), ends))
    before, after = ((rows**2).sum(axis=1) / noise for rows in (second, second - first))
    typical = np.sqrt((first[still.training] ** 2).mean(axis=0))  # a phase is each record's own
    values = dict(zip(own, typical.tolist(), strict=True))
    fault = effect.with_values(**{inner: at}).with_told_values(**values)
    return _explanation(member, fault, still, before, after)


def _explanation(
    member: Member, effect: ModelCorrection, still: _Still, before: FloatArray, after: FloatArray
) -> Explanation:
    return Explanation(
        effect,
        dict(zip(still.files, before.tolist(), strict=True)),
        dict(zip(still.files, after.tolist(), strict=True)),
        dict.fromkeys(still.files, len(member.strengths)),
        frozenset(file for file, training in zip(still.files, still.training, strict=True) if not training),
        len(effect.parameters) - len(per_record_names(effect)),
        basis=f"what {effect.enters.partition(':')[2]} shows of it before the hits",
    )
