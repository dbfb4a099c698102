"""What readings add to the tension of bolts at rest, beside noise that may wander."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from discovery.detection.limit import by_kind
from discovery.detection.power import Background, Response
from discovery.explain.tension_at_rest import at_campaign, by_chance_at_rest, screen, shows_at_rest
from discovery.options import Options
from discovery.residual.at_rest import RestResidual
from discovery.residual.gauge_noise import deviances, wander_of
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Member, ModelCorrection


@dataclass(frozen=True, eq=False)
class RestMeter:
    """Readings that show at rest.

    The larger an effect, the more of it passes for a wander of the noise: the expected gain is

        min_c L(c) - L(c_0),   L(c) = sum ln V(c) + (V(c_0) + s^2) / V(c)

    Attributes
    ----------
    residual : RestResidual
        Of the last model.
    options : Options
        For the number of draws.
    """

    residual: RestResidual
    options: Options = field(default_factory=Options)

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Core readings with the ranges of the campaign."""
        held = {effect.path for effect in self.residual.effects}
        for member in CATALOGUE.values():
            if member.core and shows_at_rest(member):
                effect = at_campaign(member, self.residual)
                if effect.path not in held:
                    yield member, effect

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:  # noqa: ARG002
        """All have a limit."""
        return ""

    def is_linear(self, member: Member) -> bool:  # noqa: ARG002
        """The wander of the noise makes it none."""
        return False

    @cached_property
    def background(self) -> Background:
        """What is left of the slow tension; gains are beside a wander that allows for it."""
        residual, rules = self.residual, self.residual.criteria.acceptance
        costs = residual.costs(residual.residual)
        cost = sum(one for file, one in costs.items() if file not in residual.hold_out)
        probes = screen(residual, Options(criteria=residual.criteria))
        chance = by_chance_at_rest(probes, residual, self.options)[1] if probes else np.zeros(0)
        limits = (rules.training_gain_tension, rules.hold_out_gain_tension)
        return Background(float(cost), 1.0, limits, chance=chance, criteria=residual.criteria)

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training rows."""
        return [one.square for one in self.responses(effects)]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response]:
        """What readings add."""
        return [self._response(effect) for effect in effects]

    def _response(self, effect: ModelCorrection) -> Response:
        residual = self.residual
        lines = residual.rows([record.of(effect) for record in residual.records])
        noise, present = residual.rows(residual.noise), residual.rows(residual.variances)
        shapes = residual.rows([record.wander for record in residual.records]) / noise
        powers, mine = (present + lines**2) / noise, residual.training
        wander = wander_of(powers[mine], shapes[mine])
        gains = deviances(powers, 1 + wander * shapes) - deviances(present / noise, present / noise)
        trained, unseen = by_kind(residual.sums(gains), residual.hold_out)
        return Response(np.maximum(trained, 0.0), np.maximum(unseen, 0.0), felt=self._felt(lines, mine))

    def _felt(self, lines: FloatArray, mine: npt.NDArray[np.bool_]) -> float:
        """RMS of a reading over that of the slow tension that is left [%]."""
        whole = self.residual.rows([record.measured for record in self.residual.records])
        return 100 * float(np.linalg.norm(lines[mine]) / max(float(np.linalg.norm(whole[mine])), 1e-300))
