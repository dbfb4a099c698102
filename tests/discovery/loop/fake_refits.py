"""Fits of a campaign that is not there: neutral answers to all that the closed loop asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

import rom
from discovery.decide.explanation import Explanation
from discovery.localisation.localise import Localisation
from discovery.loop.history import LoopHistory
from discovery.loop.refits import CampaignRefits, Probes
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Kind, Residual
from discovery.residual.course_fit import Misfit
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, ModelCorrection

ROWS = 100


@dataclass(frozen=True, eq=False)
class FakeResidual(Residual):
    """Rows of one size, and the effects beside which they are left over."""

    level: float = 1.0
    effects: tuple[str, ...] = ()
    record_count: int = 3
    kind: ClassVar[Kind] = "output error"

    @property
    def residual(self) -> FloatArray:
        return np.full(ROWS, np.sqrt(self.level))

    @property
    def owner(self) -> npt.NDArray[np.int64]:
        return np.zeros(ROWS, dtype=np.int64)

    @property
    def held_out(self) -> list[tuple[str, bool]]:
        return [("t.h5", False)]

    def beyond(self, rows: FloatArray) -> FloatArray:
        return rows


def fake_state(residual: FakeResidual, *, tension: float = 1.0, motion: float | None = None) -> State:
    """A model of the paper with errors of its tension [N] and its motion; that is the level by default."""
    shown = {"tension_rmse_n": tension, "motion_nrmse": 0.02, "relative_motion_nrmse": 0.02}
    errors: Any = {kind: {**shown, "records": 3, "failed": 0} for kind in ("hold_out", "training")}
    material = ({"motion_nrmse": residual.level if motion is None else motion},)
    return State(rom.paper_model(), residual, errors, material, least_improvement=0.1)


def explained(
    name: str = "relaxation-log", gain: float = 100.0, enters: str = "tension", **changed: Any
) -> Explanation:
    """An effect that takes so much from a cost of 400 of training records."""
    effect: ModelCorrection = CATALOGUE[name].at(enters)
    settings: dict[str, Any] = {"free_numbers": 2, "left": 1.0, **changed}
    return Explanation(
        effect, {"t.h5": 400.0}, {"t.h5": 400.0 - gain}, {"t.h5": 200}, frozenset(), **settings
    )


@dataclass(eq=False)
class FakeRefits(CampaignRefits[FakeResidual]):
    """Fits of a campaign without a bolt that find nothing and drop nothing.

    Tests override what they ask about.
    """

    options: Options = field(default_factory=Options)
    residual_type = FakeResidual

    def start(self) -> State:
        return fake_state(FakeResidual())

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        del renew_noise
        before = self.own(state.residual)
        return FakeResidual(before.level, (*before.effects, explanation.effect.path))

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        del law_is_fitted
        return fake_state(self.own(residual))

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        del history, place
        return None

    def screen(self, residual: Residual) -> Probes:
        del residual
        return ()

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        del probes, residual
        return []

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        raise AssertionError((state, misfit))


def of_fake(residual: Residual) -> FakeResidual:
    assert isinstance(residual, FakeResidual)
    return residual
