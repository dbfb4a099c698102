"""Limits at which a screen tries a slider: from barely any slip to slip over most of the motion.

A small strength tells little of a slider. Its force is of first degree in its strength and its limit
together, so that where it slips is all that shapes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from discovery.criteria.screening import Screening
from discovery.explain.probes import cut_to_bounds
from rom.effects import Member, ModelCorrection


class Held(NamedTuple):
    """A place where a slider may be: strength of its probe, stiffness of that [N/m], the largest
    displacement [m] there, and the mean normal force [N], zero where none was measured."""

    strength: float
    stiffness: float
    displacement: float
    normal: float = 0.0


def slider_shapes(
    member: Member, effect: ModelCorrection, held: Held, rules: Screening
) -> list[ModelCorrection]:
    """A slider over a grid of its limits, and of gaps likewise.

    Its limit is constant, or in proportion to a normal force that was measured.

    Parameters
    ----------
    member : Member
        With the names of its strength and limits.
    effect : ModelCorrection
        At its place.
    held : Held
        What is there.
    rules : Screening
        The grid, in shares of the largest displacement.

    Returns
    -------
    list of ModelCorrection
        One for each shape.
    """
    steps = np.geomspace(rules.finest_shape, rules.coarsest_shape, int(rules.shape_steps)).tolist()
    (strength,), (constant, share) = member.strengths, member.limits
    units = [(constant, 1.0), *([(share, held.normal)] if held.normal > 0 else [])]
    others: dict[str, Sequence[float]] = {
        name: [step * held.displacement for step in steps] if name in member.needs else values
        for name, values in member.inner.items()
        if name not in member.limits
    }
    found = []
    for (name, unit), step in product(units, steps):
        limit = step * held.displacement * held.stiffness / unit
        for point in product(*others.values()):
            values = {**dict.fromkeys(member.limits, 0.0), **dict(zip(others, point, strict=True))}
            found.append(cut_to_bounds(effect, {**values, strength: held.strength, name: limit}))
    return found
