"""A member of the catalogue: everything about an effect but the place and the values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal

from rom.model.effect import Effect, ModelCorrection, Reading, Samples, SensorFault
from rom.model.law_change import LawChange
from rom.model.laws import Parameter

Place = Literal["joint", "ground", "body", "tension", "sensor:force", "sensor:acceleration", "sensor:tension"]
NONE: Mapping[str, Any] = {}
OF_CHANNEL = "y"
"""Unit of what is added to a channel: the channel's own."""
_CHANNEL_UNITS = {"acceleration": "m/s2", "force": "N", "tension": "N"}


@dataclass(frozen=True)
class Member:
    """One effect of the catalogue.

    Parameters
    ----------
    name : str
        Name in result files.
    places : tuple of str
        Where it can enter: "joint" (a link between two bodies, or a bolted one), "ground" (any other link to
        ground), "body", "tension", "sensor:<quantity>".
    equation : str
        ``name = expression`` parts, ``; `` between them, in the function's arguments and parameters; ``F`` is
        the force, ``dz1/dt`` the rate of the first state. Of a change of the tension law, an expression.
    parameters : mapping of str to Parameter
        Physical defaults (the middle of the plausible range), units, bounds and source.
    strengths : mapping of str to float
        The parameters that, all zero, mean no effect exactly, and the smallest plausible value of each.
    classes : tuple of str
        Classes of effects that data of a usual campaign may not tell apart; the nearest first.
    source : str
        Where the effect is described.
    function : callable
        By kind: the kernel of ``Effect``, the reading of ``Reading``, the fault of ``SensorFault``; None for
        a change of the tension law, which is its equation.
    cure : callable
        Of a sensor's fault: its inverse.
    state_units : tuple of str
        Units of a kernel's internal states, in order.
    starts : tuple of str
        What each state has at the start of a motion: "x", the displacement there, "v", the velocity, or "",
        zero; empty where all are zero.
    inner : mapping of str to tuple of float
        A small grid of plausible values for parameters other than strengths, for screening; where a place's
        range ends before, its end.
    linear : bool
        Whether force, rate or channel is linear in the strengths.
    passive : bool
        Whether it can only take energy out of the motion over a closed cycle.
    core : bool
        Whether an attribution must be able to find it.
    ground : mapping of str to Parameter
        Parameters that differ where it enters a link to ground that is not bolted.
    by_record : tuple of str
        Parameters that are a record's own, such as a phase.
    of_stiffness : tuple of str
        Parameters that are those of the link's own stiffness law, where it has them.
    other : str
        Of a sensor's fault: the kind of channel, of another body, that disturbs it.
    ends : mapping of str to tuple of float
        Ends of the ranges of pure numbers that physics sets, where the plausible ones of a joint end before.
    limits : tuple of str
        Of a slider: the parameters that its limit is linear in. Force is of first degree in them and the
        strength together.
    needs : tuple of str
        Parameters that are not strengths, and at zero leave another effect.
    contains : tuple of str
        Members that are special cases of this one.
    strict : tuple of str
        Parameters whose ranges do not grow: a period of which a stroke shows less than half is none.
    of_joint : bool
        Whether its numbers are those of a joint's motion wherever it acts.
    springless : bool
        Whether it is of use only where a link has no stiffness: a slider could take a share of that, and
        about a spring's rest positions are where the motion turns.
    tensioned : bool
        Whether it is of use only beside a bolt: in a joint its own, in a link to ground any.
    """

    name: str
    places: tuple[Place, ...]
    equation: str
    parameters: Mapping[str, Parameter]
    strengths: Mapping[str, float]
    classes: tuple[str, ...]
    source: str
    function: Callable[..., Any] | None = field(default=None, repr=False)
    cure: Samples | None = field(default=None, repr=False)
    state_units: tuple[str, ...] = ()
    starts: tuple[str, ...] = ()
    inner: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    linear: bool = True
    passive: bool = False
    core: bool = True
    ground: Mapping[str, Parameter] = field(default_factory=dict)
    by_record: tuple[str, ...] = ()
    of_stiffness: tuple[str, ...] = ()
    other: str = ""
    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    strict: tuple[str, ...] = ()
    of_joint: bool = False
    springless: bool = False
    tensioned: bool = False

    @property
    def kind(self) -> Literal["force", "tension rate", "measured tension", "sensor"]:
        """What it is applied to."""
        if self.places[0].startswith("sensor:"):
            return "sensor"
        if self.places[0] != "tension":
            return "force"
        return "tension rate" if self.function is None else "measured tension"

    def at(
        self, enters: str, parameters: Mapping[str, Parameter] | None = None, *, ground: bool = False
    ) -> ModelCorrection:
        """The effect at a place, with the physical defaults or with given parameters.

        Parameters
        ----------
        enters : str
            Where it enters: a link, ``"body:<name>"``, ``"tension"`` or ``"sensor:<channel>"``.
        parameters : mapping of str to Parameter
            Parameters by name; defaults if not given.
        ground : bool
            Whether the place is a link to ground, which has defaults of its own.

        Returns
        -------
        ModelCorrection
            The effect.

        Raises
        ------
        ValueError
            If the parameters are not those of the effect.
        """
        numbers = {**self.parameters, **(self.ground if ground else {})} if parameters is None else parameters
        if set(numbers) != set(self.parameters):
            raise ValueError(
                f"effect {self.name!r} must have the parameters {', '.join(self.parameters)}, "
                f"got {', '.join(numbers) or 'none'}"
            )
        ordered = {name: self._placed(numbers[name], enters) for name in self.parameters}
        head = (self.name, enters, self.equation, ordered)
        if self.function is None:
            return LawChange(*head)
        if self.kind == "sensor":
            assert self.cure is not None
            return SensorFault(*head, self.function, self.cure, self.other)
        if self.kind == "measured tension":
            return Reading(*head, self.function)
        return Effect(*head, self.function, len(self.state_units), self.starts)

    def _placed(self, number: Parameter, enters: str) -> Parameter:
        """A parameter with its source, and the unit of the channel where it has no other."""
        kind = enters.removeprefix("sensor:").partition("_")[0]
        unit = _CHANNEL_UNITS.get(kind, OF_CHANNEL) if number.unit == OF_CHANNEL else number.unit
        return replace(number, unit=unit, source=number.source or self.source)

    def silent(self, enters: str, *, ground: bool = False) -> ModelCorrection:
        """The effect at a place with all strengths zero."""
        return self.at(enters, ground=ground).with_values(**dict.fromkeys(self.strengths, 0.0))

    def probes(self, effect: ModelCorrection) -> tuple[ModelCorrection, ...]:
        """The effect at its smallest plausible strengths, one at a time, over the grid of the others.

        What screening needs: the output of a probe minus that without effect, over the strength, is the
        sensitivity at zero strength. Strengths and grid go with the defaults of the place; what is zero at
        the joint alone or in a link to ground alone stays so there.

        Parameters
        ----------
        effect : ModelCorrection
            The member at a place, with the defaults of that place.
        """

        def there(name: str, value: float) -> float:
            default, low_high = self.parameters[name].value, effect.parameters[name].bounds
            factor = effect.parameters[name].value / default if default else 1.0
            return min(max(value * factor, low_high[0]), low_high[1])

        none = dict.fromkeys(self.strengths, 0.0)
        grid = [
            {
                name: 0.0 if name in self.ground and not effect.parameters[name].value else there(name, value)
                for name, value in zip(self.inner, point, strict=True)
            }
            for point in product(*self.inner.values())
        ]
        least = {name: there(name, value) for name, value in self.strengths.items()}
        probes = {
            tuple(probe.values): probe
            for point in grid
            for name, value in least.items()
            if (probe := effect.with_values(**{**none, **point, name: value})) and value
        }
        return tuple(probes.values())


def parameter(value: float, unit: str, low: float, high: float) -> Parameter:
    """A parameter of the catalogue: physical default, unit, bounds.

    Parameters
    ----------
    value : float
        Value.
    unit : str
        Unit.
    low : float
        Lower bound.
    high : float
        Upper bound.

    Returns
    -------
    Parameter
        The parameter.
    """
    return Parameter(value, unit, bounds=(low, high))
