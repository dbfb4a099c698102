"""Which effects in the tension the loop keeps, whatever explains them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from discovery.decide.explanation import Explanation
from discovery.explain import free_rate, tension
from discovery.explain.tension import TensionFindings
from discovery.loop.history import LoopHistory
from discovery.loop.state import State
from discovery.loop.tension_stage import in_tension
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from rom.effects import LawChange, free_form
from rom.model.laws import Parameter
from tests.discovery.loop.fake_refits import FakeRefits, FakeResidual, explained, fake_state, of_fake

Kept = Callable[..., LoopHistory]


@dataclass(eq=False)
class Bolted(FakeRefits):
    """A bolt whose tension is off by so much, and by so much with every further effect in it."""

    errors: Iterator[float] = field(default_factory=lambda: iter(()))
    last_error: float = 1.0
    misfits: Sequence[float] = (1.0,)

    def tension(self, state: State) -> Any:
        effects = of_fake(state.residual).effects
        level = self.misfits[min(len(effects), len(self.misfits) - 1)]
        return SimpleNamespace(kind="tension", effects=effects, misfit=Misfit(level, 100.0))

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        del law_is_fitted
        return fake_state(of_fake(residual), tension=next(self.errors, self.last_error))


def led(
    monkeypatch: pytest.MonkeyPatch,
    levels: list[float],
    errors: list[float],
    motion: float = 1.0,
    explanations: Sequence[tuple[Explanation, ...]] | None = None,
) -> LoopHistory:
    """The history where an effect is explained as often as there are levels, and has these errors then."""
    offered = explanations or [(explained(),)] * len(levels)

    def findings(residual: Any, _: object, only: str = "") -> TensionFindings:
        count = len(residual.effects)
        shown = offered[count] if count < len(offered) else ()
        return TensionFindings(tuple(e for e in shown if only in ("", e.effect.path)), residual.misfit)

    monkeypatch.setattr(tension, "findings", findings)
    monkeypatch.setattr(free_rate, "explain", lambda *_: ())
    refits = Bolted(errors=iter(errors[1:]), last_error=errors[-1], misfits=levels)
    return in_tension(refits, LoopHistory((fake_state(FakeResidual(motion), tension=errors[0]),)))


def names(history: LoopHistory) -> list[str]:
    return [selection.best.effect.name for selection in history.selections]


def test_effects_are_added_until_none_explains_more(monkeypatch: pytest.MonkeyPatch) -> None:
    added = [
        "relaxation-log", "tension-drift", "tension-follows-displacement",
        "tension-follows-displacement-squared",
    ]  # fmt: skip
    offered = [(explained(name),) for name in added]
    history = led(monkeypatch, [9.0, 5.0, 3.0, 1.0], [1.0, 0.9, 0.8, 0.7, 0.6], explanations=offered)
    assert names(history) == added
    assert [misfit.level for misfit in history.tension] == [9.0, 1.0]


def test_the_loop_ends_where_the_same_effects_come_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    history = led(monkeypatch, [9.0, 9.0, 9.0], [1.0, 0.9, 0.8])
    assert len(history.selections) == 1


def test_one_that_costs_the_courses_more_than_it_explains_is_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    history = led(monkeypatch, [1.02, 2.17], [1.0, 0.99, 0.98])
    assert not history.selections
    assert history.tension[-1].level == 1.02
    assert led(monkeypatch, [1.02, 1.4], [1.0, 0.99, 0.98]).selections


@pytest.mark.parametrize(("reading", "count"), [("tension-follows-displacement", 1), ("relaxation-log", 2)])
def test_a_law_must_not_hang_on_a_reading_that_courses_do_not_see(
    monkeypatch: pytest.MonkeyPatch, reading: str, count: int
) -> None:
    before = (explained(reading), explained("loosening-ratchet", 5.0))
    after = (explained("loosening-ratchet", 50.0),)
    history = led(monkeypatch, [1.0, 1.1], [1.0, 0.99, 0.98, 0.97], explanations=[before, after])
    assert len(history.selections) == count


def test_one_that_ruins_an_error_is_not_added(monkeypatch: pytest.MonkeyPatch) -> None:
    history = led(monkeypatch, [2.0, 1.2], [0.9, 9.5])
    assert not history.selections
    assert not history.tension[-1].is_noise


def test_the_misfit_is_reported_and_no_name_sought_where_the_motion_is_not_explained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    history = led(monkeypatch, [9.0], [1.0, 0.5], motion=5.0)
    assert not history.selections
    assert [misfit.level for misfit in history.tension] == [9.0, 9.0]


def test_the_loop_drops_what_a_later_effect_has_made_redundant(monkeypatch: pytest.MonkeyPatch) -> None:
    drift, ratchet = explained("tension-drift", 200.0), explained("loosening-ratchet")
    again = explained("tension-drift", 1.0)
    offered = [(drift, ratchet), (ratchet, again)]
    history = led(monkeypatch, [9.0, 1.0], [1.0, 0.9, 0.8], explanations=offered)
    assert names(history) == ["loosening-ratchet"]
    assert [misfit.level for misfit in history.tension] == [9.0, 1.0]


def free_rate_found() -> Explanation:
    effect = free_form("rate - (g_1 * max(T, 0))", "tension", {"g_1": Parameter(0.15, "1/s")})
    assert isinstance(effect, LawChange)
    return Explanation(effect, {"t.h5": 900.0}, {"t.h5": 100.0}, {"t.h5": 200}, frozenset(), 1, left=1.0)


@dataclass(eq=False)
class Named(FakeRefits):
    """A bolt beside whose law a name leaves so much, and free forms, one after the other, so much."""

    of_name: float = 4.0
    of_forms: Iterator[float] = field(default_factory=lambda: iter(()))
    error_of_name: float = 1.0
    error_of_form: float = 1.0

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        del state, renew_noise
        formed = explanation.effect.name == "free-form"
        left = next(self.of_forms) if formed else self.of_name
        return Beside(misfit=Misfit(left, 200.0), error=self.error_of_form if formed else self.error_of_name)

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        del law_is_fitted
        assert isinstance(residual, Beside)
        return fake_state(residual, tension=residual.error)

    def tension(self, state: State) -> Any:
        assert isinstance(state.residual, Beside)
        return SimpleNamespace(kind="tension", misfit=state.residual.misfit)


@dataclass(frozen=True, eq=False)
class Beside(FakeResidual):
    """Noise in the motion, and so much left over of the tension with an error [N]."""

    misfit: Misfit = field(default_factory=lambda: Misfit(1.0, 200.0))
    error: float = 1.0


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Kept:
    """The history where free forms leave so much in place of a name, and beside it."""

    def loop(
        left: list[float],
        error: float = 1.0,
        *,
        named: float | None = 4.0,
        none: int = 0,
        of_name: float = 1.0,
        declared: float = 9.0,
    ) -> LoopHistory:
        ratchet = Explanation(
            explained("loosening-ratchet").effect, {"t.h5": 900.0}, {"t.h5": 100.0}, {"t.h5": 200},
            frozenset(), 1, left=1.0,
        )  # fmt: skip
        offered = iter([(ratchet,)] if named is not None else [])
        monkeypatch.setattr(
            tension, "findings", lambda residual, *_: TensionFindings(next(offered, ()), residual.misfit)
        )
        formed = iter([()] * none + [(free_rate_found(),)] * 2)
        monkeypatch.setattr(free_rate, "explain", lambda *_: next(formed))
        refits = Named(of_name=named or 0.0, of_forms=iter(left), error_of_name=of_name, error_of_form=error)
        start = fake_state(Beside(misfit=Misfit(declared, 200.0)), tension=1.0)
        return in_tension(refits, LoopHistory((start,)))

    return loop


def test_a_free_form_that_explains_what_a_name_does_not_takes_its_place(kept: Kept) -> None:
    assert names(kept([1.41], named=1.56)) == ["free-form"]  # noise alone, and surely less
    assert names(kept([4.0], named=20.0, declared=99.0)) == [
        "free-form"
    ]  # next to nothing, though more than noise
    history = kept([1.1])
    assert names(history) == ["free-form"]
    assert [misfit.level for misfit in history.tension] == [9.0, 1.1]
    assert history.tension_at_noise_floor


@pytest.mark.parametrize(("left", "none"), [([3.0, 1.1], 0), ([1.1], 1)])
def test_or_stands_beside_it(kept: Kept, left: list[float], none: int) -> None:
    assert names(kept(left, none=none)) == ["loosening-ratchet", "free-form"]


@pytest.mark.parametrize(("named", "left"), [(1.55, 1.48), (4.0, 2.8)])
def test_a_name_stays_where_a_free_form_explains_little_more(kept: Kept, named: float, left: float) -> None:
    history = kept([left, left], named=named)
    assert names(history) == ["loosening-ratchet"]
    assert history.tension[-1].level == named
    assert not history.tension_at_noise_floor


def test_a_free_form_that_ruins_an_error_is_not_kept(kept: Kept) -> None:
    assert names(kept([1.0, 1.0], error=1.6)) == ["loosening-ratchet"]
    assert names(kept([1.0, 1.0], of_name=0.6)) == ["loosening-ratchet"]  # predicts worse than the name does


@pytest.mark.parametrize(("level", "expected"), [(1.0, []), (9.0, ["free-form"])])
def test_the_loop_asks_for_a_free_form_where_more_than_noise_is_left(
    kept: Kept, level: float, expected: list[str]
) -> None:
    assert names(kept([1.0], named=None, declared=level)) == expected
