from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import rom
from discovery.courses.fit import fit
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.laws.candidate import Candidate, Term, baseline
from discovery.laws.factors import displacement_power, tension_logistic, velocity_power
from discovery.laws.names import term_form
from discovery.search.shortlist import Proposals, propose
from tests.discovery.small_searches import FEWER
from tests.discovery.synthetic import frozen, measured

PRELOADS = (8.0, 20.0, 60.0, 150.0, 300.0, 900.0)
SHAPE = tension_logistic(7.974, -0.00362)


def _proposed(whole: FrozenMotion, seed: int = 0, *, tightening: bool = False) -> Proposals:
    return propose(whole, fit(baseline(), whole), seed, tightening)


def _place(proposals: Proposals, *motions: str) -> int:
    """Place of the first law of these motions with the logistic exponent, from 0."""
    forms = [
        sorted(term.motion.text for term in law.terms if "10 **" in term.tension.text)
        for law in proposals.candidates
    ]
    return forms.index(sorted(motions))


@pytest.fixture(scope="module")
def few() -> FrozenMotion:
    return frozen(3.0).subset(range(0, len(frozen(3.0)), 3))


@pytest.fixture(scope="module")
def proposals(few: FrozenMotion) -> Proposals:
    return _proposed(few)


def test_the_true_form_comes_first(proposals: Proposals) -> None:
    first = proposals.candidates[0]
    assert _place(proposals, "abs(v) ** n") == 0
    assert first.parameters["n"].value == pytest.approx(3.0)
    assert first.source == "pysindy:grid/single term"


def test_more_than_two_thousand_laws_are_considered_and_few_go_on(proposals: Proposals) -> None:
    assert proposals.considered > 2000
    assert 20 <= len(proposals.candidates) <= 60
    assert list(proposals.scores) == sorted(proposals.scores)


def test_no_form_comes_twice_and_all_are_laws(proposals: Proposals) -> None:
    keys = [law.key for law in proposals.candidates]
    assert len(set(keys)) == len(keys)
    for law in proposals.candidates[::7]:
        rate = law.law().rate(100.0, 3e-5, 0.04, 40.0, 20.0)
        assert np.isfinite(rate)
        assert rate < 0
        assert all(part.startswith("pysindy:") for part in law.source.split("; "))


def test_inclusion_is_a_share(proposals: Proposals) -> None:
    assert all(0 < share <= 1 + 1e-9 for share in proposals.inclusion.values())
    forms = {term_form(term) for law in proposals.candidates for term in law.terms}
    assert next(iter(proposals.inclusion)) in forms
    assert not any(re.search(r"[1-9]", form) for form in proposals.inclusion)
    # two terms of different form a draw at most
    assert sum(proposals.inclusion.values()) <= 2 + 1e-9


def test_coefficients_start_near_the_fit(proposals: Proposals, few: FrozenMotion) -> None:
    first = proposals.candidates[0]
    found = fit(first, few).candidate
    shift = np.log(found.coefficients[0] / first.coefficients[0])
    assert found.parameters["n"].value == pytest.approx(3.0, abs=0.1)
    assert abs(shift) < 3.0


@pytest.mark.slow
def test_a_sum_of_two_terms_is_proposed_where_it_is_the_truth() -> None:
    law = Candidate(
        "sum",
        (Term(velocity_power().held(n=4.0), SHAPE), Term(displacement_power().held(q=2.0), SHAPE)),
        (10**11.49, 10**12.32),
    )
    whole = freeze(
        rom.paper_model(), measured(law, preloads=PRELOADS, strengths=(1.0, 0.8, 0.6), scatter=0.2)
    )
    found = _proposed(whole)
    assert _place(found, "abs(v) ** n", "abs(x) ** q") < 20
    assert len(found.candidates[0].terms) > 1


def test_one_seed_gives_the_same_numbers_and_progress_runs_to_its_end(
    proposals: Proposals, few: FrozenMotion
) -> None:
    told: list[tuple[int, int]] = []
    again = propose(few, fit(baseline(), few), 0, progress=lambda done, total: told.append((done, total)))
    assert again.scores == proposals.scores
    assert again.candidates == proposals.candidates
    assert again.inclusion == proposals.inclusion
    assert told == [(step, 4) for step in range(5)]


def test_tightening_allows_terms_of_the_other_sign(few: FrozenMotion) -> None:
    found = _proposed(replace(few, criteria=FEWER), tightening=True)
    assert any(term.sign == 1 for law in found.candidates for term in law.terms)
    assert all(c > 0 for law in found.candidates for c in law.coefficients)
