"""Hidden tension laws recovered from raw records of the virtual rig that no fit was told about.

Campaigns have 20 preloads, hits of 100, 80 and 60 % of full strength where nothing else is said, nominal
noise, nominal scatter of gamma from test to test, records of 2.5 s, one preload in five held out. Plant,
sensors and soft hits are the same for every law of a seed: they are identified once, under the paper's law.
Forms are fitted with every number free; the form is told by races of a few with the four that are always
in them. The search among thousands is measured by ``python -m benchmarks.discovery``: docs/recovery.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.discovery import SURE, Setting, Specimen, contenders, race_of_forms, score, specimen
from benchmarks.discovery_truth import curve_error, held_out_error, same_motion
from discovery.fitting import refine
from discovery.identifiability import exponent_profile
from discovery.terms import BASELINE, Candidate, baseline

pytestmark = pytest.mark.slow

SEEDS = 10
NOMINAL = Setting(duration_s=2.5)
NEAR = ("velocity", "velocity-threshold", "dissipated-power")  # what could beat the paper's law by chance
APART = (
    "velocity",
    "velocity-constant-gamma",
    "displacement",
    "velocity-threshold",
    "velocity-and-displacement",
)
POWERS = {"power-2": 2.0, "power-3": 3.0, "eq13": 4.0, "power-5": 5.0}


@lru_cache(maxsize=SEEDS)
def of_the_paper(seed: int) -> Specimen:
    """A campaign whose bolt follows Eqs. 12-13; its identification serves all laws of the seed."""
    return specimen("eq13", seed, NOMINAL)


def campaign(law: str, seed: int) -> Specimen:
    """A campaign whose bolt follows a law."""
    paper = of_the_paper(seed)
    return paper if law == "eq13" else specimen(law, seed, NOMINAL, paper.identified)


def any_power() -> Candidate:
    """The paper's law, its exponent unknown: the fit starts from the same value whatever the truth."""
    return contenders()[0]


@pytest.mark.parametrize("law", POWERS)
def test_the_exponent_of_the_velocity_and_no_worse_than_the_truth(law: str) -> None:
    """Ten seeds: within 0.3 in nine; held-out loss error at most 1.1 times that of the true law refitted.

    The median over seeds of the ratio; and below the error of the paper's law where that is not the truth.
    """
    exponents, to_truth, to_baseline = [], [], []
    for seed in range(SEEDS):
        found = campaign(law, seed)
        fitted = refine(any_power(), found.training).candidate
        exponents.append(fitted.parameters["n"].value)
        errors = [
            held_out_error(candidate, found.hold_out)
            for candidate in (
                fitted,
                refine(found.truth.candidate, found.training).candidate,
                refine(baseline(), found.training).candidate,
            )
        ]
        to_truth.append(errors[0] / errors[1])
        to_baseline.append(errors[0] / errors[2])
    off = np.abs(np.array(exponents) - POWERS[law])
    assert np.sum(off <= 0.3) >= 9, exponents
    assert np.median(to_truth) <= 1.1, to_truth
    if law != "eq13":
        assert np.median(to_baseline) < 1.0, to_baseline


def test_nothing_is_called_better_than_the_paper_s_law_where_it_is_true() -> None:
    """Ten seeds, a race of three forms: p >= 0.01 for every law, and the first one is driven as the truth."""
    for seed in range(SEEDS):
        found = campaign("eq13", seed)
        laws = race_of_forms(found, seed, NEAR).laws
        chances = {law.name: law.p_value_against_baseline for law in laws if law.name != BASELINE}
        assert all(p is not None and p >= SURE for p in chances.values()), (seed, chances)
        assert same_motion(laws[0].candidate.law(), found.truth, found.training), (seed, laws[0].name)


@pytest.mark.parametrize(
    "law",
    ["constant-quartic", "constant-quadratic", "displacement-2", "velocity-and-displacement", "threshold"],
)
def test_the_form(law: str) -> None:
    """One seed, a race of five forms: the first is driven as the truth is and nearer than the paper's law.

    The true form is the first one; a threshold at least among those named as not told from the first, for a
    steep power does nearly as well. Constant gamma is a special case of the paper's law: not nearer.
    """
    found = campaign(law, 0)
    trial = score(race_of_forms(found, 0, APART), found.truth)
    assert trial.motion, trial
    assert trial.form == "true" or (law == "threshold" and trial.form == "listed"), trial
    if law == "constant-quartic":
        assert trial.smallest_p >= SURE, trial
        return
    assert trial.winner_error < trial.baseline_error, trial
    assert trial.smallest_p < (0.05 if law == "threshold" else SURE), trial


def test_the_curve_of_gamma() -> None:
    """Three seeds: within 15 % of Eq. 13 from 20 to 3000 N, at the median.

    Without scatter of gamma: with it, a factor of two from test to test, 60 records tell tens of percent.
    """
    still = Setting(scatter=0.0, duration_s=2.5)
    errors = []
    for seed in range(3):
        found = specimen("eq13", seed, still, of_the_paper(seed).identified)
        errors.append(curve_error(refine(baseline(), found.training).candidate, found.truth))
    assert np.median(errors) <= 15.0, errors


def test_hits_of_one_strength_tell_the_exponent_as_well_as_they_say(
    record_property: Callable[[str, object], None],
) -> None:
    """Five seeds, truths 3 and 4 in turn: the 95 % set covers the truth in four at least; widths are kept."""
    single = Setting(duration_s=2.5, strengths=(1.0,))
    covered, widths = [], []
    for seed in range(5):
        law = ("eq13", "power-3")[seed % 2]
        found = specimen(law, seed, single)
        profile = exponent_profile(found.training, any_power())
        covered.append(profile.holds(POWERS[law]))
        widths.append(round(profile.high - profile.low, 3))
    record_property("widths of the 95 % sets", widths)
    assert sum(covered) >= 4, (covered, widths)
    assert max(widths) < 6.0


def test_the_plant_of_a_seed_is_found_alike_under_every_law() -> None:
    """What makes one identification do for all laws of a seed: a soft hit loosens next to nothing."""
    paper, own = of_the_paper(0).identified.model, specimen("power-3", 0, NOMINAL).identified.model
    names = [name for name in paper.parameters if "tension_rate" not in name]
    assert len(names) > 10
    for name in names:
        assert own.parameter(name).value == pytest.approx(paper.parameter(name).value, rel=1e-3), name


def test_another_law_s_truth_is_not_recovered() -> None:
    """The scores can fail: courses of one law judged by the truth of another."""
    found = specimen("power-2", 0, NOMINAL)
    other = campaign("eq13", 0).truth
    fitted = refine(any_power(), found.training).candidate
    assert abs(fitted.parameters["n"].value - POWERS["eq13"]) > 0.3
    assert not same_motion(fitted.law(), other, found.training)
    assert same_motion(fitted.law(), found.truth, found.training)
    assert curve_error(fitted, other) > 15.0
    wrong = refine(other.candidate, found.training).candidate
    assert held_out_error(wrong, found.hold_out) > 1.1 * held_out_error(fitted, found.hold_out)
