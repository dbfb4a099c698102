"""Which effects in the tension the loop keeps, whatever explains them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discovery import refinement
from discovery.explanation import Explanation
from discovery.refinement import _Loop, _Path
from discovery.state import silent
from discovery.tension_attribution import TensionFindings
from discovery.tension_data import Misfit
from rom.effects import CATALOGUE


def explained() -> Explanation:
    effect = CATALOGUE["relaxation-log"].at("tension")
    return Explanation(effect, {"t.h5": 400.0}, {"t.h5": 300.0}, {"t.h5": 200}, frozenset(), 2, left=1.0)


def state(tension: float, level: float = 1.0) -> Any:
    held = {"tension_rmse_n": tension, "motion_nrmse": 0.02}
    return SimpleNamespace(level=level, found=None, model=None, errors={"hold_out": held, "training": held})


def led(
    monkeypatch: pytest.MonkeyPatch, levels: list[float], errors: list[float], motion: float = 1.0
) -> _Path:
    """The path where an effect is explained as often as there are levels, and adopted with these errors."""
    told = iter([TensionFindings((explained(),), Misfit(x, 100.0)) for x in levels])
    nothing = TensionFindings((), Misfit(levels[-1], 100.0))
    after = iter(errors[1:])
    monkeypatch.setattr(refinement, "explain_tension", lambda *_: next(told, nothing))
    monkeypatch.setattr(_Loop, "adopt", lambda *_: state(next(after)))
    loop = _Loop(None, None, 1, silent)  # type: ignore[arg-type]
    return loop.in_tension(_Path((state(errors[0], motion),), (), ()))


def test_effects_are_added_until_none_explains_more(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [9.0, 3.0, 1.0], [1.0, 0.9, 0.8, 0.7])
    assert len(path.chosen) == refinement.MOST_EFFECTS
    assert [one.level for one in path.tension] == [9.0, 1.0]


def test_one_that_makes_the_courses_worse_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [1.02, 1.17], [1.0, 0.99, 0.98])
    assert not path.chosen
    assert path.tension[-1].level == 1.02


def test_one_that_ruins_an_error_is_not_added(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [2.0, 1.2], [0.9, 9.5])
    assert not path.chosen
    assert not path.tension[-1].is_noise


def test_nothing_is_asked_where_the_motion_is_not_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    path = led(monkeypatch, [9.0], [1.0, 0.5], motion=5.0)
    assert not path.chosen
    assert not path.tension
