"""The force of one link along a prescribed motion, the memory of its effects included."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import invoke, pointer

_ALLOWED = 1e-6  # error of a step, of what its state has reached
_SHORTEST = 1 / 1024  # step, of the time between two samples
_FINE_STEPS, _LEAST_FINE = 8, 1000  # a sample so far, and at least; then the shortest is as below
_COARSE = 1 / 8


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
def _step(
    effects: Any, p: Any, motion: Any, i: int, share: float, size: float, step_s: float, start_s: float,
    state: Any, rates: Any, trial: Any, at: Any, spare: Any,
) -> float:  # fmt: skip
    """Try one step of Bogacki and Shampine's method over a share of the time between two samples.

    From ``rates[0]`` at its start to ``trial`` and ``rates[3]`` at its end; the force there is returned.
    """
    first, h, force = effects[0, 2], size * step_s, 0.0
    for stage in range(1, 4):
        u = share + size * (0.5 if stage == 1 else 0.75 if stage == 2 else 1.0)
        for j in range(state.size):
            if stage < 3:
                slope = 0.5 * rates[0, j] if stage == 1 else 0.75 * rates[1, j]
            else:
                slope = (2.0 * rates[0, j] + 3.0 * rates[1, j] + 4.0 * rates[2, j]) / 9.0
            trial[j] = state[j] + h * slope
        _between(motion, i, u, step_s, at)
        rates[stage] = 0.0
        force = _effects(effects, p, first, start_s + (i + u) * step_s, at, trial, rates[stage], spare)
    return force


@njit(cache=True, nogil=True, error_model="numpy")
def _error(rates: Any, trial: Any, scale: Any, size: float, step_s: float) -> float:
    """Largest error of a step as a share of what its state has reached, or of its change from a sample on."""
    worst = 0.0
    for j in range(trial.size):
        miss = -5.0 * rates[0, j] + 6.0 * rates[1, j] + 8.0 * rates[2, j] - 9.0 * rates[3, j]
        if miss != 0.0:
            reached = max(scale[j], abs(trial[j]), abs(rates[0, j]) * step_s, abs(rates[3, j]) * step_s)
            share = size * step_s * abs(miss) / (72.0 * reached)
            worst = max(worst, share) if np.isfinite(share) else np.inf
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def _from_samples(
    effects: Any, p: Any, motion: Any, i: int, step_s: float, start_s: float, state: Any, past: Any,
    rates: Any, scale: Any, trial: Any, at: Any, spare: Any,
) -> tuple[float, float]:  # fmt: skip
    """Try to reach the next sample from the rates at the last three: Adams' methods of third order.

    The rates at the next sample are those of the predictor (Bashforth); ``trial`` is the corrector (Moulton).
    Their difference, as a share as in `_error`, and the force are returned.
    """
    h, worst = step_s / 12.0, 0.0
    for j in range(state.size):
        trial[j] = state[j] + h * (23.0 * rates[0, j] - 16.0 * past[0, j] + 5.0 * past[1, j])
    at[:] = motion[:, i + 1]
    rates[3] = 0.0
    force = _effects(effects, p, effects[0, 2], start_s + (i + 1) * step_s, at, trial, rates[3], spare)
    for j in range(state.size):
        corrected = state[j] + h * (5.0 * rates[3, j] + 8.0 * rates[0, j] - past[0, j])
        if corrected != trial[j]:
            reached = max(scale[j], abs(corrected), abs(rates[0, j]) * step_s, abs(rates[3, j]) * step_s)
            share = abs(corrected - trial[j]) / reached
            worst = max(worst, share) if np.isfinite(share) else np.inf
        trial[j] = corrected
    return force, worst


@njit(cache=True, nogil=True, error_model="numpy")
def _accepted(rates: Any, trial: Any, scale: Any, state: Any, step_s: float) -> None:
    """Go on from the end of a step."""
    for j in range(state.size):
        scale[j] = max(scale[j], abs(trial[j]), abs(rates[3, j]) * step_s)
        state[j], rates[0, j] = trial[j], rates[3, j]


@njit(cache=True, nogil=True, error_model="numpy")
def force_of_effects(effects: Any, p: Any, motion: Any, step_s: float, state: Any, start_s: float) -> Any:
    """Force (samples,) of one link's effects along its motion, rows x, v, T, k, c, from and to a state.

    The states follow by Bogacki and Shampine's method of third order, in steps that its error estimate
    chooses and that end at the samples. Where these are whole samples and the motion does not turn in
    between, Adams' methods are tried, which need the rates once a sample in place of three times. ``state``
    holds the states at the last sample when it returns.

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
    state : ndarray, shape (states + 1,)
        At the first sample; at the last one afterwards.
    start_s : float
        Time of the first sample [s].

    Returns
    -------
    ndarray, shape (samples,)
        Force [N]; not a number from where the states leave all bounds.
    """
    samples = motion.shape[1]
    out, at, spare = np.full(samples, np.nan), np.zeros(5), np.zeros(1)
    first = effects[0, 2] if effects.shape[0] else 0
    rates, trial, scale = np.zeros((4, state.size)), np.zeros(state.size), np.abs(state)
    remembers = state.size > 1  # one more number than states, so that none is a valid place
    for i in range(min(samples, 1) if remembers else samples):
        for row in range(5):
            at[row] = motion[row, i]
        out[i] = _effects(effects, p, first, start_s + i * step_s, at, state, rates[0], spare)
    size, steps, whole, past = 1.0, 0, 0, np.zeros((2, state.size))
    for i in range(samples - 1 if remembers else 0):
        share, last, here = 0.0, steps, rates[0].copy()
        v0, v1 = motion[1, i], motion[1, i + 1]
        if whole >= 2 and (v0 * v1 > 0.0 or v0 == v1):  # rates at samples alone miss what happens at a turn
            out[i + 1], error = _from_samples(
                effects, p, motion, i, step_s, start_s, state, past, rates, scale, trial, at, spare
            )
            if error <= _ALLOWED:
                share, steps = 1.0, steps + 1
                _accepted(rates, trial, scale, state, step_s)
        while share < 1.0:
            steps += 1
            shortest = _SHORTEST if steps < _FINE_STEPS * i + _LEAST_FINE else _COARSE
            now = min(size, 1.0 - share)
            force = _step(effects, p, motion, i, share, now, step_s, start_s, state, rates, trial, at, spare)
            error = _error(rates, trial, scale, now, step_s)
            if error <= _ALLOWED or now <= shortest:
                share = share + now if now == size else 1.0
                out[i + 1] = force
                _accepted(rates, trial, scale, state, step_s)
            factor = 0.9 * (_ALLOWED / max(error, 1e-12 * _ALLOWED)) ** (1.0 / 3.0)
            if now == size or factor < 1.0:
                size = min(max(now * min(max(factor, 0.2), 5.0), shortest), 1.0)
        whole = whole + 1 if steps == last + 1 else 0
        past[1], past[0] = past[0], here
        if not np.isfinite(out[i + 1]):
            break
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def forces_of_effects(effects: Any, p: Any, motion: Any, step_s: float, states: Any) -> Any:
    """Force (effects, samples) of every effect by itself along one motion.

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
    states : ndarray, shape (effects, states)
        At the first sample; of each effect its own come first.

    Returns
    -------
    ndarray, shape (effects, samples)
        Forces [N].
    """
    out = np.zeros((effects.shape[0], motion.shape[1]))
    for e in range(effects.shape[0]):
        alone = np.zeros((1, 3), dtype=np.int64)
        alone[0, 0], alone[0, 1] = effects[e, 0], effects[e, 1]
        state = np.zeros(effects[e, 2] + 1)
        for i in range(effects[e, 2]):
            state[i] = states[e, i]
        out[e] = force_of_effects(alone, p, motion, step_s, state, 0.0)
    return out
