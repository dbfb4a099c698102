"""What a kind of undeclared physics is: name, places, equation, numbers with their plausible ranges."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

Family = Literal[
    "joint", "ground", "body", "tension", "sensor:force", "sensor:acceleration", "sensor:tension"
]

PLACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "joint": ("joint",),
        "ground": ("flexure_lo", "flexure_so"),
        "body": ("body:lo", "body:so"),
        "tension": ("tension",),
        "sensor:force": ("sensor:force_lo", "sensor:force_so"),
        "sensor:acceleration": ("sensor:acceleration_lo", "sensor:acceleration_so"),
        "sensor:tension": ("sensor:tension",),
    }
)
"""Places of the rig by family."""


class Number(NamedTuple):
    """A parameter: its usual value, unit and plausible range.

    The range of a strength limits its size; where it begins below zero, either sign may be drawn.
    """

    value: float
    unit: str
    low: float
    high: float


def constant(value: float, unit: str = "1") -> Number:
    """Return a number that is never drawn."""
    return Number(value, unit, value, value)


@dataclass(frozen=True)
class Kind:
    """One kind of undeclared physics.

    Attributes
    ----------
    name : str
        Name in the truth file; ``outside-...`` where no model's catalogue is to have it.
    places : tuple of str
        Families of places where it can enter.
    usual : str
        The place where it mostly enters.
    equation : str
        Equation for people.
    numbers : mapping of str to Number
        Parameters in the order in which the function takes them.
    strengths : tuple of str
        Parameters that, all zero, mean no effect exactly.
    function : callable
        What is compiled or applied; see the module that defines the kind.
    acts : {"force", "rate", "reading", "fault"}
        On a link or body, on the tension's rate, on the measured tension, on a channel.
    states : int
        Number of its own states.
    elsewhere : mapping of str to mapping
        Numbers that differ at a family of places, or at one.
    by_record : {"", "phase", "size"}
        Whether every record has a phase of its own (the two strengths are turned), or a size.
    passive : bool
        Whether it only takes energy out of the motion.
    nearest : mapping of str to str
        By place: the effect of the catalogue that nearly does the same in a campaign like the paper's, once
        the paper's model is refitted (squared cosine of their signatures above 0.88).
    """

    name: str
    places: tuple[Family, ...]
    usual: str
    equation: str
    numbers: Mapping[str, Number]
    strengths: tuple[str, ...]
    function: Callable[..., Any] = field(repr=False)
    acts: Literal["force", "rate", "reading", "fault"]
    states: int = 0
    elsewhere: Mapping[str, Mapping[str, Number]] = field(default_factory=dict)
    by_record: Literal["", "phase", "size"] = ""
    passive: bool = False
    nearest: Mapping[str, str] = field(default_factory=dict)

    @property
    def outside(self) -> bool:
        """Whether it stands outside the catalogue of effects."""
        return self.name.startswith("outside-")

    @property
    def allowed(self) -> tuple[str, ...]:
        """Every place of the rig where it can enter, the usual one first."""
        places = [place for family in self.places for place in PLACES[family]]
        return (self.usual, *(place for place in places if place != self.usual))

    def numbers_at(self, place: str) -> Mapping[str, Number]:
        """Parameters as they are at a place."""
        family = next(family for family in self.places if place in PLACES[family])
        return {**self.numbers, **self.elsewhere.get(family, {}), **self.elsewhere.get(place, {})}
