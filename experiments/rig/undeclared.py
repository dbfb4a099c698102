"""Physics that a campaign does not declare: named, placed, with numbers; what the truth file tells."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import isfinite
from types import MappingProxyType
from typing import Self

import numpy as np

from experiments.rig import faults, forces, hysteresis, outside, rates, readings
from experiments.rig.kinds import Kind

KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        kind.name: kind
        for module in (forces, hysteresis, rates, readings, faults, outside)
        for kind in module.KINDS
    }
)
"""Every kind by name."""


@dataclass(frozen=True)
class Undeclared:
    """One effect that the rig has and the campaign does not tell.

    Parameters
    ----------
    name : str
        Name of its kind, a key of `KINDS`.
    enters : str
        A link, ``"body:<name>"``, ``"tension"`` or ``"sensor:<channel>"``; empty for the usual place.
    parameters : mapping of str to float
        Values that differ from the usual ones of the place; completed on construction.

    Raises
    ------
    ValueError
        If the rig has no such kind, place or parameter, or a value cannot be.
    """

    name: str
    enters: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if self.name not in KINDS:
            raise ValueError(f"undeclared: {unknown('effect', self.name, KINDS)}")
        kind = KINDS[self.name]
        place = self.enters.replace("sensor:strain", "sensor:tension") or kind.usual
        if place not in kind.allowed:
            raise ValueError(f"undeclared {self.name}: {unknown('place', place, kind.allowed)}")
        numbers = kind.numbers_at(place)
        for name, value in self.parameters.items():
            if name not in numbers:
                raise ValueError(f"undeclared {self.name}: {unknown('parameter', name, numbers)}")
            self._check(name, value, place)
        values = {name: float(self.parameters.get(name, number.value)) for name, number in numbers.items()}
        object.__setattr__(self, "enters", place)
        object.__setattr__(self, "parameters", values)

    def _check(self, name: str, value: float, place: str) -> None:
        """Refuse a value that is no number or of a sign that cannot be."""
        low = self.kind.numbers_at(place)[name].low
        may_vanish = low <= 0.0 or name in self.kind.strengths
        if not isfinite(value) or low < 0.0:
            fits, expected = isfinite(value), "a finite number"
        elif may_vanish:
            fits, expected = value >= 0.0, "0 or more"
        else:
            fits, expected = value > 0.0, "more than 0"
        if not fits:
            raise ValueError(f"undeclared {self.name}: {name}: got {value:g}, expected {expected}")

    @property
    def kind(self) -> Kind:
        """What it is an instance of."""
        return KINDS[self.name]

    @property
    def values(self) -> tuple[float, ...]:
        """Parameter values in the order of the function."""
        return tuple(self.parameters.values())

    @property
    def bolted(self) -> bool:
        """Whether it is gone with the bolt."""
        return self.enters in ("joint", "tension", "sensor:tension")

    def scaled(self, factor: float) -> Self:
        """The same effect, stronger or weaker."""
        return replace(
            self,
            parameters={
                name: value * factor if name in self.kind.strengths else value
                for name, value in self.parameters.items()
            },
        )

    def in_record(self, rng: np.random.Generator) -> Self:
        """The effect as one record has it: with a phase or a size of that record's own, where it has one."""
        if self.kind.by_record == "size":
            return self.scaled(1.0 + 0.5 * rng.standard_normal())
        if self.kind.by_record == "phase":
            angle = rng.uniform(0.0, 2.0 * np.pi)
            first, second = (self.parameters[name] for name in self.kind.strengths)
            turned = (
                first * np.cos(angle) - second * np.sin(angle),
                first * np.sin(angle) + second * np.cos(angle),
            )
            return replace(
                self, parameters={**self.parameters, **dict(zip(self.kind.strengths, turned, strict=True))}
            )
        return self

    def truth(self) -> dict[str, object]:
        """What the truth file tells of it."""
        units = {name: number.unit for name, number in self.kind.numbers_at(self.enters).items()}
        return {
            "name": self.name,
            "enters": self.enters,
            "equation": self.kind.equation,
            "parameters": {
                name: {"value": value, "unit": units[name]} for name, value in self.parameters.items()
            },
            "in_catalogue": not self.kind.outside,
            "nearest": self.kind.nearest.get(self.enters),
            "by_record": self.kind.by_record,
        }


def unknown(what: str, got: str, known: Mapping[str, object] | tuple[str, ...]) -> str:
    """Say in one line what was not found, and the nearest right name or all of them.

    Parameters
    ----------
    what : str
        Kind of name.
    got : str
        The name.
    known : mapping or tuple of str
        Right names.

    Returns
    -------
    str
        For a message.
    """
    near = get_close_matches(got, list(known), 1, 0.5)
    if near:
        return f"got {what} {got!r}, did you mean {near[0]!r}?"
    return f"got {what} {got!r}, expected one of {', '.join(known)}"


def undeclared_from_text(text: str) -> Undeclared:
    """Return the effect that ``EFFECT[@PLACE][:key=value,...]`` names.

    Raises
    ------
    ValueError
        If the text is not of that form, or for what `Undeclared` refuses.
    """
    head, _, tail = text.rpartition(":")
    if "=" not in tail:
        head, tail = text, ""
    name, _, place = head.partition("@")
    parameters = {}
    for part in filter(None, tail.split(",")):
        key, _, value = part.partition("=")
        try:
            parameters[key.strip()] = float(value)
        except ValueError:
            raise ValueError(
                f"undeclared: got {part!r} in {text!r}, expected EFFECT[@PLACE][:key=value,...]"
            ) from None
    return Undeclared(name.strip(), place.strip(), parameters)
