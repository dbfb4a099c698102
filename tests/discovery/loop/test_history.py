"""The models of a closed loop, one after the other: which are kept, which are better, and the verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import rom
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.acceptance import motion_errors
from discovery.decide.explanation import Explanation
from discovery.loop import history
from discovery.loop.history import LoopHistory, Selection, indistinguishable, misfit_views
from discovery.loop.state import State
from discovery.residual.course_fit import Misfit
from rom.effects import CATALOGUE
from tests.discovery.loop.fake_refits import FakeResidual


def state(level: float, error: float = 1.0, records: int = 3) -> State:
    held = {"motion_nrmse": error, "relative_motion_nrmse": error, "records": records, "failed": 0}
    errors: Any = {"hold_out": held, "training": held}
    least = CRITERIA.acceptance.material_error_explained
    residual = FakeResidual(level, record_count=records)
    return State(rom.paper_model(), residual, errors, motion_errors(errors), least)


@pytest.mark.parametrize(
    ("place", "kept"),
    [(0, ["declared", "c", "end"]), (1, ["declared", "a", "end"]), (2, ["declared", "a", "end"])],
)
def test_with_an_effect_goes_the_model_that_it_led_to(place: int, kept: list[str]) -> None:
    names: Any = ("declared", "a", "b" if place else "c", "d")
    path = LoopHistory(names, ("one", "two", "three")).without(place, "end")  # type: ignore[arg-type]
    assert list(path.states) == kept
    assert len(path.selections) == len(path.states) - 1


def test_the_only_effect_leaves_the_model_without_any() -> None:
    assert LoopHistory(("declared", "a"), ("one",)).without(0, "end").states == ("end",)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("before", "after", "error", "better"),
    [
        (6.6, 1.02, 0.999, True),  # noise alone is left
        (6.6, 1.02, 1.01, False),  # but every error rose
        (6.6, 1.5, 0.999, True),  # little beyond noise is left
        (6.6, 2.5, 0.999, False),  # more than that
        (1.25, 1.18, 0.999, False),  # hardly less than before
        (1.1, 1.0, 0.999, False),  # it was noise before
        (1.1, 1.0, 0.97, True),
        (6.6, 5.0, 0.97, True),
    ],
)
def test_a_better_state_lowers_an_error_or_leaves_little_beyond_noise(
    before: float, after: float, error: float, better: bool
) -> None:
    assert LoopHistory((state(before),)).improves(state(after, error)) is better


def test_what_noise_leaves_of_few_rows_at_times_is_little_beyond_noise() -> None:
    after = state(1.45, 0.999)
    assert not LoopHistory((state(1.7),)).improves(after)
    assert LoopHistory((state(1.7),)).improves(replace(after, by_chance=1.5))


@pytest.mark.parametrize(("held_out", "better"), [(0.95, True), (1.05, False)])
def test_where_simulations_leave_noise_alone_held_out_motion_is_met_no_worse(
    held_out: float, better: bool
) -> None:
    """Balances of forces, which noise passes through, may leave less with an effect that is not there."""
    before = replace(state(1.44), material=({"force_error": 0.4},), simulated_to_noise=True)
    after = replace(state(0.98, held_out), material=({"force_error": 0.34},))
    found = LoopHistory((before,))
    assert found.improves(after) is better
    assert LoopHistory((replace(before, simulated_to_noise=False),)).improves(after)
    assert found.verdict() == "no-effect"
    assert "1.44 times" in found.remarks()[0]
    louder = LoopHistory((replace(state(40.0), simulated_to_noise=True),))  # a mode that only forces show
    assert louder.verdict() == "unexplained"


def test_a_model_with_which_a_record_diverges_is_no_better() -> None:
    assert LoopHistory((state(6.6),)).improves(state(1.0, 0.5))
    assert not LoopHistory((state(6.6),)).improves(state(1.0, 0.5, records=2))


@pytest.mark.parametrize(
    ("named", "formed", "better"),
    [
        (1.22, 1.0, True),  # next to nothing of much is left by the name, but noise alone by the form
        (1.22, 1.1, False),  # hardly less
        (1.0, 0.99, False),  # the name leaves noise alone
        (3.0, 1.1, True),
        (3.0, 2.0, True),
        (3.0, 2.5, False),
    ],
)
def test_a_form_without_the_catalogue_takes_the_place_of_a_name_that_leaves_far_more(
    named: float, formed: float, better: bool
) -> None:
    path, other = (LoopHistory((state(10.8), state(left))) for left in (named, formed))
    assert (path.or_better(other).last is other.last) is better


def told(held_out: float) -> Explanation:
    """A force that takes 380 of 400 from training records, and so much of 100 from held-out ones."""
    return Explanation(
        CATALOGUE["cubic-stiffness"].at("joint"), {"t.h5": 400.0, "h.h5": 100.0},
        {"t.h5": 20.0, "h.h5": 100.0 - held_out}, {"t.h5": 200, "h.h5": 50}, frozenset({"h.h5"}), 1,
    )  # fmt: skip


def test_what_training_records_alone_ask_for_is_like_what_suits_them_as_well() -> None:
    best, rival = told(-20.0), told(-90.0)
    assert indistinguishable([best, rival], best) == ()
    assert indistinguishable([best, rival], best, hold_out=False) == (rival,)


def test_the_verdict_is_that_of_the_last_model() -> None:
    declared = LoopHistory((state(1.0),))
    assert declared.verdict() == "no-effect"
    assert LoopHistory((state(5.0),)).verdict() == "unexplained"
    closed = LoopHistory((state(5.0), state(1.0)), (Selection(told(20.0)),))
    assert closed.verdict() == "closed"
    assert closed.verdict(("a number that uncoupled tests deny",)) == "unexplained"
    assert declared.verdict(("a number that uncoupled tests deny",)) == "no-effect"


def test_criteria_of_a_history_decide() -> None:
    strict = Criteria().changed(acceptance={"noise_level": 1.1, "material_error": 0.5})
    assert LoopHistory((state(1.15),)).verdict() == "no-effect"
    assert LoopHistory((state(1.15),), criteria=strict).verdict() == "unexplained"
    before, after = state(6.6), state(5.0, 0.7)
    assert LoopHistory((before,)).improves(after)
    assert not LoopHistory((before,), criteria=strict).improves(after)


def test_the_last_misfit_of_the_courses_is_told_with_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    views = {"tension_by_preload": (("0 to 30 N", 4.0),)}
    monkeypatch.setattr(history, "tension_views", lambda misfit: views if misfit.level == 2.0 else {})
    told = misfit_views((Misfit(9.0, 100.0), Misfit(2.0, 100.0)))
    assert told == ({"tension_courses": 2.0}, views)
    assert misfit_views(()) == ({}, {})


@pytest.mark.parametrize(
    ("level", "error", "verdict"),
    [
        (3.0, 0.004, "no-effect"),
        (3.0, 0.02, "unexplained"),
        (8.0, 0.004, "unexplained"),
        (1.0, 0.02, "no-effect"),
    ],
)
def test_what_the_samples_of_a_hit_leave_open_is_no_missing_effect(
    level: float, error: float, verdict: str
) -> None:
    path = LoopHistory((state(level, error),))
    assert path.verdict() == verdict
    assert bool(path.remarks()) == (level > 1.2 and verdict == "no-effect")
    assert not path.at_noise_floor or level == 1.0
