"""From a campaign to a ranking of tension laws: identify, freeze, propose, race, and see what is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from discovery.courses.fit import refine
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.criteria.ranking import RankingRules
from discovery.laws.candidate import Candidate, baseline
from discovery.laws.given import GivenLaw, check_finite, given_law, starts_of
from discovery.ranking.confidence_sets import exponent_profile, motion_profile
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.race import race
from discovery.ranking.result import RankedLaw, Ranking
from discovery.search.selection import select
from discovery.search.shortlist import Proposals, propose
from discovery.separating_tests.hits import propose_tests
from rom.campaign.campaign import Campaign
from rom.criteria.number import Numerical
from rom.identification.identify import Identification, identify_campaign
from rom.identification.reduce import Progress, reduce_records, tension_courses
from rom.model.laws import Law
from rom.one_thread import one_threaded
from rom.signals.measured_records import judged_by, screened, with_something_left, with_stored_records
from rom.signals.quality import Doubt
from rom.signals.tension_bins import TensionCourse

Stages = Callable[[str], Progress | None]
Given: TypeAlias = str | Law | Candidate
_NAMED: Numerical[int] = 5  # of columns left out


@one_threaded
@with_stored_records
def discover(
    campaign: Campaign,
    jobs: int = 1,
    progress: Stages | None = None,
    seed: int = 0,
    tightening: bool = False,
    criteria: Criteria = CRITERIA,
    laws: Sequence[Given] = (),
    libraries: Sequence[str | object] | None = None,
    optimizers: Sequence[str | object] | None = None,
    max_terms: int | None = None,
) -> Ranking:
    """Rank the tension laws that the loosening records of a campaign support.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`; nothing is fitted to its held-out records.
    jobs : int
        Processes; the numbers do not depend on it.
    progress : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    seed : int
        Seed of folds, ensembles and resampling.
    tightening : bool
        Whether records whose tension rose are fitted too, and laws may have a term of either sign.
    criteria : Criteria
        The numbers that decide.
    laws : sequence of str, Law or Candidate
        Laws of one's own that run among the candidates (`discovery.laws.given.given_law`).
    libraries : sequence of str or object
        Names in `discovery.LIBRARIES`, or pysindy libraries over the inputs ``v, x, T, F, D``
        (`discovery.search.pysindy_libraries`); all of `discovery.LIBRARIES` if not given.
    optimizers : sequence of str or object
        Names in `discovery.OPTIMIZERS`, or objects with ``fit(theta, target)`` and then ``coef_``, such as
        pysindy's; they see columns and a target of length 1. All of `discovery.OPTIMIZERS`, and the best
        pairs of columns, if not given.
    max_terms : int
        Terms of a sum, at most; the criterion ``search.largest_support`` if not given.

    Returns
    -------
    Ranking
        Laws, the first one first; `model` is the identified model with the first law.

    Raises
    ------
    ValueError
        If the model has not one bolted link, fewer than four training records with a hit and a tension are
        left, a law of one's own cannot be one, or a library or an optimizer cannot be used.

    Examples
    --------
    >>> discovery.discover(campaign, libraries=[PolynomialLibrary(3)], optimizers=["STLSQ"])  # doctest: +SKIP
    """
    stage: Stages = progress or (lambda _: None)
    given, selection = _given(laws), select(libraries, optimizers)
    if max_terms is not None:
        criteria = criteria.changed(search={"largest_support": _at_least_one(max_terms)})
    data = _data(campaign, jobs, stage, tightening, criteria)
    check_given(given, data.frozen)
    first = refine(baseline(), data.frozen)
    proposals = propose(data.frozen, first, seed, tightening, jobs, stage("proposing laws"), selection)
    return _ranking(data, given, proposals, seed, jobs, stage)


@one_threaded
@with_stored_records
def compare(
    campaign: Campaign,
    laws: Sequence[Given],
    jobs: int = 1,
    progress: Stages | None = None,
    seed: int = 0,
    tightening: bool = False,
    criteria: Criteria = CRITERIA,
) -> Ranking:
    """Rank laws of one's own beside gamma(T), constant gamma with powers 2 and 4, and no loosening.

    They are fitted and judged as `discover` judges its own.

    Parameters
    ----------
    campaign, jobs, progress, seed, tightening, criteria
        As for `discover`.
    laws : sequence of str, Law or Candidate
        An expression of dT/dt, a tension rate, ``ranking.laws[0].candidate``, or what
        `discovery.laws.law_file.read_laws` returns.

    Returns
    -------
    Ranking
        As from `discover`.

    Raises
    ------
    ValueError
        As for `discover`, or if there is no law to compare.

    Examples
    --------
    >>> ranking = discovery.compare(campaign, ["-a * abs(D * v) * max(T, 0)"])  # doctest: +SKIP
    """
    stage: Stages = progress or (lambda _: None)
    given = _given(laws)
    if not given:
        raise ValueError("found no law to compare, expected one or more")
    data = _data(campaign, jobs, stage, tightening, criteria)
    check_given(given, data.frozen)
    return _ranking(data, given, Proposals((), 0, {}, ()), seed, jobs, stage)


@dataclass(frozen=True, eq=False)
class _Data:
    """What laws are fitted to and judged by."""

    campaign: Campaign
    found: Identification
    frozen: FrozenMotion
    hold_out: FrozenMotion | None
    doubts: tuple[Doubt, ...]
    rose: tuple[str, ...]


def _data(campaign: Campaign, jobs: int, stage: Stages, tightening: bool, criteria: Criteria) -> _Data:
    campaign = with_something_left(screened(judged_by(campaign, criteria.of_records), jobs))
    found = identify_campaign(campaign, jobs, stage("identifying"))
    unseen, doubts = _held_out(campaign, found, jobs, stage)
    rules = criteria.ranking
    kept, rose = _loosened(found.courses, tightening, rules)
    if len(kept) < rules.least_cases:
        raise ValueError(
            f"{campaign.path}: found {len(kept)} loosening records with a hit and a tension that may be "
            f"fitted, expected {rules.least_cases:g} or more to compare tension laws"
        )
    model = replace(found.model, identification=None)
    frozen = freeze(model, kept, signed=tightening, criteria=criteria)
    hold_out = freeze(model, unseen, signed=tightening, criteria=criteria) if unseen else None
    return _Data(campaign, found, frozen, hold_out, doubts, rose)


def _at_least_one(terms: int) -> int:
    if isinstance(terms, bool) or not isinstance(terms, int) or terms < 1:
        raise ValueError(f"max_terms: found {terms!r}, expected 1 or more")
    return terms


def _given(laws: Sequence[Given]) -> tuple[Candidate, ...]:
    return tuple(given_law(law) for law in laws)


def check_given(laws: Sequence[Candidate], frozen: FrozenMotion) -> None:
    """Refuse laws of one's own whose rate is not a number along the motion of these records.

    Raises
    ------
    ValueError
        With the place where it is not.
    """
    for law in laws:
        if isinstance(law, GivenLaw):
            check_finite(law, frozen.nodes)


def _ranking(
    data: _Data, given: Sequence[Candidate], proposals: Proposals, seed: int, jobs: int, stage: Stages
) -> Ranking:
    frozen, hold_out, found = data.frozen, data.hold_out, data.found
    starts = [start for law in given for start in starts_of(law)]
    laws = race(
        [*starts, *proposals.candidates], frozen, hold_out, data.campaign, seed, jobs, stage("ranking laws")
    )
    ranking = Ranking(
        laws=laws,
        considered=proposals.considered + len(given),
        identified=found.model,
        inclusion=proposals.inclusion,
        courses=(*frozen.courses, *(hold_out.courses if hold_out else ())),
        scatter=laws[0].fit.scatter,
        rules=frozen.criteria.ranking,
        set_aside=tuple(f"{doubt.file}: {doubt.message}" for doubt in (*found.set_aside, *data.doubts)),
        warnings=(
            *found.warnings,
            *(f"{file}: its tension rose; not fitted" for file in data.rose),
            *_left_out(proposals.dropped),
            *proposals.notes,
            *_not_fitted(given, laws),
        ),
    )
    return _with_what_is_open(ranking, frozen, jobs, stage)


def _not_fitted(given: Sequence[Candidate], laws: Sequence[RankedLaw]) -> tuple[str, ...]:
    """Say which laws of one's own could not be fitted, or no longer simulated."""
    there = {law.name for law in laws}
    return tuple(
        f"law {law.name!r}: it could not be fitted to these records: no start led to a finite likelihood"
        for law in given
        if law.name not in there
    )


def _held_out(
    campaign: Campaign, found: Identification, jobs: int, stage: Stages
) -> tuple[tuple[TensionCourse, ...], tuple[Doubt, ...]]:
    """Return the courses of the held-out loosening records, and why others of them are set aside."""
    records = campaign.select("loosening", hold_out=True)
    if not records:
        return (), ()
    reduced = list(reduce_records(campaign, records, jobs, stage("reading held-out records")))
    sound = [record for record in reduced if not record.doubts]
    doubts = tuple(doubt for record in reduced for doubt in record.doubts)
    return tension_courses(sound, found.course_noise, campaign.settings), doubts


def _loosened(
    courses: Sequence[TensionCourse], tightening: bool, rules: RankingRules
) -> tuple[tuple[TensionCourse, ...], tuple[str, ...]]:
    """Return the courses to fit, and the files of those that tightened beyond their noise."""
    rose = {
        course.file
        for course in courses
        if not tightening and course.change[-1] > rules.tightened * np.sqrt(course.covariance[-1, -1])
    }
    return tuple(c for c in courses if c.file not in rose), tuple(sorted(rose))


def _left_out(columns: Sequence[str]) -> tuple[str, ...]:
    """Say which columns the sparse fits could not take."""
    if not columns:
        return ()
    more = f" and {len(columns) - _NAMED} more" if len(columns) > _NAMED else ""
    named = "; ".join(columns[:_NAMED])
    return (f"sparse fits: left out columns that are zero or multiples of others: {named}{more}",)


def _with_what_is_open(ranking: Ranking, frozen: FrozenMotion, jobs: int, stage: Stages) -> Ranking:
    """Add the exponents' confidence sets, the laws not told apart, and the tests that would tell them."""
    report = stage("what is still open")
    winner = ranking.laws[0]
    if report is not None:
        report(0, 3)
    profile = exponent_profile(frozen, winner.candidate, jobs=jobs)
    if report is not None:
        report(1, 3)
    motion = motion_profile(frozen, winner.candidate, jobs=jobs)
    if report is not None:
        report(2, 3)
    rules = frozen.criteria.ranking
    compared = [
        law
        for law in ranking.laws
        if law.rank <= rules.compared or law.delta_bic < rules.compared_reach or law.source == "given"
    ]
    fits = [replace(law.fit, candidate=law.candidate) for law in compared]
    pairs = compare_laws(fits, frozen, {law.name: law.scores for law in compared})
    tests = propose_tests(fits[:3], frozen)
    if report is not None:
        report(3, 3)
    laws = tuple(replace(law, indistinguishable=not_told_apart(pairs, law.name)) for law in ranking.laws)
    return replace(
        ranking,
        laws=laws,
        profile=profile,
        motion_profile=motion,
        indistinguishable=laws[0].indistinguishable,
        proposals=tests,
    )
