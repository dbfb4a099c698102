"""The state of a ring-down at its first sample, fitted to what is measured of it."""

from __future__ import annotations

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.ring_down import PERIODS, RingDown, Tension
from rom.model.model import Model

_GROWING: Numerical[tuple[float, ...]] = (0.75, 1.5, 3.0)  # periods
_OUT_OF_PHASE: Numerical[float] = 0.5  # of the motion left: a state that suits less is looked for again
_STEP: Numerical[float] = 1e-3  # of the state's scale
_STATE_STEPS: Numerical[int] = 12
_SETTLED: Numerical[float] = 1e-4  # of the cost


def fitted_state(
    ring: RingDown, model: Model, start: FloatArray | None = None, tension: Tension = None
) -> FloatArray:
    """Return the state at a record's first sample that suits its motion best, (2 bodies,) [m], [m/s].

    By damped Gauss-Newton steps; without a start, from what suits the first periods, and there from the state
    of the model without its effects, which is linear in it.

    Parameters
    ----------
    ring : RingDown
        The record.
    model : Model
        With its effects.
    start : ndarray, shape (2 bodies,)
        Where to start, if known.
    tension : mapping of str to float or None
        Of bolted links [N].
    """
    if start is None:
        start = first_state(ring, model, tension)
    return _settled(ring, model, start, tension)[0]


def first_state(ring: RingDown, model: Model, tension: Tension = None) -> FloatArray:
    """Return the state at a record's first sample that suits its first periods, (2 bodies,) [m], [m/s].

    Begun with that of the linear model; where more than half of the motion is left and effects act, also with
    what suits 0.75 periods, then ever more.

    Parameters
    ----------
    ring : RingDown
        The record.
    model : Model
        With its effects.
    tension : mapping of str to float or None
        Of bolted links [N].
    """
    first = ring.parts(PERIODS, most=1)[0]
    found = _of_linear(first, model, tension)
    far = found[1] > _OUT_OF_PHASE**2 * float(first.whitened @ first.whitened)
    if far and model.shapes is None and model.effects_of("force"):
        found = min(found, _settled(first, model, _grown(ring, model, tension), tension), key=_cost)
    return found[0]


def _of_linear(ring: RingDown, model: Model, tension: Tension) -> tuple[FloatArray, float]:
    """The state to which the better of the linear model's leads, and its cost."""
    starts = _linear_states(ring, model, tension)
    return min((_settled(ring, model, one, tension) for one in starts), key=_cost)


def _grown(ring: RingDown, model: Model, tension: Tension) -> FloatArray:
    """The state that suits a share of a period, and from there ever more: over all the phase is lost."""
    short, *longer = (ring.parts(periods, most=1)[0] for periods in _GROWING)
    state = _of_linear(short, model, tension)[0]
    for part in longer:
        state = _settled(part, model, state, tension)[0]
    return state


def _cost(fit: tuple[FloatArray, float]) -> float:
    return fit[1]


def _linear_states(ring: RingDown, model: Model, tension: Tension) -> list[FloatArray]:
    """States of the linear model that suit the first two periods, and all of them."""
    bare, unit = model.without_effects_of("force"), ring.scale
    still = ring.simulated(bare, np.zeros(len(unit)), tension)
    columns = [ring.simulated(bare, one, tension) for one in np.diag(unit)]
    if still is None or any(column is None for column in columns):
        return [np.zeros(len(unit))]
    table = np.stack([column - still for column in columns if column is not None], axis=1)
    table = table.reshape(len(ring.channels), -1, len(unit))
    target = (ring.whitened - still).reshape(len(ring.channels), -1)
    periods = max(2 * ring.row_rate_hz / (ring.measurement.strongest_hz or 1.0), 4 * len(unit))
    found = []
    for rows in (int(periods), table.shape[1]):
        part = table[:, :rows].reshape(-1, len(unit))
        found.append(np.linalg.lstsq(part, target[:, :rows].ravel(), rcond=None)[0] * unit)
    return found


def state_slopes(
    ring: RingDown, model: Model, state: FloatArray, shown: FloatArray, tension: Tension = None
) -> FloatArray | None:
    """Slopes of what is shown by the state in its scale; None where a simulation diverges.

    Parameters
    ----------
    ring : RingDown
        The record.
    model : Model
        With its effects.
    state : ndarray, shape (2 bodies,)
        Displacements [m], then velocities [m/s].
    shown : ndarray, shape (rows,)
        What the model shows from that state.
    tension : mapping of str to float or None
        Of bolted links [N].

    Returns
    -------
    ndarray or None
        Shape (rows, 2 bodies).
    """
    columns = []
    for step in np.diag(_STEP * ring.scale):
        moved = ring.simulated(model, state + step, tension)
        if moved is None:
            return None
        columns.append((moved - shown) / _STEP)
    return np.stack(columns, axis=1)


def _settled(ring: RingDown, model: Model, state: FloatArray, tension: Tension) -> tuple[FloatArray, float]:
    shown, damping = ring.simulated(model, state, tension), 1e-6
    if shown is None:
        return state, np.inf
    left = ring.whitened - shown
    cost = float(left @ left)
    for _ in range(_STATE_STEPS):
        slopes = state_slopes(ring, model, state, shown, tension)
        if slopes is None:
            break
        matrix, right = slopes.T @ slopes, slopes.T @ left
        while damping < 1e6:
            step = np.linalg.lstsq(matrix + damping * np.diag(np.diag(matrix)), right, rcond=None)[0]
            trial = ring.simulated(model, state + step * ring.scale, tension)
            after = np.inf if trial is None else float(np.sum((ring.whitened - trial) ** 2))
            if after < cost:
                break
            damping = max(10 * damping, 1e-3)
        else:
            break
        assert trial is not None
        gain, state, shown, cost = cost - after, state + step * ring.scale, trial, after
        left, damping = ring.whitened - shown, damping / 10
        if gain < _SETTLED * cost:
            break
    return state, cost
