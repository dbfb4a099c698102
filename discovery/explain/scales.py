"""The catalogue's ranges at the scale of a motion that was measured.

Defaults and ranges of the catalogue are those of a lap joint that moves by 0.1 mm and of a flexure that moves
by 1 mm. A parameter of the unit N^a m^b s^c goes to another link as ``(F/F_0)^a (X/X_0)^(b+c) (V/V_0)^-c``,
with F, X and V the force, displacement and velocity there: all that has no unit stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from discovery.criteria.tension import Tension
from discovery.residual.trajectory import MeasuredTrajectory
from rom.criteria.number import Numerical
from rom.effects import Effect, Member, SensorFault
from rom.identification.equation_error import Balance
from rom.identification.force_balance import Balances
from rom.model.laws import Parameter
from rom.model.model import Model
from rom.model.structure import GROUND
from rom.model.units import parse_unit


@dataclass(frozen=True)
class Scale:
    """Typical force [N], and largest displacement [m] and velocity [m/s] of a place."""

    force: float
    displacement: float
    velocity: float

    @classmethod
    def largest(
        cls, force: Sequence[float], displacement: Sequence[float], velocity: Sequence[float]
    ) -> Scale | None:
        """The largest of each; None where nothing moves or pulls.

        Parameters
        ----------
        force, displacement, velocity : Sequence[float]
            One size of each record [N], [m], [m/s].
        """
        sizes = [max(one, default=0.0) for one in (force, displacement, velocity)]
        return cls(*sizes) if min(sizes) > 0 else None

    def is_near(self, other: Scale, times: float) -> bool:
        """Whether force, displacement and velocity are those of another scale to within a factor."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return all(1 / times <= mine / its <= times for mine, its in pairs)

    def over(self, other: Scale, unit: str) -> float:
        """Factor by which a number of a unit is larger here than there."""
        n, m, s = parse_unit(unit).powers
        return float(
            (self.force / other.force) ** n
            * (self.displacement / other.displacement) ** (m + s)
            * (self.velocity / other.velocity) ** -s
        )


OF_JOINT: Numerical[Scale] = Scale(30.0, 1e-4, 0.05)  # those that the catalogue's own numbers are given for
OF_GROUND: Numerical[Scale] = Scale(10.0, 1e-3, 0.1)


def scale_of(balances: Balances, enters: str) -> Scale | None:
    """Scale of a place over the training records; None where nothing moves or pulls there.

    A body that nobody drives is pulled by its links as hard as its mass resists.
    """
    masses = {f"body.{body.name}.mass": body.mass_kg or 0.0 for body in balances.settings.body}
    force, x, v = list[float](), list[float](), list[float]()
    for record in balances.records:
        if record.settings.hold_out or enters not in record.motion:
            continue
        motion = record.motion[enters]
        x.append(float(np.ptp(motion[0])) / 2)
        v.append(float(np.abs(motion[1]).max()))
        near = [b for b in record.balances if enters == b.place or enters in b.pulls]
        here = {**masses, **record.settings.given}
        force += [
            _typical_force(b, here.get(f"body.{b.place.removeprefix('body:')}.mass", 0.0)) for b in near
        ]
    return Scale.largest(force, x, v)


def ends_of(model: Model, enters: str) -> tuple[str, str]:
    """What an effect acts between; on a body it acts against the ground."""
    ends = {link.name: (link.first, link.second) for link in model.structure.links}
    return ends.get(enters, (enters.removeprefix("body:"), GROUND))


def scale_along(trajectories: Sequence[MeasuredTrajectory], model: Model, enters: str) -> Scale | None:
    """Scale of a place over training records of hits, from the measured motion; None where nothing moves.

    Parameters
    ----------
    trajectories : sequence of MeasuredTrajectory
        The records.
    model : Model
        Whose masses say what forces the motion takes.
    enters : str
        A link or ``"body:<name>"``.
    """
    first, second = ends_of(model, enters)
    force, x, v = list[float](), list[float](), list[float]()
    for trajectory in trajectories:
        ours = [body for body in model.structure.bodies if body.name in (first, second)]
        moving = [body for body in ours if body.name in trajectory.velocity]
        if trajectory.settings.hold_out or not moving:
            continue
        displacement, velocity = trajectory.relative((first, second))
        x.append(float(np.ptp(displacement)) / 2)
        v.append(float(np.abs(velocity).max()))
        accelerations = (np.diff(trajectory.velocity[body.name]) * trajectory.rate_hz for body in moving)
        force += [body.mass * float(a.std()) for body, a in zip(moving, accelerations, strict=True)]
    return Scale.largest(force, x, v)


def _typical_force(balance: Balance, mass: float) -> float:
    driven = float(balance.terms["force"].std())
    return driven if driven > 0 or not mass else mass * float(balance.terms["acceleration"].std())


def sees_normal_force(balances: Balances, enters: str) -> bool:
    """Whether the normal force of a link was measured."""
    motions = [record.motion[enters] for record in balances.records if enters in record.motion]
    return any(np.any(motion[2] > 0) for motion in motions)


def at_scale(
    member: Member, effect: Effect, scale: Scale, *, ground: bool, pressed: bool, criteria: Tension
) -> Effect:
    """Return the effect with defaults and ranges of the scale of its place.

    Parameters
    ----------
    member : Member
        Of the catalogue.
    effect : Effect
        At its place.
    scale : Scale
        Force and motion there.
    ground : bool
        Whether it acts between a body and the ground.
    pressed : bool
        Whether a tension or a measured normal force acts there; without one limits of sliders are constant.
    criteria : Tension
        How much wider than the scaled ranges they may be.

    Returns
    -------
    Effect
        At the same place, with other numbers.
    """
    wider = criteria.wider_range
    of_ground: Mapping[str, Parameter] = {**member.parameters, **member.ground}
    scaled = {}
    for name, of_joint in member.parameters.items():
        constant = name in member.limits and not pressed
        at_ground = (ground and not member.of_joint) or constant
        number, known = (of_ground[name], OF_GROUND) if at_ground else (of_joint, OF_JOINT)
        factor = scale.over(known, number.unit)
        low, high = (bound * factor for bound in number.bounds)
        if name in member.ends:
            low, high = member.ends[name]
        elif number.unit != "1" and name not in member.strict:
            low, high = low * (wider if low < 0 else 1 / wider), high * wider
        scaled[name] = replace(number, value=number.value * factor, bounds=(low, high))
    made = member.at(effect.enters, scaled)
    assert isinstance(made, Effect)
    return made


Scaled = TypeVar("Scaled", Effect, SensorFault)


def rescaled(correction: Scaled, scale: Scale, known: Scale = OF_JOINT) -> Scaled:
    """Return an effect or fault with every number and range as much larger as the scale is than a known one.

    Parameters
    ----------
    correction : Effect or SensorFault
        With numbers for the known scale.
    scale, known : Scale
        Where it is to act, and what its numbers are given for.

    Returns
    -------
    Effect or SensorFault
        The same with other numbers.
    """
    numbers = {}
    for name, number in correction.parameters.items():
        factor = scale.over(known, number.unit)
        low, high = number.bounds
        numbers[name] = replace(number, value=number.value * factor, bounds=(low * factor, high * factor))
    return replace(correction, parameters=numbers)
