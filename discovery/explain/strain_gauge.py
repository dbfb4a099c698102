"""Readings that follow the motion, and faults of the gauge: what each takes from the fast part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from discovery.decide.explanation import limited, standard_errors
from discovery.explain.at_rest import about_hz
from discovery.explain.tension_gain import Pair, TensionGain, at_bounds
from discovery.residual.fast_tension import Projected, project_disturbance, project_fault, project_readings
from discovery.residual.tension_data import TensionData
from discovery.residual.tension_records import TensionObservation
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Member, ModelCorrection, Motion, Reading, SensorFault
from rom.signals.per_record_parameters import per_record_names

_FINER: Numerical[int] = 17  # sizes between the neighbours of the best one


def explained_by_gauge(data: TensionData, effects: Sequence[Pair]) -> tuple[list[TensionGain], FloatArray]:
    """Gains of effects in the fast part, and its cost by record."""
    readings = [(m, e) for m, e in effects if isinstance(e, Reading)]
    gained: list[TensionGain] = []
    cost = np.zeros(len(data.records))
    if readings:
        rows, places = reading_rows(data, readings)
        cost += [float(row.target @ row.target) for row in rows]
        gained += [_linear(data, effect, rows, places[effect.path]) for _, effect in readings]
    for member, effect in effects:
        if not isinstance(effect, SensorFault):
            continue
        found, before = (
            _line(data, member, effect) if per_record_names(effect) else _fault(data, member, effect)
        )
        cost += before
        gained.append(found)
    return gained, cost


def reading_rows(
    data: TensionData, readings: Sequence[tuple[Member, Reading]]
) -> tuple[list[Projected], Mapping[str, slice]]:
    """Return the fast part of every record, a column for every strength, and the columns of each path."""
    units: list[Reading] = []
    places = {}
    for member, effect in readings:
        first = len(units)
        for name in member.strengths:
            none = effect.with_values(**dict.fromkeys(member.strengths, 0.0))
            unit = none.with_values(**{name: member.strengths[name]})
            units.append(unit)
        places[effect.path] = slice(first, len(units))
    rows = []
    for case, record in enumerate(data.records):
        motion = measured_motion(record)
        rows.append(
            project_readings(record, data.nodes(case), [unit.added(motion) for unit in units], data.criteria)
        )
    return rows, places


def _linear(
    data: TensionData, effect: ModelCorrection, rows: Sequence[Projected], place: slice
) -> TensionGain:
    train = rows[: data.training]
    squares = np.array([row.columns[:, place].T @ row.columns[:, place] for row in train])
    rights = np.array([row.columns[:, place].T @ row.target for row in train])
    inverse = np.linalg.pinv(squares.sum(axis=0))
    found = inverse @ rights.sum(axis=0)
    scores = rights - squares @ found
    error = standard_errors(inverse, scores)
    rests = [row.target - row.columns[:, place] @ found for row in rows]
    gains = [float(row.target @ row.target - rest @ rest) for row, rest in zip(rows, rests, strict=True)]
    names = list(effect.parameters)[: len(found)]
    least = CATALOGUE[effect.name].strengths
    values, errors = {}, {}
    for name, value, spread in zip(names, found, error, strict=True):
        low, high = effect.parameters[name].bounds
        values[name] = float(np.clip(value * least[name], low, high))
        errors[name] = float(spread * least[name])
    with_limits = limited(effect.with_values(**values), errors)
    return TensionGain(with_limits, np.array(gains), at_bounds(with_limits))


def _fault(data: TensionData, member: Member, effect: SensorFault) -> tuple[TensionGain, FloatArray]:
    """A fault of one size for all: the best of a grid, then of a finer one about that."""
    (name,) = member.strengths
    low, high = effect.parameters[name].bounds
    sizes = np.geomspace(0.2 * member.strengths[name], high, 60)
    coarse = np.concatenate([-sizes[::-1], sizes] if low < 0 else [sizes])
    gains, _ = _fault_gains(data, member, effect, coarse)
    best = int(np.argmax(gains[: data.training].sum(axis=0)))
    first, last = (float(coarse[k]) for k in (max(best - 1, 0), min(best + 1, len(coarse) - 1)))
    grid = np.union1d(coarse, np.linspace(first, last, _FINER))
    gains, before = _fault_gains(data, member, effect, grid)
    own = gains[: data.training]
    best = int(np.argmax(own.sum(axis=0)))
    slopes = np.gradient(own, grid, axis=1)
    scores, bend = slopes[:, best] / 2, -np.gradient(slopes.sum(axis=0), grid)[best] / 2
    inverse = np.full((1, 1), 1 / max(bend, 1e-300))
    top, near = grid[best] + scores.sum() * inverse[0, 0], grid[max(best - 1, 0) : best + 2]
    found = effect.with_values(**{name: float(np.clip(top, near[0], near[-1]))})
    with_limits = limited(found, {name: float(standard_errors(inverse, scores[:, None])[0])})
    return TensionGain(with_limits, gains[:, best], at_bounds(with_limits)), before


def _fault_gains(
    data: TensionData, member: Member, effect: SensorFault, sizes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gains of every size, (records, sizes), and costs without a fault, (records,)."""
    rows = fault_rows(data, member, effect, sizes)
    before = np.array([float(row.target @ row.target) for row in rows])
    after = np.array([((row.target[:, None] - row.columns) ** 2).sum(axis=0) for row in rows])
    return before[:, None] - after, before


def fault_rows(data: TensionData, member: Member, effect: SensorFault, sizes: FloatArray) -> list[Projected]:
    """Return the part about the hit of every record, a column for every size of a fault of the gauge.

    Parameters
    ----------
    data : TensionData
        The records.
    member : Member
        What the catalogue says of the fault.
    effect : SensorFault
        The fault.
    sizes : ndarray, shape (sizes,)
        Its strengths.

    Returns
    -------
    list of Projected
        One for each record.
    """
    (name,) = member.strengths
    faults = [effect.with_values(**{name: float(value)}) for value in sizes]
    least = int(np.argmin(np.abs(sizes - data.criteria.gauge_fault * member.strengths[name])))
    return [
        project_fault(record, data.nodes(case), faults, least, data.criteria)
        for case, record in enumerate(data.records)
    ]


def _line(data: TensionData, member: Member, effect: SensorFault) -> tuple[TensionGain, FloatArray]:
    """A disturbance of each record's own size, told before the hit, at one frequency for all."""
    own = per_record_names(effect)
    (inner,) = [name for name in effect.parameters if name not in own]
    grid = np.array([f + d for f in member.inner[inner] for d in about_hz(data.criteria)])
    none = effect.with_values(**dict.fromkeys(own, 0.0))
    gains, coefficients, before = [], [], []
    for case, record in enumerate(data.records):
        zero = np.zeros(len(record.tension))
        groups = [
            [none.with_values(**{name: 1.0, inner: float(f)}).apply(zero, record.rate_hz) for name in own]
            for f in grid
        ]
        row = project_disturbance(record, data.nodes(case), groups, data.criteria)
        assert row.own is not None
        before.append(float(row.target @ row.target))
        sizes = row.own.reshape(len(grid), len(own))
        parts = row.columns.reshape(len(row.target), len(grid), len(own))
        rest = row.target[:, None] - np.einsum("rfo,fo->rf", parts, sizes)
        gains.append(before[-1] - (rest**2).sum(axis=0))
        coefficients.append(sizes)
    table = np.array(gains)
    best = int(np.argmax(table[: data.training].sum(axis=0)))
    mean = np.array(coefficients)[: data.training, best].mean(axis=0)
    values = dict(zip(own, mean.tolist(), strict=True))
    found = effect.with_values(**{inner: float(grid[best])}).with_told_values(**values)
    return TensionGain(found, table[:, best]), np.array(before)


def measured_motion(record: TensionObservation) -> Motion:
    """Motion of a record as readings of its gauge see it."""
    time = np.arange(len(record.tension)) / record.rate_hz
    return Motion(time, record.course.impact_s, record.displacement, record.link_force, record.bodies)
