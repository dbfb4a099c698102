"""The numbers of a declared model as coefficients of its records' spectra, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rom.criteria.number import Numerical
from rom.effects import ModelCorrection, with_stiffness
from rom.identification.priors import PriorConstraint
from rom.identification.record_spectra import UNCOUPLED
from rom.identification.spectral_model import CORNER, SpectralRecord, key, step_unit
from rom.identification.uncoupled_priors import without_modes
from rom.model.laws import Law
from rom.model.model import LinkLaws, Model

_DIFFERENCE: Numerical[float] = 1e-4  # of a number's size
_TINY: Numerical[float] = 1e-9
# factors on a value at once: a start far away is found again by small steps alone
_LARGEST_STEP: Numerical[tuple[float, float]] = (0.3, 3.0)
_LEAST_CORNER: Numerical[float] = 1e-6  # [Hz]
Slopes = Mapping[str, float]
_OF_EFFECT = "effect|"


def effect_number(effect: ModelCorrection, parameter: str) -> str:
    """Name of a number of an effect; it is counted in shares of its size."""
    return f"{_OF_EFFECT}{effect.enters}|{effect.name}|{parameter}"


def is_of_effect(name: str) -> bool:
    """Whether a name is that of an effect's number."""
    return name.startswith(_OF_EFFECT)


def size_of(value: float) -> float:
    """What steps of a number are counted in."""
    return max(abs(value), _TINY)


@dataclass(frozen=True, eq=False)
class FreeParameters:
    """A model, and the corners of the sensors' AC coupling, as free numbers.

    A constant of a link or a mass is one number, counted in shares of its value; a law that sees the tension
    has its parameters, counted in shares of their sizes, behind the coefficient of every record. `ties` hold
    numbers that records hardly tell apart while the model lacks something.
    """

    model: Model
    corners: Mapping[str, float]
    ties: tuple[PriorConstraint, ...] = ()

    def values(self, record: SpectralRecord, tension: float) -> dict[str, float]:
        """Values of all terms of a record [SI], at a tension [N]."""
        found = {}
        for term in record.terms:
            if term.matrix == "corner":
                found[key(record, term)] = self.corners.get(term.name, self.corners.get(CORNER, term.value))
            elif term.given:
                found[key(record, term)] = term.value
            elif term.matrix == "mass":
                found[key(record, term)] = self._masses[term.name.split(".")[1]]
            else:
                found[key(record, term)] = float(self.law(term.name)(tension))
        return found

    def slopes(self, name: str, tension: float) -> Slopes:
        """Derivatives of a term's coefficient in its unit by the free numbers behind it, by their names."""
        if "@" not in name:
            return {name: 1.0}
        term = name.partition("@")[0]
        if (term, tension) not in self._slopes:  # a record's parts ask for the same
            self._slopes[term, tension] = self._slopes_of(term, tension)
        return self._slopes[term, tension]

    @cached_property
    def _slopes(self) -> dict[tuple[str, float], Slopes]:
        return {}

    def _slopes_of(self, term: str, tension: float) -> Slopes:
        """Derivatives of a law's value in shares of it."""
        law = self.law(term)
        here, found = float(law(tension)), {}
        if here == 0.0:  # a share of nothing is nothing
            return {}
        for parameter, value in law.parameters.items():
            size = size_of(value.value)
            moved = _within(law, parameter, value.value + _DIFFERENCE * size)
            step = moved.parameters[parameter].value - value.value
            if step == 0.0:
                moved = _within(law, parameter, value.value - _DIFFERENCE * size)
                step = moved.parameters[parameter].value - value.value
            if step == 0.0:  # its bounds give it
                continue
            found[f"{term}:{parameter}"] = (float(moved(tension)) - here) / here * size / step
        return found

    def change_with_tension(self, name: str, tension: float, error: float) -> float:
        """Return by what share of itself a term's coefficient changes with an error of the tension.

        Parameters
        ----------
        name : str
            Name of the coefficient; those of a record's joint alone follow its tension.
        tension, error : float
            Tension of the record, and by how much it may be off [N].

        Returns
        -------
        float
            Zero where nothing changes.
        """
        if "@" not in name:
            return 0.0
        law = self.law(name.partition("@")[0])
        ends = max(tension - error, 0.0), tension + error
        here, low, high = (float(law(at)) for at in (tension, *ends))
        return (high - low) / here * error / (ends[1] - ends[0]) if here and error > 0 else 0.0

    def stepped(self, steps: Mapping[str, float]) -> FreeParameters:
        """The same with its numbers moved, by the names of ``slopes`` and in their units."""
        model, corners = self.model, dict(self.corners)
        for name, step in steps.items():
            if name.startswith(CORNER):
                old = corners.get(name, corners.get(CORNER, step_unit(CORNER, 0.0)))
                corners[name] = max(old + step * step_unit(CORNER, old), _LEAST_CORNER)
            elif is_of_effect(name):
                model = _with_effect_step(model, name, step)
            else:
                model = _with_step(model, name, step)
        model = replace(model, effects=tuple(with_stiffness(effect, model) for effect in model.effects))
        return replace(self, model=model, corners=corners)

    @cached_property
    def believed(self) -> tuple[PriorConstraint, ...]:
        """The ties that hold beside the model's effects, which show in a body's own test too."""
        return without_modes(self.ties, {effect.enters for effect in self.model.effects})

    @cached_property
    def _masses(self) -> dict[str, float]:
        return {body.name: body.mass for body in self.model.structure.bodies}

    def law(self, term: str) -> Law:
        """The law of a link behind a term: its stiffness, with the bolt in or without, or its damping."""
        link, place, *rest = term.split(".")
        laws = self.model.link_laws[link]
        if rest == [UNCOUPLED]:
            laws = self.model.uncoupled_laws.get(link, laws)
        return laws.stiffness if place == "stiffness" else laws.damping


def _within(law: Law, parameter: str, value: float) -> Law:
    """The law with a value cut to its bounds; a step beyond all numbers, of a law gone astray, is none."""
    low, high = law.parameters[parameter].bounds
    value = value if np.isfinite(value) else law.parameters[parameter].value
    return law.with_values(**{parameter: float(np.clip(value, low, high))})


def _limited(value: float, step: float) -> float:
    """A value moved by a step, a share of its size, by no more than the largest; zero may go anywhere."""
    moved = value + step * size_of(value)
    if abs(value) <= _TINY or not np.isfinite(moved):
        return moved
    return value * float(np.clip(moved / value, *_LARGEST_STEP))


def _with_step(model: Model, name: str, step: float) -> Model:
    path, _, parameter = name.partition(":")
    link, place, *rest = path.split(".")
    if link == "body":
        mass = {place: float(np.clip(1 + step, *_LARGEST_STEP))}
        bodies = tuple(replace(b, mass=b.mass * mass.get(b.name, 1.0)) for b in model.structure.bodies)
        return replace(model, structure=replace(model.structure, bodies=bodies))
    apart = rest == [UNCOUPLED] and link in model.uncoupled_laws
    every = model.uncoupled_laws if apart else model.link_laws
    laws = every[link]
    law = laws.stiffness if place == "stiffness" else laws.damping
    if parameter:
        old = law.parameters[parameter].value
        law = _within(law, parameter, _limited(old, step))
    else:
        factor = float(np.clip(1 + step, *_LARGEST_STEP))
        for constant, value in law.parameters.items():
            law = _within(law, constant, value.value * factor)
    changed: Mapping[str, LinkLaws] = {**every, link: replace(laws, **{place: law})}
    if apart:
        return replace(model, uncoupled_laws=changed)
    alone = model.uncoupled_laws
    if place == "damping" and link in alone:  # one number, with the bolt in or without
        alone = {**alone, link: replace(alone[link], damping=law)}
    return replace(model, link_laws=changed, uncoupled_laws=alone)


def _with_effect_step(model: Model, name: str, step: float) -> Model:
    enters, effect_name, parameter = name.removeprefix(_OF_EFFECT).split("|")
    effects = []
    for effect in model.effects:
        if (effect.enters, effect.name) == (enters, effect_name):
            old = effect.parameters[parameter]
            value = float(np.clip(old.value + step * size_of(old.value), *old.bounds))
            effect = effect.with_values(**{parameter: value})
        effects.append(effect)
    return replace(model, effects=tuple(effects))
