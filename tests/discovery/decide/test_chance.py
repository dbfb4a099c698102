"""Signs of records drawn anew: what a catalogue explains of a residual by chance."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.decide.acceptance import is_accepted
from discovery.decide.chance import (
    by_record,
    largest_by_chance,
    largest_of_noise,
    p_value,
)
from discovery.decide.explanation import Explanation
from discovery.explain.probes import Probe, by_chance
from rom.effects import CATALOGUE

RECORDS, ROWS, EFFECTS = 20, 50, 30


def _scores(rng: np.random.Generator, strength: float = 0.0, alike: float = 0.0) -> np.ndarray:
    """Scores of random effects, the first of which is in the residual, every record with a misfit too."""
    outputs = rng.standard_normal((EFFECTS, RECORDS * ROWS))
    owner = np.repeat(np.arange(RECORDS), ROWS)
    misfit = np.repeat(rng.standard_normal(RECORDS), ROWS) * outputs[1]
    residual = rng.standard_normal(RECORDS * ROWS) + strength * outputs[0] + alike * misfit
    return np.stack([by_record(output, residual, owner, RECORDS) for output in outputs])


def test_the_scores_of_records_add_up_to_what_an_effect_explains():
    rng = np.random.default_rng(0)
    output, residual = rng.standard_normal((2, 60))
    scores = by_record(output, residual, np.repeat(np.arange(3), 20), 3)
    assert scores.sum() ** 2 == pytest.approx((output @ residual) ** 2 / (output @ output))


def test_rows_of_ties_tell_of_no_record():
    rng = np.random.default_rng(0)
    output, residual = rng.standard_normal((2, 70))
    assert by_record(output, residual, np.repeat(np.arange(3), 20), 3).shape == (3,)


@pytest.mark.parametrize("alike", [0.0, 0.5], ids=["noise", "misfit of each record's own"])
def test_false_alarms_of_the_whole_catalogue_are_as_many_as_are_asked(alike):
    alarms = 0
    for seed in range(100):
        scores = _scores(np.random.default_rng(seed), alike=alike)
        best = float(np.max(scores.sum(axis=1) ** 2))
        alarms += p_value(best, largest_by_chance(scores)) <= CRITERIA.chance.false_alarms
    assert alarms <= 11  # binomial: more come with a chance below 1 %


def test_what_all_records_tell_alike_is_no_chance():
    scores = _scores(np.random.default_rng(1), strength=0.3)
    assert p_value(float(scores[0].sum() ** 2), largest_by_chance(scores)) == 0.001


def test_of_one_effect_noise_gives_a_chi_square_and_of_more_it_gives_more():
    shapes = np.random.default_rng(3).standard_normal((40, 200))
    every = [shape[None] for shape in shapes]
    one, all_of_them = largest_of_noise(every[:1], 2.0), largest_of_noise(every, 2.0)
    assert np.mean(one) == pytest.approx(2.0, rel=0.15)
    assert p_value(2.0 * 3.84, one) == pytest.approx(0.05, abs=0.02)
    assert np.median(all_of_them) > 4 * np.median(one)
    again = largest_of_noise(
        [*every, *(np.vstack([one, 5.0 * one]) for one in every), np.zeros((1, 200))], 2.0
    )
    assert again == pytest.approx(all_of_them)  # neither sizes nor copies nor nothing at all count


def test_numbers_that_move_residuals_apart_count_each():
    first, second = np.linalg.qr(np.random.default_rng(4).standard_normal((200, 2)))[0].T
    three = largest_of_noise([np.stack([first, 3.0 * second, first + 0.05 * second])], 1.0)
    assert np.mean(three) == pytest.approx(2.0, rel=0.1)
    assert p_value(5.99, three) == pytest.approx(0.05, abs=0.02)
    assert np.mean(largest_of_noise([np.stack([first, first + 0.05 * second])], 1.0)) == pytest.approx(
        1.0, rel=0.15
    )


def _probe(scores: np.ndarray) -> Probe:
    member = CATALOGUE["cubic-stiffness"]
    return Probe(member, member.at("joint"), float(scores.sum() ** 2), 1.0, 1.0, scores)


def test_the_signs_of_few_records_tell_nothing():
    few = np.ones(CRITERIA.chance.fewest_pieces - 1)
    assert by_chance([[_probe(few)]]) is None
    assert by_chance([[_probe(np.ones(CRITERIA.chance.fewest_pieces))]]) is not None
    assert by_chance([]) is None


@pytest.mark.parametrize(("chance", "sure"), [(None, True), (0.001, True), (0.2, False)])
def test_an_effect_that_chance_explains_is_not_sure(chance, sure):
    effect = CATALOGUE["cubic-stiffness"].at("joint")
    before, after = {"a": 2000.0, "b": 2000.0}, {"a": 1000.0, "b": 1000.0}
    one = Explanation(effect, before, after, {"a": 1000, "b": 1000}, frozenset("b"), 1, p_value=chance)
    assert is_accepted(one) is sure
