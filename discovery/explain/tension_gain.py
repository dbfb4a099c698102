"""What an effect in the tension or its gauge takes from the cost of each record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from discovery.residual.course_fit import CourseFit
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, ModelCorrection
from rom.model.laws import Parameter

Pair = tuple[Member, ModelCorrection]
_AT_BOUND: Numerical[float] = 1e-6  # of a range


@dataclass(frozen=True, eq=False)
class TensionGain:
    """An effect with its fitted numbers, and the cost that it takes from each record.

    Attributes
    ----------
    effect : ModelCorrection
        With its fitted parameters and their 95 % limits.
    gains : ndarray, shape (records,)
        -2 log likelihood without the effect less that with it.
    at_bound : tuple of str
        Parameters that ended at an end of their range.
    beside : mapping of str to Parameter
        Numbers of the tension law that were fitted with it, where any were.
    left : float or None
        Mean square of what is then left over of the courses.
    p_value : float or None
        Chance of as much from noise.
    slow : CourseFit or None
        The fit to the courses where it is a law's.
    """

    effect: ModelCorrection
    gains: FloatArray
    at_bound: tuple[str, ...] = ()
    beside: Mapping[str, Parameter] = field(default_factory=dict)
    left: float | None = None
    p_value: float | None = None
    slow: CourseFit | None = None


def at_bounds(effect: ModelCorrection) -> tuple[str, ...]:
    """Parameters at an end of their range."""
    found = []
    for name, number in effect.parameters.items():
        low, high = number.bounds
        near = _AT_BOUND * (high - low)
        if number.value >= high - near or number.value <= low + near:
            found.append(name)
    return tuple(found)
