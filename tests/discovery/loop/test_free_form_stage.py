"""A term without the catalogue in place of a name: where the form is wrong, not where a fit was stuck."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.decide.explanation import Explanation
from discovery.loop.free_form_stage import or_free_form
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Residual
from rom.effects import ModelCorrection, free_form
from rom.model.laws import Parameter
from tests.discovery.loop.fake_refits import FakeRefits, FakeResidual, explained, fake_state, of_fake

RULES = replace(CRITERIA, acceptance=replace(CRITERIA.acceptance, training_gain_motion=5.0))
FORM = explained("cubic-stiffness", 200.0, "joint", p_value=0.001, left=1.0)
TERM = replace(FORM, effect=free_form("g_1 * (x ** 3)", "joint", {"g_1": Parameter(1e12, "N/m3")}))
STUCK, BEST = 1.15, 1.0


@dataclass(eq=False)
class Stuck(FakeRefits):
    """The name's fit is stuck; from beside another term it ends where `freed` says."""

    freed: float = STUCK
    options: Options = field(default_factory=lambda: Options(criteria=RULES))

    def free_forms(self, state: State) -> Sequence[Explanation]:
        del state
        return (TERM,)

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        del explanation, renew_noise
        return FakeResidual(BEST, of_fake(state.residual).effects)

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        assert effect is TERM.effect
        return FakeResidual(self.freed, of_fake(residual).effects)


@pytest.mark.parametrize(("freed", "name"), [(STUCK, "free-form"), (BEST, "cubic-stiffness")])
def test_a_stuck_fit_of_the_right_name_is_freed_before_its_form_is_called_wrong(
    freed: float, name: str
) -> None:
    start = LoopHistory((fake_state(FakeResidual(4.0)),), criteria=RULES)
    named = start.extended(Selection(FORM), fake_state(FakeResidual(STUCK, ("cubic",))))
    found = or_free_form(Stuck(freed=freed), named, start)
    assert [selection.best.effect.name for selection in found.selections] == [name]
    assert found.last.level == pytest.approx(BEST)
    assert np.isclose(named.last.level, STUCK)
