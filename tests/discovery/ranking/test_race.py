"""The race on simulated courses: the true law first, names, tables, equal laws merged, any number of jobs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discovery.courses.fit import fit, refine
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.criteria.criteria import CRITERIA
from discovery.laws.candidate import (
    BASELINE,
    CONSTANT_QUADRATIC,
    CONSTANT_QUARTIC,
    NO_LOOSENING,
    Candidate,
    Term,
    baseline,
    constant_power,
    rivals_always_in_the_race,
)
from discovery.laws.factors import (
    displacement_power,
    tension_exponential,
    tension_logistic,
    tension_power,
    velocity_power,
    velocity_threshold,
)
from discovery.laws.given import given_law
from discovery.laws.names import equation_name, names_of
from discovery.ranking import merging
from discovery.ranking.cross_validation import dispersion
from discovery.ranking.merging import at_bound, merged, same_equations, without_vanished
from discovery.ranking.race import RankedLaw, _corrected, _listed, _with_reduced, race
from discovery.ranking.result import Ranking
from discovery.views.ranking_file import ranking_section
from discovery.views.ranking_plot import ranked
from rom import paper_model
from rom.campaign.campaign import read_campaign
from rom.identification.identify import Identification
from rom.identification.reduce import reduce_records, tension_courses
from rom.model.laws import Parameter, free_form_law
from tests.discovery.synthetic import measured, with_power

FREE = Candidate("free", (Term(velocity_power(), tension_logistic()),), (1e11,), "hand")
THRESHOLD = Candidate("th", (Term(velocity_threshold(0.01, 0.06), tension_logistic()),), (1e11,), "hand")
BY_DISPLACEMENT = Candidate("x", (Term(displacement_power(), tension_power()),), (1e9,), "hand")


@pytest.fixture(scope="module")
def frozen() -> FrozenMotion:
    return freeze(paper_model(), measured(with_power(3.0), scatter=0.3, seed=5))


@pytest.fixture(scope="module")
def laws(frozen: FrozenMotion) -> tuple[RankedLaw, ...]:
    return race([FREE, BY_DISPLACEMENT], frozen)


def named(laws: tuple[RankedLaw, ...], name: str) -> RankedLaw:
    return next(law for law in laws if law.name == name)


def test_true_power_wins_and_its_limits_hold_the_truth(laws: tuple[RankedLaw, ...]) -> None:
    first = laws[0]
    exponent = first.parameters["n"]
    assert first.candidate.key == FREE.key
    assert exponent.low is not None
    assert exponent.high is not None
    assert exponent.low < 3.0 < exponent.high
    assert exponent.high - exponent.low < 1.0
    assert [law.rank for law in laws] == list(range(1, len(laws) + 1))


def test_rivals_are_always_listed(laws: tuple[RankedLaw, ...]) -> None:
    assert {rival.name for rival in rivals_always_in_the_race()} <= {law.name for law in laws}
    assert named(laws, NO_LOOSENING).free_numbers == 0
    assert len({law.name for law in laws}) == len(laws)


def test_scores_against_baseline(laws: tuple[RankedLaw, ...]) -> None:
    first, base = laws[0], named(laws, BASELINE)
    assert base.p_value_against_baseline is None
    assert base.wins_against_baseline == (0, 16)
    assert first.cross_validated_score > base.cross_validated_score + 5
    assert first.wins_against_baseline[0] > 8
    assert first.p_value_against_baseline is not None
    assert first.p_value_against_baseline < 0.2
    assert named(laws, NO_LOOSENING).p_value_against_baseline == 1.0
    assert first.delta_bic == 0.0
    assert base.delta_bic > 10
    assert named(laws, CONSTANT_QUADRATIC).delta_bic > 100
    assert sum(law.chosen for law in laws) == pytest.approx(1.0)


def test_errors_are_empty_without_a_campaign(laws: tuple[RankedLaw, ...]) -> None:
    assert laws[0].errors["hold_out"]["records"] == 0
    assert laws[0].errors["training"]["tension_loss_error_percent_median"] is None


def test_law_equal_to_a_simpler_one_is_its_look_alike(frozen: FrozenMotion) -> None:
    extra = Term(velocity_power().held(n=4.0), tension_logistic())
    tiny = Candidate("tiny", (FREE.terms[0], extra), (1e11, 1e-6), "hand")
    part = frozen.subset(range(4, 12))
    found = race([FREE, THRESHOLD, tiny], part, seed=1)
    everyone = [law.equation for law in found] + [text for law in found for text in law.look_alikes]
    assert {FREE.equation, THRESHOLD.equation, tiny.equation} <= set(everyone)
    for law in found:
        if THRESHOLD.equation in law.look_alikes:
            assert law.free_numbers <= 4


def own_law(name: str, rate: str, **numbers: Parameter) -> Candidate:
    return given_law(free_form_law(name, rate, "tension rate", numbers))


def test_a_law_given_under_another_name_than_its_standing_equation_is_one_row(frozen: FrozenMotion) -> None:
    """It keeps its name and numbers; the standing law takes no share of its probability."""
    part = frozen.subset(range(6, 12))
    quartic = own_law("power 4", "-c4 * v**4 * max(T, 0)", c4=Parameter(1.0, "s3/m4", bounds=(0.0, np.inf)))
    curve = own_law(
        "curve", "-c * v**4 * T * exp(-b / (1 + exp(r * T)))", c=Parameter(1.0, "s3/m4"),
        b=Parameter(1.0, "1", bounds=(-40.0, 90.0)), r=Parameter(-0.01, "1/N", bounds=(-0.1, -1e-5)),
    )  # fmt: skip
    alone, found = (race(laws, part, seed=1) for laws in ((), (quartic, curve)))
    same = {"power 4": CONSTANT_QUARTIC, "curve": BASELINE}
    assert {law.name: law.same_as for law in found if law.same_as} == {n: (s,) for n, s in same.items()}
    assert not {law.name for law in found} & {*same.values()}
    assert len(found) == len(alone) == 4
    for name, standing in same.items():
        row, before = named(found, name), named(alone, standing)
        assert row.rank == before.rank
        assert row.probability == pytest.approx(before.probability, abs=0.02)
        assert row.p_value_against_baseline == before.p_value_against_baseline
    ranking = Ranking(found, 2, paper_model(), {})
    assert ranking[BASELINE] is named(found, "curve")
    rows = ranking_section(ranking)["laws"]  # of the file: there every name of the race has a row
    repeated = {row["name"]: row["repeats"] for row in rows if "repeats" in row}
    assert repeated == {standing: name for name, standing in same.items()}
    assert [row["rank"] for row in rows] == list(range(1, 7))
    assert sum(row["probability"] for row in rows) == pytest.approx(1.0)
    assert len(ranked({"laws": rows})) == 4


def test_a_law_whose_range_keeps_it_from_fitting_as_the_standing_one_is_another_row(
    frozen: FrozenMotion,
) -> None:
    part = frozen.subset(range(6, 12))
    slow = own_law("slow", "-c4 * v**4 * max(T, 0)", c4=Parameter(1.0, "s3/m4", bounds=(0.0, 100.0)))
    found = race([slow], part)
    assert {"slow", CONSTANT_QUARTIC} <= {law.name for law in found}
    assert not any(law.same_as for law in found)


def test_laws_of_one_equation_are_one_row_beside_a_first_one_whose_range_forbids_it(
    frozen: FrozenMotion,
) -> None:
    part = frozen.subset(range(6, 12))
    slow, free = (
        own_law(name, "-c4 * v**4 * max(T, 0)", c4=Parameter(1.0, "s3/m4", bounds=(0.0, most)))
        for name, most in (("slow", 100.0), ("power 4", np.inf))
    )
    quartic = constant_power(4.0, CONSTANT_QUARTIC)
    same = same_equations([slow, free], [quartic], part)
    found = merged([refine(law, part) for law in (slow, free, quartic)], part, same)
    assert [one.names for one in found] == [("slow",), ("power 4", CONSTANT_QUARTIC)]


def test_equal_terms_are_one_law_without_a_fit(frozen: FrozenMotion, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever name the one fit of them has, the others are told beside it."""
    monkeypatch.setattr(merging, "same_law", lambda *_: False)  # as where its search fails
    one, other = (replace(baseline(), name=name, source="given") for name in ("one", "other"))
    same = same_equations([one, other], [baseline()], frozen)
    assert same == {"other": one, BASELINE: one}
    part = frozen.subset(range(6, 8))
    for law, *rest in (("one", "other", BASELINE), ("other", "one", BASELINE)):
        (found,) = merged([refine(replace(one, name=law), part)], part, same)
        assert found.names == (law, *rest)


def test_law_at_its_bound_is_no_look_alike_of_one_that_fits_far_better(frozen: FrozenMotion) -> None:
    better = replace(refine(FREE, frozen), deviance=100.0)
    low = THRESHOLD.with_values({"v_th": 0.0})
    worse = refine(low, frozen)
    assert at_bound(replace(worse, candidate=low))
    offsets = np.full_like(worse.offsets, -50.0)  # other courses
    for deviance, look_alike in ((399.0, False), (100.5, True)):
        rival = replace(worse, candidate=low, offsets=offsets, deviance=deviance)
        found = merged([better, rival], frozen)
        assert found[0].look_alikes == ((THRESHOLD.equation,) if look_alike else ())
        assert len(found) == (1 if look_alike else 2)


def test_a_term_that_a_fit_drove_to_nothing_is_dropped(frozen: FrozenMotion) -> None:
    """Such a sum was listed with both terms and with the price of all its numbers."""
    part = frozen.subset(range(4, 12))
    alone = refine(FREE, part)
    extra = Term(displacement_power().held(q=6.0), tension_power())
    gamma = alone.candidate.coefficients[0]
    numbers = {name: p.value for name, p in alone.candidate.parameters.items() if name != "gamma"}
    values = {f"{name}_1": value for name, value in numbers.items()}
    two = Candidate("two", (FREE.terms[0], extra), (gamma, 1e-290), "hand").with_values(values)
    found = replace(alone, candidate=two, free=two.free)
    reduced = without_vanished(found, part)
    assert reduced is not None
    assert (reduced.key, reduced.coefficients) == (FREE.key, (gamma,))
    assert without_vanished(replace(found, candidate=replace(two, coefficients=(gamma, 1e25))), part) is None
    one, other = _with_reduced([found], part)
    assert one is found
    assert other is not None
    (entrant,) = merged([replace(found, deviance=other.deviance + 100), other], part)
    assert entrant.fit is other
    assert entrant.look_alikes == (two.equation,)
    rounded = THRESHOLD.with_values({"v_th": 4.4e-16})
    assert at_bound(replace(found, candidate=rounded, free=rounded.free))


def test_a_quiet_gauge_does_not_send_the_true_law_to_the_losses() -> None:
    """The frozen motion is off by more than such noise: only behind the correction a law is judged."""
    quiet = freeze(paper_model(), measured(with_power(3.0), scatter=0.1, noise=0.005, seed=5))
    uncorrected = fit(FREE, quiet)
    assert dispersion(uncorrected, quiet) > quiet.criteria.ranking.misfit
    found = _corrected(uncorrected, quiet)
    assert not found.of_losses
    assert dispersion(found, quiet) < 1.5
    assert found.candidate.parameters["n"].value == pytest.approx(3.0, abs=0.01)


def test_a_fit_to_a_quiet_gauge_goes_on_to_the_likelihoods_maximum() -> None:
    """Deviations that do not follow the law's numbers make every step look bad: it ended 492 noises away."""
    quiet = freeze(paper_model(), measured(with_power(3.0), scatter=0.1, noise=0.01, seed=5))
    found = fit(FREE, quiet)
    assert dispersion(found, quiet) < 5
    assert found.candidate.parameters["n"].value == pytest.approx(3.0, abs=0.02)


def test_law_that_comes_first_in_one_resample_of_twenty_is_listed_whatever_its_rank(
    laws: tuple[RankedLaw, ...],
) -> None:
    many = tuple(
        replace(laws[0], rank=rank, name=f"law {rank}", source="hand", chosen=chosen)
        for rank, chosen in enumerate([0.9, *[0.0] * 12, 0.04, 0.06], 1)
    )
    assert [law.name for law in _listed(many, CRITERIA.ranking)] == [
        *(f"law {rank}" for rank in range(1, 11)),
        "law 15",
    ]


@pytest.mark.slow
def test_numbers_do_not_depend_on_jobs(frozen: FrozenMotion) -> None:
    part = frozen.subset(range(6, 12))
    one, two = (race([FREE], part, seed=2, jobs=jobs) for jobs in (1, 2))
    assert [law.name for law in one] == [law.name for law in two]
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.scores, b.scores)
        assert a.parameters == b.parameters
        assert a.p_value_against_baseline == b.p_value_against_baseline


def test_progress_rises_to_its_end(frozen: FrozenMotion) -> None:
    told: list[tuple[int, int]] = []
    race([], frozen.subset(range(6, 10)), progress=lambda done, total: told.append((done, total)))
    shares = [done / total for done, total in told]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_ranking_in_words_tables_and_as_a_model(laws: tuple[RankedLaw, ...], frozen: FrozenMotion) -> None:
    ranking = Ranking(laws, 321, paper_model(), {}, indistinguishable=(laws[1].name,))
    text = ranking.summary()
    assert laws[0].name in text
    assert "321 candidate laws" in text
    assert f"do not distinguish it from: {laws[1].name}" in text
    assert "others" not in text
    rare = replace(ranking, laws=tuple(replace(law, chosen=0.6 * (law.rank == 1)) for law in laws))
    assert f"drawn again: {laws[0].name} 60 %; others 40 %." in rare.summary()
    frame = ranking.to_frame()
    assert list(frame["name"]) == [law.name for law in laws]
    assert len(ranking.plot().axes[0].texts) == len(laws)
    assert "<table" in ranking._repr_html_()
    course = frozen.courses[-6]
    response = ranking.model.simulate({"lo": course.force}, course.rate_hz, course.initial)
    assert response.status == "ok"
    assert float(np.asarray(response.tension)[-1]) < course.initial
    assert ranking[BASELINE].name == BASELINE
    front = ranking.front
    assert front[0].name == NO_LOOSENING
    assert laws[0] in front
    assert [law.free_numbers for law in front] == sorted({law.free_numbers for law in front})
    with pytest.raises(KeyError, match="no law 'none'"):
        ranking["none"]


def test_terms_are_counted_by_form_whatever_their_numbers(laws: tuple[RankedLaw, ...]) -> None:
    quartic = Candidate("", (baseline().terms[0], Term(displacement_power(3.0), tension_power())), (1.0, 1.0))
    chosen = [(FREE, 0.5), (quartic, 0.3), (BY_DISPLACEMENT, 0.1), (THRESHOLD, 0.0)]
    made = tuple(replace(laws[0], candidate=law, chosen=share) for law, share in chosen)
    found = Ranking(made, 0, paper_model(), {}).chosen_terms
    assert list(found) == ["|v|^n T gamma(T)", "|x|^q T"]
    assert list(found.values()) == pytest.approx([0.8, 0.4])


def test_names_are_equations_and_each_its_own() -> None:
    fading = Term(velocity_power(2.0).held(n=2.0), tension_exponential(312.0))
    pair = Candidate("", (Term(velocity_power(3.98), tension_logistic()), fading), (1.0, 1.0))
    assert equation_name(pair) == "|v|^3.98 T gamma(T) + |v|^2 T exp(-T/312)"
    rising = Candidate("", (replace(fading, sign=1),), (1.0,))
    assert equation_name(rising) == "- |v|^2 T exp(-T/312)"
    at_zero = Candidate("", (Term(velocity_threshold(0.0, 0.05, 3.02), tension_logistic()),), (1.0,))
    assert equation_name(at_zero).startswith("max(|v| - 0, 0)^3.02 T")
    near = replace(pair, terms=(Term(velocity_power(3.9801), tension_logistic()), fading))
    names = names_of([baseline(), pair, near, pair])
    assert names[0] == BASELINE
    assert len(set(names)) == 4


@pytest.mark.slow
def test_listed_laws_are_judged_on_training_and_held_out_records(
    rig_campaign: Path, rig_identified: Identification
) -> None:
    campaign, found = read_campaign(rig_campaign), rig_identified
    model = replace(found.model, identification=None)
    frozen = freeze(model, found.courses)
    records = list(reduce_records(campaign, campaign.select("loosening", hold_out=True), 1))
    unseen = freeze(model, tension_courses(records, found.course_noise, campaign.settings))
    laws = race([FREE], frozen, unseen, campaign)
    base = named(laws, BASELINE)
    assert base.errors["training"]["records"] == len(frozen)
    assert base.errors["hold_out"]["records"] == len(unseen)
    loss = base.errors["training"]["tension_loss_error_percent_median"]
    floor = base.noise_floor["training"]["tension_loss_error_percent_median"]
    assert loss is not None
    assert floor is not None
    assert loss < 20
    assert floor == pytest.approx(1, abs=0.5)  # on this campaign noise is a per cent of a loss
    assert named(laws, NO_LOOSENING).errors["training"]["tension_loss_error_percent_median"] == (
        pytest.approx(100.0)
    )
