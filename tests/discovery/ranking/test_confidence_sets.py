from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.courses.fit import fit, refine
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.criteria.criteria import CRITERIA
from discovery.laws.candidate import BASELINE, Candidate, Term, baseline, constant_power, no_loosening
from discovery.laws.factors import displacement_power, tension_exponential, tension_power, velocity_power
from discovery.ranking.confidence_sets import (
    ExponentProfile,
    compare_laws,
    exponent_profile,
    motion_profile,
    not_told_apart,
)
from discovery.ranking.cross_validation import groups_of, limits
from discovery.ranking.model_limits import widened
from tests.discovery.synthetic import free_power, frozen, known_fit, measured, small, with_power

VALUES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)


@pytest.fixture(scope="module")
def profile() -> ExponentProfile:
    return exponent_profile(small(noise=0.5), values=VALUES)


def test_the_confidence_set_holds_the_truth_and_is_narrow(profile: ExponentProfile) -> None:
    assert profile.name == "n"
    assert profile.identifiable
    assert profile.fits
    assert profile.low < profile.best < profile.high
    assert profile.holds(4.0)
    assert profile.high - profile.low < 1.0
    assert "95 % limits" in profile.summary


def test_the_ends_are_where_the_likelihood_ratio_says(profile: ExponentProfile) -> None:
    for end in (profile.low, profile.high):
        rise = profile.deviance[np.argmin(np.abs(profile.values - end))]
        assert rise == pytest.approx(3.84 * profile.dispersion, abs=0.3)
    assert profile.deviance[np.argmin(np.abs(profile.values - profile.best))] == pytest.approx(0.0, abs=0.05)
    assert profile.delta_bic.min() == 0.0
    assert np.all(np.diff(profile.values) > 0)


def test_everything_else_is_refitted_at_every_value(profile: ExponentProfile) -> None:
    assert len(profile.candidates) == len(profile.values)
    for value, candidate in zip(profile.values, profile.candidates, strict=True):
        assert candidate.parameters["n"].value == value
    rates = {candidate.parameters["gamma_i"].value for candidate in profile.candidates}
    assert len(rates) == len(profile.candidates)


@pytest.mark.slow
def test_the_set_does_not_depend_on_the_values_or_processes(profile: ExponentProfile) -> None:
    other = exponent_profile(small(noise=0.5), values=(0.5, 3.6, 4.3, 7.0), jobs=2)
    assert other.low == pytest.approx(profile.low, abs=0.02)
    assert other.high == pytest.approx(profile.high, abs=0.02)


def with_uncertain_damping(whole: FrozenMotion) -> FrozenMotion:
    laws = whole.model.link_laws["joint"]
    damping = replace(
        laws.damping,
        parameters={
            name: replace(value, low=0.5 * value.value, high=1.5 * value.value) if name == "c_d" else value
            for name, value in laws.damping.parameters.items()
        },
    )
    model = replace(whole.model, link_laws={**whole.model.link_laws, "joint": replace(laws, damping=damping)})
    return replace(whole, model=model)


def test_an_uncertain_model_widens_the_set(profile: ExponentProfile) -> None:
    found = exponent_profile(with_uncertain_damping(small(noise=0.5)), values=VALUES)
    assert profile.of_model == 0.0
    assert found.of_model > 0.002
    assert found.high >= profile.high
    assert found.best == pytest.approx(profile.best, abs=0.01)


def test_an_uncertain_model_widens_the_limits_of_the_laws_numbers() -> None:
    whole = small(noise=0.5)
    found = known_fit(free_power(), whole)
    told = limits(found, whole, groups_of(whole), np.random.default_rng(0))
    numbers = found.candidate.parameters
    known = {name: replace(numbers[name], low=told[name][0], high=told[name][1]) for name in found.free}
    law: Any = SimpleNamespace(fit=found, parameters=known)
    same = widened(law, whole)
    assert [same[name].high for name in known] == pytest.approx([p.high for p in known.values()])
    wide = widened(law, with_uncertain_damping(whole))
    for name, p in known.items():
        assert wide[name].low < p.low < p.high < wide[name].high


def test_the_main_term_of_a_sum_is_profiled() -> None:
    minor = Term(velocity_power().held(n=2.0), tension_power())
    main = free_power().terms[0]
    law = Candidate("sum", (minor, main), (1e-2, free_power().coefficients[0]))
    found = exponent_profile(small(noise=0.5), law, values=VALUES)
    assert found.name == "n_2"
    assert found.holds(4.0)


def test_a_law_without_velocity_lends_its_tension_factor() -> None:
    law = Candidate("x", (Term(displacement_power(), tension_exponential()),), (1e12,))
    found = exponent_profile(small(noise=0.5), law, values=VALUES)
    assert found.name == "n"
    assert "T_s" in found.fitted.candidate.parameters
    assert "abs(v) ** n" in found.fitted.candidate.equation


def test_where_nothing_is_lost_nothing_is_identifiable() -> None:
    nothing = Candidate("nothing", with_power(4.0).terms, (1.0,))
    whole = freeze(rom.paper_model(), measured(nothing, preloads=(20.0, 100.0, 500.0)))
    found = exponent_profile(whole, values=VALUES)
    assert found.reach == "no loss above noise"
    assert not found.identifiable
    assert "no loss stands out" in found.summary
    assert found.holds(2.0)
    assert found.holds(8.0)


def test_one_case_with_much_noise_leaves_the_set_open() -> None:
    whole = freeze(rom.paper_model(), measured(preloads=(150.0,), strengths=(1.0,), noise=3.0, scatter=0.3))
    found = exponent_profile(whole, values=VALUES)
    assert not found.identifiable or found.high - found.low > 1.0
    assert found.holds(4.0)


def test_a_form_that_cannot_fit_says_so() -> None:
    whole = small()
    steps = replace(whole, change=whole.change + 5.0 * np.sin(np.arange(whole.change.shape[1])))
    found = exponent_profile(steps, values=VALUES)
    assert not found.fits
    assert found.dispersion > 2
    assert "no value fits" in found.summary


@pytest.mark.slow
def test_velocity_is_told_from_displacement() -> None:
    by_velocity = motion_profile(small(noise=0.3), values=(0.0, 1.0, 2.0, 3.0))
    assert by_velocity.driver == "velocity"
    assert by_velocity.displacement.holds(0.0)
    law = Candidate("x", (Term(displacement_power(), baseline().terms[0].tension),), (10**12.62,))
    by_displacement = motion_profile(
        freeze(rom.paper_model(), measured(law, preloads=(20.0, 60.0, 300.0), scatter=0.3, noise=0.3)),
        law,
        values=(0.0, 1.0, 2.0, 3.0),
    )
    assert by_displacement.driver in ("displacement", "both")
    assert not by_displacement.displacement.holds(0.0)
    assert by_displacement.displacement.holds(2.0)
    claimed = {"both": "both act"}.get(by_displacement.driver, "displacement drives")
    assert (by_displacement.tests, by_displacement.numbers, by_displacement.few) == (6, 5, True)
    assert "is open" in by_displacement.summary
    enough = replace(CRITERIA, ranking=replace(CRITERIA.ranking, tests_per_number=1.0))
    fitted = replace(by_displacement.velocity.fitted, criteria=enough)
    many = replace(by_displacement, velocity=replace(by_displacement.velocity, fitted=fitted))
    assert ("is open" if many.at_edge else claimed) in many.summary


def test_too_few_values_are_refused() -> None:
    with pytest.raises(ValueError, match="needs three values of n at least, got 2"):
        exponent_profile(frozen(), values=(2.0, 4.0))


def test_pairs_tell_what_the_courses_decide() -> None:
    whole = frozen()
    twin = replace(free_power(), name="twin")
    laws = (baseline(), free_power(), twin, constant_power(2.0, "quadratic"), no_loosening())
    fits = [refine(law, whole) for law in laws]
    pairs = compare_laws(fits, whole)
    assert len(pairs) == 10
    assert set(not_told_apart(pairs, BASELINE)) == {"free power", "twin"}
    assert not_told_apart(pairs, "no loosening") == ()
    for pair in pairs:
        assert pair.score_difference >= 0
        assert repr(pair.first) in pair.summary
        assert repr(pair.second) in pair.summary
        if {pair.first, pair.second} == {"free power", "twin"}:
            assert pair.separation == pytest.approx(0.0, abs=1e-2)
            assert "are not distinguished" in pair.summary


def test_scores_given_decide() -> None:
    """Cross-validated scores take the place of the fits' own."""
    whole = frozen()
    fits = [fit(baseline(), whole), fit(constant_power(2.0, "quadratic"), whole)]
    even = np.zeros(len(whole))
    (pair,) = compare_laws(fits, whole, {BASELINE: even, "quadratic": even})
    assert not pair.told_apart
    assert pair.separation > 10
    assert "the courses do not decide" in pair.summary
    (pair,) = compare_laws(
        fits, whole, {BASELINE: even, "quadratic": even + 1.0 + 0.1 * np.arange(len(whole))}
    )
    assert pair.first == "quadratic"
    assert pair.told_apart


def test_no_record_counts_for_more_than_its_bound_between_two_laws() -> None:
    """Two records strongly for a law hide no steady lead, and make up for none."""
    whole = frozen()
    fits = [fit(baseline(), whole), fit(constant_power(2.0, "quadratic"), whole)]
    even, steady = np.zeros(len(whole)), 0.7 + 0.1 * np.arange(len(whole)) / len(whole)
    lucky = np.where(np.isin(np.arange(len(whole)), (0, 3)), (90.0 + 0 * even), steady)
    (pair,) = compare_laws(fits, whole, {BASELINE: even, "quadratic": lucky})
    assert pair.score_difference == pytest.approx(np.minimum(lucky, 5.0).sum())
    assert pair.told_apart
    (pair,) = compare_laws(fits, whole, {BASELINE: even, "quadratic": np.where(lucky > 5, 90.0, -steady)})
    assert not pair.told_apart
