"""Catalogue of effects that a model may lack: a file per family, found by its ``MEMBERS``.

A new effect is one more ``Member`` in a file of this folder, in a file of one's own and ``register``, or in
an installed package with an entry point of the group ``boltlaw.effects``. May import `rom.model`, and from
`rom.kernels` what compiles a function.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rom.effects.free_form import FREE_FORM, free_form
from rom.effects.member import Member
from rom.model.effect import Effect, ModelCorrection, Motion, Reading, SensorFault
from rom.model.law_change import LawChange
from rom.model.laws import Parameter
from rom.plug_ins import EFFECTS, members_of, plug_ins

if TYPE_CHECKING:
    from rom.model.model import Model

__all__ = [
    "CATALOGUE",
    "Effect",
    "LawChange",
    "Member",
    "ModelCorrection",
    "Motion",
    "Reading",
    "SensorFault",
    "candidates",
    "candidates_of",
    "free_form",
    "look_alikes",
    "make",
    "places",
    "register",
    "with_stiffness",
]

E = TypeVar("E", bound=ModelCorrection)
_members: dict[str, Member] = {}
CATALOGUE: Mapping[str, Member] = MappingProxyType(_members)
"""Members of the catalogue by name."""


def register(*members: Member) -> None:
    """Add members to the catalogue of this process.

    Raises
    ------
    ValueError
        If there is another member of the same name.
    """
    for member in members:
        if _members.setdefault(member.name, member) != member:
            raise ValueError(f"an effect's name must be new to the catalogue, got {member.name!r}")


for _module in sorted(info.name for info in iter_modules(__path__) if not info.name.startswith("_")):
    register(*getattr(import_module(f"{__name__}.{_module}"), "MEMBERS", ()))


def make(name: str, enters: str, parameters: Mapping[str, Parameter], equation: str = "") -> ModelCorrection:
    """The effect of a model from what its file says: of the catalogue, or free-form from its equation.

    Parameters
    ----------
    name : str
        Name of the effect.
    enters : str
        Where it enters: a link, ``"body:<name>"``, ``"tension"`` or ``"sensor:<channel>"``.
    parameters : mapping of str to Parameter
        Parameters by name.
    equation : str
        The equation.

    Returns
    -------
    ModelCorrection
        The effect.

    Raises
    ------
    ValueError
        If the catalogue has none of that name.
    """
    if name == FREE_FORM:
        return free_form(equation, enters, parameters)
    if name not in _members:
        raise ValueError(f"an effect must be one of {', '.join((*_members, FREE_FORM))}, got {name!r}")
    return _members[name].at(enters, parameters)


def look_alikes(name: str) -> tuple[str, ...]:
    """Other members that share a class with one: these data may not tell them apart."""
    classes = set(CATALOGUE[name].classes)
    return tuple(n for n, member in CATALOGUE.items() if n != name and classes & set(member.classes))


def kind_of_link(ends: tuple[str, str], law: str) -> str:
    """Whether a link is a joint or the ground's: a bolted one is a joint wherever it ends."""
    return "ground" if "ground" in ends and law != "bolted" else "joint"


def places(model: Model, channels: Iterable[str] = ()) -> Mapping[str, str]:
    """Where effects can enter: ``enters`` and the kind of the place, for a model and measured channels."""
    structure = model.structure
    found = {link.name: kind_of_link((link.first, link.second), link.law) for link in structure.links}
    found |= {f"body:{name}": "body" for name in structure.body_names}
    if structure.bolted_links:
        found["tension"] = "tension"
    for channel in channels:
        shown = "tension" if channel == "strain" else channel  # a gauge's faults are told as tension
        found[f"sensor:{shown}"] = f"sensor:{shown.partition('_')[0]}"
    return found


def candidates(
    model: Model, channels: Iterable[str] = (), *, core: bool = True
) -> tuple[tuple[Member, ModelCorrection], ...]:
    """Every effect of the catalogue at every place of a model where it can enter, with physical defaults.

    Parameters
    ----------
    model : Model
        The model that may lack one.
    channels : iterable of str
        Measured channels whose sensors may be at fault.
    core : bool
        Only members that are marked as core.
    """
    bolted = model.structure.bolted_links
    return tuple(
        (member, with_stiffness(member.at(enters, ground=kind == "ground"), model))
        for member in CATALOGUE.values()
        if member.core or not core
        for enters, kind in places(model, channels).items()
        if kind in member.places
        if not member.tensioned or (bolted if kind == "ground" else enters in bolted)
    )


def candidates_of(
    kind: type[E], model: Model, channels: Iterable[str] = (), *, core: bool = True
) -> tuple[tuple[Member, E], ...]:
    """Candidates of one type that the model does not hold yet.

    Parameters
    ----------
    kind : type
        `Effect`, `LawChange`, `Reading` or `SensorFault`.
    model : Model
        The model that may lack one.
    channels, core
        As for `candidates`.
    """
    known = {effect.path for effect in model.effects}
    found = candidates(model, channels, core=core)
    return tuple((m, e) for m, e in found if isinstance(e, kind) and e.path not in known)


def in_record(model: Model, given: Mapping[str, float]) -> Model:
    """The model as it is in a record that gives masses and stiffnesses of its own, by path.

    Bodies and links that the model does not have, and laws without such a number, count for nothing.
    """
    if not given:
        return model
    known = model.parameters
    model = model.with_values({path: value for path, value in given.items() if path in known})
    alone = {}
    for link, laws in model.uncoupled_laws.items():
        k = given.get(f"{link}.stiffness.k")
        stiffness = laws.stiffness if k is None else laws.stiffness.with_values(k=k)
        alone[link] = replace(laws, stiffness=stiffness)
    effects = tuple(with_stiffness(effect, model) for effect in model.effects)
    return replace(model, uncoupled_laws=alone, effects=effects)


def with_stiffness(effect: E, model: Model) -> E:
    """The effect with those parameters that are the stiffness law's own, as far as they are plausible."""
    laws, member = model.link_laws.get(effect.enters), CATALOGUE.get(effect.name)
    if laws is None or member is None:
        return effect
    law = laws.stiffness.parameters
    own = {name: law[name].value for name in member.of_stiffness if name in law}
    return effect.with_values(**{n: float(np.clip(v, *effect.parameters[n].bounds)) for n, v in own.items()})


def _register_plug_ins() -> None:
    """Add the effects of installed packages, once all that they may import from here is there.

    Raises
    ------
    ValueError
        If one has the name of another's.
    """
    owners = dict.fromkeys(_members, "boltlaw")
    for package, members in plug_ins(EFFECTS, lambda found: members_of(found, Member)):
        for member in members:
            owner = owners.setdefault(member.name, package)
            if owner != package or _members.get(member.name, member) != member:
                raise ValueError(
                    f"plug-in {package!r}: found an effect {member.name!r}, which {owner!r} has too, "
                    "expected another name"
                )
        register(*members)


_register_plug_ins()
