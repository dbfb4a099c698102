"""Models of one campaign, refitted to all its training records: with one effect more, or without one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discovery.decide.acceptance import MATERIAL, QUIET
from discovery.decide.explanation import Explanation
from discovery.loop.history import FAR_LESS
from discovery.loop.state import (
    Stages,
    State,
    cost,
    level,
    linearised_start,
    refit_fault,
    refitted,
    set_aside,
    settled,
    with_law,
)
from discovery.options import Options
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.output_error import WhitenedResidual, starting, whiten, whitened_residual_of
from discovery.residual.tension import TensionResidual
from discovery.residual.trajectory import Measurements, read_measurements
from rom.campaign.campaign import Campaign
from rom.effects import Effect, LawChange, Reading, SensorFault, with_stiffness
from rom.identification.identify import Identification, reidentified
from rom.identification.noise_spectrum import Group, NoiseFloor
from rom.identification.spectral_model import SpectralRecord
from rom.identification.uncoupled_priors import as_uncoupled, unlikely
from rom.signals.per_record_parameters import per_record_names


@dataclass(frozen=True, eq=False)
class Refits:
    """Fits of a campaign's models by records that are traced along them."""

    campaign: Campaign
    found: Identification
    jobs: int
    stage: Stages

    @cached_property
    def measurements(self) -> Measurements:
        """All sound records as they were measured."""
        return read_measurements(self.campaign, set_aside(self.found))

    def options(self, seed: int = 0) -> Options:
        """How explainers are run."""
        return Options(self.jobs, self.stage, seed)

    def tension_of(self, state: State) -> TensionResidual:
        """What a state's model leaves over of the tension."""
        return TensionResidual(self.campaign, state.found, state.model, self.options())

    def start(self) -> State:
        """The declared model, its numbers refitted to all training records.

        An effect may pass for damping in the identification, which is free to scale what it weighs.
        """
        evidence = refitted(self.gathered(starting(self.found, self.found.model)))
        return self.settled(self._nearer(evidence))

    def _nearer(self, evidence: WhitenedResidual) -> WhitenedResidual:
        """Start from the uncoupled tests instead, where that leaves far less.

        An identification takes what it leaves over for noise: misfit, alike in all coupled records, may lead
        its links anywhere, too far for steps to lead back.
        """
        ties = self.found.linear.ties if self.found.linear is not None else ()
        if level(evidence) <= QUIET or not ties:
            return evidence
        baseline = starting(self.found, as_uncoupled(self.found.model, ties))
        other = refitted(self.gathered(baseline, evidence.floors))
        if level(other) >= FAR_LESS * level(evidence):
            return evidence
        return refitted(self.gathered(other.baseline))

    def gathered(
        self, baseline: FreeParameters, floors: Mapping[Group, NoiseFloor] | None = None
    ) -> WhitenedResidual:
        """All sound records traced along a model, and what it leaves over."""
        return whitened_residual_of(self.campaign, baseline, self.measurements, floors, self.stage("tracing"))

    def settled(self, evidence: WhitenedResidual, *, learned: bool = False) -> State:
        """Learn the tension law anew unless it is ``learned`` already, and tell the errors."""
        return settled(self.campaign, self.found, evidence, self.jobs, self.stage, learned=learned)

    def adopt(self, state: State, one: Explanation, *, floors_too: bool = False) -> State:
        """Add an effect, refit everything together, and tell the errors."""
        return self.settled(self.beside(state, one, floors_too=floors_too), learned=bool(one.beside))

    def beside(self, state: State, one: Explanation, *, floors_too: bool = False) -> WhitenedResidual:
        """Add an effect, trace all records anew and refit everything together.

        ``floors_too``: what was in the noise before the hits is not any more.
        """
        effect, near = one.effect, state.evidence.baseline
        if isinstance(effect, LawChange | Reading):  # the motion does not see it
            model = effect.added_to(with_law(state.model, one.beside))
            return replace(state.evidence, baseline=replace(near, model=model))
        model, floors = effect.added_to(near.model), None if floors_too else state.evidence.floors
        if isinstance(effect, Effect) and not floors_too:  # first along the old model's traces
            near = self._fitted(linearised_start(state.evidence, effect)).baseline
            model = near.model
        evidence = self._fitted(self.gathered(replace(near, model=model), floors))
        if isinstance(effect, SensorFault) and not (
            floors_too or per_record_names(effect)
        ):  # from afar so far
            again = refitted(self.gathered(refit_fault(evidence, effect), evidence.floors))
            evidence = min(evidence, again, key=cost)
        return evidence

    def _fitted(self, evidence: WhitenedResidual) -> WhitenedResidual:
        """Fit all numbers together; where more than noise is left, also from a start that forgets them.

        A model that lacked the effect may have been far from its plant, where steps do not lead back, and one
        whose numbers uncoupled tests deny still is.
        """
        after = refitted(evidence)
        if level(after) <= QUIET and not _denied(after):
            return after
        records: dict[str, list[SpectralRecord]] = {}
        for trace, part, _ in after.parts:
            if not trace.settings.hold_out:
                records.setdefault(trace.settings.file, []).append(part)
        near, parts = after.baseline.model, [tuple(parts) for parts in records.values()]
        try:
            anew = reidentified(
                self.found, parts, self.campaign.settings, {effect.enters for effect in near.effects}
            )
        except np.linalg.LinAlgError:  # forces along a motion that is nowhere near the measured one
            return after
        effects = tuple(with_stiffness(effect, anew) for effect in near.effects)
        model = replace(anew, effects=effects, identification=None)
        other = refitted(whiten(after.traces, replace(after.baseline, model=model), after.floors))
        return min(after, other, key=lambda e: cost(e) * (1 + MATERIAL * bool(_denied(e))))


def _denied(evidence: WhitenedResidual) -> tuple[str, ...]:
    """Numbers of a model that uncoupled tests deny."""
    return unlikely(evidence.baseline.model, evidence.baseline.believed)
