"""The classical Runge-Kutta method, one to eight samples a step: its cost is linear in the links.

For structures that are too large for dense propagators. Of fourth order. The steps follow the difference
between the slope at the end of a step and that of its last stage; the force of a longer step is the
parabola of the same impulse.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.equations import Program, derivative
from rom.kernels.exponential_integrator import LOSS, PEAK, REACHED, STEPS, Task
from rom.kernels.start import largest_impulse

LONGEST_STEP = 8  # samples
# doubt of a step relative to the peak velocity: while tensions move, and while their rates are below a share
# of their peak; the error is far smaller
GOAL, CALM_GOAL, CALM = 1e-6, 1e-5, 1e-3
ROUGH = 2e-3  # share of the peak velocity up to which a step may smooth the force


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _copy(values: Any, target: Any) -> None:
    """``target[:] = values``, which would compile the text of an error about their shapes, for seconds."""
    for i in range(target.size):
        target[i] = values[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _step(program: Program, p: Any, t: float, h: float, forces: Any, y: Any, work: Any) -> float:
    """One step of length ``h`` from ``y`` to ``work[2]``; the largest doubt of a velocity [m/s].

    ``work[0]`` holds the slope at the start, and at the end that at the end; ``forces`` are those at the
    start, middle and end.
    """
    slope, trial, end, stage_slope = work[0], work[1], work[2], work[3]
    n, doubt = program.size[0], 0.0
    for i in range(y.size):
        end[i], trial[i] = y[i] + h / 6.0 * slope[i], y[i] + 0.5 * h * slope[i]
    for stage in range(1, 4):
        middle = (stage + 1) // 2
        derivative(program, p, t + 0.5 * h * middle, forces[middle], trial, stage_slope, work[4])
        weight = h / 6.0 if stage == 3 else h / 3.0
        reach = h if stage == 2 else 0.5 * h
        for i in range(y.size):
            end[i] += weight * stage_slope[i]
            trial[i] = y[i] + reach * stage_slope[i]
    for i in range(2 * n, 2 * n + program.size[1]):
        end[i] = max(end[i], 0.0)
    derivative(program, p, t + h, forces[2], end, slope, work[4])
    for i in range(n, 2 * n):
        doubt = max(doubt, abs(slope[i] - stage_slope[i]))
    return h / 6.0 * doubt


@njit(cache=True, nogil=True, error_model="numpy")
def _load(task: Task, sample: int, count: int, forces: Any) -> float:
    """Forces on the bodies at the start, middle and end of a step; the impulse [N s] off a straight line."""
    hidden = 0.0
    for u in range(task.driven.size):
        body, start, end = task.driven[u], task.force[u, sample], task.force[u, sample + count]
        total = 0.5 * (start + end)
        for i in range(1, count):
            total += task.force[u, sample + i]
        forces[0, body], forces[2, body] = start, end
        forces[1, body] = 0.25 * (6.0 * total / count - start - end)
        hidden = max(hidden, abs(total - 0.5 * count * (start + end)) / task.rate)
    return hidden


@njit(cache=True, nogil=True, error_model="numpy")
def _scale(task: Task, p: Any, n: int) -> float:
    """Expected peak velocity [m/s]."""
    velocity = 1e-12
    for i in range(n):
        velocity = max(velocity, abs(task.y0[n + i]), 10.0 * abs(task.y0[i]))
    for u in range(task.driven.size):
        velocity = max(velocity, largest_impulse(task.force[u]) / task.rate / p[task.driven[u]])
    return velocity


@njit(cache=True, nogil=True, error_model="numpy")
def _record(program: Program, task: Task, sample: int, y: Any, slope: Any, report: Any, out: Any) -> None:
    """Keep the peaks of a sample, and write it: the state, then the accelerations."""
    n = program.size[0]
    for b in range(program.size[1]):
        report[LOSS] = max(report[LOSS], abs(y[2 * n + b] - task.tensions[b]))
    for i in range(n, 2 * n):
        report[PEAK] = max(report[PEAK], abs(y[i]))
    report[REACHED] = sample + 1.0
    if out.size:
        for i in range(y.size):
            out[i, sample] = y[i]
        for i in range(n):
            out[y.size + i, sample] = slope[n + i]


@njit(cache=True, nogil=True, error_model="numpy")
def _largest(values: Any) -> float:
    largest = 0.0
    for value in values:
        largest = max(largest, abs(value))
    return largest


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    task: Task, first: int, count: int, h: float, start: Any, rates: Any, y: Any, bins: Any, total: Any
) -> None:
    """Add the tension changes at the ``count`` samples from ``first`` on to their bins, by Hermite's cubic.

    ``start`` and ``y`` are the tensions at both ends, ``rates`` (2, tensions) their rates there.
    """
    for i in range(count):
        sample, s = first + i, (i + 1.0) / count
        while bins[0] < task.edges.size - 1 and sample >= task.edges[bins[0] + 1]:
            bins[0] += 1
        if bins[0] == task.edges.size - 1 or sample < task.edges[bins[0]] or sample % task.every != 0:
            continue
        for b in range(y.size):
            rise = y[b] - start[b]
            bend = h * (rates[0, b] * (1.0 - s) - rates[1, b] * s) - rise * (1.0 - 2.0 * s)
            total[bins[0], b] += start[b] - task.tensions[b] + s * rise + s * (1.0 - s) * bend


@njit(cache=True, nogil=True, error_model="numpy")
def integrate_links(program: Program, p: Any, task: Task, report: Any, out: Any) -> Any:
    """As ``exponential.integrate``, without an estimate of the error; sample by sample to fill ``out``.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    task : Task
        What is asked, of one case.
    report : ndarray, shape (6 + states,)
        Filled; errors and sizes of states stay zero.
    out : ndarray, shape (3 bodies + tensions + states, samples)
        Filled, unless it is empty.

    Returns
    -------
    ndarray, shape (bins, tensions)
        Sums over a bin's samples of the changes of tension from the start [N].
    """
    n, tensions = program.size[0], program.size[1]
    y, total = np.zeros(2 * n + tensions + program.size[2]), np.zeros((task.edges.size - 1, tensions))
    work, forces, before = np.zeros((5, y.size)), np.zeros((3, n)), np.zeros((2, y.size))
    bins, held, rates = np.zeros(1, dtype=np.int64), slice(2 * n, 2 * n + tensions), np.zeros((2, tensions))
    _copy(task.y0[: 2 * n], y[: 2 * n])
    _copy(task.y0[2 * n :], y[2 * n + tensions :])
    _copy(task.tensions, y[held])
    report[:] = 0.0
    scale, mobility, sample, count, last = _scale(task, p, n), 1.0 / np.min(p[:n]), 0, 1, task.edges[-1] - 1
    fastest = 0.0
    longest = 1 if out.size else LONGEST_STEP
    _load(task, 0, min(last, 1), forces)
    derivative(program, p, 0.0, forces[0], y, work[0], work[4])
    _record(program, task, 0, y, work[0], report, out)
    while sample < last:
        while count > 1 and (
            sample + count > last or _load(task, sample, count, forces) * mobility > ROUGH * scale
        ):
            count //= 2
        if count == 1:
            _load(task, sample, 1, forces)
        _copy(y, before[0])
        _copy(work[0], before[1])
        _copy(work[0, held], rates[0])
        h = count / task.rate
        goal = scale * (CALM_GOAL if _largest(rates[0]) <= CALM * fastest else GOAL)
        doubt = _step(program, p, sample / task.rate, h, forces, y, work)
        if count > 1 and not doubt <= goal:
            _copy(before[1], work[0])
            count //= 2
            continue
        _copy(work[2], y)
        _copy(work[0, held], rates[1])
        _add(task, sample + 1, count, h, before[0, held], rates, y[held], bins, total)
        fastest = max(fastest, _largest(rates[1]))
        sample += count
        _record(program, task, sample, y, work[0], report, out)
        report[STEPS] += 1.0
        if not np.isfinite(np.sum(y)):
            report[REACHED] = sample
            break
        if doubt * 16.0 < goal and count < longest:
            count *= 2
    return total
