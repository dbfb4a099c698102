"""Models of a campaign without a bolt, refitted by simulation from states of the records' own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.decide.acceptance import OVER_NOISE, MaterialErrors, motion_errors
from discovery.decide.explanation import Explanation
from discovery.detection.limit import Meter
from discovery.detection.simulation import DecayMeter
from discovery.explain.probes import cut_to_bounds
from discovery.explain.simulation import explain_screened, free_forms, screen
from discovery.explain.simulation_fit import fitted, together
from discovery.localisation.localise import Localisation
from discovery.localisation.simulation import localise_motion
from discovery.loop.history import LoopHistory
from discovery.loop.refits import FixedTensionRefits, Probes
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Residual, cost
from discovery.residual.course_fit import Misfit
from discovery.residual.fitted_number import LEAST_MASS
from discovery.residual.simulation import SimulationResidual, over_noise, refitted
from rom.campaign.campaign import Campaign
from rom.campaign.settings import RecordSettings
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, ModelCorrection
from rom.evaluation.error_measures import ErrorsByKind
from rom.identification.force_noise import with_force_noise
from rom.identification.free_decay import fit_free_decay, free_model, ring_downs
from rom.identification.identify import identify_campaign
from rom.identification.modal_model import identify_modes
from rom.identification.ring_down import RingDown
from rom.identification.ring_down_states import fitted_state
from rom.model.model import Model
from rom.signals.quality import Doubt

_VANISHED: Numerical[float] = 1e-6  # of a number: rounding beside its bound


@dataclass(frozen=True, eq=False)
class FreeRefits(FixedTensionRefits[SimulationResidual]):
    """Fits of a campaign's models to ring-downs, to driven records, or to records of modes, by simulation.

    Attributes
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    rings : tuple of RingDown
        Sound records.
    declared : Model
        The declared model.
    free : tuple of str
        Paths of its numbers that the records tell.
    lines : tuple of str
        What to know of them.
    """

    campaign: Campaign
    rings: tuple[RingDown, ...]
    declared: Model
    free: tuple[str, ...]
    lines: tuple[str, ...]
    record_doubts: tuple[Doubt, ...]
    options: Options
    residual_type = SimulationResidual

    @classmethod
    def of(cls, campaign: Campaign, options: Options) -> FreeRefits:
        """Read all records and identify the declared model.

        Raises
        ------
        ValueError
            If no training record is sound.
        """
        options.stage("identifying")
        rings, doubts = ring_downs(campaign)
        fit = fit_free_decay(rings, campaign)
        model = free_model(campaign.settings, fit)
        return cls(campaign, rings, model, fit.free, fit.lines, doubts, options)

    @classmethod
    def of_modes(cls, campaign: Campaign, options: Options) -> FreeRefits:
        """Read all records of a campaign of modes and identify them.

        Raises
        ------
        ValueError
            If no training record is sound.
        """
        options.stage("identifying")
        found = identify_modes(campaign)
        rings, lines = with_force_noise(found.rings, found.model, campaign)
        return cls(campaign, rings, found.model, found.free, (*found.lines, *lines), found.doubts, options)

    @classmethod
    def of_driven(cls, campaign: Campaign, options: Options) -> FreeRefits:
        """Read all records of driven bodies and identify the declared model by output error.

        Raises
        ------
        ValueError
            If nothing can be identified from the campaign.
        """
        found = identify_campaign(campaign, options.jobs, options.stage("identifying"))
        rings, doubts = ring_downs(campaign)
        model = replace(found.model, identification=None)
        given = {f"body.{body.name}.mass" for body in campaign.settings.body if body.mass_kg is not None}
        free = tuple(
            path
            for path, number in model.parameters.items()
            if path not in given and (number.source == "identified" or path.startswith("body."))
        )
        rings, lines = with_force_noise(rings, model, campaign)
        return cls(campaign, rings, model, free, (*found.warnings, *lines), doubts, options)

    @property
    def aside(self) -> tuple[Doubt, ...]:
        """Doubts about records."""
        return self.record_doubts

    @property
    def warnings(self) -> tuple[str, ...]:
        """What fixes the scale of the numbers."""
        return self.lines

    def start(self) -> State:
        """The declared model."""
        states = tuple(fitted_state(ring, self.declared) for ring in self.rings)
        residual = SimulationResidual(self.rings, self.declared, self.free, states, self.options.criteria)
        return self.evaluated(refitted(residual).residual)

    @property
    def sound(self) -> list[RecordSettings]:
        """Records that were compared."""
        compared = {ring.file for ring in self.rings}
        return [record for record in self.campaign.settings.record if record.file in compared]

    def _model_of(self, residual: SimulationResidual) -> tuple[Model, tuple[str, ...]]:
        return residual.model, ()

    def _material_errors(self, residual: SimulationResidual, errors: ErrorsByKind) -> MaterialErrors:
        """Of displacements, and of the motion as it is measured, over its noise.

        Where slow noise of an integrated motion makes most of the displacements' errors, these hardly tell.
        """
        held_out = np.array([ring.hold_out for ring in residual.rings])[residual.owner]
        pairs = zip(motion_errors(errors), (held_out, ~held_out), strict=True)
        return tuple({**of, OVER_NOISE: over_noise(residual.residual[rows])} for of, rows in pairs)

    def _fitted_with(self, residual: SimulationResidual, effect: ModelCorrection) -> SimulationResidual:
        return fitted(residual, [effect])

    def _fitted_without(self, residual: SimulationResidual, effect: ModelCorrection) -> SimulationResidual:
        others = tuple(_beside(e, effect) for e in residual.model.effects if e.path != effect.path)
        return together(replace(residual, model=replace(residual.model, effects=others)))

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        """The last model refitted from where a fit beside an effect ended."""
        return self._fitted_without(self.own(residual), effect)

    def settled(self, residual: Residual) -> Residual:
        """Where a thorough fit ends; the same object where it hardly gains."""
        own = self.own(residual)
        if not own.model.effects:
            return residual
        after = together(replace(own, thorough=True))
        gained = cost(own) - cost(after)
        return replace(after, thorough=own.thorough) if gained > own.little(cost(own)) else residual

    def screen(self, residual: Residual) -> Probes:
        """Probes of every force of the catalogue at the scale of its place."""
        return screen(self.own(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises."""
        return explain_screened(probes, self.own(residual), self.options)

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """The best sparse sum of terms in one link."""
        return free_forms(self.own(state.residual), self.options)

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Masses and stiffnesses that effects have driven to zero."""
        first, last = history.states[0].model, history.last.model
        lines = []
        for path in self.free:
            before, after = first.parameter(path).value, last.parameter(path).value
            least = 2 * LEAST_MASS if path.endswith(".mass") else _VANISHED
            if path.endswith((".mass", ".k")) and after < least * before:
                lines.append(f"{path}: next to nothing with the effects, {before:.4g} without them")
        return tuple(lines)

    def meters(self, history: LoopHistory) -> Sequence[Meter]:
        """Forces in the ring-downs."""
        judged = {one.settings.file: one.comparisons[:1] for one in history.last.evaluations}
        errors = {file: of[0].motion_nrmse if of else {} for file, of in judged.items()}
        return [DecayMeter(self.own(history.last.residual), errors, history.chance)]

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        """Where the residual lives."""
        return localise_motion(self.own(state.residual))


def _beside(other: ModelCorrection, dropped: ModelCorrection) -> ModelCorrection:
    """An effect that takes over the strength of a special case of it that is dropped in its place."""
    member = CATALOGUE.get(other.name)
    if member is None or dropped.name not in member.contains or dropped.enters != other.enters:
        return other
    shared = [name for name in member.strengths if name in dropped.parameters]
    sums = {n: other.parameters[n].value + dropped.parameters[n].value for n in shared}
    return cut_to_bounds(other, sums)
