"""What a closed loop asks of a kind of campaign: fits of its models, with one effect more or one less."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

from discovery.courses.tension_likelihood import rate_uncertainty_of
from discovery.decide.acceptance import MaterialErrors, is_accepted, motion_errors, noise_by_chance
from discovery.decide.explanation import Explanation
from discovery.detection.limit import Meter
from discovery.explain.force_balance import explanation
from discovery.explain.probes import Probe
from discovery.localisation.localise import Localisation
from discovery.loop.found_effects import describe
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.result import FoundEffect
from discovery.loop.state import State, errors_of
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.tension import TensionResidual
from rom.campaign.campaign import Campaign
from rom.campaign.settings import RecordSettings
from rom.effects import CATALOGUE, ModelCorrection, SensorFault
from rom.evaluation.error_measures import Errors, ErrorsByKind
from rom.evaluation.evaluate import Evaluation, evaluate
from rom.model.laws import Parameter
from rom.model.model import Model
from rom.signals.quality import Doubt

Probes = Sequence[Sequence[Probe]]
ResidualT = TypeVar("ResidualT", bound=Residual)


class CampaignRefits(ABC, Generic[ResidualT]):
    """Fits of one campaign's models to its training records; ``ResidualT`` is the residual of its kind.

    Impact tests, ring-downs, driven or cycled campaigns and bolts at rest each have one
    (`discovery.loop.impact_refits`, `discovery.loop.free_refits`, `discovery.loop.balance_refits`,
    `discovery.loop.rest_refits`); `discovery.loop.close_loop` runs over each. What is not abstract suits a
    campaign without a bolt whose noise comes from its channels alone.

    Attributes
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    options : Options
        How the loop is run.
    residual_type : type
        Its ``ResidualT``.
    """

    campaign: Campaign
    options: Options
    residual_type: type[ResidualT]

    def own(self, residual: Residual) -> ResidualT:
        """The residual, which is of the campaign's kind."""
        assert isinstance(residual, self.residual_type)
        return residual

    @property
    def aside(self) -> Sequence[Doubt]:
        """Doubts about records, which are then compared with nothing."""
        return ()

    @property
    def set_aside(self) -> tuple[str, ...]:
        """Records of doubtful quality, a line each."""
        return tuple(f"{doubt.file}: {doubt.message}" for doubt in self.aside)

    @property
    def doubtful(self) -> frozenset[str]:
        """Files of these records."""
        return frozenset(doubt.file for doubt in self.aside)

    @property
    def sound(self) -> list[RecordSettings]:
        """Records that are compared with free simulations."""
        return [record for record in self.campaign.settings.record if record.file not in self.doubtful]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know of the records and of every model of them."""
        return ()

    @property
    def of_declared(self) -> tuple[str, ...]:
        """What the identification of the declared model warns of."""
        return ()

    @abstractmethod
    def start(self) -> State:
        """The declared model, its numbers fitted to all training records."""

    def corrected(self, fault: SensorFault) -> CampaignRefits[ResidualT]:
        """The same campaign, identified anew beside a fault of its gauge.

        Raises
        ------
        ValueError
            If nothing tells of the gauge.
        """
        raise ValueError(f"{self.campaign.path}: its records tell of no fault of a gauge, got {fault.path}")

    @abstractmethod
    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        """The model of a residual with its tension law and its errors."""

    @abstractmethod
    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        """What is left over with one more effect, everything refitted.

        Parameters
        ----------
        state : State
            The model so far.
        explanation : Explanation
            Of the effect that is added.
        renew_noise : bool
            Whether the noise is estimated anew, where it does not come from the channels alone.

        Returns
        -------
        Residual
            Of the model with the effect.
        """

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        """The last model refitted from where a fit beside an effect ended; None where that cannot differ."""
        return None

    def settled(self, residual: Residual) -> Residual:
        """Refitted beside the noise as it is with the model's effects, as closely as the records allow."""
        return residual

    def along_law(self, state: State, numbers: Mapping[str, Parameter] | None = None) -> State:
        """The state with its motion followed along a tension that falls by its law, with these numbers."""
        return state

    @abstractmethod
    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the other effects leave over, refitted, where one is redundant; None where it is not."""

    def views(self, history: LoopHistory) -> Iterable[State]:
        """The last state with the slopes along which effects are screened, in the order of trial."""
        yield history.last

    @abstractmethod
    def screen(self, residual: Residual) -> Probes:
        """Probes of every effect of the catalogue, best first."""

    @abstractmethod
    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises."""

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """Terms without the catalogue, fitted."""
        return ()

    def in_simulation(self, history: LoopHistory) -> LoopHistory:
        """The history with effects that free simulations alone show, where those are not its residual."""
        return history

    def tension(self, state: State) -> TensionResidual | None:
        """What the model's law leaves over of the tension's histories; None without a bolt."""
        return None

    def meters(self, history: LoopHistory) -> Sequence[Meter]:
        """What tells the strengths of effects that the last residual would have shown; none by default."""
        return ()

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Reasons to doubt that the last model is near its structure."""
        return ()

    @abstractmethod
    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        """Where a residual lives, and the last misfit of the tension's histories."""

    def described(self, selection: Selection, state: State) -> FoundEffect:
        """An effect that was found, with limits and what is indistinguishable from it."""
        residual, best = self.own(state.residual), selection.best.effect
        effect = next((e for e in state.model.effects if e.path == best.path), best)
        tests = self._separating_tests(effect, [rival.effect for rival in selection.rivals], residual)
        effect = self._with_limits(effect, best, residual)
        return describe(selection, state, effect, tests, self._channels(residual), self.options.jobs)

    def _simulated(self, model: Model) -> tuple[Evaluation, ...]:
        """Compare all sound records with a model."""
        options = self.options
        return evaluate([model], self.campaign, self.sound, options.jobs, options.stage("errors"))

    def with_known_rate(self, history: LoopHistory) -> LoopHistory:
        """The history whose last model tells how rates differ between tests, where its law was changed."""
        last, fit = history.last, history.tension[-1].fit if history.tension else None
        if fit is None or last.model.rate_uncertainty is not None:
            return history
        known = rate_uncertainty_of(last.model, fit.fit.rate_uncertainty)
        model = replace(last.model, rate_uncertainty=known)
        return history.ending(replace(last, model=model, evaluations=self._simulated(model)))

    def with_coverage(self, state: State) -> ErrorsByKind:
        """Errors of a state, and for how much of the time held-out tensions lie within their limits."""
        options = self.options
        unseen = [one for one in self.sound if one.hold_out and one.test == "loosening"]
        judged = evaluate([state.model], self.campaign, unseen, options.jobs, bands="hold_out")
        within = errors_of(judged)["hold_out"]["tension_course_within_band"]
        of_unseen: Errors = {**state.errors["hold_out"], "tension_course_within_band": within}
        return {**state.errors, "hold_out": of_unseen}

    def _with_limits(
        self, effect: ModelCorrection, found: ModelCorrection, residual: ResidualT
    ) -> ModelCorrection:
        """An effect with 95 % limits."""
        return effect

    def _separating_tests(
        self,
        effect: ModelCorrection,
        rivals: Sequence[ModelCorrection],
        residual: ResidualT,
    ) -> list[str]:
        """For each rival the test that would tell it from an effect, in words; empty where none would."""
        return [""] * len(rivals)

    def _channels(self, residual: ResidualT) -> tuple[str, ...]:
        """Channels whose sensors may be at fault: so many more effects were tried."""
        return ()


Refits = CampaignRefits[Any]
"""Of a campaign of any kind."""


class FixedTensionRefits(CampaignRefits[ResidualT]):
    """Fits of a campaign in which no law moves a tension: all effects are fitted together.

    Its noise does not depend on the effects, or is renewed in every fit.
    """

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        """The model of a residual with its tension law and its errors."""
        own = self.own(residual)
        model, warnings = self._model_of(own)
        return self._state(own, model, warnings)

    def _state(self, own: ResidualT, model: Model, warnings: tuple[str, ...]) -> State:
        """A model that leaves a residual, its errors by free simulation."""
        evaluations = self._simulated(model)
        errors = errors_of(evaluations)
        least = self.options.criteria.acceptance.material_error
        material = self._material_errors(own, errors)
        by_chance = noise_by_chance(int(own.training.sum()), own.noise_freedom, self.options.criteria)
        return State(model, own, errors, material, least, None, evaluations, warnings, by_chance)

    @abstractmethod
    def _model_of(self, residual: ResidualT) -> tuple[Model, tuple[str, ...]]:
        """The model of a residual with its effects, and what to know of its numbers."""

    def _material_errors(self, residual: ResidualT, errors: ErrorsByKind) -> MaterialErrors:
        """The errors that an effect in the motion must lower."""
        return motion_errors(errors)

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        """See ``CampaignRefits.refit_with``."""
        if explanation.residual is None:
            return self._fitted_with(self.own(state.residual), explanation.effect)
        return self._beside_others(self.own(explanation.residual))

    def _beside_others(self, residual: ResidualT) -> ResidualT:
        """All effects fitted beside each other, where an explanation's own fit held the others."""
        return residual

    @abstractmethod
    def _fitted_with(self, residual: ResidualT, effect: ModelCorrection) -> ResidualT:
        """What is left over with one more effect, everything refitted."""

    @abstractmethod
    def _fitted_without(self, residual: ResidualT, effect: ModelCorrection) -> ResidualT:
        """What is left over without one of the effects, everything refitted."""

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the other effects leave over, refitted, where one is redundant; None where it is not."""
        last, path = history.last, history.selections[place].best.effect.path
        effect = next(e for e in last.model.effects if e.path == path)
        if effect.name not in CATALOGUE or place + 1 == len(history.selections):
            return None
        after = self.own(last.residual)
        rest = self._fitted_without(after, effect)
        needed = is_accepted(self._explanation(effect, rest, after), self.options.criteria)
        return None if needed else rest

    def _explanation(self, effect: ModelCorrection, before: ResidualT, after: ResidualT) -> Explanation:
        """Costs of all records with an effect of the catalogue and without."""
        return explanation(effect, before, after)
