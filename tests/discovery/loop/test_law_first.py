"""When another law of loosening is taken before all effects in the motion."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

import rom
from discovery.criteria.criteria import CRITERIA
from discovery.loop import tension_stage
from discovery.loop.history import LoopHistory, Selection
from tests.discovery.loop.fake_refits import FakeRefits, FakeResidual, explained, fake_state


@dataclass(frozen=True)
class History:
    """What the rule looks at of a history of the loop."""

    last: Any
    selections: tuple[Any, ...] = ()
    tension: tuple[Any, ...] = ()
    is_explained: bool = False
    criteria = CRITERIA

    def ending(self, last: Any) -> History:
        return History(last, self.selections)


@pytest.mark.parametrize(
    ("kind", "histories", "along_law", "is_taken"),
    [
        ("law change", 400.0, (150.0, 140.0), True),  # the histories are off by more than the motion
        ("law change", 100.0, (3.0, 1.4), True),  # next to nothing is left of the motion
        ("law change", 100.0, (150.0, 140.0), False),
        ("law change", 100.0, (70.0, 40.0), True),  # once the stiffnesses have followed
        ("law change", 400.0, (310.0, 320.0), False),
        ("reading", 400.0, (3.0, 1.4), False),
    ],
)
def test_a_law_comes_first_where_the_histories_or_the_motion_say_so(
    monkeypatch: pytest.MonkeyPatch, kind: str, histories: float, along_law: tuple[float, ...], is_taken: bool
) -> None:
    start = History(SimpleNamespace(level=300.0))
    named = History(start.last, (SimpleNamespace(best=SimpleNamespace(effect=SimpleNamespace(kind=kind))),))
    monkeypatch.setattr(tension_stage, "_named", lambda *_, **__: named)
    levels = iter(along_law)
    refits = without_harm(monkeypatch)
    refits.tension = lambda _: of_level(histories)
    refits.along_law = lambda *_: SimpleNamespace(level=next(levels), errors={})
    found: Any = tension_stage.law_first(refits, start)  # type: ignore[arg-type]
    assert (found is not start) == is_taken
    if is_taken:
        assert found.selections == named.selections
        assert found.last.level == min(along_law)


def without_harm(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(tension_stage, "harms", lambda *_: False)
    monkeypatch.setattr(tension_stage, "numbers_of", lambda fit: fit)
    return SimpleNamespace(options=SimpleNamespace(criteria=CRITERIA))


def of_level(level: float) -> SimpleNamespace:
    misfit = SimpleNamespace(level=level, is_noise=False)
    return SimpleNamespace(misfit=misfit, baseline=f"fit that leaves {level:g}")


@pytest.mark.parametrize(
    ("left", "last"),
    [
        ((231.0, 5.4, 1.6, 1.59), 3),  # until the courses have settled
        ((231.0, 5.4, 6.0), 1),  # what leaves more is not kept
        ((231.0, 200.0, 150.0, 100.0, 50.0), 4),  # not for ever
    ],
)
def test_a_law_is_fitted_along_the_motion_that_follows_it(
    monkeypatch: pytest.MonkeyPatch, left: tuple[float, ...], last: int
) -> None:
    refits, given = without_harm(monkeypatch), []

    def along_law(state: Any, numbers: str = "") -> SimpleNamespace:
        given.append(numbers)
        return SimpleNamespace(turn=state.turn + 1, errors={})

    refits.along_law, refits.tension = along_law, lambda state: of_level(left[state.turn])
    found: Any = tension_stage._followed(refits, SimpleNamespace(turn=-1))  # type: ignore[arg-type]
    assert found.turn == last
    assert given == ["", *(f"fit that leaves {level:g}" for level in left[: len(given) - 1])]


@pytest.mark.parametrize(
    ("name", "level", "tension", "is_taken"),
    [
        ("loosening-power", 0.95, 1.0, True),
        ("loosening-power", 1.3, 1.0, False),  # the motion suits the tension as it was better
        ("loosening-power", 0.95, 2.0, False),  # nearer in the motion, but the tension is ruined
        ("relaxation-log", 0.95, 1.0, False),  # no other law was found
    ],
)
def test_the_motion_is_followed_along_a_law_that_was_found_after_it(
    name: str, level: float, tension: float, is_taken: bool
) -> None:
    last = fake_state(FakeResidual(1.18))
    history = LoopHistory((last,)).extended(Selection(explained(name)), last)
    refits = FakeRefits(rom.paper_model())  # type: ignore[arg-type]
    followed = fake_state(FakeResidual(level), tension=tension)
    refits.along_law = lambda *_: followed  # type: ignore[method-assign]
    found = tension_stage.along_found_law(refits, history)
    assert found.names == history.names
    assert (found.last is followed) == is_taken
