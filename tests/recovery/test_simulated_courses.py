"""Hidden tension laws recovered from simulated courses of ten seeds: no sensors, no identification.

The plant is known; noise is that of the rig's gauge and gamma scatters from test to test, so what can go
wrong is the fit of the law and the choice among forms. Each seed has 12 preloads, or 20 under laws whose
courses tell little of them, hits of 100 and 60 % of full strength, one preload in five held out.
`test_discovery` has the whole chain from raw records.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.discovery import contenders
from benchmarks.discovery_specimens import HOLD_OUT_EVERY
from benchmarks.discovery_truth import LAWS, Truth, curve_error, form, held_out_error, same_motion, truth_of
from discovery.courses.fit import refine
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.laws.candidate import baseline, rivals_always_in_the_race
from rom.parameters.he_2025 import paper_model
from tests.discovery.synthetic import measured
from tests.recovery.test_discovery import APART, POWERS, nine_in_ten
from tests.shared import once_per_run

pytestmark = pytest.mark.slow

SEEDS = range(10)
STRENGTHS = (1.0, 0.6)
LENGTH_S = 0.25
PRELOADS = 12
MORE_PRELOADS = {"power-5": 20, "constant-quartic": 20, "threshold-30": 20}  # of 12: 9, 9, 7 seeds of ten
LONGER_S = {"power-5": 0.5, "threshold-30": 0.5}  # so little is lost under steep laws that means must be long
SCATTER = 0.25  # of ln gamma from test to test


class Courses(NamedTuple):
    """Motion and courses of training records and of those held out, and their law."""

    training: FrozenMotion
    hold_out: FrozenMotion
    truth: Truth


def courses(law: str, seed: int) -> Courses:
    """Courses under a hidden law."""
    truth, preloads = truth_of(LAWS[law]), np.geomspace(6.0, 3000.0, MORE_PRELOADS.get(law, PRELOADS))
    made = measured(
        truth.candidate, preloads=preloads, strengths=STRENGTHS, scatter=SCATTER, seed=seed,
        length_s=LONGER_S.get(law, LENGTH_S),
    )  # fmt: skip
    unseen = preloads[HOLD_OUT_EVERY // 2 :: HOLD_OUT_EVERY]
    parts = ([c for c in made if (c.preload in unseen) is held] for held in (False, True))
    return Courses(*(freeze(paper_model(), part) for part in parts), truth)


class Power(NamedTuple):
    """An exponent, held-out loss errors [%] of its law, the true one and the paper's, and what it explains.

    The last: -2 log likelihood of the paper's law less that of the law with a free exponent, both refitted.
    """

    exponent: float
    own: float
    truth: float
    baseline: float
    gain: float


@once_per_run
def power(law: str, seed: int) -> Power:
    training, hold_out, truth = courses(law, seed)
    own, true, paper = (refine(one, training) for one in (contenders()[0], truth.candidate, baseline()))
    errors = (held_out_error(fit.candidate, hold_out) for fit in (own, true, paper))
    return Power(own.candidate.parameters["n"].value, *errors, paper.deviance - own.deviance)


@pytest.mark.parametrize("law", POWERS)
def test_the_exponent_of_the_velocity_and_no_worse_than_the_truth(law: str) -> None:
    """Within 0.3 in nine seeds; median over seeds of the held-out error at most 1.1 times the true law's."""
    found = [power(law, seed) for seed in SEEDS]
    assert nine_in_ten([abs(one.exponent - POWERS[law]) <= 0.3 for one in found]), found
    assert np.median([one.own / one.truth for one in found]) <= 1.1, found
    if law != "eq13":
        assert np.median([one.own / one.baseline for one in found]) < 1.0, found


@pytest.mark.parametrize("law", POWERS)
def test_another_exponent_explains_more_only_where_it_is_true(law: str) -> None:
    """Likelihood ratio of the free exponent against the paper's law, significant at 1 in 1000."""
    significant = [bool(power(law, seed).gain > chi2.isf(1e-3, 1)) for seed in SEEDS]
    assert nine_in_ten([told is (law != "eq13") for told in significant]), law


@once_per_run
def best_form(law: str, seed: int) -> str:
    """Name of the contender of lowest Bayesian information criterion; "truth" where it has the true form."""
    training, _, truth = courses(law, seed)
    fits = [refine(one, training) for one in (*rivals_always_in_the_race(), *contenders(APART[law]))]
    price = np.log(len(training))
    best = min(fits, key=lambda fit: fit.deviance + price * len(fit.free)).candidate
    return "truth" if form(best) == form(truth.candidate) else best.name


@pytest.mark.parametrize("law", [law for law in APART if law != "threshold"])
def test_the_form(law: str) -> None:
    """The true one in nine seeds. A threshold of 20 mm/s, which a steep power imitates, is not among them."""
    found = [best_form(law, seed) for seed in SEEDS]
    assert nine_in_ten([name == "truth" for name in found]), found


def test_another_law_s_truth_is_not_recovered() -> None:
    """The scores can fail: courses of one law judged by the truth of another."""
    training, hold_out, truth = courses("power-2", 0)
    other, fitted = truth_of(LAWS["eq13"]), refine(contenders()[0], training).candidate
    assert abs(fitted.parameters["n"].value - POWERS["eq13"]) > 0.3
    assert same_motion(fitted.law(), truth, training)
    assert not same_motion(fitted.law(), other, training)
    assert curve_error(fitted, other) > 15.0
    wrong = refine(other.candidate, training).candidate
    assert held_out_error(wrong, hold_out) > 1.1 * held_out_error(fitted, hold_out)
