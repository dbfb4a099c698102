"""What effects add to the forces that a model leaves unbalanced in driven bodies and cycled links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from discovery.detection.limit import by_kind, by_piece, dispersion
from discovery.detection.power import Background, Response, background_of
from discovery.explain.force_balance_screen import candidates_in_balances
from discovery.explain.probes import LARGEST
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.channels import FloatArray
from rom.effects import Member, ModelCorrection

_FORCE = "force_error"


@dataclass(frozen=True, eq=False)
class BalanceMeter:
    """Effects in balances of forces.

    Attributes
    ----------
    residual : ForceBalanceResidual
        Of the last model.
    chance : ndarray, shape (draws,), or None
        Largest gains by chance of the last screen.
    """

    residual: ForceBalanceResidual
    chance: FloatArray | None = None

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Core effects at the scales of their places."""
        known = {effect.path for effect in self.residual.effects}
        for member, effect in candidates_in_balances(self.residual):
            if member.core and effect.path not in known:
                yield member, effect

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:  # noqa: ARG002
        """All have a limit."""
        return ""

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""
        return member.linear

    @cached_property
    def _scaled(self) -> FloatArray:
        """Whitened columns of the model's numbers, (rows, numbers)."""
        balances = self.residual.balances
        return np.asarray(balances.columns / balances.noise[:, None])

    def _left_over(self, rows: FloatArray) -> FloatArray:
        """Whitened rows less what the numbers that suit the training rows explain."""
        mine = self.residual.training
        numbers = np.linalg.lstsq(self._scaled[mine], rows[mine], rcond=None)[0]
        return np.asarray(rows - self._scaled @ numbers)

    @cached_property
    def background(self) -> Background:
        """What is left unbalanced."""
        errors = {_FORCE: np.array([self.residual.force_error()])}
        return background_of(self.residual, errors, self.chance)

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training rows."""
        return [0.0 if one is None else one.square for one in self.responses(effects)]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response | None]:
        """What effects at one place add."""
        return [self._response(self.residual.force_of(effect)) for effect in effects]

    def _response(self, force: FloatArray) -> Response | None:
        residual = self.residual
        white = residual.whitened(force)
        if not np.abs(white).max(initial=0.0) < LARGEST:
            return None
        beyond = self._left_over(white)
        mine, noise, pieces = residual.training, residual.balances.noise, residual.pieces
        trained = by_piece(beyond[mine] ** 2, pieces)
        scores = by_piece(beyond[mine] * residual.residual[mine], pieces)
        judged = mine if mine.all() else ~mine
        _, unseen = by_kind(residual.costs(beyond), residual.hold_out)
        whole = float(np.linalg.norm(residual.balances.force[mine]))
        return Response(
            trained, unseen, dispersion(scores, float(trained.sum()), self.background.level),
            {_FORCE: np.array([float(np.linalg.norm((beyond * noise)[judged]))])},
            100 * float(np.linalg.norm(force[mine])) / whole,
        )  # fmt: skip
