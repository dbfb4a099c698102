"""The verdict on a closed loop in plain words."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discovery.loop.result import Closure
from experiments.text import closures
from tests.discovery.sound_closure import closure, friction, skew, unknown_force
from tests.experiments.report.test_closure import content


def test_what_is_left_is_not_claimed_where_no_file_says_it() -> None:
    found = closures.answer({"verdict": "closed", "effects": [{"name": "x", "enters": "joint"}]})
    assert (
        found.verdict
        == "The loop closes. The model lacked x (link joint); with that, how much is left is not known."
    )


def test_what_is_left_is_a_share_of_what_was() -> None:
    residual = {"before": {"total": 50.0}, "after": {"total": 2.0}}
    found = closures.answer({"verdict": "closed", "effects": [], "residual": residual})
    assert found.verdict == "The loop closes: 4.0 % of the residual's mean square is left, 2.00 times noise."


@pytest.mark.parametrize(
    ("p", "words"), [(0.4, "as small as noise."), (1e-5, "but more regular than noise.")]
)
def test_what_is_as_small_as_noise_is_not_called_noise_where_it_is_regular(p: float, words: str) -> None:
    residual = {"before": {"total": 50.0}, "after": {"total": 1.0, "whiteness_p": p}}
    found = closures.answer({"verdict": "closed", "effects": [], "residual": residual})
    assert found.verdict.startswith("The loop closes: what is left is as small as noise")
    assert found.verdict.endswith(words)


@pytest.mark.parametrize(
    ("found", "part", "good"),
    [
        (closure(friction()), "lacked coulomb-friction (link flexure_lo), or its look-alike;", True),
        (closure(skew()), "acceleration-skew (sensor acceleration_so)", True),
        (closure(verdict="no-effect"), "Nothing is missing that these records show", True),
        (closure(verdict="unexplained"), "Something is missing that no effect explains", False),
        (closure(unknown_force(), verdict="unexplained"), "a term outside the catalogue (link joint)", False),
    ],
    ids=["closed", "sensor", "no-effect", "unexplained", "free-form"],
)
def test_the_verdict_comes_first_in_plain_words(found: Closure, part: str, good: bool) -> None:
    answer = closures.answer(content(found))
    assert part in answer.verdict
    assert answer.good is good
    assert bool(answer.headlines) is bool(found.effects)


def test_a_look_alike_that_hold_out_records_exclude_is_no_alternative() -> None:
    found = friction()
    for costs, part in (((2.55, 3.2), ");"), ((1.0, 1.1), "), or one of 2 look-alikes;")):
        alike = tuple(
            replace(like, hold_out_cost=cost) for like, cost in zip(found.look_alikes, costs, strict=True)
        )
        text = closures.answer(content(closure(replace(found, look_alikes=alike)))).verdict
        assert f"lacked coulomb-friction (link flexure_lo{part}" in text
