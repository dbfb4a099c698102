"""Hidden tension laws recovered from raw records of the virtual rig that no fit was told about.

Campaigns have 20 preloads, hits of 100 and 60 % of full strength where nothing else is said (with ``--every``
of 80 % too, as when the limits were set), nominal noise, nominal scatter of gamma from test to test, records
of 2.5 s, one preload in five held out. Plant, sensors and soft hits are the same for every law of a seed:
they are identified once (`plants`), under the paper's law with full hits alone. Forms are fitted with every
number free; the form is told by races of a few with the four that are always in them. The search among
thousands is measured by ``python -m benchmarks.discovery``: docs/recovery.md.

A law's campaign of a seed is one test, which processes of a run share out among them, and what was found
under all seeds is judged by the tests after it. ``--seeds`` says how many there are: three, or the ten that
the limits were set for. "Nine of ten" asks for every one of three. `test_simulated_courses` always has ten,
and every law; of those here some are variants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.discovery import contenders, race_of_forms
from benchmarks.discovery_scores import SURE, Trial, score
from benchmarks.discovery_specimens import PRELOADS, STRENGTHS, Setting, Specimen, specimen
from benchmarks.discovery_truth import LAWS, curve_error, held_out_error, same_motion, truth_of
from discovery.courses.fit import refine
from discovery.laws.candidate import Candidate, baseline
from discovery.ranking.confidence_sets import exponent_profile
from experiments.studies.rig import run as measure
from rom.campaign.campaign import read_campaign
from rom.identification.identify import Identification, identify_campaign
from tests.recovery.plants import plants
from tests.shared import Shared

pytestmark = pytest.mark.slow

ONE_STRENGTH = Setting(duration_s=2.5, strengths=(1.0,))
POWERS = {"power-2": 2.0, "power-3": 3.0, "eq13": 4.0, "power-5": 5.0}
APART = {  # what each hidden law must be told from, beside the four laws that are in every race
    "constant-quartic": ("velocity", "velocity-constant-gamma"),
    "constant-quadratic": ("velocity", "velocity-constant-gamma"),
    "displacement-2": ("velocity", "displacement"),
    "velocity-and-displacement": ("velocity", "displacement", "velocity-and-displacement"),
    "threshold": ("velocity", "velocity-threshold"),
    "threshold-30": ("velocity", "velocity-threshold"),
}
TEN = 10
NEAR = ("velocity", "velocity-threshold", "dissipated-power")  # what could beat the paper's law by chance
RACES = {"eq13": NEAR, **APART}
VARIANTS = (  # simulated courses have them all
    "displacement-2", "power-2", "power-3", "power-5", "constant-quadratic", "constant-quartic",
    "velocity-and-displacement", "threshold-30",
)  # fmt: skip


class Errors(NamedTuple):
    """An exponent, and held-out loss errors [%] of its law, the true law and the paper's, all refitted."""

    exponent: float
    own: float
    truth: float
    baseline: float


class Found(NamedTuple):
    """What the campaign of one law and seed gave: of power laws errors, where forms race their trial."""

    errors: Errors | None
    trial: Trial | None


def any_power() -> Candidate:
    """The paper's law, its exponent unknown: the fit starts from the same value whatever the truth."""
    return contenders()[0]


def measured(one: Specimen, law: str, seed: int) -> Found:
    """Fit and race whatever a law's tests judge."""
    errors = trial = None
    if law in POWERS:
        fits = [refine(law, one.training).candidate for law in (any_power(), one.truth.candidate, baseline())]
        errors = Errors(fits[0].parameters["n"].value, *(held_out_error(fit, one.hold_out) for fit in fits))
    if law in RACES:
        ranking = race_of_forms(one, seed, RACES[law], profiled=False)
        trial = score(ranking, one.truth, frozen=(one.training, one.hold_out))
    return Found(errors, trial)


def plant_of(shared: Shared, seed: int) -> Identification:
    """The plant of a seed, as a campaign under the paper's law tells it: one full hit a preload does."""
    return plants(shared, [seed])[0].identified


class Rig(NamedTuple):
    """What campaigns are made with, and where what was found is kept."""

    shared: Shared
    nominal: Setting


@pytest.fixture
def rig(shared: Shared, pytestconfig: pytest.Config) -> Rig:
    strengths = STRENGTHS if pytestconfig.getoption("every") else (1.0, 0.6)
    return Rig(shared, Setting(duration_s=2.5, strengths=strengths))


def of_law(rig: Rig, law: str, seed: int) -> Found:
    """What the campaign of a law and seed gave."""
    return measured(specimen(law, seed, rig.nominal, plant_of(rig.shared, seed)), law, seed)


def nine_in_ten(hits: Sequence[bool]) -> bool:
    """Whether at most one in ten fails: none of fewer than ten."""
    return len(hits) - sum(hits) <= len(hits) // 10


def over_seeds(rig: Rig, law: str, seeds: Sequence[int]) -> list[Found]:
    """What the campaigns of a law gave, each made once in a run."""
    return rig.shared.all({f"{law}, {seed}": partial(of_law, rig, law, seed) for seed in seeds})


def each(laws: Iterable[str]) -> pytest.MarkDecorator:
    """A test for each law; those between or beside others are variants."""
    return pytest.mark.parametrize(
        "law", [pytest.param(law, marks=[pytest.mark.variant] if law in VARIANTS else []) for law in laws]
    )


@each(dict.fromkeys([*RACES, *POWERS]))
def test_the_true_law_foretells_losses_on_every_seed(law: str, seed: int, rig: Rig) -> None:
    """Refitted, it errs by less than the whole loss, which is what a law without loosening errs by.

    Of soft hits below a threshold no loss is left to foretell: there it need only do better than the paper's.
    """
    (found,) = over_seeds(rig, law, [seed])
    errors = [part.truth if isinstance(part, Errors) else part.truth_error for part in found if part]
    assert errors
    limit = found.trial.baseline_error if law == "threshold-30" and found.trial else 100.0
    assert max(errors) < limit, found


@each(POWERS)
def test_the_exponent_of_the_velocity_and_no_worse_than_the_truth(
    law: str, seeds: Sequence[int], rig: Rig
) -> None:
    """Within 0.3 in nine seeds of ten; held-out loss error at most 1.1 times that of the true law refitted.

    The median over seeds of the ratio; and below the error of the paper's law where that is not the truth.
    """
    found = [one.errors for one in over_seeds(rig, law, seeds) if one.errors]
    assert len(found) == len(seeds)
    assert nine_in_ten([abs(one.exponent - POWERS[law]) <= 0.3 for one in found]), found
    assert np.median([one.own / one.truth for one in found]) <= 1.1, found
    if law != "eq13":
        assert np.median([one.own / one.baseline for one in found]) < 1.0, found


def trials_of(rig: Rig, law: str, seeds: Sequence[int]) -> list[Trial]:
    trials = [one.trial for one in over_seeds(rig, law, seeds) if one.trial]
    assert len(trials) == len(seeds)
    return trials


def test_nothing_is_called_better_than_the_paper_s_law_where_it_is_true(
    seeds: Sequence[int], rig: Rig
) -> None:
    """Every seed, a race of three forms: p >= 0.01 for all laws; the first one is driven as the truth."""
    for trial in trials_of(rig, "eq13", seeds):
        assert trial.smallest_p >= SURE, trial
        assert trial.motion, trial


@each(APART)
def test_the_form(law: str, seeds: Sequence[int], rig: Rig) -> None:
    """In nine seeds of ten the true form is the first, driven as the truth and nearer than the paper's law.

    Of hits whose velocities peak at 62 and 37 mm/s a threshold of 30 mm/s is told; one of 20 mm/s is at
    least among those named as not told from the first: a steep power does nearly as well. Slopes over the
    velocity, which a small step of a threshold changes by much, are not judged there, errors under ten seeds.
    Constant gamma with the fourth power is a special case of the paper's law: nothing is called better.
    """
    trials = trials_of(rig, law, seeds)
    named = ("true", "listed") if law == "threshold" else ("true",)
    assert nine_in_ten([trial.form in named for trial in trials]), trials
    assert law.startswith("threshold") or nine_in_ten([trial.motion for trial in trials]), trials
    if law == "constant-quartic":
        assert all(trial.smallest_p >= SURE for trial in trials), trials
    if law.startswith("threshold") and len(trials) < TEN:
        return  # so little is lost that errors are near the whole loss, and their ratios scatter
    assert np.median([trial.winner_error / trial.truth_error for trial in trials]) <= 1.1, trials
    if law != "constant-quartic":
        assert np.median([trial.winner_error / trial.baseline_error for trial in trials]) < 1.0, trials


def test_the_curve_of_gamma(seeds: Sequence[int], shared: Shared) -> None:
    """Within 15 % of Eq. 13 from 20 to 3000 N, in nine seeds of ten.

    Without scatter of gamma: with it, a factor of two from test to test, 40 records tell tens of percent.
    Then one hit a preload is enough.
    """
    still = Setting(scatter=0.0, duration_s=2.5, strengths=(1.0,))

    def of_seed(seed: int) -> float:
        found = specimen("eq13", seed, still, plant_of(shared, seed))
        return curve_error(refine(baseline(), found.training).candidate, found.truth)

    errors = list(shared.all({f"still, {seed}": partial(of_seed, seed) for seed in seeds}))
    assert nine_in_ten([error <= 15.0 for error in errors]), errors


class Limits(NamedTuple):
    """The 95 % set of an exponent, the truth, and if the set holds it."""

    low: float
    best: float
    high: float
    truth: float
    holds: bool


def limits_from_one_strength(shared: Shared, seeds: Sequence[int]) -> list[Limits]:
    """Profiles of the exponent from campaigns with a single hit a preload, truths 4 and 3 in turn."""

    def of_seed(seed: int) -> Limits:
        law = ("eq13", "power-3")[seed % 2]
        one = specimen(law, seed, ONE_STRENGTH, plant_of(shared, seed))
        profile = exponent_profile(one.training, any_power())
        truth = POWERS[law]
        return Limits(profile.low, profile.best, profile.high, truth, profile.holds(truth))

    return shared.all({f"one strength, {seed}": partial(of_seed, seed) for seed in seeds})


def test_hits_of_one_strength_limit_the_exponent(seed: int, shared: Shared) -> None:
    (found,) = limits_from_one_strength(shared, [seed])
    assert found.low < found.best < found.high, found
    assert found.high - found.low < 6.0, found


def test_hits_of_one_strength_tell_the_exponent_as_well_as_they_say(
    seeds: Sequence[int], shared: Shared, record_property: Callable[[str, object], None]
) -> None:
    """Truths 4 and 3 in turn: the 95 % set covers the truth in four seeds of five; widths are kept."""
    found = limits_from_one_strength(shared, seeds)
    record_property("widths of the 95 % sets", [round(one.high - one.low, 3) for one in found])
    assert sum(not one.holds for one in found) <= len(found) // 5, found


@pytest.mark.variant  # about these tests alone, whose laws share a plant
def test_the_plant_of_a_seed_is_found_alike_under_every_law(shared: Shared, tmp_path: Path) -> None:
    """What makes one identification do for all laws of a seed: a soft hit loosens next to nothing."""
    like_the_paper_s = {"duration_s": 3.0, "scatter": 0.0, "hold_out_every": 0}
    measure(tmp_path / "c", PRELOADS, 1.0, 0, 1, law="power-3", **like_the_paper_s)
    paper, own = plant_of(shared, 0).model, identify_campaign(read_campaign(tmp_path / "c")).model
    names = [name for name in paper.parameters if "tension_rate" not in name]
    assert len(names) > 10
    for name in names:
        assert own.parameter(name).value == pytest.approx(paper.parameter(name).value, rel=1e-3), name


@pytest.mark.variant
def test_another_law_s_truth_is_not_recovered(rig: Rig) -> None:
    """The scores can fail: courses of one law judged by the truth of another."""
    found, other = specimen("power-2", 0, rig.nominal, plant_of(rig.shared, 0)), truth_of(LAWS["eq13"])
    fitted = refine(any_power(), found.training).candidate
    assert abs(fitted.parameters["n"].value - POWERS["eq13"]) > 0.3
    assert not same_motion(fitted.law(), other, found.training)
    assert same_motion(fitted.law(), found.truth, found.training)
    assert curve_error(fitted, other) > 15.0
    wrong = refine(other.candidate, found.training).candidate
    assert held_out_error(wrong, found.hold_out) > 1.1 * held_out_error(fitted, found.hold_out)
