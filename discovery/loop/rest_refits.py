"""Models of a campaign of bolts at rest, refitted to the slow lines of its tensions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from scipy import stats

from discovery.decide.acceptance import is_accepted
from discovery.decide.explanation import Explanation
from discovery.explain.rest_fit import fitted
from discovery.explain.tension_at_rest import explain_screened, explanation, screen
from discovery.localisation.at_rest import localise_rest
from discovery.localisation.localise import Localisation
from discovery.loop.found_effects import describe
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.refits import Probes
from discovery.loop.result import FoundEffect
from discovery.loop.state import State, errors_of
from discovery.options import Options
from discovery.residual.at_rest import RestResidual
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.rest_records import rest_record
from discovery.residual.tension import TensionResidual
from discovery.separating_tests.rests import longer_rests
from rom.campaign.campaign import Campaign
from rom.effects import ModelCorrection, Reading, SensorFault
from rom.evaluation.at_rest import held_tension
from rom.evaluation.evaluate import evaluate
from rom.identification.identify import Identification, identify_campaign
from rom.signals.measured_records import measured_record


@dataclass(frozen=True, eq=False)
class RestRefits:
    """Fits of what gauges show beyond a tension that stays as it is; see `discovery.loop.refits`."""

    campaign: Campaign
    identification: Identification
    residual: RestResidual
    options: Options
    set_aside: tuple[str, ...] = ()

    @classmethod
    def of(cls, campaign: Campaign, options: Options) -> RestRefits:
        """Read all records.

        Raises
        ------
        ValueError
            If there is no training record.
        """
        identification = identify_campaign(campaign, options.jobs, options.stage("identifying"))
        records = []
        for settings in campaign.settings.record:
            _, tension = held_tension(identification.model, measured_record(campaign, settings).measurement)
            rules = options.criteria.at_rest
            records.append(rest_record(settings, tension.samples, tension.rate_hz, rules))
        residual = RestResidual(tuple(records), (), options.criteria)
        return cls(campaign, identification, residual, options)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the identification warns of."""
        return self.identification.warnings

    def start(self) -> State:
        """The declared model: a tension that stays as it is."""
        return self.evaluated(self.residual)

    def corrected(self, fault: SensorFault) -> RestRefits:
        """The same: at rest nothing tells the gauge's scale."""
        raise ValueError(f"a campaign at rest tells of no fault of its gauge, got {fault.path}")

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:  # noqa: ARG002
        """Make the model of a residual, and its errors on all records."""
        rest, options = _rest(residual), self.options
        model = replace(self.identification.model, identification=None)
        for effect in rest.effects:
            model = model.with_effect(effect)
        evaluations = evaluate([model], self.campaign, None, options.jobs, options.stage("errors"))
        errors = rest.slow_errors()
        material = tuple({"slow_tension_n": errors[kind]} for kind in ("hold_out", "training"))
        least = options.criteria.acceptance.material_error
        return State(
            model, rest, errors_of(evaluations), material, least, None, evaluations, by_chance=self._by_chance
        )

    @property
    def _by_chance(self) -> float:
        """Mean square of slow lines that noise alone hardly exceeds: they are few."""
        rows = int(self.residual.training.sum())
        return float(stats.chi2.isf(self.options.criteria.tension.misfit_chance, rows)) / rows

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:  # noqa: ARG002
        """All effects fitted together, beside the noise as it then is.

        Parameters
        ----------
        state : State
            The model so far.
        explanation : Explanation
            Of the effect that is added.
        renew_noise : bool
            Without effect: noise is what any residual shows above its slow lines.

        Returns
        -------
        Residual
            Of the model with the effect.
        """
        if explanation.residual is not None:
            return explanation.residual
        rest, effect = _rest(state.residual), explanation.effect
        assert isinstance(effect, Reading)
        return fitted(rest, (*rest.effects, effect))

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:  # noqa: ARG002
        """None: the declared model has no numbers that could be stuck."""
        return None

    def with_present_noise(self, residual: Residual) -> Residual:
        """The same: noise is what any residual shows above its slow lines."""
        return residual

    def along_law(self, state: State) -> State:
        """The same: at rest no law of loosening acts."""
        return state

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the others leave over, refitted, where an effect is redundant; None where it is not."""
        last, path = _rest(history.last.residual), history.selections[place].best.effect.path
        if place + 1 == len(history.selections):
            return None
        effect = next(e for e in last.effects if e.path == path)
        rest = fitted(last, [e for e in last.effects if e.path != path])
        explained = explanation(effect, rest, last)
        return None if is_accepted(explained, self.options.criteria) else rest

    def views(self, history: LoopHistory) -> Iterable[State]:
        """The last state: what a reading adds does not depend on the others."""
        yield history.last

    def screen(self, residual: Residual) -> Probes:
        """Probes of every reading of the catalogue that shows at rest."""
        return screen(_rest(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of these readings."""
        return explain_screened(probes, _rest(residual), self.options)

    def free_forms(self, state: State) -> Sequence[Explanation]:  # noqa: ARG002
        """None: of a wander and a curve without a name one record tells nothing of the other."""
        return ()

    def tension(self, state: State) -> TensionResidual | None:  # noqa: ARG002
        """None: without hits there are no histories after them."""
        return None

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:  # noqa: ARG002
        """None: there is no structure to be far from."""
        return ()

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:  # noqa: ARG002
        """How slow what is left is, and in which records."""
        return localise_rest(_rest(state.residual))

    def described(self, selection: Selection, state: State) -> FoundEffect:
        """An effect with the limits of the last fit, and what is indistinguishable from it."""

        def limited(effect: ModelCorrection, _: ModelCorrection) -> ModelCorrection:
            return effect

        def separating(effect: ModelCorrection, rivals: Sequence[ModelCorrection]) -> list[str]:
            return longer_rests(effect, rivals, _rest(state.residual))

        return describe(selection, state, (), limited, separating)


def _rest(residual: Residual) -> RestResidual:
    assert isinstance(residual, RestResidual)
    return residual
