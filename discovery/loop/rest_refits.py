"""Models of a campaign of bolts at rest, refitted to the slow lines of its tensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from discovery.decide.acceptance import MaterialErrors
from discovery.decide.explanation import Explanation
from discovery.detection.at_rest import RestMeter
from discovery.detection.limit import Meter
from discovery.explain.rest_fit import fitted
from discovery.explain.tension_at_rest import explain_screened, explanation, screen
from discovery.localisation.at_rest import localise_rest
from discovery.localisation.localise import Localisation
from discovery.loop.history import LoopHistory
from discovery.loop.refits import FixedTensionRefits, Probes
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.at_rest import RestResidual
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.rest_records import rest_record
from discovery.separating_tests.holds import longer_rests
from rom.campaign.campaign import Campaign
from rom.effects import ModelCorrection
from rom.evaluation.at_rest import held_tension
from rom.evaluation.error_measures import ErrorsByKind
from rom.identification.identify import Identification, identify_campaign
from rom.model.model import Model
from rom.signals.measured_records import measured_record


@dataclass(frozen=True, eq=False)
class RestRefits(FixedTensionRefits[RestResidual]):
    """Fits of what gauges show beyond a tension that stays as it is.

    Noise is what any residual shows above its slow lines. No free form is asked for: of a wander and a curve
    without a name one record tells nothing of the other.
    """

    campaign: Campaign
    identification: Identification
    residual: RestResidual
    options: Options
    residual_type = RestResidual

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

    def _model_of(self, residual: RestResidual) -> tuple[Model, tuple[str, ...]]:
        """The model of a residual; nothing more is to be known of it."""
        model = self.identification.model
        return replace(model, identification=None, effects=(*model.effects, *residual.effects)), ()

    def _material_errors(self, residual: RestResidual, errors: ErrorsByKind) -> MaterialErrors:
        """Errors of the slow tension on hold-out and on training records."""
        slow = residual.slow_errors()
        return tuple({"slow_tension_n": slow[kind]} for kind in ("hold_out", "training"))

    def _fitted_with(self, residual: RestResidual, effect: ModelCorrection) -> RestResidual:
        """All effects fitted together, beside the noise as it then is."""
        return fitted(residual, (*residual.effects, effect))

    def _fitted_without(self, residual: RestResidual, effect: ModelCorrection) -> RestResidual:
        """The others fitted together."""
        return fitted(residual, [e for e in residual.effects if e.path != effect.path])

    def _explanation(self, effect: ModelCorrection, before: RestResidual, after: RestResidual) -> Explanation:
        """Costs of all records with an effect and without, beside the noise of each."""
        return explanation(effect, before, after)

    def screen(self, residual: Residual) -> Probes:
        """Probes of every reading of the catalogue that shows at rest."""
        return screen(self.own(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of these readings."""
        return explain_screened(probes, self.own(residual), self.options)

    def meters(self, history: LoopHistory) -> Sequence[Meter]:
        """Readings that show at rest."""
        return [RestMeter(self.own(history.last.residual), self.options)]

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        """How slow what is left is, and in which records."""
        return localise_rest(self.own(state.residual))

    def _separating_tests(
        self, effect: ModelCorrection, rivals: Sequence[ModelCorrection], residual: RestResidual
    ) -> list[str]:
        """For each rival how long a record would show the difference."""
        return longer_rests(effect, rivals, residual)
