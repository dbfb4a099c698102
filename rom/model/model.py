"""The reduced-order model: its description, what simulates it, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rom.model.assembly import TOLERANCE, Assembly, Response, assemble, simulate, tensions_of
from rom.model.batch import final_tension, mean_tensions
from rom.model.description import LinkLaws, ModelDescription
from rom.model.link_force import equilibrium, link_force
from rom.model.writing import write_model
from rom.result_views import HasViews

__all__ = ["LinkLaws", "Model"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Model(ModelDescription, HasViews):
    """A reduced-order model that simulates, draws and saves itself; parameters as of its description."""

    def __getstate__(self) -> dict[str, object]:
        kept = {f.name for f in fields(self)}
        return {name: value for name, value in self.__dict__.items() if name in kept}  # no addresses of code

    @cached_property
    def assembly(self) -> Assembly:
        """Tables and coefficients for the kernels; made on first use."""
        return assemble(self)

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
        return link_force(self.assembly, link, displacement, rate_hz, tension, settled=settled)

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
            self.assembly, force, rate_hz, initial_tension, initial_displacement, initial_velocity, tolerance
        )

    def equilibrium(
        self, initial_tension: float | Mapping[str, float] | None = None
    ) -> Mapping[str, float] | None:
        """Where effects without motion hold the bodies [m], by body; None where nothing pushes them.

        Forces that go with time count for nothing; nor is there a place of rest for a body that floats.
        """
        if not self.effects_of("force"):
            return None
        return equilibrium(self.assembly, tensions_of(self.structure, initial_tension)) or None

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
        return final_tension(
            self.assembly, forces, rate_hz, initial_tension, self._checked(vary), window_s, body, tolerance
        )

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
            self.assembly,
            forces,
            rate_hz,
            initial_tension,
            edges_s,
            tension_rate_hz,
            self._checked(vary),
            body,
            tolerance,
        )

    def _checked(self, vary: Mapping[str, npt.ArrayLike] | None) -> Mapping[str, npt.ArrayLike]:
        for path in vary or {}:
            self.parameter(path)
        return vary or {}

    def save(self, path: str | Path, **header: object) -> None:
        """Write ``model.json``; ``header`` fills the keys campaign, seed and elapsed_s, or adds others."""
        write_model(self, Path(path), header)
