"""The paper's model as a user would write it for other integrators."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.integrate import solve_ivp

FloatArray = npt.NDArray[np.float64]
RATE_HZ = 19200.0


@njit(cache=True)
def derivative(y: Any, force: float, dy: Any) -> None:
    """He et al. (2025), Eqs. 2, 5, 11, 12 and 13."""
    x, v, T = y[0] - y[1], y[2] - y[3], y[4]
    k = 9.763e5 / (1.0 + math.exp(-0.0608 * (T - 2.003)))
    c = 1853.0 - 1717.4 / (1.0 + math.exp(-0.00922 * T))
    joint = k * x + c * v
    dy[0], dy[1] = y[2], y[3]
    dy[2] = (force - 8.2 * y[2] - 8963.6 * y[0] - joint) / 8.625
    dy[3] = (joint - 2.696 * y[3] - 91800.0 * y[1]) / 0.9888
    gamma = math.exp(math.log(10.0) * (11.79 - 7.974 / (1.0 + math.exp(-0.00362 * T))))
    dy[4] = -gamma * v * v * v * v * T


@njit(cache=True)
def runge_kutta(force: Any, tension: float, substeps: int, states: Any) -> float:
    """Classical fourth order on the samples of the force, for this model alone; fills ``states`` if any."""
    y, trial, total, slope = np.zeros(5), np.zeros(5), np.zeros(5), np.zeros(5)
    y[4] = tension
    h = 1.0 / (RATE_HZ * substeps)
    for sample in range(force.size - 1):
        start, rise = force[sample], force[sample + 1] - force[sample]
        for step in range(substeps):
            for i in range(5):
                trial[i], total[i] = y[i], 0.0
            for stage in range(4):
                derivative(trial, start + rise * (step + 0.5 * ((stage + 1) // 2)) / substeps, slope)
                weight = h / 6.0 if stage in (0, 3) else h / 3.0
                reach = h if stage == 2 else 0.5 * h
                for i in range(5):
                    total[i] += weight * slope[i]
                    trial[i] = y[i] + reach * slope[i]
            for i in range(5):
                y[i] += total[i]
        if states.size:
            for i in range(5):
                states[i, sample + 1] = y[i]
    return float(y[4])


def scipy_final(
    force: FloatArray, tension: float, method: str, *, compiled: bool = True, **options: float
) -> float:
    """``solve_ivp`` with the force by index; no output in between.

    The steps are limited to 0.5 ms so that none passes over the hit. The right-hand side is compiled, or in
    plain Python as most would write it.
    """
    values, dy = force.tolist(), np.zeros(5)
    fill = derivative if compiled else derivative.py_func

    def rhs(t: float, y: FloatArray) -> FloatArray:
        place = t * RATE_HZ
        i = min(int(place), len(values) - 2)
        fill(y, values[i] + (values[i + 1] - values[i]) * (place - i), dy)
        return dy.copy()

    span = (0.0, (force.size - 1) / RATE_HZ)
    start = np.array([0.0, 0.0, 0.0, 0.0, tension])
    solution = solve_ivp(rhs, span, start, method, t_eval=[span[1]], max_step=5e-4, atol=1e-13, **options)
    return float(solution.y[4, -1])


PEERS: dict[str, Callable[[FloatArray, float], float]] = {
    "SciPy LSODA, rtol 1e-8": lambda force, tension: scipy_final(force, tension, "LSODA", rtol=1e-8),
    "SciPy LSODA, rtol 1e-8, equations in Python": lambda force, tension: scipy_final(
        force, tension, "LSODA", compiled=False, rtol=1e-8
    ),
    "SciPy RK45, rtol 1e-6": lambda force, tension: scipy_final(force, tension, "RK45", rtol=1e-6),
    "SciPy DOP853, rtol 1e-8": lambda force, tension: scipy_final(force, tension, "DOP853", rtol=1e-8),
    "compiled Runge-Kutta 4": lambda force, tension: runge_kutta(force, tension, 1, np.empty((0, 0))),
}
