"""Wider ranges for numbers that a fit has brought to where theirs end.

Ranges that are scaled to a motion are rough, and rougher where the model that tells the motion is far off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from discovery.explain.free_form import member_of
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection

WIDENINGS: Numerical[int] = 2
"""Of a range, at most."""


def widened(
    effects: Sequence[ModelCorrection], factor: float, highest_hz: float = math.inf
) -> tuple[ModelCorrection, ...] | None:
    """Return effects with wider ranges where numbers that have a unit ended away from zero.

    Parameters
    ----------
    effects : sequence of ModelCorrection
        As a fit left them.
    factor : float
        By which ends of ranges move.
    highest_hz : float
        Frequency beyond which records tell nothing [Hz]: ranges of frequencies end there.

    Returns
    -------
    tuple of ModelCorrection or None
        None where no number lies at such an end.
    """
    found = tuple(_widened(effect, factor, highest_hz) for effect in effects)
    return None if all(new is old for new, old in zip(found, effects, strict=True)) else found


def _widened(effect: ModelCorrection, factor: float, highest_hz: float) -> ModelCorrection:
    wider, strict = {}, member_of(effect).strict
    for name, number in effect.parameters.items():
        if name in strict or (number.unit == "Hz" and number.value >= highest_hz):
            continue
        end = next((bound for bound in number.bounds if bound == number.value != 0.0), None)
        if end is not None and number.unit != "1" and abs(end) == max(map(abs, number.bounds)):
            low, high = (factor * bound if bound == end else bound for bound in number.bounds)
            wider[name] = replace(number, bounds=(low, high))
    return replace(effect, parameters={**effect.parameters, **wider}) if wider else effect
