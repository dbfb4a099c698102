"""The force of one link along a prescribed motion, the memory of its effects included."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import invoke, pointer


@njit(cache=True, nogil=True, error_model="numpy")
def _effects(effects: Any, p: Any, first: int, t: float, at: Any, s: Any, ds: Any, spare: Any) -> float:
    """Force of the effects at (x, v, T, k, c); fills the rates of their states."""
    force = 0.0
    for e in range(effects.shape[0]):
        place = effects[e, 2] - first
        state, rates = pointer(s, place), pointer(ds, place)
        numbers, rate = pointer(p, effects[e, 1]), pointer(spare, 0)
        force += invoke(effects[e, 0], (t, at[0], at[1], at[2], at[3], at[4], state, numbers, rates, rate))
    return force


@njit(cache=True, nogil=True, error_model="numpy")
def _between(motion: Any, i: int, share: float, step_s: float, at: Any) -> None:
    """Motion between two samples: x by the cubic of its ends and slopes, v its slope, the rest linear."""
    x0, x1, v0, v1 = motion[0, i], motion[0, i + 1], motion[1, i] * step_s, motion[1, i + 1] * step_s
    u, w = share, 1.0 - share
    at[0] = w * w * (1.0 + 2.0 * u) * x0 + u * u * (1.0 + 2.0 * w) * x1 + u * w * (w * v0 - u * v1)
    at[1] = (6.0 * u * w * (x1 - x0) + w * (1.0 - 3.0 * u) * v0 + u * (3.0 * u - 2.0) * v1) / step_s
    for row in range(2, motion.shape[0]):
        at[row] = w * motion[row, i] + u * motion[row, i + 1]


@njit(cache=True, nogil=True, error_model="numpy")
def force_of_effects(
    effects: Any, p: Any, motion: Any, step_s: float, substeps: int, state: Any, start_s: float
) -> Any:
    """Force (samples,) of one link's effects along its motion, rows x, v, T, k, c, from and to a state.

    The states follow by the classical Runge-Kutta method, ``substeps`` steps from sample to sample; ``state``
    holds those at the last sample when it returns.

    Parameters
    ----------
    effects : ndarray, shape (effects, 3)
        Address, place of the first parameter, place of the first state, one link's in order.
    p : ndarray, shape (coefficients,)
        Parameters.
    motion : ndarray, shape (5, samples)
        x [m], v [m/s], T [N], k [N/m], c [N s/m].
    step_s : float
        Time from sample to sample [s].
    substeps : int
        Steps from sample to sample.
    state : ndarray, shape (states + 1,)
        At the first sample; at the last one afterwards.
    start_s : float
        Time of the first sample [s].

    Returns
    -------
    ndarray, shape (samples,)
        Force [N].
    """
    samples = motion.shape[1]
    out, at, spare, h = np.zeros(samples), np.zeros(5), np.zeros(1), step_s / substeps
    first = effects[0, 2] if effects.shape[0] else 0
    rates, trial = np.zeros((4, state.size)), np.zeros(state.size)
    for i in range(samples):
        for row in range(5):
            at[row] = motion[row, i]
        rates[0] = 0.0
        out[i] = _effects(effects, p, first, start_s + i * step_s, at, state, rates[0], spare)
        if state.size == 1 or i == samples - 1:  # one more number than states, so that none is a valid place
            continue
        for k in range(substeps):
            t = start_s + i * step_s + k * h
            if k:  # the first rate is that which came with the force; `at` is where the step before ended
                rates[0] = 0.0
                _effects(effects, p, first, t, at, state, rates[0], spare)
            for stage in range(1, 4):
                back = 0.5 if stage < 3 else 1.0
                if stage != 2:  # both stages in the middle have one motion
                    _between(motion, i, (k + back) / substeps, step_s, at)
                for j in range(state.size):
                    trial[j] = state[j] + back * h * rates[stage - 1, j]
                rates[stage] = 0.0
                _effects(effects, p, first, t + back * h, at, trial, rates[stage], spare)
            for j in range(state.size):
                state[j] += h / 6.0 * (rates[0, j] + 2.0 * (rates[1, j] + rates[2, j]) + rates[3, j])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def forces_of_effects(effects: Any, p: Any, motion: Any, step_s: float, substeps: int) -> Any:
    """Force (effects, samples) of every effect by itself along one motion, its states zero at the start.

    Rows of ``effects``: address, place of the first parameter, number of states.

    Parameters
    ----------
    effects : ndarray, shape (effects, 3)
        Address, place of the first parameter, number of states.
    p : ndarray, shape (coefficients,)
        Parameters.
    motion : ndarray, shape (5, samples)
        x [m], v [m/s], T [N], k [N/m], c [N s/m].
    step_s : float
        Time from sample to sample [s].
    substeps : int
        Steps from sample to sample.

    Returns
    -------
    ndarray, shape (effects, samples)
        Forces [N].
    """
    out = np.zeros((effects.shape[0], motion.shape[1]))
    for e in range(effects.shape[0]):
        alone = np.zeros((1, 3), dtype=np.int64)
        alone[0, 0], alone[0, 1] = effects[e, 0], effects[e, 1]
        out[e] = force_of_effects(alone, p, motion, step_s, substeps, np.zeros(effects[e, 2] + 1), 0.0)
    return out
