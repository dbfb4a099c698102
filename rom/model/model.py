"""The reduced-order model: a structure, the laws of its links, and effects; simulation and model.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from rom.model.assembly import PLACES, TOLERANCE, Assembly, Response, assemble, simulate, tensions_of
from rom.model.batch import final_tension, mean_tensions
from rom.model.effect import Effect, ModelCorrection
from rom.model.law_change import LawChange, change_law
from rom.model.laws import Law, Parameter
from rom.model.link_force import equilibrium, link_force
from rom.model.places import check_effects, places_of
from rom.model.structure import Structure
from rom.viewed import Viewed

FloatArray = npt.NDArray[np.float64]


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
class Model(Viewed):
    """Structure, laws, effects and what ``predict`` needs beside them.

    Parameters
    ----------
    structure : Structure
        Bodies and links.
    link_laws : mapping of str to LinkLaws
        Laws of every link, by link.
    effects : tuple of ModelCorrection
        ModelCorrection effects, in order: forces, changes of the tension law, readings of the tension,
        faults of
        sensors. A simulation sees the first two; what compares it with records sees the others.
    filter_cutoff_hz : mapping of str to float
        High-pass cutoff of the filter chain by kind of test [Hz].
    calibration : tuple of float
        Coefficients of the tension calibration, lowest first.
    windows, sampling : mapping
        As in the campaign file.
    uncoupled_laws : mapping of str to LinkLaws
        Laws that differ while the bolt is out, by link (flexures stiffen when a bolt is tightened).
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

    def __getstate__(self) -> dict[str, object]:
        kept = {f.name for f in fields(self)}
        return {name: value for name, value in self.__dict__.items() if name in kept}  # no addresses of code

    @cached_property
    def acting_laws(self) -> Mapping[str, LinkLaws]:
        """Laws of every link as a simulation sees them, every change of the tension law in them."""
        return self._changed[0]

    @cached_property
    def assembly(self) -> Assembly:
        """Tables and coefficients for the kernels; made on first use."""
        laws, paths = self._changed
        made = assemble(replace(self, link_laws=laws))
        of_changes = {path: made.places[inner] for path, inner in paths.items()}
        return replace(made, places={**made.places, **of_changes})

    @cached_property
    def _changed(self) -> tuple[Mapping[str, LinkLaws], Mapping[str, str]]:
        """Laws with all changes in them, and where those have the parameters of the changes."""
        changes = [effect for effect in self.effects if isinstance(effect, LawChange)]
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

    def with_values(self, values: Mapping[str, float]) -> Model:
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
        return replace(
            self, structure=replace(self.structure, bodies=bodies), link_laws=link_laws, effects=effects
        )

    def with_effect(self, effect: ModelCorrection) -> Model:
        """The same model with one more effect of any kind; see ``Model`` for what is refused."""
        return replace(self, effects=(*self.effects, effect))

    def without_bolt(self) -> Model:
        """The same structure with every bolted link, and every effect in one, taken out."""
        links = tuple(link for link in self.structure.links if link.law != "bolted")
        laws = {link.name: self.uncoupled_laws.get(link.name, self.link_laws[link.name]) for link in links}
        return self.on(replace(self.structure, links=links), laws)

    def on(self, structure: Structure, link_laws: Mapping[str, LinkLaws]) -> Model:
        """The model of another structure, with those effects whose place is there too."""
        effects = tuple(effect for effect in self.effects if effect.enters in places_of(effect, structure))
        return replace(self, structure=structure, link_laws=link_laws, effects=effects)

    def link_force(
        self,
        link: str,
        displacement: npt.ArrayLike,
        rate_hz: float,
        tension: npt.ArrayLike = 0.0,
        *,
        settled: bool = False,
    ) -> FloatArray:
        """Force [N] of one link driven on its own through a relative displacement (samples,) [m].

        ``F = k(T) x + c(T) dx/dt + effects``, the velocity by central differences.

        Parameters
        ----------
        link : str
            The link.
        displacement : array, shape (samples,)
            Relative displacement, first body minus second [m].
        rate_hz : float
            Sampling rate [Hz].
        tension : float or array, shape (samples,)
            Tension or normal force that its laws and effects see [N].
        settled : bool
            Effects with memory start as the same motion backwards leaves them, not at zero.

        Raises
        ------
        ValueError
            If the link is unknown.
        """
        return link_force(self, link, displacement, rate_hz, tension, settled=settled)

    def simulate(
        self,
        force: Mapping[str, npt.ArrayLike],
        rate_hz: float,
        initial_tension: float | Mapping[str, float] | None = None,
        initial_displacement: Mapping[str, float] | None = None,
        initial_velocity: Mapping[str, float] | None = None,
        tolerance: float = TOLERANCE,
    ) -> Response:
        """Simulate the response to forces that run linearly between their samples.

        Parameters
        ----------
        force : mapping of str to array
            Force on each driven body [N]; arrays of equal length, one at least.
        rate_hz : float
            Sampling rate of the forces [Hz].
        initial_tension : float or mapping of str to float
            Tension at the first sample [N], by link where there are several bolted links.
        initial_displacement, initial_velocity : mapping of str to float
            State at the first sample by body [m], [m/s]; zero where not given. With neither given the bodies
            start at rest, where the constant forces of effects hold them.
        tolerance : float
            Local tolerance of the final tension relative to its change, and of velocities to their peak.

        Returns
        -------
        Response
            At the samples of the force; with the status ``"diverged"`` where the motion or a tension
            grows beyond all bounds.

        Raises
        ------
        ValueError
            If a shape, a body or a value is not what is required.
        """
        if initial_displacement is None and initial_velocity is None:
            initial_displacement = self.equilibrium(initial_tension)
        return simulate(
            self, force, rate_hz, initial_tension, initial_displacement, initial_velocity, tolerance
        )

    def equilibrium(
        self, initial_tension: float | Mapping[str, float] | None = None
    ) -> Mapping[str, float] | None:
        """Where effects without motion hold the bodies [m], by body; None where nothing pushes them.

        Forces that go with time count for nothing; nor is there a place of rest for a body that floats.
        """
        if not any(isinstance(effect, Effect) for effect in self.effects):
            return None
        return equilibrium(self, tensions_of(self.structure, initial_tension)) or None

    def final_tension(
        self,
        forces: npt.ArrayLike,
        rate_hz: float,
        initial_tension: npt.ArrayLike,
        vary: Mapping[str, npt.ArrayLike] | None = None,
        window_s: tuple[float, float] | None = None,
        body: str | None = None,
        tolerance: float = TOLERANCE,
    ) -> FloatArray:
        """Final tension of many cases that start at rest: the fast path.

        Parameters
        ----------
        forces : array, shape (cases, samples)
            Force on ``body`` [N].
        rate_hz : float
            Sampling rate [Hz].
        initial_tension : array, shape (cases,) or (cases, bolted links)
            Initial tensions [N].
        vary : mapping of str to array, shape (cases,)
            Values of parameters that differ between cases, by path; nothing is compiled again.
        window_s : tuple of float
            Mean over the samples of this window [s] in place of the last value; cut at the record's end.
        body : str
            The driven body; the first one if not given.
        tolerance : float
            Local tolerance relative to the change of tension.

        Returns
        -------
        ndarray, shape (cases,) or (cases, bolted links)
            Tension [N]; NaN for a case that diverged.

        Raises
        ------
        ValueError
            If a shape, a path or a value is not what is required.
        """
        return final_tension(self, forces, rate_hz, initial_tension, vary or {}, window_s, body, tolerance)

    def mean_tensions(
        self,
        forces: npt.ArrayLike,
        rate_hz: float,
        initial_tension: npt.ArrayLike,
        edges_s: npt.ArrayLike,
        vary: Mapping[str, npt.ArrayLike] | None = None,
        body: str | None = None,
        tolerance: float = TOLERANCE,
        tension_rate_hz: float | None = None,
    ) -> FloatArray:
        """Mean tensions over bins of time, of many cases that start at rest; as fast as ``final_tension``.

        Parameters
        ----------
        forces, rate_hz, initial_tension, vary, body, tolerance
            As for ``final_tension``. A run ends with its last bin.
        edges_s : array, shape (bins + 1,) or (cases, bins + 1)
            Rising edges of the bins [s]; a bin holds the samples from its edge to before the next, and is cut
            at the record's ends.
        tension_rate_hz : float
            Rate of the samples that are averaged [Hz], a divisor of ``rate_hz``; that itself if not given.

        Returns
        -------
        ndarray, shape (cases, bins) or (cases, bins, bolted links)
            Tension [N]; NaN for a case that diverged.

        Raises
        ------
        ValueError
            If a shape, a path or a value is not what is required, or a bin holds no sample.
        """
        return mean_tensions(
            self, forces, rate_hz, initial_tension, edges_s, tension_rate_hz, vary or {}, body, tolerance
        )

    def save(self, path: str | Path, **header: object) -> None:
        """Write ``model.json``; ``header`` fills the keys campaign, seed and elapsed_s, or adds others."""
        from rom.model_file import write_model

        write_model(self, Path(path), header)
