"""The measures of the benchmark of probabilities, and a few of its races."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchmarks import law_probabilities
from benchmarks.law_probabilities import (
    Race,
    all_pairs,
    calibration_error,
    diagram,
    first_sets,
    raced,
    report,
)

LAWS = 10


def race(*probabilities: float, hidden: int) -> Race:
    return Race("hidden", 0, probabilities, hidden, probabilities[0], hidden == 0, -3.0, -2.0, -1.0)


def test_what_comes_true_as_often_as_it_is_likely_has_no_calibration_error() -> None:
    rng = np.random.default_rng(0)
    probability = rng.uniform(0, 1, 40000)
    right = (rng.uniform(0, 1, 40000) < probability).astype(float)
    assert calibration_error(probability, right) < 0.01
    assert calibration_error(probability**0.2, right) > 0.2
    assert calibration_error(np.full(10, 0.93), np.ones(10)) == pytest.approx(0.07)


def test_every_law_of_every_race_is_counted() -> None:
    races = [race(0.7, 0.3, hidden=0), race(0.6, 0.4, hidden=1), race(0.9, 0.1, hidden=-1)]
    probability, right = all_pairs(races)
    assert list(probability) == [0.7, 0.3, 0.6, 0.4, 0.9, 0.1]
    assert list(right) == [1, 0, 0, 1, 0, 0]
    text = report(races)
    assert "3 races; the hidden form is not listed in 1" in text
    assert "| the first law as fitted | 100 % | +2.00 |" in text


def test_a_race_that_is_there_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run: list[int] = []

    def once(number: int) -> Race:
        run.append(number)
        return race(0.7, 0.3, hidden=0)

    monkeypatch.setattr(law_probabilities, "run", once)
    first, again = raced(3, tmp_path), raced(3, tmp_path)
    assert asdict(first) == asdict(again)
    assert run == [3]
    diagram([first], tmp_path / "diagram.svg")
    assert (tmp_path / "diagram.svg").stat().st_size > 1000


@pytest.mark.variant
def test_probabilities_of_ten_races_one_of_each_law_are_what_they_say() -> None:
    races = [law_probabilities.run(number) for number in range(LAWS)]
    probability, right = all_pairs(races)
    for found in races:
        assert sum(found.probabilities) == pytest.approx(1.0)
    # of ten calibrated races the error is below in 99 of 100 by binomial chance
    rng = np.random.default_rng(0)
    chance = [
        calibration_error(probability, (rng.uniform(size=len(right)) < probability).astype(float))
        for _ in range(1000)
    ]
    assert calibration_error(probability, right) < np.quantile(chance, 0.99)
    assert first_sets(races)[1].mean() >= 0.9
