"""The classical Runge-Kutta method from sample to sample: its cost is linear in the number of links.

For structures that are too large for dense propagators. Of fourth order; no step crosses a knot of the force.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.equations import Program, derivative
from rom.kernels.exponential import LOSS, PEAK, REACHED, STEPS, Task


@njit(cache=True, nogil=True, error_model="numpy")
def _step(program: Program, p: Any, t: float, h: float, forces: Any, y: Any, work: Any) -> None:
    """One step of length ``h`` in place; ``forces`` are those at its start, middle and end."""
    slope, trial, total = work[0], work[1], work[2]
    for i in range(y.size):
        total[i], trial[i] = 0.0, y[i]
    for stage in range(4):
        middle = (stage + 1) // 2
        derivative(program, p, t + 0.5 * h * middle, forces[middle], trial, slope, work[3])
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        reach = h if stage == 2 else 0.5 * h
        for i in range(y.size):
            total[i] += weight * slope[i]
            trial[i] = y[i] + reach * slope[i]
    for i in range(y.size):
        y[i] += total[i]
    for i in range(2 * program.size[0], 2 * program.size[0] + program.size[1]):
        y[i] = max(y[i], 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _load(task: Task, sample: int, forces: Any) -> None:
    """Forces on the bodies at the start, middle and end of the step behind a sample."""
    after = min(sample + 1, task.force.shape[1] - 1)
    for u in range(task.driven.size):
        body, start, end = task.driven[u], task.force[u, sample], task.force[u, after]
        forces[0, body], forces[1, body], forces[2, body] = start, 0.5 * (start + end), end


@njit(cache=True, nogil=True, error_model="numpy")
def _write(program: Program, p: Any, t: float, forces: Any, y: Any, work: Any, out: Any, sample: int) -> None:
    """Write a sample: the state, then the accelerations."""
    derivative(program, p, t, forces[0], y, work[0], work[3])
    for i in range(y.size):
        out[i, sample] = y[i]
    for i in range(program.size[0]):
        out[y.size + i, sample] = work[0, program.size[0] + i]


@njit(cache=True, nogil=True, error_model="numpy")
def integrate_links(program: Program, p: Any, task: Task, report: Any, out: Any) -> Any:
    """As ``exponential.integrate``, without an estimate of the error."""
    n, tensions = program.size[0], program.size[1]
    y = np.zeros(2 * n + tensions + program.size[2])
    total, bin = np.zeros((task.edges.size - 1, tensions)), 0
    work, forces = np.zeros((4, y.size)), np.zeros((3, n))
    y[: 2 * n] = task.y0
    y[2 * n : 2 * n + tensions] = task.tensions
    report[:] = 0.0
    samples = task.edges[-1]
    for sample in range(samples):
        while sample >= task.edges[bin + 1]:
            bin += 1
        _load(task, sample, forces)
        if out.size:
            _write(program, p, sample / task.rate, forces, y, work, out, sample)
        for b in range(tensions):
            change = y[2 * n + b] - task.tensions[b]
            report[LOSS] = max(report[LOSS], abs(change))
            if sample >= task.edges[bin] and sample % task.every == 0:
                total[bin, b] += change
        for i in range(n, 2 * n):
            report[PEAK] = max(report[PEAK], abs(y[i]))
        report[REACHED] = sample + 1.0
        if sample + 1 < samples:
            _step(program, p, sample / task.rate, 1.0 / task.rate, forces, y, work)
            report[STEPS] += 1.0
            if not np.isfinite(np.sum(y)):
                break
    return total
