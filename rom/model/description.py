"""What a reduced-order model is: a structure, the laws of its links, and effects; no simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Literal, Self, overload

from rom.model.effect import Effect, Kind, ModelCorrection, Reading, SensorFault
from rom.model.law_change import LawChange, change_law
from rom.model.laws import Law, Parameter
from rom.model.places import check_effects, places_of
from rom.model.rate_uncertainty import RateUncertainty
from rom.model.shapes import ModeShapes
from rom.model.structure import Structure

PLACES = ("stiffness", "damping", "tension_rate")


@dataclass(frozen=True)
class LinkLaws:
    """Stiffness, damping and, for a bolted link, the law of its tension.

    Raises
    ------
    ValueError
        If a law stands where it does not enter.
    """

    stiffness: Law
    damping: Law
    tension_rate: Law | None = None

    def __post_init__(self) -> None:
        for place, law in zip(PLACES, (self.stiffness, self.damping, self.tension_rate), strict=True):
            if law is not None and law.enters != place.replace("_", " "):
                raise ValueError(f"{place} must be a law that enters there, got {law.name!r} ({law.enters})")


@dataclass(frozen=True)
class ModelDescription:
    """Structure, laws, effects, and what processing needs beside them.

    Parameters
    ----------
    structure : Structure
        Bodies and links.
    link_laws : mapping of str to LinkLaws
        Laws of every link, by link.
    effects : tuple of ModelCorrection
        In order: forces, changes of the tension law, readings of the tension, faults of sensors. A
        simulation sees the first two; what compares it with records sees the others.
    filter_cutoff_hz : mapping of str to float
        High-pass cutoff of the filter chain by kind of test [Hz].
    calibration : tuple of float
        Coefficients of the tension calibration, lowest first.
    windows, sampling : mapping
        As in the campaign file.
    uncoupled_laws : mapping of str to LinkLaws
        Laws that differ while the bolt is out, by link (flexures stiffen when a bolt is tightened).
    rate_uncertainty : RateUncertainty
        How far one new test may be from the tension law; dropped where that or its numbers change.
    shapes : ModeShapes
        What sensors show of bodies that are modes; None where bodies are masses that move.
    identification : object
        What an identification reports of itself; not saved.

    Raises
    ------
    ValueError
        If laws and links do not match, an effect enters where there is nothing or where its kind cannot, or
        two effects of one name enter at one place.
    """

    structure: Structure
    link_laws: Mapping[str, LinkLaws]
    effects: tuple[ModelCorrection, ...] = ()
    filter_cutoff_hz: Mapping[str, float] = field(default_factory=dict)
    calibration: tuple[float, ...] = ()
    windows: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sampling: Mapping[str, float] = field(default_factory=dict)
    uncoupled_laws: Mapping[str, LinkLaws] = field(default_factory=dict)
    rate_uncertainty: RateUncertainty | None = field(default=None, repr=False)
    shapes: ModeShapes | None = None
    identification: object | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("link_laws", "filter_cutoff_hz", "windows", "sampling", "uncoupled_laws"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        names = set(self.structure.link_names)
        if set(self.link_laws) != names:
            raise ValueError(
                f"laws must be given for the links {sorted(names)}, got {sorted(self.link_laws)}"
            )
        for link in self.structure.links:
            if (self.link_laws[link.name].tension_rate is not None) != (link.law == "bolted"):
                raise ValueError(
                    f"link {link.name!r} is {link.law}: only bolted links have a tension law, and all have"
                )
        check_effects(self.effects, self.structure)

    @cached_property
    def acting_laws(self) -> Mapping[str, LinkLaws]:
        """Laws of every link as a simulation sees them, every change of the tension law in them."""
        return self.changed_laws[0]

    @cached_property
    def changed_laws(self) -> tuple[Mapping[str, LinkLaws], Mapping[str, str]]:
        """Laws with all changes in them, and where those have the parameters of the changes."""
        changes = self.effects_of("law change")
        if not changes:
            return self.link_laws, {}
        link = self.structure.bolted_links[0]
        laws = self.link_laws[link]
        assert laws.tension_rate is not None
        rate, names = change_law(laws.tension_rate, changes)
        paths = {path: f"{link}.tension_rate.{name}" for path, name in names.items()}
        return {**self.link_laws, link: replace(laws, tension_rate=rate)}, paths

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Every parameter by path, e.g. ``"joint.tension_rate.gamma"`` or ``"body.lo.mass"``."""
        found = {f"body.{body.name}.mass": Parameter(body.mass, "kg") for body in self.structure.bodies}
        for link, laws in self.link_laws.items():
            for place, law in zip(PLACES, (laws.stiffness, laws.damping, laws.tension_rate), strict=True):
                if law is not None:
                    found |= {f"{link}.{place}.{name}": value for name, value in law.parameters.items()}
        for effect in self.effects:
            found |= {f"{effect.path}.{name}": p for name, p in effect.parameters.items()}
        if self.shapes is not None:
            found |= self.shapes.numbers
        return MappingProxyType(found)

    def parameter(self, path: str) -> Parameter:
        """The parameter at a path.

        Raises
        ------
        ValueError
            If there is none.
        """
        try:
            return self.parameters[path]
        except KeyError:
            raise ValueError(f"parameter must be one of {', '.join(self.parameters)}, got {path!r}") from None

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The same model with other parameter values, by path; nothing is compiled again.

        Raises
        ------
        ValueError
            If a path is unknown or a value is outside its bounds.
        """
        for path in values:
            self.parameter(path)

        def below(prefix: str) -> dict[str, float]:
            return {path.removeprefix(prefix): v for path, v in values.items() if path.startswith(prefix)}

        bodies = tuple(
            replace(body, mass=float(values.get(f"body.{body.name}.mass", body.mass)))
            for body in self.structure.bodies
        )
        link_laws = {}
        for link, laws in self.link_laws.items():
            rate = laws.tension_rate
            link_laws[link] = LinkLaws(
                laws.stiffness.with_values(**below(f"{link}.stiffness.")),
                laws.damping.with_values(**below(f"{link}.damping.")),
                rate and rate.with_values(**below(f"{link}.tension_rate.")),
            )
        effects = tuple(e.with_values(**below(f"{e.path}.")) for e in self.effects)
        structure = replace(self.structure, bodies=bodies)
        known = None if any(".tension_rate." in path for path in values) else self.rate_uncertainty
        shapes = self.shapes and self.shapes.with_values(values)
        return replace(
            self, structure=structure, link_laws=link_laws, effects=effects, rate_uncertainty=known,
            shapes=shapes,
        )  # fmt: skip

    def with_effect(self, effect: ModelCorrection) -> Self:
        """The same model with one more effect of any kind; see ``ModelDescription`` for what is refused."""
        return replace(self, effects=(*self.effects, effect))

    def with_tension_law(self, law: Law, link: str | None = None) -> Self:
        """The same model with another law of the tension in a bolted link; the first one if not given.

        Raises
        ------
        ValueError
            If the link is not bolted.
        """
        bolted = self.structure.bolted_links
        if link not in (*bolted, None) or not bolted:
            raise ValueError(f"link must be one of the bolted links {bolted}, got {link!r}")
        link = link or bolted[0]
        laws = {**self.link_laws, link: replace(self.link_laws[link], tension_rate=law)}
        return replace(self, link_laws=laws, rate_uncertainty=None)

    @overload
    def effects_of(self, kind: Literal["force"]) -> tuple[Effect, ...]: ...
    @overload
    def effects_of(self, kind: Literal["law change"]) -> tuple[LawChange, ...]: ...
    @overload
    def effects_of(self, kind: Literal["reading"]) -> tuple[Reading, ...]: ...
    @overload
    def effects_of(self, kind: Literal["sensor fault"]) -> tuple[SensorFault, ...]: ...
    def effects_of(self, kind: Kind) -> tuple[ModelCorrection, ...]:
        """The effects of one kind, in order."""
        return tuple(effect for effect in self.effects if effect.kind == kind)

    def without_effects_of(self, *kinds: Kind) -> Self:
        """The same model without its effects of some kinds."""
        return replace(self, effects=tuple(effect for effect in self.effects if effect.kind not in kinds))

    def without_bolt(self) -> Self:
        """The same structure with every bolted link, and every effect in one, taken out."""
        links = tuple(link for link in self.structure.links if link.law != "bolted")
        laws = {link.name: self.uncoupled_laws.get(link.name, self.link_laws[link.name]) for link in links}
        return self.on(replace(self.structure, links=links), laws)

    def on(self, structure: Structure, link_laws: Mapping[str, LinkLaws]) -> Self:
        """The model of another structure, with those effects whose place is there too."""
        effects = tuple(effect for effect in self.effects if effect.enters in places_of(effect, structure))
        known = self.rate_uncertainty if structure.bolted_links == self.structure.bolted_links else None
        return replace(
            self, structure=structure, link_laws=link_laws, effects=effects, rate_uncertainty=known
        )
