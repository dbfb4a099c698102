"""What readings that follow the motion, and faults of the gauge, add to the fast part of the tension."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from discovery.detection.power import Background, Response
from discovery.explain.strain_gauge import fault_rows, measured_motion, reading_rows
from discovery.explain.tension import candidates_in_tension, in_course
from discovery.residual.course_fit import CourseFit
from discovery.residual.tension import TensionResidual
from discovery.residual.tension_data import TensionData
from rom.effects import CATALOGUE, Member, ModelCorrection, Reading, SensorFault
from rom.signals.per_record_parameters import per_record_names

OWN_NUMBERS = "it has a number of each record's own; its limit is not calculated"
HISTORIES = (
    "it shows in the tension's histories, where each test has a rate of its own: what hold-out tests gain is "
    "not predicted, so its limit is not calculated"
)


@dataclass(frozen=True, eq=False)
class GaugeMeter:
    """Readings that follow the motion, and faults of the gauge that show about the hit.

    Attributes
    ----------
    residual : TensionResidual
        Of the last model.
    data : TensionData
        Its records.
    base : CourseFit
        The fit of the model's own law.
    blocked : str
        Why none is looked for; empty where they are.
    """

    residual: TensionResidual
    data: TensionData
    base: CourseFit
    blocked: str = ""

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Effects of the catalogue in the tension and its gauge."""
        return candidates_in_tension(self.residual)

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:
        """Mains and drift are each record's own; histories do not tell."""
        if self.blocked or per_record_names(effect):
            return self.blocked or OWN_NUMBERS
        return HISTORIES if in_course(member, effect) else ""

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""
        return member.linear and member.kind != "sensor"

    @cached_property
    def background(self) -> Background:
        """The histories' cost alone: that of the fast part is small beside it."""
        criteria = self.data.frozen.criteria
        rules = criteria.acceptance
        return Background(
            float(self.base.costs[: self.data.training].sum()), self.base.misfit.level,
            (rules.training_gain_tension, rules.hold_out_gain_tension), criteria=criteria,
        )  # fmt: skip

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training records."""
        return [one.square for one in self.responses(effects)]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response]:
        """What effects add."""
        member = CATALOGUE[effects[0].name]
        name = next(name for name in member.strengths if effects[0].parameters[name].value)
        sizes = np.array([effect.parameters[name].value for effect in effects])
        if isinstance(effects[0], Reading):
            rows, places = reading_rows(self.data, [(member, effects[0])])
            column = places[effects[0].path].start + list(member.strengths).index(name)
            units = [row.columns[:, column] / member.strengths[name] for row in rows]
            squares = np.array([[float(unit @ unit) * size**2 for size in sizes] for unit in units])
        else:
            assert isinstance(effects[0], SensorFault)
            least = self.data.criteria.gauge_fault * member.strengths[name]  # every gauge may have as much
            projected = fault_rows(self.data, member, effects[0], np.array([least, *sizes]))
            squares = np.array([np.sum(row.columns[:, 1:] ** 2, axis=0) for row in projected])
        count, felt = self.data.training, [self._felt(effect) for effect in effects]
        return [Response(of[:count], of[count:], felt=one) for of, one in zip(squares.T, felt, strict=True)]

    def _felt(self, effect: ModelCorrection) -> float:
        """RMS of what an effect adds to the readings of training records over that of their changes [%]."""
        added, whole = 0.0, 0.0
        for record in self.data.records[: self.data.training]:
            if isinstance(effect, Reading):
                rows = effect.added(measured_motion(record))
            else:
                assert isinstance(effect, SensorFault)
                rows = effect.apply(record.tension, record.rate_hz) - record.tension
            added += float(rows @ rows)
            whole += float(np.sum((record.tension - record.course.initial) ** 2))
        return 100 * float(np.sqrt(added / max(whole, 1e-300)))
