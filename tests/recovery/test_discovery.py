"""Hidden tension laws recovered from raw records of the virtual rig that no fit was told about.

Campaigns have 20 preloads, hits of 100, 80 and 60 % of full strength where nothing else is said, nominal
noise, nominal scatter of gamma from test to test, records of 2.5 s, one preload in five held out. Plant,
sensors and soft hits are the same for every law of a seed: they are identified once, under the paper's law.
Forms are fitted with every number free; the form is told by races of a few with the four that are always
in them. The search among thousands is measured by ``python -m benchmarks.discovery``: docs/recovery.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.discovery import SURE, Setting, Trial, contenders, race_of_forms, score, specimen
from benchmarks.discovery_truth import curve_error, held_out_error, same_motion
from discovery.fitting import refine
from discovery.identifiability import exponent_profile
from discovery.terms import Candidate, baseline
from rom.identification import Identification

pytestmark = pytest.mark.slow

SEEDS = 10
NOMINAL = Setting(duration_s=2.5)
NEAR = ("velocity", "velocity-threshold", "dissipated-power")  # what could beat the paper's law by chance
APART = {  # what each hidden law must be told from, beside the four laws that are in every race
    "constant-quartic": ("velocity", "velocity-constant-gamma"),
    "constant-quadratic": ("velocity", "velocity-constant-gamma"),
    "displacement-2": ("velocity", "displacement"),
    "velocity-and-displacement": ("velocity", "displacement", "velocity-and-displacement"),
    "threshold": ("velocity", "velocity-threshold"),
}
POWERS = {"power-2": 2.0, "power-3": 3.0, "eq13": 4.0, "power-5": 5.0}
Found = TypeVar("Found")


def over_seeds(work: Callable[..., Found], *others: object) -> list[Found]:
    """What ``work(seed, *others)`` returns for every seed, one by one: tests run side by side."""
    return [work(seed, *others) for seed in range(SEEDS)]


@lru_cache(maxsize=1)
def plants() -> list[Identification]:
    """The plant of every seed as identified under the paper's law: it serves all laws of the seed."""
    return over_seeds(_plant)


def _plant(seed: int) -> Identification:
    return specimen("eq13", seed, NOMINAL).identified


def any_power() -> Candidate:
    """The paper's law, its exponent unknown: the fit starts from the same value whatever the truth."""
    return contenders()[0]


class Errors(NamedTuple):
    """An exponent, and the held-out loss error over that of the true law and of the paper's law."""

    exponent: float
    to_truth: float
    to_baseline: float


def _errors(seed: int, law: str, known: Sequence[Identification]) -> Errors:
    found = specimen(law, seed, NOMINAL, known[seed])
    fits = [refine(law, found.training) for law in (any_power(), found.truth.candidate, baseline())]
    own, true, paper = (held_out_error(one.candidate, found.hold_out) for one in fits)
    return Errors(fits[0].candidate.parameters["n"].value, own / true, own / paper)


@pytest.mark.parametrize("law", POWERS)
def test_the_exponent_of_the_velocity_and_no_worse_than_the_truth(law: str) -> None:
    """Ten seeds: within 0.3 in nine; held-out loss error at most 1.1 times that of the true law refitted.

    The median over seeds of the ratio; and below the error of the paper's law where that is not the truth.
    """
    found = over_seeds(_errors, law, plants())
    assert sum(abs(one.exponent - POWERS[law]) <= 0.3 for one in found) >= 9, found
    assert np.median([one.to_truth for one in found]) <= 1.1, found
    if law != "eq13":
        assert np.median([one.to_baseline for one in found]) < 1.0, found


def _trial(seed: int, law: str, forms: Sequence[str], known: Sequence[Identification]) -> Trial:
    found = specimen(law, seed, NOMINAL, known[seed])
    return score(race_of_forms(found, seed, forms, profiled=False), found.truth)


def test_nothing_is_called_better_than_the_paper_s_law_where_it_is_true() -> None:
    """Ten seeds, a race of three forms: p >= 0.01 for every law, and the first one is driven as the truth."""
    for trial in over_seeds(_trial, "eq13", NEAR, plants()):
        assert trial.smallest_p >= SURE, trial
        assert trial.motion, trial


@pytest.mark.parametrize("law", APART)
def test_the_form(law: str) -> None:
    """Ten seeds: in nine the true form is the first one, driven as the truth and nearer than the paper's law.

    A threshold at least among those named as not told from the first: a steep power does nearly as well, and
    where it is the first one its slopes over the velocity are its own.
    Constant gamma with the fourth power is a special case of the paper's law: nothing is called better.
    """
    trials = over_seeds(_trial, law, APART[law], plants())
    named = ("true", "listed") if law == "threshold" else ("true",)
    assert sum(trial.form in named for trial in trials) >= 9, trials
    assert law == "threshold" or sum(trial.motion for trial in trials) >= 9, trials
    assert np.median([trial.winner_error / trial.truth_error for trial in trials]) <= 1.1, trials
    if law == "constant-quartic":
        assert all(trial.smallest_p >= SURE for trial in trials), trials
        return
    assert np.median([trial.winner_error / trial.baseline_error for trial in trials]) < 1.0, trials


def test_the_curve_of_gamma() -> None:
    """Three seeds: within 15 % of Eq. 13 from 20 to 3000 N, at the median.

    Without scatter of gamma: with it, a factor of two from test to test, 60 records tell tens of percent.
    """
    still = Setting(scatter=0.0, duration_s=2.5)
    errors = []
    for seed in range(3):
        found = specimen("eq13", seed, still, plants()[seed])
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
    paper, own = plants()[0].model, specimen("power-3", 0, NOMINAL).identified.model
    names = [name for name in paper.parameters if "tension_rate" not in name]
    assert len(names) > 10
    for name in names:
        assert own.parameter(name).value == pytest.approx(paper.parameter(name).value, rel=1e-3), name


def test_another_law_s_truth_is_not_recovered() -> None:
    """The scores can fail: courses of one law judged by the truth of another."""
    found = specimen("power-2", 0, NOMINAL, plants()[0])
    other = specimen("eq13", 0, NOMINAL, plants()[0]).truth
    fitted = refine(any_power(), found.training).candidate
    assert abs(fitted.parameters["n"].value - POWERS["eq13"]) > 0.3
    assert not same_motion(fitted.law(), other, found.training)
    assert same_motion(fitted.law(), found.truth, found.training)
    assert curve_error(fitted, other) > 15.0
    wrong = refine(other.candidate, found.training).candidate
    assert held_out_error(wrong, found.hold_out) > 1.1 * held_out_error(fitted, found.hold_out)
