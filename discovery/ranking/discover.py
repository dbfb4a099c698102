"""From a campaign to a ranking of tension laws: identify, freeze, propose, race, and see what is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

from discovery.courses.fit import refine
from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.laws.candidate import Candidate, baseline, rivals_always_in_the_race
from discovery.laws.given import GivenLaw, check_finite, given_law, starts_of
from discovery.laws.plug_in_laws import plug_in_laws, usable
from discovery.ranking.confidence_sets import exponent_profile, motion_profile
from discovery.ranking.pairwise import compare_laws, not_told_apart
from discovery.ranking.population import population_of
from discovery.ranking.race import race, unit_of
from discovery.ranking.result import RankedLaw, Ranking
from discovery.ranking.specimens import Specimens, specimens
from discovery.search.selection import select
from discovery.search.shortlist import Proposals, propose
from discovery.separating_tests.impacts import propose_tests
from rom.campaign.campaign import Campaign
from rom.criteria.number import Numerical
from rom.jobs import processes
from rom.model.laws import Law
from rom.one_thread import one_threaded
from rom.progress import Progress
from rom.signals.measured_records import with_stored_records

Stages = Callable[[str], Progress | None]
Given: TypeAlias = str | Law | Candidate | RankedLaw
_NAMED: Numerical[int] = 5  # of columns left out


@one_threaded
@with_stored_records
def discover(
    campaign: Campaign | Sequence[Campaign],
    jobs: int | None = None,
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
    campaign : Campaign or sequence of Campaign
        As read by `rom.read_campaign`; nothing is fitted to held-out records. Several are of bolts of one
        kind: the law is shared, its rate differs from bolt to bolt (`ranking.population`), and whole bolts
        are left out in cross-validation.
    jobs : int
        Processes, on which the numbers do not depend; all cores if not given.
    progress : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    seed : int
        Seed of folds, ensembles and resampling.
    tightening : bool
        Whether records whose tension rose are fitted too, and laws may have a term of either sign.
    criteria : Criteria
        The numbers that decide.
    laws : sequence of str, Law, Candidate or RankedLaw
        Laws of one's own that run among the candidates (`discovery.laws.given.given_law`), beside those of
        installed packages.
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
        If the model has not one bolted link, several campaigns are not of one kind, fewer than four training
        records with a hit and a tension are left, a law of one's own cannot be one, or a library or an
        optimizer cannot be used.

    Examples
    --------
    >>> discovery.discover(campaign, libraries=[PolynomialLibrary(3)], optimizers=["STLSQ"])  # doctest: +SKIP
    """
    stage: Stages = progress or (lambda _: None)
    given, selection = _given(laws), select(libraries, optimizers)
    plugged = plug_in_laws(given)
    if max_terms is not None:
        criteria = criteria.changed(search={"largest_support": _at_least_one(max_terms)})
    jobs = processes(jobs)
    data = specimens(campaign, jobs, stage, tightening, criteria)
    check_given(given, data.frozen)
    plugged, notes = usable(plugged, data.frozen.nodes)
    first = refine(baseline(unit_of(data.frozen)), data.frozen)
    proposals = propose(data.frozen, first, seed, tightening, jobs, stage("proposing laws"), selection)
    return _ranking(data, (*given, *plugged), proposals, seed, jobs, stage, notes)


@one_threaded
@with_stored_records
def compare(
    campaign: Campaign | Sequence[Campaign],
    laws: Sequence[Given],
    jobs: int | None = None,
    progress: Stages | None = None,
    seed: int = 0,
    tightening: bool = False,
    criteria: Criteria = CRITERIA,
) -> Ranking:
    """Rank laws of one's own beside gamma(T), constant gamma with powers 2 and 4, and no loosening.

    They are fitted and judged as `discover` judges its own; laws of installed packages are with them
    (`discovery.laws.plug_in_laws`).

    Parameters
    ----------
    campaign, jobs, progress, seed, tightening, criteria
        As for `discover`.
    laws : sequence of str, Law, Candidate or RankedLaw
        An expression of dT/dt, a tension rate, a row of an earlier ranking, or what
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
    plugged = plug_in_laws(given)
    if not given and not plugged:
        raise ValueError("found no law to compare, expected one or more")
    jobs = processes(jobs)
    data = specimens(campaign, jobs, stage, tightening, criteria)
    check_given(given, data.frozen)
    plugged, notes = usable(plugged, data.frozen.nodes)
    return _ranking(data, (*given, *plugged), Proposals((), 0, {}, ()), seed, jobs, stage, notes)


def _at_least_one(terms: int) -> int:
    if isinstance(terms, bool) or not isinstance(terms, int) or terms < 1:
        raise ValueError(f"max_terms: found {terms!r}, expected 1 or more")
    return terms


def _given(laws: Sequence[Given]) -> tuple[Candidate, ...]:
    found = tuple(given_law(law.candidate if isinstance(law, RankedLaw) else law) for law in laws)
    standing = [law.name for law in rivals_always_in_the_race()]
    for law in found:
        if isinstance(law, GivenLaw) and law.name in standing:
            raise ValueError(f"law {law.name!r}: found the name of a standing law, expected another name")
    return found


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
    data: Specimens,
    given: Sequence[Candidate],
    proposals: Proposals,
    seed: int,
    jobs: int,
    stage: Stages,
    notes: Sequence[str] = (),
) -> Ranking:
    frozen, hold_out = data.frozen, data.hold_out
    starts = [start for law in given for start in starts_of(law)]
    laws = race(
        [*starts, *proposals.candidates], frozen, hold_out, data.campaigns, seed, jobs, stage("ranking laws")
    )
    set_aside, warnings = data.notes()
    ranking = Ranking(
        laws=laws,
        considered=proposals.considered + len(given),
        identified=data.bolts[0].found.model,
        inclusion=proposals.inclusion,
        courses=(*frozen.courses, *(hold_out.courses if hold_out else ())),
        population=population_of(laws[0].fit, data),
        scatter=laws[0].fit.between_tests,
        rules=frozen.criteria.ranking,
        signed=frozen.signed,
        set_aside=set_aside,
        warnings=(
            *warnings,
            *_left_out(proposals.dropped),
            *proposals.notes,
            *notes,
            *_not_fitted(given, laws),
        ),
    )
    return _with_what_is_open(ranking, frozen, jobs, stage)


def _not_fitted(given: Sequence[Candidate], laws: Sequence[RankedLaw]) -> tuple[str, ...]:
    """Say which laws of one's own could not be fitted, or no longer simulated."""
    there = {name for law in laws for name in (law.name, *law.same_as)}
    return tuple(
        f"law {law.name!r}: it could not be fitted to these records: no start led to a finite likelihood"
        for law in given
        if law.name not in there
    )


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
    names = [bolt.name for bolt in ranking.population.bolts] if ranking.population else []
    tests = propose_tests(fits[:3], frozen, bolts=names)
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
