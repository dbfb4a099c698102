"""What the loop drops once a later effect is there: that which explains nothing beside the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from discovery.loop.force_loop import _together
from discovery.loop.force_loop import _without_needless as without_needless_forces

from discovery.decide.explanation import Explanation
from discovery.explain import at_rest
from discovery.explain.force_balance import ForceBalanceResidual
from discovery.explain.motion import explanation
from discovery.explain.tension import TensionFindings
from discovery.loop import close_loop as refinement
from discovery.loop.close_loop import _Loop
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.redundant import without_needless, without_needless_in_tension
from discovery.loop.refits import Refits
from discovery.loop.state import State, silent, with_effects
from discovery.options import Options
from discovery.residual.course_fit import Misfit
from discovery.residual.output_error import whiten
from experiments.studies.rig import Undeclared
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect, ModelCorrection
from rom.identification.force_balance import balances_of
from tests.discovery import driven_twins as twins
from tests.discovery.rig_campaigns import identified

CUBIC = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e9})
GAIN = Undeclared("acceleration-gain", "sensor:acceleration_so", {"g": 0.1})
BIAS = Undeclared("acceleration-bias", "sensor:acceleration_lo", {"b": 0.5})


def refits(*undeclared: Undeclared) -> Refits:
    """Of a campaign of six preloads, one in three held out."""
    return Refits(*identified(*undeclared), 1, silent)


def of_catalogue(hidden: Undeclared, strength: float) -> ModelCorrection:
    effect = CATALOGUE[hidden.name].at(hidden.enters, ground=hidden.enters.startswith("flexure"))
    return effect.with_values(**{name: strength * value for name, value in hidden.parameters.items()})


def with_effect(state: State, effect: ModelCorrection, mine: Refits) -> State:
    """The state with an effect in its model, nothing refitted."""
    baseline = replace(state.evidence.baseline, model=effect.added_to(state.model))
    evidence = state.evidence
    if isinstance(effect, Effect):
        evidence = with_effects(whiten(evidence.traces, baseline, evidence.floors))
    else:
        evidence = mine.gathered(baseline, evidence.floors)
    return replace(state, model=baseline.model, evidence=evidence)


@pytest.mark.parametrize("there", [False, True])
def test_a_force_is_dropped_where_the_model_does_as_well_without(there: bool) -> None:
    mine = refits(*([CUBIC] if there else []))
    first, effect = mine.start(), of_catalogue(CUBIC, 1.0 if there else 0.0)
    one = Selection(explanation(effect, CATALOGUE["cubic-stiffness"], first.evidence), ())
    path = without_needless(LoopHistory((first,)).longer(one, with_effect(first, effect, mine)), mine)
    assert len(path.chosen) == len(path.states) - 1 == len(path.states[-1].model.effects) == int(there)


@pytest.mark.parametrize("there", [False, True])
def test_a_fault_is_dropped_where_a_later_effect_has_made_it_needless(there: bool) -> None:
    mine = refits(CUBIC, *([GAIN] if there else []))
    first = mine.start()
    gain, cubic = of_catalogue(GAIN, 1.0 if there else 1e-3), of_catalogue(CUBIC, 1.0)
    second = mine.adopt(first, explanation(gain, CATALOGUE["acceleration-gain"], first.evidence))
    told = [
        Selection(explanation(effect, CATALOGUE[effect.name], state.evidence), ())
        for effect, state in ((gain, first), (cubic, second))
    ]
    path = LoopHistory((first,)).longer(told[0], second)
    assert without_needless(path, mine) is path  # the last one is not asked
    third = mine.adopt(second, told[1].best)
    path = without_needless(path.longer(told[1], third), mine)
    assert ("acceleration-gain" in {one.best.effect.name for one in path.chosen}) is there
    assert path.last.level < 1.2
    assert len(path.states) == len(path.chosen) + 1


def test_what_shows_before_the_hits_stays_whatever_the_motion_says() -> None:
    mine = refits(CUBIC, BIAS)
    first = mine.start()
    (told,) = (e for e in at_rest.explain(first.evidence, Options()) if e.effect.name == "acceleration-bias")
    second = mine.adopt(first, told, floors_too=True)
    cubic = of_catalogue(CUBIC, 1.0)
    one = Selection(explanation(cubic, CATALOGUE["cubic-stiffness"], second.evidence), ())
    path = LoopHistory((first,)).longer(Selection(told, ()), second).longer(one, mine.adopt(second, one.best))
    assert without_needless(path, mine) is path


@pytest.mark.parametrize("shows_later", [False, True])
def test_what_shows_before_the_hits_only_later_may_make_others_needless(
    monkeypatch: pytest.MonkeyPatch, shows_later: bool
) -> None:
    state: Any = SimpleNamespace(evidence=None)
    cubic, hum = (Selection(shown(name, 100.0), ()) for name in ("cubic-stiffness", "hum"))
    first, done = LoopHistory((state,)), []
    monkeypatch.setattr(
        _Loop, "in_motion", lambda _, path, given=None: path if done else path.longer(given, state)
    )
    monkeypatch.setattr(_Loop, "at_rest", lambda _, path: path.longer(hum, state) if shows_later else path)

    def dropping(path: LoopHistory, _: Refits) -> LoopHistory:
        done.append(path.names)
        return first.longer(path.chosen[-1], state)

    monkeypatch.setattr(refinement, "without_needless", dropping)
    nothing: Any = None
    after = _Loop(Refits(nothing, nothing, 1, silent)).moved(first, cubic)
    assert [one.best.effect.name for one in after.chosen] == ["hum" if shows_later else "cubic-stiffness"]
    assert len(done) == int(shows_later)


@pytest.mark.parametrize(("left", "screens"), [([100.0, 50.0, 50.0], 2), ([100.0, 99.5], 1)])
def test_the_loop_goes_on_as_long_as_the_same_effects_leave_less(
    monkeypatch: pytest.MonkeyPatch, left: list[float], screens: int
) -> None:
    state: Any = SimpleNamespace(evidence=None)
    asked, costs, first = [], iter(left), LoopHistory((state,))
    found = (Selection(shown("tension-drift", 100.0), ()), None), ()
    monkeypatch.setattr(_Loop, "_most_helpful", lambda *_: asked.append(1) or found)
    monkeypatch.setattr(LoopHistory, "improves", lambda *_: True)
    monkeypatch.setattr(Refits, "settled", lambda *_: state)
    monkeypatch.setattr(refinement, "reestimate_noise", lambda evidence: evidence)
    monkeypatch.setattr(refinement, "cost", lambda _: next(costs))
    monkeypatch.setattr(refinement, "without_needless", lambda *_: first)
    nothing: Any = None
    assert _Loop(Refits(nothing, nothing, 1, silent)).in_motion(first) is first
    assert len(asked) == screens


def test_what_the_motion_does_not_show_is_not_judged_by_it() -> None:
    state: Any = SimpleNamespace(model=SimpleNamespace(effects=()), evidence=None)
    nothing: Any = None
    path = LoopHistory((state,))
    for one in (shown("tension-skew", 100.0, "sensor:tension"), shown("loosening-ratchet", 100.0)):
        path = path.longer(Selection(one, ()), state)
    assert without_needless(path, nothing) is path


def shown(name: str, gain: float, enters: str = "tension") -> Explanation:
    effect, cost = CATALOGUE[name].at(enters), 400.0
    return Explanation(effect, {"t.h5": cost}, {"t.h5": cost - gain}, {"t.h5": 200}, frozenset(), 2, left=1.0)


def shortened(gains: dict[str, float], error: float = 1.0) -> LoopHistory:
    """Three effects in the tension, and what each explains where the one before the last is asked again."""

    def state(*names: str, error: float = 1.0) -> Any:
        held = {"tension_rmse_n": error, "motion_nrmse": 0.02, "records": 3, "failed": 0}
        return SimpleNamespace(names=names, level=1.0, errors={"hold_out": held, "training": held})

    names = ("relaxation-log", "tension-drift", "loosening-ratchet")
    path = LoopHistory((state(),), tension=(Misfit(9.0, 100.0), Misfit(2.0, 100.0)))
    for place, name in enumerate(names, 1):
        path = path.longer(Selection(shown(name, 100.0), ()), state(*names[:place]))

    def explain(_last: Any, asked: str) -> TensionFindings:
        told = tuple(shown(name, gains.get(name, 100.0)) for name in names)
        return TensionFindings(tuple(e for e in told if asked in ("", e.effect.path)), Misfit(5.0, 100.0))

    def adopt(last: Any, one: Explanation) -> Any:
        return state(*last.names, one.effect.name, error=error)

    return without_needless_in_tension(path, 0, explain, adopt)


def test_an_effect_in_the_tension_is_dropped_where_a_later_one_leaves_it_nothing() -> None:
    assert len(shortened({}).chosen) == 3
    path = shortened({"tension-drift": 5.0})
    assert [one.best.effect.name for one in path.chosen] == ["relaxation-log", "loosening-ratchet"]
    assert path.last.names == ("relaxation-log", "loosening-ratchet")  # type: ignore[attr-defined]
    assert len(path.states) == 3
    assert [one.level for one in path.tension] == [9.0, 5.0]  # beside what stays


def test_it_stays_where_the_later_one_hangs_on_it_or_the_model_gets_worse_without() -> None:
    assert len(shortened({"tension-drift": 5.0, "loosening-ratchet": 5.0}).chosen) == 3
    assert len(shortened({"tension-drift": 5.0}, error=2.0).chosen) == 3


@pytest.mark.parametrize("there", [False, True])
def test_a_force_along_a_driven_motion_is_dropped_too(tmp_path: Path, there: bool) -> None:
    def force(x: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(2e7 * x**3 + (5.0 if there else 0.0) * np.tanh(v / 2e-3))

    balances = balances_of(twins.driven(tmp_path / "driven", extra=force))[0]
    held = [("coulomb-friction", {"F_c": 5.0 if there else 0.01}), ("cubic-stiffness", {"k3": 2e7})]
    effects = [CATALOGUE[name].at("guide", ground=True).with_values(**values) for name, values in held]
    state = ForceBalanceResidual(balances, tuple(effects), dict.fromkeys(balances.names, 0.0))  # type: ignore[arg-type]
    left = without_needless_forces(_together(state.with_numbers())).effects
    assert [one.name for one in left] == ["coulomb-friction"] * there + ["cubic-stiffness"]
