"""What effects add to the simulated motion of ring-downs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from discovery.detection.limit import by_piece, dispersion
from discovery.detection.power import Background, Response, background_of
from discovery.explain.probes import LARGEST
from discovery.explain.simulation import candidates_in_decays, moved_little
from discovery.residual.simulation import SimulationResidual
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Member, ModelCorrection

_MOTION = "motion_nrmse"


@dataclass(frozen=True, eq=False)
class DecayMeter:
    """Effects in ring-downs. Of a held-out record, whose state is its own, the response is taken as large as
    that of training records for the same motion.

    Attributes
    ----------
    residual : SimulationResidual
        Of the last model.
    chance : ndarray, shape (draws,), or None
        Largest gains by chance of the last screen.
    """

    residual: SimulationResidual
    chance: FloatArray | None = None

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Core forces at the scales of their places."""
        return (pair for pair in candidates_in_decays(self.residual) if pair[0].core)

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:  # noqa: ARG002
        """All have a limit."""
        return ""

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""
        return member.linear

    @cached_property
    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        """Squares of the whitened motion of training and of hold-out records."""
        rings = self.residual.rings
        squares = [
            [float(np.sum(r.whitened**2)) for r in rings if r.hold_out is held] for held in (False, True)
        ]
        return np.array(squares[0]), np.array(squares[1])

    @cached_property
    def background(self) -> Background:
        """What is left of the motion."""
        residual = self.residual
        costs = residual.costs(residual.residual)
        judged = [(file, held) for file, held in residual.held_out if held] or residual.held_out
        sizes = self._sizes[1] if len(self._sizes[1]) else self._sizes[0]
        errors = {_MOTION: np.sqrt(np.array([costs[file] for file, _ in judged]) / sizes)}
        return background_of(residual, errors, self.chance)

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training rows."""
        return [0.0 if one is None else one.square for one in self.responses(effects)]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response | None]:
        """What effects at one place add."""
        return [self._response(effect) for effect in effects]

    def _response(self, effect: ModelCorrection) -> Response | None:
        residual, member, factor = self.residual, CATALOGUE[effect.name], 1.0
        if member.linear:
            small = moved_little(member, effect, residual)
            if small is None:
                return None
            name = next(name for name in member.strengths if effect.parameters[name].value)
            factor = effect.parameters[name].value / small[0].parameters[name].value
            output: FloatArray | None = small[1]
        else:
            output = residual.output_of(effect)
        if output is None or not np.abs(output).max(initial=0.0) < LARGEST:
            return None
        return self._of_output(output).scaled(factor)

    def _of_output(self, output: FloatArray) -> Response:
        residual, (training, unseen) = self.residual, self._sizes
        beyond, pieces = residual.beyond(output), residual.pieces
        trained = by_piece(beyond**2, pieces)
        scores = by_piece(beyond * residual.unexplained, pieces)
        share = float(trained.sum() / training.sum())
        judged = unseen if len(unseen) else training
        felt = float(np.linalg.norm(output[residual.training])) / np.sqrt(training.sum())
        return Response(
            trained, share * unseen, dispersion(scores, float(trained.sum()), self.background.level),
            {_MOTION: np.full(len(judged), np.sqrt(share))}, 100 * float(felt),
        )  # fmt: skip
