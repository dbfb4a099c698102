"""Which effects in the tension the loop keeps, whatever explains them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discovery.decide.explanation import Explanation
from discovery.explain import free_rate
from discovery.explain.tension import TensionFindings
from discovery.loop import close_loop as refinement
from discovery.loop.close_loop import _Loop
from discovery.loop.history import LoopHistory
from discovery.loop.refits import Refits
from discovery.loop.state import silent
from discovery.residual.course_fit import Misfit
from discovery.residual.tension import TensionResidual
from rom.effects import CATALOGUE


def explained(name: str = "relaxation-log", gain: float = 100.0) -> Explanation:
    effect, cost = CATALOGUE[name].at("tension"), 400.0
    return Explanation(effect, {"t.h5": cost}, {"t.h5": cost - gain}, {"t.h5": 200}, frozenset(), 2, left=1.0)


def state(tension: float, level: float = 1.0, model: tuple[str, ...] = ()) -> Any:
    held = {"tension_rmse_n": tension, "motion_nrmse": 0.02, "records": 3, "failed": 0}
    return SimpleNamespace(level=level, found=None, model=model, errors={"hold_out": held, "training": held})


def led(
    monkeypatch: pytest.MonkeyPatch,
    levels: list[float],
    errors: list[float],
    motion: float = 1.0,
    explanations: list[tuple[Explanation, ...]] | None = None,
) -> LoopHistory:
    """The path where an effect is explained as often as there are levels, and adopted with these errors."""
    found = explanations or [(explained(),)] * len(levels)
    after = iter(errors[1:])

    def explain(*asked: Any) -> TensionFindings:
        model, only = asked[0].model, asked[-1]
        told = found[len(model)] if len(model) < len(found) else ()
        level = levels[min(len(model), len(levels) - 1)]
        return TensionFindings(tuple(e for e in told if only in ("", e.effect.path)), Misfit(level, 100.0))

    def adopt(_: Refits, before: Any, one: Explanation) -> Any:
        return state(next(after, errors[-1]), model=(*before.model, one.effect.path))

    monkeypatch.setattr(refinement, "findings", explain)
    monkeypatch.setattr(free_rate, "explain", lambda *_: ())
    monkeypatch.setattr(TensionResidual, "misfit", Misfit(levels[0], 100.0))
    monkeypatch.setattr(Refits, "adopt", adopt)
    loop = _Loop(Refits(None, None, 1, silent))  # type: ignore[arg-type]
    return loop.in_tension(LoopHistory((state(errors[0], motion),)))


def test_effects_are_added_until_none_explains_more(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [
        "relaxation-log", "tension-drift", "tension-follows-displacement",
        "tension-follows-displacement-squared",
    ]  # fmt: skip
    found = [(explained(name),) for name in names]
    path = led(monkeypatch, [9.0, 5.0, 3.0, 1.0], [1.0, 0.9, 0.8, 0.7, 0.6], explanations=found)
    assert [one.best.effect.name for one in path.chosen] == names
    assert [one.level for one in path.tension] == [9.0, 1.0]


def test_the_loop_ends_where_the_same_effects_come_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [9.0, 9.0, 9.0], [1.0, 0.9, 0.8])
    assert len(path.chosen) == 1


def test_one_that_costs_the_courses_more_than_it_explains_is_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = led(monkeypatch, [1.02, 2.17], [1.0, 0.99, 0.98])
    assert not path.chosen
    assert path.tension[-1].level == 1.02
    assert led(monkeypatch, [1.02, 1.4], [1.0, 0.99, 0.98]).chosen


@pytest.mark.parametrize(("reading", "count"), [("tension-follows-displacement", 1), ("relaxation-log", 2)])
def test_a_law_must_not_hang_on_a_reading_that_courses_do_not_see(
    monkeypatch: pytest.MonkeyPatch, reading: str, count: int
) -> None:
    before = (explained(reading), explained("loosening-ratchet", 5.0))
    after = (explained("loosening-ratchet", 50.0),)
    path = led(monkeypatch, [1.0, 1.1], [1.0, 0.99, 0.98, 0.97], explanations=[before, after])
    assert len(path.chosen) == count


def test_one_that_ruins_an_error_is_not_added(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [2.0, 1.2], [0.9, 9.5])
    assert not path.chosen
    assert not path.tension[-1].is_noise


def test_courses_are_told_and_no_name_sought_where_the_motion_is_not_explained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = led(monkeypatch, [9.0], [1.0, 0.5], motion=5.0)
    assert not path.chosen
    assert [one.level for one in path.tension] == [9.0, 9.0]


def test_the_loop_drops_what_a_later_effect_has_made_needless(monkeypatch: pytest.MonkeyPatch) -> None:
    drift, ratchet = explained("tension-drift", 200.0), explained("loosening-ratchet")
    again = explained("tension-drift", 1.0)
    path = led(monkeypatch, [9.0, 1.0], [1.0, 0.9, 0.8], explanations=[(drift, ratchet), (ratchet, again)])
    assert [one.best.effect.name for one in path.chosen] == ["loosening-ratchet"]
    assert [one.level for one in path.tension] == [9.0, 1.0]
