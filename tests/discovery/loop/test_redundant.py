"""What the loop drops once a later effect is there: that which explains nothing beside the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.decide.explanation import Explanation
from discovery.explain import at_rest, ground_motion, tension
from discovery.explain.force_balance import explanation as of_balance
from discovery.explain.force_balance import fitted
from discovery.explain.motion import explanation
from discovery.explain.motion_fit import with_effects
from discovery.explain.tension import TensionFindings
from discovery.loop.balance_refits import BalanceRefits
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.motion_stage import in_motion, with_later_disturbances
from discovery.loop.redundant import without_redundant, without_redundant_in_tension
from discovery.loop.refits import Probes
from discovery.loop.state import State
from discovery.loop.tension_stage import adopted
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.residual.output_error import WhitenedResidual, whiten
from experiments.studies.rig import Undeclared
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect, ModelCorrection
from tests.discovery import driven_twins as twins
from tests.discovery.loop.fake_refits import FakeRefits, FakeResidual, explained, fake_state, of_fake
from tests.discovery.residual.test_free_parameters import evidence as evidence_of_rows
from tests.discovery.rig_campaigns import refits, start

THREE = ("relaxation-log", "tension-drift", "loosening-ratchet")
CUBIC = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})
GAIN = Undeclared("acceleration-gain", "sensor:acceleration_so", {"g": 0.1})
BIAS = Undeclared("acceleration-bias", "sensor:acceleration_lo", {"b": 0.5})


def whitened(state: State) -> WhitenedResidual:
    assert isinstance(state.residual, WhitenedResidual)
    return state.residual


def names(path: LoopHistory) -> list[str]:
    return [selection.best.effect.name for selection in path.selections]


def of_catalogue(hidden: Undeclared, strength: float) -> ModelCorrection:
    effect = CATALOGUE[hidden.name].at(hidden.enters, ground=hidden.enters.startswith("flexure"))
    return effect.with_values(**{name: strength * value for name, value in hidden.parameters.items()})


def with_effect(state: State, effect: Effect) -> State:
    """The state with an effect in its model, nothing refitted."""
    before = whitened(state)
    baseline = replace(before.baseline, model=effect.added_to(state.model))
    residual = with_effects(whiten(before.traces, baseline, before.floors))
    return replace(state, model=baseline.model, residual=residual)


@pytest.mark.parametrize("there", [False, True])
def test_a_force_is_dropped_where_the_model_does_as_well_without(there: bool) -> None:
    hidden = [CUBIC] if there else []
    mine, first = refits(*hidden), start(*hidden)
    effect = of_catalogue(CUBIC, 1.0 if there else 0.0)
    assert isinstance(effect, Effect)
    one = Selection(explanation(effect, CATALOGUE["cubic-stiffness"], whitened(first)))
    path = without_redundant(mine, LoopHistory((first,)).extended(one, with_effect(first, effect)))
    assert len(path.selections) == len(path.states) - 1 == len(path.states[-1].model.effects) == int(there)


@pytest.mark.parametrize("there", [False, pytest.param(True, marks=pytest.mark.variant)])
def test_a_fault_is_dropped_where_a_later_effect_has_made_it_redundant(there: bool) -> None:
    hidden = [CUBIC, *([GAIN] if there else [])]
    mine, first = refits(*hidden), start(*hidden)
    gain, cubic = of_catalogue(GAIN, 1.0 if there else 1e-3), of_catalogue(CUBIC, 1.0)
    second = adopted(mine, first, explanation(gain, CATALOGUE["acceleration-gain"], whitened(first)))
    told = [
        Selection(explanation(effect, CATALOGUE[effect.name], whitened(state)))
        for effect, state in ((gain, first), (cubic, second))
    ]
    path = LoopHistory((first,)).extended(told[0], second)
    assert without_redundant(mine, path) is path  # the last one is not asked
    third = adopted(mine, second, told[1].best)
    path = without_redundant(mine, path.extended(told[1], third))
    assert ("acceleration-gain" in names(path)) is there
    assert path.last.level < 1.2
    assert len(path.states) == len(path.selections) + 1


@pytest.mark.variant
def test_what_shows_before_the_hits_stays_whatever_the_motion_says() -> None:
    mine, first = refits(CUBIC, BIAS), start(CUBIC, BIAS)
    (told,) = (e for e in at_rest.explain(whitened(first), Options()) if e.effect.name == "acceleration-bias")
    second = mine.evaluated(mine.refit_with(first, told, renew_noise=True))
    cubic = of_catalogue(CUBIC, 1.0)
    one = Selection(explanation(cubic, CATALOGUE["cubic-stiffness"], whitened(second)))
    path = LoopHistory((first,)).extended(Selection(told), second)
    path = path.extended(one, adopted(mine, second, one.best))
    assert without_redundant(mine, path) is path


@dataclass(eq=False)
class LaterDisturbance(FakeRefits):
    """Fits in which a hum makes a cubic spring redundant."""

    dropped: list[frozenset[str]] = field(default_factory=list)

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        after = of_fake(super().refit_with(state, explanation, renew_noise=renew_noise))
        return replace(after, level=1.0)

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        names = history.names
        if len(names) == 1 or history.selections[place].best.effect.name != "cubic-stiffness":
            return None
        self.dropped.append(names)
        return replace(of_fake(history.last.residual), effects=("sensor:tension.hum",))


@pytest.mark.parametrize("shows_later", [False, True])
def test_what_shows_before_the_hits_only_later_may_make_others_redundant(
    monkeypatch: pytest.MonkeyPatch, shows_later: bool
) -> None:
    cubic, hum = explained("cubic-stiffness", 300.0, "joint"), explained("hum", 100.0, "sensor:tension")

    def at_rest_shows(residual: FakeResidual, _: Options) -> tuple[Explanation, ...]:
        return (hum,) if shows_later and hum.effect.path not in residual.effects else ()

    monkeypatch.setattr(at_rest, "explain", at_rest_shows)
    monkeypatch.setattr(ground_motion, "explain", lambda *_: ())
    refits, first = LaterDisturbance(), LoopHistory((fake_state(FakeResidual(5.0)),))
    after = with_later_disturbances(refits, first, Selection(cubic))
    assert names(after) == ["hum" if shows_later else "cubic-stiffness"]
    assert len(after.states) == 2
    assert refits.dropped == [frozenset({cubic.effect.path, hum.effect.path})] * shows_later


@dataclass(eq=False)
class Alternating(FakeRefits):
    """Fits in which an effect always helps and is redundant at once, with so much left over each time."""

    left: Iterator[float] = field(default_factory=lambda: iter(()))
    screens: int = 0

    def screen(self, residual: Residual) -> Probes:
        self.screens += 1
        return super().screen(residual)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        del probes, residual
        return [explained("cubic-stiffness", 300.0, "joint")]

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        after = of_fake(super().refit_with(state, explanation, renew_noise=renew_noise))
        return replace(after, level=0.5 * after.level)

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        del history, place
        return FakeResidual(next(self.left))


@pytest.mark.parametrize(("left", "screens"), [([50.0, 50.0], 2), ([99.5], 1)])
def test_the_loop_goes_on_as_long_as_the_same_effects_leave_less(left: list[float], screens: int) -> None:
    refits = Alternating(left=iter(left))
    after = in_motion(refits, LoopHistory((fake_state(FakeResidual(100.0)),)))
    assert (after.names, after.last.level) == (frozenset(), pytest.approx(left[-1]))
    assert refits.screens == screens


def test_what_the_motion_does_not_show_is_not_examined_by_it() -> None:
    nothing: Any = None
    state = State(rom.paper_model(), evidence_of_rows(0.0), nothing)
    path = LoopHistory((state,))
    for one in (explained("tension-skew", enters="sensor:tension"), explained("loosening-ratchet")):
        path = path.extended(Selection(one), state)
    assert without_redundant(ImpactRefits(nothing, nothing, Options()), path) is path


@dataclass(eq=False)
class InTension(FakeRefits):
    """Fits of effects in the tension; those beside which one was dropped have such an error."""

    error: float = 1.0

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        del law_is_fitted
        return fake_state(of_fake(residual), tension=self.error)

    def tension(self, state: State) -> Any:
        return SimpleNamespace(kind="tension", effects=of_fake(state.residual).effects)


@pytest.fixture
def shortened(monkeypatch: pytest.MonkeyPatch) -> Callable[..., LoopHistory]:
    """Three effects in the tension, and what each explains where the one before the last is asked again."""

    def loop(gains: dict[str, float], error: float = 1.0) -> LoopHistory:
        offered = [explained(name, gains.get(name, 100.0)) for name in THREE]

        def findings(_residual: Any, _: Options, path: str = "") -> TensionFindings:
            shown = tuple(e for e in offered if path in ("", e.effect.path))
            return TensionFindings(shown, Misfit(5.0, 100.0))

        monkeypatch.setattr(tension, "findings", findings)
        paths = [explained(name).effect.path for name in THREE]
        states = [fake_state(FakeResidual(effects=tuple(paths[:count]))) for count in range(4)]
        path = LoopHistory((states[0],), tension=(Misfit(9.0, 100.0), Misfit(2.0, 100.0)))
        for name, state in zip(THREE, states[1:], strict=True):
            path = path.extended(Selection(explained(name)), state)
        return without_redundant_in_tension(InTension(error=error), path, 0)

    return loop


def test_an_effect_in_the_tension_is_dropped_where_a_later_one_leaves_it_nothing(
    shortened: Callable[..., LoopHistory],
) -> None:
    assert len(shortened({}).selections) == 3
    path = shortened({"tension-drift": 5.0})
    assert names(path) == ["relaxation-log", "loosening-ratchet"]
    assert of_fake(path.last.residual).effects == ("tension.relaxation-log", "tension.loosening-ratchet")
    assert len(path.states) == 3
    assert [one.level for one in path.tension] == [9.0, 5.0]  # beside what stays


def test_it_stays_where_the_later_one_hangs_on_it_or_the_model_gets_worse_without(
    shortened: Callable[..., LoopHistory],
) -> None:
    assert len(shortened({"tension-drift": 5.0, "loosening-ratchet": 5.0}).selections) == 3
    assert len(shortened({"tension-drift": 5.0}, error=2.0).selections) == 3


@pytest.mark.parametrize("there", [False, True])
def test_a_force_along_a_driven_motion_is_dropped_too(tmp_path: Path, there: bool) -> None:
    def force(x: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(2e7 * x**3 + (5.0 if there else 0.0) * np.tanh(v / 2e-3))

    held = [("coulomb-friction", {"F_c": 5.0 if there else 0.01}), ("cubic-stiffness", {"k3": 2e7})]
    effects = [CATALOGUE[name].at("guide", ground=True).with_values(**values) for name, values in held]
    mine = BalanceRefits.of(twins.driven(tmp_path / "driven", extra=force), Options())
    first = mine.start()
    assert isinstance(first.residual, ForceBalanceResidual)
    path = LoopHistory((first,))
    for count in (1, 2):
        residual = fitted(first.residual, effects[:count])[0]
        one = of_balance(effects[count - 1], first.residual, residual)
        path = path.extended(Selection(one), mine.evaluated(residual))
    left = without_redundant(mine, path)
    assert names(left) == ["coulomb-friction"] * there + ["cubic-stiffness"]
    assert [one.name for one in left.last.model.effects] == names(left)
