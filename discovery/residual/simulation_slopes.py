"""Slopes of what a model shows of simulated records, by its numbers and by the states at their starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg

from discovery.residual.fitted_number import FittedNumber
from discovery.residual.modal_slopes import ModalSlopes
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection
from rom.identification.ring_down import RingDown
from rom.identification.ring_down_states import state_slopes
from rom.model.model import Model

_FIRST_STEP: Numerical[float] = 1e-4
_LARGEST_STEP: Numerical[float] = 0.1


class SimulatedRecord(NamedTuple):
    """A record, its state, whether that is fitted, and what a model shows; None where it does not finish."""

    ring: RingDown
    state: FloatArray
    shown: FloatArray | None
    is_free: bool


class UnseenRecord(NamedTuple):
    """A record that is held out, its slopes by the model's numbers, (rows, numbers), and what its state
    imitates: an orthonormal basis, (rows, rank)."""

    record: SimulatedRecord
    by_numbers: FloatArray
    of_state: FloatArray

    def beyond(self, model: Model, effect: ModelCorrection, numbers: FloatArray) -> FloatArray | None:
        """What an effect adds beyond what its own state imitates, (rows,); None where that does not finish.

        Parameters
        ----------
        model : Model
            Without the effect.
        effect : ModelCorrection
            At a strength.
        numbers : ndarray, shape (numbers,)
            In their sizes: how those of the model change that training records are fitted with.
        """
        ring, state, shown, _ = self.record
        moved = ring.simulated(model.with_effect(effect), state)
        if moved is None or shown is None:
            return None
        left = moved - shown - self.by_numbers @ numbers
        return np.asarray(left - self.of_state @ (self.of_state.T @ left))


def orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of columns of any size, (rows, rank)."""
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    return np.asarray(linalg.orth(columns / size, rcond=1e-10))


def slopes_of(
    model: Model,
    records: Sequence[SimulatedRecord],
    numbers: Sequence[FittedNumber],
    steps: dict[str, float],
    change: float,
) -> FloatArray:
    """Return slopes of what is shown by the numbers in their sizes, then by the free states in their scales.

    Steps are such that they move the motion by a small share of it: a frequency that is a little wrong loses
    the phase of a long record.

    Parameters
    ----------
    model : Model
        With its effects.
    records : sequence of SimulatedRecord
        By that model.
    numbers : sequence of FittedNumber
        Of the model.
    steps : dict of str to float
        Last steps by number, in its size; renewed.
    change : float
        Share of the motion by which a step moves it.

    Returns
    -------
    ndarray
        Shape (rows of all records, numbers and free states).
    """
    edges = np.concatenate([[0], np.cumsum([one.ring.measured.size for one in records])])
    of_states = sum(len(one.state) for one in records if one.is_free)
    table = np.zeros((edges[-1], len(numbers) + of_states))
    of_sensors = ModalSlopes([one.ring for one in records], model, [one.state for one in records])
    for column, number in enumerate(numbers):
        found = of_sensors.of(number.path)
        if found is None:
            found = _slope(model, number, records, steps, change) / number.size
        table[:, column] = found * number.slope(model.parameter(number.path).value)
    first = len(numbers)
    for place, one in enumerate(records):
        if not one.is_free:
            continue
        by_state = None if one.shown is None else state_slopes(one.ring, model, one.state, one.shown)
        if by_state is not None:
            table[edges[place] : edges[place + 1], first : first + len(one.state)] = by_state
        first += len(one.state)
    return table


def _slope(
    model: Model,
    number: FittedNumber,
    records: Sequence[SimulatedRecord],
    steps: dict[str, float],
    change: float,
) -> FloatArray:
    value = model.parameter(number.path).value
    step = steps.get(number.path, _FIRST_STEP)
    found = np.zeros(sum(one.ring.measured.size for one in records))
    for _ in range(3):
        ahead = step if value + step * number.size <= number.high else -step
        moved = model.with_values({number.path: value + ahead * number.size})
        parts = []
        for ring, state, here, _free in records:
            there = None if here is None else ring.simulated(moved, state)
            parts.append(np.zeros(ring.measured.size) if there is None or here is None else there - here)
        difference = np.concatenate(parts)
        found = difference / ahead
        whole = float(np.sqrt(sum(np.sum(one.shown**2) for one in records if one.shown is not None)))
        share = float(np.linalg.norm(difference)) / max(whole, 1e-300)
        steps[number.path] = float(np.clip(step * change / max(share, 1e-12), 1e-9, _LARGEST_STEP))
        if 0.1 * change < share < 10 * change or steps[number.path] == step:
            break
        step = steps[number.path]
    return found
