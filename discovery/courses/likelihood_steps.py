"""Levenberg-Marquardt steps that raise the marginal likelihood of a law."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from discovery.courses.marginal_likelihood import TALLEST_STEP, Problem, State
from discovery.courses.variability import tau
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_NO_GAIN: Numerical[float] = 1e-3  # of the deviance, foreseen: not worth a trial
_LENGTHENED_GAIN: Numerical[float] = 1e-3  # of the deviance: for less no number is to run far
_SHARED: Numerical[float] = 2.0  # standard errors of the deviations' mean: more is not by chance
_SHIFT: Numerical[float] = 0.5  # of the log rate at a time: numbers of a law follow it about linearly
_SCALES: Numerical[float] = 0.999  # squared cosine of a number that scales a law: beyond finite differences
_SHIFTS: Numerical[int] = 40  # from the largest deviation that there can be


def climbed(
    problem: Problem, state: State, settled: float, most: int, restricted: bool = False
) -> tuple[State, bool]:
    """The best place that steps from a state lead to, each lowering the deviance by more than asked.

    Parameters
    ----------
    problem : Problem
        The fit.
    state : State
        The start.
    settled : float
        Gain in deviance below which a step is the last.
    most : int
        Steps at most.
    restricted : bool
        Whether scatter is that of the restricted likelihood.

    Returns
    -------
    tuple of (State, bool)
        The place, with the scatter that suits it, and whether no more is to be gained.
    """
    found = _ended(problem, state, settled, most, restricted)
    start = levelled(problem, found[0])
    if start is found[0]:
        return found
    again = _ended(problem, start, settled, most, restricted)
    return again if again[0].deviance < found[0].deviance else found


def _ended(problem: Problem, state: State, settled: float, most: int, restricted: bool) -> tuple[State, bool]:
    """Where steps from a state end, and whether no more is to be gained."""
    damping = 1e-3
    for _ in range(most):
        state = problem.scattered(state, restricted)
        trial, damping = step(problem, state, damping)
        if trial is None:
            return problem.scattered(state, restricted), True
        gain, state = state.deviance - trial.deviance, trial
        if gain < settled:
            return problem.scattered(state, restricted), True
    return problem.scattered(state, restricted), False


def levelled(problem: Problem, state: State) -> State:
    """The place whose law has what the deviations of all tests share.

    A law 20 times too fast, all tests 20 times slower than it, has the courses of the right one; where these
    are off by far more than noise their scatter grows with it, and steps see next to nothing to gain.

    Parameters
    ----------
    problem : Problem
        The fit.
    state : State
        The place; it is kept where deviations share no more than by chance, or the law has no scale.
    """
    for _ in range(_SHIFTS if state.u.size else 0):
        weight = 1 / tau(state.scatter, problem.frozen.initial, problem.rules) ** 2
        mean = float(weight @ state.u / weight.sum())
        if abs(mean) * np.sqrt(weight.sum()) <= _SHARED:
            break
        shift = float(np.clip(mean, -_SHIFT, _SHIFT))
        per_unit, place = _scale(problem, state)
        if per_unit is None:
            break
        theta = state.theta.copy()
        theta[place] += shift * per_unit
        trial = problem.solve(problem.clipped(theta), state.scatter, state.u - shift)
        if not trial.deviance < state.deviance:
            break
        state = trial
    return state


def _scale(problem: Problem, state: State) -> tuple[float | None, int]:
    """How far a number that scales the law moves for a unit of the log rate, and its place; None without one.

    Courses follow it as they follow the deviations of all tests together.
    """
    columns, slope = problem.jacobian(state).reshape(state.residual.size, -1), state.slope.ravel()
    along, size = slope @ columns, (columns**2).sum(axis=0) * (slope @ slope)
    share = np.where(size > 0, along**2 / np.where(size > 0, size, 1.0), 0.0)
    if not share.size or share.max() < _SCALES:
        return None, 0
    place = int(np.argmax(share))
    return float(slope @ slope / along[place]), place


def step(problem: Problem, state: State, damping: float) -> tuple[State | None, float]:
    """One accepted Levenberg-Marquardt step, or None where none lowers the deviance.

    Parameters
    ----------
    problem : Problem
        The fit.
    state : State
        Where it is.
    damping : float
        Of the first trial, in diagonal elements of the normal equations.

    Returns
    -------
    tuple of (State or None, float)
        The better place, and the damping of the next step.
    """
    if not len(state.theta):
        return None, damping
    matrix, right = problem.normal_equations(state)
    diagonal = np.diag(matrix)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))  # each number by itself: their units are far apart
    alike = matrix / np.outer(scale, scale)
    low, high = ((bound - state.theta) * scale for bound in problem.bounds)
    for _ in range(8):
        damped = alike + (damping + 1e-12) * np.eye(len(scale))
        change = least_within(damped, right / scale, low, high) / scale
        if 2 * change @ right - change @ matrix @ change < _NO_GAIN:
            return None, damping
        theta = problem.clipped(state.theta + change)
        trial = problem.solve(theta, state.scatter, _followed(problem, state, theta))
        if np.isfinite(trial.deviance) and trial.deviance < state.deviance:
            return _lengthened(problem, state, trial, change), max(damping / 5, 1e-9)
        damping *= 8
    return None, damping


def _followed(problem: Problem, state: State, theta: FloatArray) -> FloatArray:
    """Deviations near their modes at other numbers, (cases,), to first order: few Newton steps lead there."""
    weight = 1 / tau(state.scatter, problem.frozen.initial, problem.rules) ** 2
    along = np.einsum("cb,cbp,p->c", state.slope, problem.jacobian(state), theta - state.theta)
    lag = along / ((state.slope**2).sum(axis=1) + weight)
    return np.asarray(state.u - np.clip(lag, -TALLEST_STEP, TALLEST_STEP))


def _lengthened(problem: Problem, state: State, best: State, change: FloatArray) -> State:
    """Go on along a change for as long as twice as much lowers the deviance further.

    Far from the measured courses their curvature makes a Gauss-Newton step up to twenty times too short.
    """
    while state.deviance - best.deviance > _LENGTHENED_GAIN * state.deviance:
        change = 2 * change
        trial = problem.solve(problem.clipped(state.theta + change), best.scatter, best.u)
        if not trial.deviance < best.deviance:
            break
        best = trial
    return best


def least_within(matrix: FloatArray, right: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The change d within a range that makes d' M d - 2 r' d least.

    Were the free one clipped instead, numbers beside one at its end would make up for what it may not do.

    Parameters
    ----------
    matrix, right : ndarray, shapes (numbers, numbers) and (numbers,)
        M, positive definite, and r.
    low, high : ndarray, shape (numbers,)
        Ends of the range of d.

    Returns
    -------
    ndarray, shape (numbers,)
        d.
    """
    change = np.linalg.solve(matrix, right)
    if not ((change < low) | (change > high)).any():  # nor where it is not finite
        return np.asarray(change)
    scale = np.sqrt(np.diag(matrix))
    root = np.linalg.cholesky(matrix / np.outer(scale, scale)).T
    aim = np.linalg.solve(root.T, right / scale)
    return np.asarray(optimize.lsq_linear(root, aim, (low * scale, high * scale), method="bvls").x / scale)
