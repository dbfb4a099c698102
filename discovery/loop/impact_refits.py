"""Models of a campaign of impact tests, refitted to all its training records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discovery.courses.fit import refine
from discovery.decide.acceptance import in_tension, is_accepted, motion_errors
from discovery.decide.explanation import Explanation
from discovery.detection.limit import Meter
from discovery.detection.motion import MotionMeter
from discovery.detection.tension import GaugeMeter
from discovery.explain import at_rest, free_form
from discovery.explain.calibration import DISAGREE
from discovery.explain.motion import explain_screened, explanation, motion_channels, screen
from discovery.explain.motion_fit import (
    linearised_start,
    reestimate_noise,
    refit,
    refit_fault,
    refit_from_afar,
    residual_without,
    with_effects,
    without_effect,
)
from discovery.explain.simulated_fit import SimulatedFit
from discovery.laws.given import given_law
from discovery.localisation.localise import Localisation, localise
from discovery.loop.declared_law import tension_law_of, with_law_numbers, with_law_of
from discovery.loop.found_effects import as_first_fitted
from discovery.loop.history import LoopHistory, misfit_views
from discovery.loop.refits import CampaignRefits, Probes
from discovery.loop.refitted_numbers import effect_with_limits
from discovery.loop.state import State, errors_of
from discovery.options import Options
from discovery.residual.base import Residual, cost, level
from discovery.residual.collapse import Followed
from discovery.residual.course_fit import Misfit
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.output_error import WhitenedResidual, starting, whitened_residual_of
from discovery.residual.tension import TensionResidual
from discovery.residual.trajectory import read_measurements
from discovery.separating_tests.effects import separating_tests
from rom.campaign.campaign import Campaign
from rom.effects import CATALOGUE, Effect, LawChange, ModelCorrection, Reading, SensorFault, with_stiffness
from rom.identification.identify import Identification, identify_campaign
from rom.identification.noise_spectrum import Group, NoiseDensity
from rom.identification.spectral_model import SpectralRecord
from rom.identification.uncoupled_priors import as_uncoupled, unlikely
from rom.model.laws import Law, Parameter
from rom.model.model import Model
from rom.signals.per_record_parameters import per_record_names
from rom.signals.quality import Doubt

NOT_EXPLAINED = "the motion is not explained, so no effect in the tension is looked for"


@dataclass(frozen=True, eq=False)
class ImpactRefits(CampaignRefits[WhitenedResidual]):
    """Fits of a campaign's models by records that are followed along them."""

    campaign: Campaign
    identification: Identification
    options: Options
    residual_type = WhitenedResidual

    @classmethod
    def of(
        cls,
        campaign: Campaign,
        options: Options,
        faults: tuple[SensorFault, ...] = (),
        warnings: tuple[str, ...] = (),
        law: Law | None = None,
    ) -> ImpactRefits:
        """Identify a campaign.

        Parameters
        ----------
        campaign : Campaign
            As read by `rom.read_campaign`.
        options : Options
            How the loop is run.
        faults : tuple of SensorFault
            Of the gauge, known before.
        warnings : tuple of str
            What is already known of the campaign.
        law : Law
            Form of the tension law, its numbers the start; gamma(T) of the paper if not given.

        Returns
        -------
        ImpactRefits
            With the campaign's identification.

        Raises
        ------
        ValueError
            If nothing can be identified from the campaign.
        """
        identification = identify_campaign(campaign, options.jobs, options.stage("identifying"), faults, law)
        warnings = (*identification.warnings, *warnings)
        return cls(campaign, replace(identification, warnings=warnings), options)

    @property
    def aside(self) -> Sequence[Doubt]:
        """What the identification doubts."""
        return self.identification.set_aside

    @property
    def warnings(self) -> tuple[str, ...]:
        """Which records are not followed."""
        return self.measured.warnings

    @property
    def of_declared(self) -> tuple[str, ...]:
        """What the identification warns of."""
        return self.identification.warnings

    def corrected(self, fault: SensorFault) -> ImpactRefits:
        """The campaign identified anew beside a fault of its gauge: all that follows rests on the tension."""
        return self.of(self.campaign, self.options, (fault,), (DISAGREE,), self.identification.declared)

    @cached_property
    def measured(self) -> Followed:
        """All sound records, as measured."""
        read = read_measurements(self.campaign, self.doubtful)
        return Followed.among(self.identification.model, read, self.options.criteria.motion.kept_stiffness)

    def start(self) -> State:
        """The declared model, its numbers refitted to all training records.

        An effect may pass for damping in the identification, which is free to scale what it weighs.
        """
        first = self.followed(starting(self.identification, self.identification.model))
        residual = refit_from_afar(first)
        return self.evaluated(self._nearer(residual))

    def _nearer(self, residual: WhitenedResidual) -> WhitenedResidual:
        """Start from the uncoupled tests instead, where that leaves far less.

        An identification takes what it leaves over for noise: misfit, alike in all coupled records, may lead
        its links anywhere, too far for steps to lead back.
        """
        rules, linear = self.options.criteria, self.identification.linear
        priors = linear.ties if linear is not None else ()
        if level(residual) <= rules.acceptance.noise_level or not priors:
            return residual
        parameters = starting(self.identification, as_uncoupled(self.identification.model, priors))
        enough = rules.closing.far_less * level(residual)
        other = refit_from_afar(self.followed(parameters, residual.floors), enough)
        return residual if level(other) >= enough else refit_from_afar(self.followed(other.baseline))

    def followed(
        self, parameters: FreeParameters, floors: Mapping[Group, NoiseDensity] | None = None
    ) -> WhitenedResidual:
        """All sound records followed along a model, and what it leaves over.

        Raises
        ------
        ValueError
            If there is no sound impact test.
        """
        if not self.measured.records:
            raise ValueError(
                f"{self.campaign.path}: found no sound impact test, expected one: beside cycled links, "
                "driven bodies are compared where displacements were measured"
            )
        return whitened_residual_of(
            self.campaign, parameters, self.measured.records, floors,
            self.options.stage("tracing"), self.options.criteria,
        )  # fmt: skip

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        """Learn the tension law anew beside a model's other numbers, and simulate all records."""
        residual = self.own(residual)
        model = residual.stated.baseline.model
        if law_is_fitted:
            found = replace(self.identification, model=model)
        elif self.identification.declared is None:
            found = self.identification.with_model(model, self.options.stage("tension law"))
        else:
            found = self._with_declared_law(model)
        model = replace(found.model, identification=None)
        evaluations = self._simulated(model)
        errors = errors_of(evaluations)
        residual = residual.of_models(lambda near: with_law_of(near, model))
        least = self.options.criteria.acceptance.material_error_explained
        return State(model, residual, errors, motion_errors(errors), least, found, evaluations)

    def _with_declared_law(self, model: Model) -> Identification:
        """The declared law refitted to losses, then whole to tension histories: losses tell its scale alone.

        Beside a change of the law its shape stays as it was fitted together with that.
        """
        present = replace(self.identification, declared=tension_law_of(model))
        found = present.with_model(model, self.options.stage("tension law"))
        bare = replace(found.model, identification=None)
        data = TensionResidual(self.campaign, found, bare, self.options).data
        if data is None or model.effects_of("law change"):
            return found
        law, struck = tension_law_of(found.model), np.flatnonzero(data.struck[: data.training])
        held = [name for name in law.parameters if name not in found.law_numbers]
        fit = refine(given_law(law, held), data.part(hold_out=False).subset(struck))
        if not (fit.converged and np.isfinite(fit.deviance)):
            return found
        limits = {name: fit.limits(name) for name in fit.free}
        numbers = {n: replace(fit.candidate.parameters[n], low=a, high=b) for n, (a, b) in limits.items()}
        near = replace(with_law_numbers(found.model, numbers), rate_uncertainty=fit.rate_uncertainty)
        return replace(found, model=near)

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        """See ``CampaignRefits.refit_with``; all records are followed anew.

        ``renew_noise``: what was in the noise before the hits is not any more.
        """
        residual = self.own(state.residual)
        effect, near = explanation.effect, residual.baseline
        if isinstance(effect, LawChange | Reading):  # the motion does not see it
            numbers = explanation.beside
            return residual.of_models(lambda model: effect.added_to(with_law_numbers(model, numbers)))
        model, floors = effect.added_to(near.model), None if renew_noise else residual.floors
        if isinstance(effect, Effect) and not renew_noise:  # first along the old model's motion
            near = self._fitted(linearised_start(residual, effect)).baseline
            model = near.model
        after = self._fitted(self.followed(replace(near, model=model), floors))
        if isinstance(effect, SensorFault) and not (renew_noise or per_record_names(effect)):
            again = refit(self.followed(refit_fault(after, effect), after.floors))
            after = min(after, again, key=cost)  # slopes were those from afar so far
        return after

    def _fitted(self, residual: WhitenedResidual) -> WhitenedResidual:
        """Fit all numbers together; where more than noise is left, also from a start that forgets them.

        A model that lacked the effect may have been far from its structure, where steps do not lead back, and
        one whose numbers uncoupled tests deny still is.
        """
        rules, after = self.options.criteria.acceptance, refit(residual)
        if level(after) <= rules.noise_level and not _denied(after):
            return after
        records: dict[str, list[SpectralRecord]] = {}
        for trace, part, _ in after.parts:
            if not trace.settings.hold_out:
                records.setdefault(trace.settings.file, []).append(part)
        near, parts = after.baseline.model, [tuple(parts) for parts in records.values()]
        places = {effect.enters for effect in near.effects}
        try:
            anew = self.identification.refitted_to(parts, self.campaign.settings, places)
        except np.linalg.LinAlgError:  # forces along a motion that is nowhere near the measured one
            return after
        effects = tuple(with_stiffness(effect, anew) for effect in near.effects)
        model = replace(anew, effects=effects, identification=None)
        other = refit(after.at(replace(after.baseline, model=model)))
        return min(after, other, key=lambda e: cost(e) * (1 + rules.material_share * bool(_denied(e))))

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        """The last model refitted from where a fit beside a force ended: a fit that was stuck is freed so."""
        if not isinstance(effect, Effect):
            return None
        return refit(residual_without(self.own(residual), effect))

    def settled(self, residual: Residual) -> Residual:
        """Refitted beside the noise of bodies struck alone as it is now; by simulation where forces act."""
        if self.own(residual).simulated is not None:
            return residual
        near = reestimate_noise(self.own(residual))
        if not near.baseline.model.effects_of("force"):
            return near
        fit = SimulatedFit(near, self.measured.records, self.campaign.settings.windows.final_s)
        found = fit.fitted(self.options.stage("fitting by simulation"))
        if found is None:
            return near
        along = min(near, refit(self.followed(found.baseline, near.floors)), key=cost)
        return replace(along, simulated=found)

    def along_law(self, state: State, numbers: Mapping[str, Parameter] | None = None) -> State:
        """The state with all records followed along a tension that falls by its law, with these numbers."""
        near = self.own(state.residual).of_models(lambda model: with_law_numbers(model, numbers or {}))
        return self.evaluated(refit(self.followed(near.baseline, near.floors)), law_is_fitted=True)

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the others leave over, refitted, where an effect is redundant; None where it is not.

        Of forces of the catalogue the last one is examined too: the fit that it came with may be better by
        the model's own numbers alone.
        """
        best, criteria = history.selections[place].best, self.options.criteria
        effect = best.effect
        if isinstance(effect, Effect) and effect.name in CATALOGUE:
            last = self.own(history.last.residual)
            rest = residual_without(last, effect)
            own = next(e for e in last.baseline.model.effects if e.path == effect.path)
            needed = is_accepted(explanation(own, CATALOGUE[effect.name], with_effects(rest)), criteria)
            return None if needed else refit(rest)
        if in_tension(best) or place + 1 == len(history.selections):
            return None
        last = self.own(history.last.residual)
        if isinstance(effect, Effect):
            rest = refit(residual_without(last, effect))
        elif isinstance(effect, SensorFault):  # what it corrects is another motion
            followed = self.followed(without_effect(last.baseline, effect), last.floors)
            shown = at_rest.explain(followed, self.options)
            if any(is_accepted(e, criteria) and e.effect.path == effect.path for e in shown):
                return None
            rest = refit(followed)
        else:
            return None
        return None if self._needs(best, rest, last) else rest

    def _needs(self, best: Explanation, rest: WhitenedResidual, last: WhitenedResidual) -> bool:
        """Whether fits of everything without an effect and with it differ by more than chance."""
        before, after = rest.costs(rest.residual), last.costs(last.residual)
        if before.keys() != after.keys():  # some cannot be simulated without it
            return True
        compared = replace(
            best, before=before, after=after, samples=last.samples, hold_out=last.hold_out, left=None,
            p_value=None,
        )  # fmt: skip
        return is_accepted(compared, self.options.criteria)

    def views(self, history: LoopHistory) -> Iterable[State]:
        """Far from the structure slopes that hold from afar first, then those nearby.

        A law of the tension is far from linear in its numbers, so where the former leave more than next to
        nothing both are asked.
        """
        state, residual = history.last, self.own(history.last.residual).searched
        limit = self.options.criteria.closing.far_from_structure
        afar = state.level > limit and not history.at_noise_floor
        for from_afar in (True, False) if afar else (False,):
            yield replace(state, residual=replace(residual, from_afar=from_afar))

    def screen(self, residual: Residual) -> Probes:
        """Probes of every effect of the catalogue in the motion."""
        return screen(self.own(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises."""
        return explain_screened(probes, self.own(residual), self.options)

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """The best sparse sum of terms in every link."""
        return free_form.explain(self.own(state.residual).searched, self.options)

    def tension(self, state: State) -> TensionResidual | None:
        """What the model's law leaves over of the tension's histories; the last one asked for is kept."""
        assert state.identification is not None
        if not (self._latest and self._latest[0][0] is state):
            found = TensionResidual(self.campaign, state.identification, state.model, self.options)
            self._latest[:] = [(state, found)]
        return self._latest[0][1]

    @cached_property
    def _latest(self) -> list[tuple[State, TensionResidual]]:
        """The last state whose tension was asked for, and that."""
        return []

    def meters(self, history: LoopHistory) -> Sequence[Meter]:
        """Effects in the motion, and in the tension and its gauge."""
        last = history.last
        of_motion = MotionMeter(self.own(last.residual).searched, last.evaluations, history.chance)
        tension = self.tension(last)
        if tension is None or tension.data is None or tension.baseline is None:
            return [of_motion]
        blocked = "" if history.is_explained else NOT_EXPLAINED
        return [of_motion, GaugeMeter(tension, tension.data, tension.baseline, blocked)]

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Numbers of the last model that uncoupled tests deny."""
        last = history.last
        return unlikely(last.model, self.own(last.residual).baseline.believed)

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        """Where the residual of the motion lives, and that of the tension's histories."""
        return localise(self.own(state.residual).stated, *misfit_views(misfit))

    def _with_limits(
        self, effect: ModelCorrection, found: ModelCorrection, residual: WhitenedResidual
    ) -> ModelCorrection:
        if isinstance(effect, Effect):
            return effect_with_limits(effect, residual.stated)
        return effect if isinstance(effect, LawChange) else as_first_fitted(effect, found)

    def _separating_tests(
        self, effect: ModelCorrection, rivals: Sequence[ModelCorrection], residual: WhitenedResidual
    ) -> list[str]:
        return separating_tests(effect, rivals, residual)

    def _channels(self, residual: WhitenedResidual) -> tuple[str, ...]:
        return (*motion_channels(residual), "tension")


def _denied(residual: WhitenedResidual) -> tuple[str, ...]:
    """Numbers of a model that uncoupled tests deny."""
    return unlikely(residual.baseline.model, residual.baseline.believed)
