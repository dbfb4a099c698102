"""Few numbers of the fast part of a record's tension.

The fast part is what the measured tension has beyond a course that was simulated with the record's own rate.
It is projected on a few columns, each what one effect would add, after directions that a wrong course or slow
noise could take are projected out; whitened by the gauge's noise before the hit, what is left are numbers of
unit variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import integrate, linalg

from discovery.criteria.tension import Tension
from discovery.residual.tension_records import TensionObservation
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import SensorFault

_LEAD_SHARE: Numerical[float] = 0.01  # of the time before a hit: what is later is not quiet
# any loss is nearly a sum of these
_LOSSES_S: Numerical[tuple[float, ...]] = (1e-3, 4e-3, 1.5e-2, 5e-2)
_OTHER_POWER: Numerical[float] = 2.0  # of |v|, beside the simulated quartic one; two or three cost more skew
_SAME: Numerical[float] = 1e-8  # of the largest singular value: directions that are none


@dataclass(frozen=True, eq=False)
class Projected:
    """Whitened numbers of one record: `target`, and what an effect adds, a column for every trial.

    `own` are the record's own coefficients of the columns from before the hit, where it has such.
    """

    target: FloatArray
    columns: FloatArray
    own: FloatArray | None = None


def rest_of(record: TensionObservation, nodes: FloatArray) -> FloatArray:
    """Measured tension less the course simulated with the record's own rate [N], at all samples."""
    time = np.arange(len(record.tension)) / record.rate_hz - record.course.impact_s
    change = np.interp(time, nodes[0], nodes[5]) - nodes[5, 0]
    return np.asarray(record.tension - record.course.initial - change)


def _window(record: TensionObservation, start_s: float, end_s: float) -> slice:
    start_s, end_s = start_s * record.times, end_s * record.times
    first = int((record.course.impact_s + start_s) * record.rate_hz)
    return slice(
        max(first, 0), min(int((record.course.impact_s + end_s) * record.rate_hz), len(record.tension))
    )


def project_readings(
    record: TensionObservation, nodes: FloatArray, columns: Sequence[FloatArray], criteria: Tension
) -> Projected:
    """Project the fast part on readings of strength one that follow the motion.

    Parameters
    ----------
    record : TensionObservation
        The record.
    nodes : ndarray, shape (6, nodes)
        Its frozen motion, (t x v F D T).
    columns : sequence of ndarray, shape (samples,)
        The readings [N].
    criteria : Tension
        Window, slowest frequency, and the share of the peaks that is no finding.

    Returns
    -------
    Projected
        The whitened tension, and a column for every trial.
    """
    found = _after_hit(record, nodes, columns, criteria)
    peaks = [np.abs(column[_window(record, 0.0, criteria.fast_window_s)]).max() for column in columns]
    share = criteria.fast_peak * np.sqrt(record.white) / np.maximum(peaks, 1e-300)
    return _allowing(found, found.columns * share)


def _after_hit(
    record: TensionObservation, nodes: FloatArray, columns: Sequence[FloatArray], criteria: Tension
) -> Projected:
    window = _window(record, 0.0, criteria.fast_window_s)
    time = (np.arange(window.start, window.stop) / record.rate_hz) - record.course.impact_s
    length = float(time[-1])
    order = np.arange(int(2 * criteria.slowest_hz / record.times * length) + 1)
    slow = np.cos(np.pi * np.outer(time / length, order))
    losses = np.exp(-np.outer(time / record.times, 1 / np.array(_LOSSES_S)))
    course = np.interp(time, nodes[0], nodes[5])[:, None]
    target, rows = rest_of(record, nodes)[window], np.stack([c[window] for c in columns], axis=1)
    return _projected(target, rows, np.hstack([slow, losses, course]), record.white)


def _allowing(found: Projected, allowed: FloatArray) -> Projected:
    """Whiten for what each record may have, columns of one standard deviation: no gauge is ideal."""
    root = np.linalg.cholesky(np.eye(len(found.target)) + allowed @ allowed.T)
    return Projected(np.linalg.solve(root, found.target), np.linalg.solve(root, found.columns))


def project_fault(
    record: TensionObservation,
    nodes: FloatArray,
    faults: Sequence[SensorFault],
    least: int,
    criteria: Tension,
) -> Projected:
    """Project the part about the hit on what faults would make of the course, a column for every fault.

    Parameters
    ----------
    record : TensionObservation
        The record.
    nodes : ndarray, shape (6, nodes)
        Its frozen motion, (t x v F D T).
    faults : sequence of SensorFault
        One fault of several sizes.
    least : int
        Place of the size that is no finding.
    criteria : Tension
        Window about the hit, and directions that are kept.

    Returns
    -------
    Projected
        The whitened tension, and a column for every trial.
    """
    window = _window(record, -criteria.fault_lead_s, criteria.fault_window_s)
    time = (np.arange(window.start, window.stop) / record.rate_hz) - record.course.impact_s
    course = np.interp(time, nodes[0], nodes[5])
    columns = np.stack([fault.apply(course, record.rate_hz) - course for fault in faults], axis=1)
    x = record.displacement[window]
    other = np.interp(time, nodes[0], _course_of_another_power(nodes))
    nuisance = np.stack([np.ones_like(time), course, other, x, x**2], axis=1)
    rank = int(criteria.fault_directions)
    found = _projected(rest_of(record, nodes)[window], columns, nuisance, record.white, rank)
    return _allowing(found, found.columns[:, [least]])


def _course_of_another_power(nodes: FloatArray) -> FloatArray:
    """Course [N] of a rate in proportion to another power of the velocity, with the same loss in the end.

    Where such a law holds, the measured tension falls sooner or later than the simulated one, as if its gauge
    were not on time.
    """
    time, velocity, tension = nodes[0], np.abs(nodes[2]), np.maximum(nodes[5], 1e-3 * nodes[5, 0])
    passed = integrate.cumulative_trapezoid(velocity**_OTHER_POWER, time, initial=0)
    share = passed / max(passed[-1], np.finfo(float).tiny)
    return np.asarray(tension[0] * (tension[-1] / tension[0]) ** share)


def project_disturbance(
    record: TensionObservation,
    nodes: FloatArray,
    groups: Sequence[Sequence[FloatArray]],
    criteria: Tension,
) -> Projected:
    """Project the part after the hit on groups of columns, with coefficients of each group from before it.

    Drawn towards zero as far as noise alone could have moved them.

    Parameters
    ----------
    record : TensionObservation
        The record.
    nodes : ndarray, shape (6, nodes)
        Its frozen motion, (t x v F D T).
    groups : sequence of sequence of ndarray, shape (samples,)
        Columns of each group [N].
    criteria : Tension
        Window and slowest frequency.

    Returns
    -------
    Projected
        The whitened tension, its columns, and the coefficients of each group from before the hit.
    """
    after = _after_hit(record, nodes, [unit for group in groups for unit in group], criteria)
    window = _window(record, -10.0, -min(2e-3, _LEAD_SHARE * record.course.impact_s))
    target = record.tension[window] - record.tension[window].mean()
    own = []
    for group in groups:
        rows = np.stack([unit[window] for unit in group], axis=1)
        rows = rows - rows.mean(axis=0)
        found = np.linalg.lstsq(rows, target, rcond=None)[0]
        chi_square = float(((rows @ found) ** 2).sum()) / record.white
        own.append(found * max(0.0, 1 - len(group) / max(chi_square, 1e-300)))
    return replace(after, own=np.concatenate(own))


def _projected(
    target: FloatArray, columns: FloatArray, nuisance: FloatArray, white: float, rank: int | None = None
) -> Projected:
    scale = np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300)
    basis = linalg.orth(nuisance / scale, rcond=1e-9)
    left = columns - basis @ (basis.T @ columns)
    sizes = np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    main, singular, _ = np.linalg.svd(left / sizes, full_matrices=False)
    determined = singular > _SAME * singular[0]
    main = main[:, determined][:, :rank]
    rest = target - basis @ (basis.T @ target)
    noise = np.sqrt(white)
    return Projected(main.T @ rest / noise, main.T @ left / noise)
