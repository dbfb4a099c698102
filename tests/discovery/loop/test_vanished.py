"""An effect that stood in balances of forces for one that simulations show is dropped, others are not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.loop.balance_refits import BalanceRefits
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.state import State
from rom.effects import CATALOGUE
from tests.discovery.loop.fake_refits import FakeResidual, explained, fake_state

STOOD_FOR, SHOWN = "even-stiffness", "cubic-stiffness"


def state(error: float, limits: tuple[float, float] | None = None) -> State:
    """A model of both effects, the first with limits of its strength; of the second alone without these."""
    found = fake_state(FakeResidual())
    first = CATALOGUE[STOOD_FOR].at("flexure_lo", ground=True)
    if limits is not None:
        low, high = limits
        first = replace(first, parameters={"k2": replace(first.parameters["k2"], low=low, high=high)})
    effects = (*([] if limits is None else [first]), CATALOGUE[SHOWN].at("flexure_lo", ground=True))
    errors: Any = {kind: {**of, "motion_nrmse": error} for kind, of in found.errors.items()}
    return replace(found, model=replace(found.model, effects=effects), errors=errors)


@pytest.mark.parametrize(
    ("limits", "alone", "left"),
    [
        ((-1.0, 2.0), 0.02, (SHOWN,)),
        ((1.0, 2.0), 0.02, (STOOD_FOR, SHOWN)),  # it is there
        ((-1.0, 2.0), 0.03, (STOOD_FOR, SHOWN)),  # without it the motion is met worse
    ],
)
def test_an_effect_whose_limits_hold_zero_is_dropped_where_motion_is_met_as_well(
    limits: tuple[float, float], alone: float, left: tuple[str, ...]
) -> None:
    stood, shown = (Selection(explained(name, enters="flexure_lo")) for name in (STOOD_FOR, SHOWN))
    begun = LoopHistory((state(0.04), state(0.03)), (stood,), criteria=CRITERIA)
    found = begun.extended(shown, state(0.02, limits))

    def searched(start: LoopHistory) -> LoopHistory:
        assert not start.selections
        return start.extended(shown, state(alone))

    refits = cast(BalanceRefits, SimpleNamespace(_searched=searched))
    ended = BalanceRefits._without_vanished(refits, begun, found)
    assert tuple(one.best.effect.name for one in ended.selections) == left
