"""The records that tell something of the tension, together, and what an effect takes from their cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from scipy import stats

from discovery.courses.frozen_motion import FrozenMotion
from discovery.localisation.localise import Profile
from discovery.residual.tension import TensionObservation
from rom.campaign.channels import FloatArray
from rom.effects import Member, ModelCorrection
from rom.model.laws import Parameter
from rom.model.model import Model

if TYPE_CHECKING:
    from discovery.explain.tension_law import CourseFit

Pair = tuple[Member, ModelCorrection]
_CHANCE = 1e-3
_NEARLY_NOISE = 1.5  # mean square: a motion that is known to a few percent shifts courses by as much
_AT_BOUND = 1e-6  # of a range


@dataclass(frozen=True, eq=False)
class Data:
    """All records of a campaign that tell something of the tension, training ones first."""

    model: Model
    seen: tuple[TensionObservation, ...]
    frozen: FrozenMotion
    training: int
    struck: FloatArray  # whether a record is a loosening one: coupled ones are not run again

    def nodes(self, case: int) -> FloatArray:
        """Frozen motion of one record, (t x v F D T, nodes)."""
        return self.frozen.of_case(case)

    @property
    def files(self) -> list[str]:
        """Files in order."""
        return [seen.settings.file for seen in self.seen]

    def part(self, *, hold_out: bool, of: FrozenMotion | None = None) -> FrozenMotion:
        """Training or held-out records."""
        whole = of or self.frozen
        ends = (self.training, len(self.seen)) if hold_out else (0, self.training)
        return whole.subset(range(*ends))


@dataclass(frozen=True)
class Misfit:
    """Mean square of what a law leaves over of the courses, 1 being noise, of so many free numbers.

    `views` hold the same along preload, relative velocity and time, see `discovery.localisation.tension`.
    """

    level: float
    numbers: float
    views: Mapping[str, Profile] = field(default_factory=dict)

    @property
    def is_noise(self) -> bool:
        """Whether chance alone would leave as much in one campaign of a thousand, or nearly so."""
        if self.numbers <= 0:
            return True
        return self.level <= max(_NEARLY_NOISE, float(stats.chi2.isf(_CHANCE, self.numbers)) / self.numbers)

    def loss_to(self, after: Misfit) -> float:
        """How much more of the courses another model leaves, as a cost."""
        return (after.level - self.level) * after.numbers


@dataclass(frozen=True, eq=False)
class Gained:
    """An effect, the cost that it takes from each record, and its numbers that are at a bound.

    `beside` holds the numbers of the tension law that were fitted with it, where any were, `left` the mean
    square of what is then left over of the courses, `p_value` the chance of as much from noise, `slow` the
    fit to the courses where it is a law's.
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
