"""The classical Runge-Kutta method on the force's own samples, for any structure and any effect."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.equations import Program, derivative


@njit(cache=True, nogil=True, error_model="numpy")
def _step(program: Program, p: Any, t: float, h: float, forces: Any, y: Any, work: Any) -> None:
    """One step of length ``h`` in place; ``forces`` are those at its start, middle and end."""
    slope, trial, total = work
    total[:] = 0.0
    trial[:] = y
    for stage in range(4):
        middle = (stage + 1) // 2
        derivative(program, p, t + 0.5 * h * middle, forces[middle], trial, slope)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        reach = h if stage == 2 else 0.5 * h
        for i in range(y.size):
            total[i] += weight * slope[i]
            trial[i] = y[i] + reach * slope[i]
    n, tensions, _ = program.size
    for i in range(y.size):
        y[i] += total[i]
    for i in range(2 * n, 2 * n + tensions):
        y[i] = max(y[i], 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def runge_kutta(
    program: Program, p: Any, rate: float, driven: Any, force: Any, y0: Any, substeps: int, states: Any
) -> Any:
    """Integrate over a record with ``substeps`` steps a sample; ``states`` is filled, shape (samples, state).

    Returns the number of samples reached; fewer than there are where the state is no longer finite.
    """
    n = program.size[0]
    y, h = np.zeros(y0.size + 1), 1.0 / (rate * substeps)
    y[:-1] = y0
    work = np.zeros((3, y.size))
    forces = np.zeros((3, n))
    states[0] = y0
    for sample in range(force.shape[1] - 1):
        for step in range(substeps):
            for row, body in enumerate(driven):
                start, slope = force[row, sample], force[row, sample + 1] - force[row, sample]
                for stage in range(3):
                    forces[stage, body] = start + slope * (step + 0.5 * stage) / substeps
            _step(program, p, sample / rate + step * h, h, forces, y, work)
        states[sample + 1] = y[:-1]
        if not np.isfinite(np.sum(y)):
            return sample + 1
    return force.shape[1]


@njit(cache=True, nogil=True, error_model="numpy")
def accelerations(program: Program, p: Any, rate: float, driven: Any, force: Any, states: Any) -> Any:
    """Accelerations of the bodies at every sample [m/s2], shape (samples, bodies)."""
    n = program.size[0]
    result = np.empty((states.shape[0], n))
    y, dy, forces = np.zeros(states.shape[1] + 1), np.zeros(states.shape[1] + 1), np.zeros(n)
    for sample in range(states.shape[0]):
        for row, body in enumerate(driven):
            forces[body] = force[row, sample]
        y[:-1] = states[sample]
        derivative(program, p, sample / rate, forces, y, dy)
        result[sample] = dy[n : 2 * n]
    return result
