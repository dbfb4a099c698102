"""Models of a campaign of ring-downs, refitted by simulation from states of the records' own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from discovery.criteria.number import Numerical
from discovery.decide.acceptance import is_accepted, motion_errors
from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import explanation
from discovery.explain.simulation import explain_screened, fitted, free_forms, screen, together
from discovery.localisation.localise import Localisation
from discovery.localisation.simulation import localise_motion
from discovery.loop.found_effects import describe
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.refits import Probes
from discovery.loop.result import FoundEffect
from discovery.loop.state import State, errors_of
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.simulation import LEAST_MASS, SimulationResidual, refitted
from discovery.residual.tension import TensionResidual
from rom.campaign.campaign import Campaign
from rom.effects import CATALOGUE, ModelCorrection, SensorFault
from rom.evaluation.evaluate import evaluate
from rom.identification.free_decay import FreeDecayFit, fit_free_decay, free_model, ring_downs
from rom.identification.ring_down import RingDown, fitted_state

_VANISHED: Numerical[float] = 1e-6  # of a number: rounding beside its bound


@dataclass(frozen=True, eq=False)
class FreeRefits:
    """Fits of a campaign's models to ring-downs by simulation; see `discovery.loop.refits`."""

    campaign: Campaign
    rings: tuple[RingDown, ...]
    fit: FreeDecayFit
    set_aside: tuple[str, ...]
    options: Options

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
        lines = tuple(f"{doubt.file}: {doubt.message}" for doubt in doubts)
        return cls(campaign, rings, fit_free_decay(rings, campaign), lines, options)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What fixes the scale of the numbers."""
        return self.fit.lines

    def start(self) -> State:
        """The declared model."""
        model = free_model(self.campaign.settings, self.fit)
        states = tuple(fitted_state(ring, model) for ring in self.rings)
        residual = SimulationResidual(self.rings, model, self.fit.free, states, self.options.criteria)
        return self.evaluated(refitted(residual).residual)

    def corrected(self, fault: SensorFault) -> FreeRefits:
        """The same: without a bolt there is no gauge."""
        raise ValueError(f"a campaign without a bolt has no gauge, got {fault.path}")

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:  # noqa: ARG002
        """Make the model of a residual, and simulate all sound records."""
        mine, options = _simulated(residual), self.options
        sound = {ring.file for ring in self.rings}
        records = [r for r in self.campaign.settings.record if r.file in sound]
        evaluations = evaluate([mine.model], self.campaign, records, options.jobs, options.stage("errors"))
        errors = errors_of(evaluations)
        least = options.criteria.acceptance.material_error
        return State(mine.model, mine, errors, motion_errors(errors), least, None, evaluations)

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:  # noqa: ARG002
        """All effects fitted together.

        Parameters
        ----------
        state : State
            The model so far.
        explanation : Explanation
            Of the effect that is added.
        renew_noise : bool
            Without effect: noise comes from the channels alone.

        Returns
        -------
        Residual
            Of the model with the effect.
        """
        if explanation.residual is not None:
            return explanation.residual
        return fitted(_simulated(state.residual), explanation.effect)

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        """The last model refitted from where a fit beside an effect ended."""
        mine = _simulated(residual)
        others = tuple(e for e in mine.model.effects if e.path != effect.path)
        return together(replace(mine, model=replace(mine.model, effects=others)))

    def with_present_noise(self, residual: Residual) -> Residual:
        """The same: noise comes from the channels alone."""
        return residual

    def along_law(self, state: State) -> State:
        """The same: there is no bolt whose tension falls."""
        return state

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the others leave over, refitted, where an effect is redundant; None where it is not."""
        last = _simulated(history.last.residual)
        path = history.selections[place].best.effect.path
        effect = next(e for e in last.model.effects if e.path == path)
        if effect.name not in CATALOGUE or place + 1 == len(history.selections):
            return None
        others = tuple(e for e in last.model.effects if e.path != path)
        rest = together(replace(last, model=replace(last.model, effects=others)))
        explained = explanation(effect, CATALOGUE[effect.name], rest, last)
        return None if is_accepted(explained, self.options.criteria) else rest

    def views(self, history: LoopHistory) -> Iterable[State]:
        """The last state alone."""
        yield history.last

    def screen(self, residual: Residual) -> Probes:
        """Probes of every force of the catalogue at the scale of its place."""
        return screen(_simulated(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises."""
        return explain_screened(probes, _simulated(residual), self.options)

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """The best sparse sum of terms in one link."""
        return free_forms(_simulated(state.residual), self.options)

    def tension(self, state: State) -> TensionResidual | None:  # noqa: ARG002
        """None: there is no bolt."""
        return None

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Masses and stiffnesses that effects have driven to zero."""
        first, last = history.states[0].model, history.last.model
        lines = []
        for path in self.fit.free:
            before, after = first.parameter(path).value, last.parameter(path).value
            least = 2 * LEAST_MASS if path.endswith(".mass") else _VANISHED
            if not path.endswith(".c") and after < least * before:
                lines.append(f"{path}: next to nothing with the effects, {before:.4g} without them")
        return tuple(lines)

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:  # noqa: ARG002
        """Where the residual lives."""
        return localise_motion(_simulated(state.residual))

    def described(self, selection: Selection, state: State) -> FoundEffect:
        """An effect with the limits of the last fit, and what is indistinguishable from it."""

        def limited(effect: ModelCorrection, _: ModelCorrection) -> ModelCorrection:
            return effect

        def separating(_: ModelCorrection, rivals: Sequence[ModelCorrection]) -> list[str]:
            return [""] * len(rivals)

        return describe(selection, state, (), limited, separating)


def _simulated(residual: Residual) -> SimulationResidual:
    assert isinstance(residual, SimulationResidual)
    return residual
