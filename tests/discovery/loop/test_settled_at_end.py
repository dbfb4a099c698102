"""The last model is settled where a later stage has moved it, and kept where that makes nothing worse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

import rom
from discovery.loop.history import LoopHistory
from discovery.loop.motion_stage import settled_at_end
from discovery.loop.state import State
from discovery.residual.base import Residual
from rom.effects import CATALOGUE
from tests.discovery.loop.fake_refits import FakeRefits, FakeResidual, fake_state

FRICTION = CATALOGUE["coulomb-friction"].at("joint")


@dataclass(eq=False)
class Settling(FakeRefits):
    """A settled fit leaves `after`, and errors of the motion of `motion`."""

    after: float = 1.0
    motion: float = 0.02

    def settled(self, residual: Residual) -> Residual:
        del residual
        return FakeResidual(self.after)

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        state = super().evaluated(residual, law_is_fitted=law_is_fitted)
        errors = {kind: {**one, "motion_nrmse": self.motion} for kind, one in state.errors.items()}
        return replace(state, errors=errors)


def ending(*, forces: bool) -> LoopHistory:
    state = fake_state(FakeResidual(4.0))
    return LoopHistory((replace(state, model=FRICTION.added_to(rom.paper_model())) if forces else state,))


@pytest.mark.parametrize(
    ("refits", "forces", "level"),
    [
        (Settling(), True, 1.0),
        (Settling(), False, 4.0),  # nothing is settled where no force was found
        (Settling(after=5.0), True, 4.0),
        (Settling(motion=0.05), True, 4.0),  # simulations are worse by far
        (FakeRefits(), True, 4.0),  # it was settled before
    ],
)
def test_the_last_model_is_settled_where_that_leaves_less_and_harms_nothing(
    refits: FakeRefits, forces: bool, level: float
) -> None:
    assert settled_at_end(refits, ending(forces=forces)).last.level == pytest.approx(level)
