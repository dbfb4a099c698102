"""Several bolts under one law: what differs between them, and what a new bolt borrows from the others."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.courses.fit import Fit, predict
from discovery.courses.frozen_motion import FrozenMotion, freeze, freeze_bolts
from discovery.laws.candidate import BASELINE, NO_LOOSENING, Candidate
from discovery.laws.given import given_law
from discovery.ranking.cross_validation import folds_of, groups_of
from discovery.ranking.discover import discover
from discovery.ranking.population import bolt_of_courses, standard_deviations
from discovery.ranking.race import race
from discovery.ranking.result import RankedLaw, Ranking
from discovery.ranking.specimens import check_one_kind
from experiments.studies import rig
from rom.model.laws import Law
from rom.parameters.he_2025 import paper_model
from tests.discovery.bolts import bolts_of
from tests.discovery.synthetic import free_power, known_fit, measured, with_power

TRUE = with_power(4.0)
DEVIATIONS = (-0.6, 0.0, 0.2, 0.7)
FAR = (30.0, 300.0, 1000.0)  # preloads of tests to come


@pytest.fixture(scope="module")
def several() -> FrozenMotion:
    return freeze_bolts(bolts_of(TRUE, DEVIATIONS, scatter=0.2))


@pytest.fixture(scope="module")
def shared(several: FrozenMotion) -> Fit:
    return known_fit(free_power(), several)


def test_standard_deviations_come_with_limits(shared: Fit, several: FrozenMotion) -> None:
    between, within, tension = standard_deviations(shared, several)
    assert between.value == pytest.approx(shared.sigma, rel=0.05)
    assert between.low < np.std(DEVIATIONS, ddof=1) < between.high
    assert within.low < 0.2 < within.high
    assert between.high / between.low > within.high / within.low  # of four bolts, and of sixteen tests
    assert tension == pytest.approx(np.exp(np.mean(np.log(several.initial))))
    with pytest.raises(ValueError, match="one bolt"):
        standard_deviations(shared, freeze(paper_model(), bolts_of(TRUE, [0.0])[0][1]))


def test_a_bolt_without_hits_has_the_rate_of_the_population(shared: Fit) -> None:
    none = bolt_of_courses(shared, "ninth", paper_model(), ())
    assert (none.tests, none.deviation.value) == (0, 0.0)
    assert none.deviation.high == pytest.approx(1.96 * shared.sigma, rel=0.01)


def test_a_bolt_goes_from_the_population_to_its_own_rate_with_its_hits(shared: Fit) -> None:
    ((model, courses),) = bolts_of(TRUE, [0.7], scatter=0.0, seed=5)
    none, one, all_four = (bolt_of_courses(shared, "ninth", model, courses[:count]) for count in (0, 1, 4))
    true = TRUE.with_values({"gamma": TRUE.coefficients[0] * np.exp(0.7)}).law()
    off = [log_rate(bolt.law) - log_rate(true) for bolt in (none, one, all_four)]
    assert np.abs(off[2]) < 0.2
    assert np.abs(off[2]) < np.abs(off[0])
    assert 0.0 < one.deviation.value < all_four.deviation.value
    assert all_four.model.link_laws["joint"].tension_rate == all_four.law
    widths = [bolt.deviation.high - bolt.deviation.low for bolt in (none, one, all_four)]
    assert widths[0] > 2 * widths[1] > 2 * widths[2]
    known = all_four.model.rate_uncertainty
    assert known is not None
    assert known.between_bolts == pytest.approx(widths[2] / (2 * 1.96), rel=0.01)
    relative = [np.sqrt(known.covariance[0][0]) / all_four.law.parameters["gamma"].value]
    typical = np.sqrt(shared.rate_uncertainty.covariance[0][0]) / shared.candidate.coefficients[0]
    assert relative == pytest.approx([typical])
    assert log_rate(all_four.law) - log_rate(none.law) == pytest.approx(all_four.deviation.value)


def log_rate(law: Law) -> float:
    return float(np.log(-law.rate(150.0, 1e-5, 0.05, 0.0, 0.0)))


def test_a_law_of_ones_own_takes_the_rate_of_a_bolt(several: FrozenMotion) -> None:
    found = known_fit(given_law("-a * abs(D * v) * max(T, 0)"), several)
    ((model, courses),) = bolts_of(TRUE, [0.7], scatter=0.0, seed=5)
    bolt = bolt_of_courses(found, "ninth", model, courses)
    assert bolt.law.parameters["own_rate"].value == pytest.approx(np.exp(bolt.deviation.value))


def error_of(candidate: Candidate, deviation: float, unseen: FrozenMotion) -> float:
    """Median error of ln loss in the last bin."""
    loss = -predict(candidate, unseen, np.full(len(unseen), deviation))[:, -1]
    return float(np.median(np.abs(np.log(np.maximum(loss, 1e-9) / -unseen.change[:, -1]))))


@pytest.mark.slow
def test_three_hits_on_a_ninth_bolt_and_the_other_eight_say_more_than_three_hits() -> None:
    """Loss at other preloads: a fit to three hits alone knows little of how it goes with the preload."""
    borrowed, alone = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        deviations = np.log(1.6) * rng.standard_normal(9)
        bolts = bolts_of(TRUE, deviations[:8], preloads=(60.0, 150.0, 700.0), scatter=0.3, seed=seed)
        shared = known_fit(free_power(), freeze_bolts(bolts))
        rates = TRUE.with_values({"gamma": TRUE.coefficients[0] * np.exp(deviations[8])})
        hits = measured(
            rates, preloads=(60.0, 150.0, 700.0), strengths=(1.0,), scatter=0.3, seed=seed + 900, length_s=0.5
        )
        unseen = freeze(paper_model(), measured(rates, preloads=FAR, noise=0.01, length_s=0.5))
        bolt = bolt_of_courses(shared, "ninth", paper_model(), hits)
        borrowed.append(error_of(shared.candidate, bolt.deviation.value, unseen))
        own = known_fit(free_power(), freeze(paper_model(), hits))
        alone.append(error_of(own.candidate, 0.0, unseen))
    assert np.median(borrowed) < 0.5 * np.median(alone)


@pytest.mark.variant
def test_raw_records_of_three_bolts_tell_the_law_and_two_hits_a_fourth_ones_rate(tmp_path: Path) -> None:
    """Of the rig, |v|^3 T gamma(T) at rates of their own; nothing but the campaign folders is given."""
    rates = (0.5, 1.0, 2.0, 1.6)
    read = [
        rom.read_campaign(
            rig.run(
                tmp_path / f"bolt-{place}", 4 if place < 3 else 2, seed=4 + place, jobs=1, rate=rate,
                law="power-3", duration_s=2.5, hold_out_every=0,
            )
        )
        for place, rate in enumerate(rates)
    ]  # fmt: skip
    ranking = discover(read[:3], libraries=["velocity"], optimizers=["STLSQ"], max_terms=1)
    (true,) = (law for law in ranking.laws if re.fullmatch(r"\|v\|\^\S+ T gamma\(T\)", law.name))
    assert true.name in (ranking.laws[0].name, *ranking.indistinguishable)
    exponent = true.parameters["n"]
    assert exponent.low is not None
    assert exponent.high is not None
    assert exponent.low < 3.0 < exponent.high
    population = ranking.population
    assert population is not None
    assert population.between_bolts.low < np.std(np.log(rates[:3]), ddof=1) < population.between_bolts.high
    fourth = ranking.for_bolt(read[3], true.name)
    assert [bolt.tests for bolt in (*population.bolts, fourth)] == [4, 4, 4, 2]
    for bolt, rate in zip((*population.bolts, fourth), rates, strict=True):
        assert bolt.deviation.low < np.log(rate) < bolt.deviation.high


@pytest.fixture(scope="module")
def laws(several: FrozenMotion) -> tuple[RankedLaw, ...]:
    return race([free_power()], several, seed=1)


def test_whole_bolts_are_left_out(several: FrozenMotion) -> None:
    folds = folds_of(several, groups_of(several))
    assert [sorted(left) for _, left in folds] == [list(range(4 * k, 4 * k + 4)) for k in range(4)]


def test_the_race_of_several_bolts_leaves_no_law_credit_for_their_rates(laws: tuple[RankedLaw, ...]) -> None:
    by_name = {law.name: law for law in laws}
    assert laws[0].name in ("free power", BASELINE)
    assert by_name[NO_LOOSENING].rank == len(laws)
    assert sum(law.probability for law in laws) == pytest.approx(1.0)
    first = laws[0]
    known = first.known_bolt_loss_error_percent_median
    assert known is not None
    assert known < first.cross_validated_loss_error_percent_median
    assert known < 25  # between tests of a bolt: 0.2


def test_a_ranking_of_one_bolt_knows_no_other(laws: tuple[RankedLaw, ...]) -> None:
    campaign: Any = SimpleNamespace()
    with pytest.raises(ValueError, match="ranking of one bolt"):
        Ranking(laws, 1, paper_model(), {}).for_bolt(campaign)


def campaign(path: str, **changed: Any) -> Any:
    """What is compared of a campaign."""
    link = SimpleNamespace(name="joint", between=("lo", "so"), law="bolted")
    settings = {"body_names": ("lo", "so"), "link": (link,), "bolt": SimpleNamespace(link="joint")} | changed
    return SimpleNamespace(
        path=Path(path),
        digests={"a.h5": path},
        select=lambda *_: [SimpleNamespace(file="a.h5")],
        settings=SimpleNamespace(**settings),
    )


def test_campaigns_that_cannot_be_of_one_kind_are_refused() -> None:
    check_one_kind([campaign("a"), campaign("b")])
    with pytest.raises(ValueError, match=r"^b: found the bodies lo, expected those of a, lo, so: several"):
        check_one_kind([campaign("a"), campaign("b", body_names=("lo",))])
    other = SimpleNamespace(name="lap", between=("lo", "so"), law="bolted")
    with pytest.raises(ValueError, match=r"^b: found the links lap \(lo-so, bolted\), expected those of a"):
        check_one_kind([campaign("a"), campaign("b", link=(other,))])
    with pytest.raises(ValueError, match=r"^a: found loosening records of another campaign"):
        check_one_kind([campaign("a"), campaign("b"), campaign("a")])
    with pytest.raises(ValueError, match="tightening"):
        check_one_kind([campaign("a"), campaign("b")], tightening=True)
    with pytest.raises(ValueError, match="found no campaign"):
        check_one_kind([])
