"""A law shared by several bolts of one kind: how its rate differs between them, and what it is of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.courses.between_bolts import Index, Variances
from discovery.courses.fit import Fit, at_fit, correction, deviation_of_bolt
from discovery.courses.frozen_motion import FrozenMotion, freeze_bolts
from discovery.courses.marginal_likelihood import Problem, State
from discovery.laws.given import GivenLaw
from discovery.ranking.specimens import Specimens, names_of_bolts, specimen
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.laws import Law
from rom.model.model import Model
from rom.signals.measured_records import with_stored_records
from rom.signals.tension_bins import TensionCourse

_CORRECTIONS: Numerical[int] = 2  # of a new bolt's courses by full re-simulation


@dataclass(frozen=True)
class Limited:
    """A number with its 95 % limits; `high` is infinite where the records do not bound it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Bolt:
    """One bolt of a population.

    Attributes
    ----------
    name : str
        Of its campaign, or of the folder where two campaigns have one name.
    tests : int
        Loosening tests that tell its deviation.
    deviation : Limited
        Natural logarithm of its rate over that of the law, given its tests and the population.
    law : Law
        The law at its rate.
    model : Model
        Its own identified model with that law: it simulates, and saves itself as ``model.json``.
    """

    name: str
    tests: int
    deviation: Limited
    law: Law
    model: Model


@dataclass(frozen=True, eq=False)
class Population:
    """Bolts of one kind under one law.

    Attributes
    ----------
    between_bolts, between_tests : Limited
        Standard deviations of the natural logarithm of the rate: from bolt to bolt, and from test to test of
        a bolt at `tension`. Limits are by profile of the restricted likelihood, the scatter's other numbers
        fitted again at every value: with 8 bolts a chi2 of one degree of freedom is near enough.
    tension : float
        Geometric mean of the tensions before the hits [N].
    bolts : tuple of Bolt
        In the order of the campaigns.
    of_course : tuple of int
        Bolt of each of the ranking's `courses`.
    """

    between_bolts: Limited
    between_tests: Limited
    tension: float
    bolts: tuple[Bolt, ...]
    of_course: tuple[int, ...]


def population_of(found: Fit, data: Specimens) -> Population | None:
    """Return what a fitted law says of the bolts that it was fitted to; None of one bolt."""
    frozen = data.frozen
    if frozen.bolts is None:
        return None
    between, within, tension = standard_deviations(found, frozen)
    _, state = at_fit(found, frozen)
    bolts, names = [], names_of_bolts([one.campaign for one in data.bolts])
    for place, one in enumerate(data.bolts):
        cases = np.flatnonzero(frozen.bolt == place)
        deviation = _deviation(found, state, frozen.initial, cases)
        bolts.append(_bolt(names[place], len(cases), deviation, found, one.found.model))
    held_out = () if data.hold_out is None or data.hold_out.bolt is None else data.hold_out.bolt.tolist()
    of_course = (*np.asarray(frozen.bolt).tolist(), *held_out)
    return Population(between, within, tension, tuple(bolts), of_course)


def standard_deviations(found: Fit, frozen: FrozenMotion) -> tuple[Limited, Limited, float]:
    """Between bolts, between tests, and the tension [N] at which the second holds.

    Raises
    ------
    ValueError
        If the tests are of one bolt.
    """
    if frozen.bolts is None:
        raise ValueError("found the tests of one bolt, expected those of several")
    _, state = at_fit(found, frozen)
    information = (state.slope**2).sum(axis=1)
    seen = (state.slope * state.residual).sum(axis=1) + information * state.u
    tension = float(np.exp(np.mean(np.log(np.maximum(frozen.initial, 1e-3)))))
    scaled = frozen.initial * 100.0 / tension  # so that the first number is ln tau there
    variances = Variances(frozen.bolts, information, seen, scaled, frozen.criteria.courses)
    a, b, of_bolts = found.scatter
    start = np.array([a + b * np.log(tension / 100.0), b, of_bolts])
    level = frozen.criteria.chance.normal_quantile**2
    best = variances.best(start)
    between, within = (
        Limited(float(np.exp(best[place])), *variances.limits(best, place, level)) for place in (2, 0)
    )
    return between, within, tension


def _deviation(found: Fit, state: State, initial: FloatArray, cases: Index) -> Limited:
    """Deviation of the bolt that some tests are of: its prior from the population, and what they say."""
    value, error = deviation_of_bolt(found, state, initial, cases)
    half = found.criteria.chance.normal_quantile * error
    return Limited(value, value - half, value + half)


def _bolt(name: str, tests: int, deviation: Limited, found: Fit, model: Model) -> Bolt:
    law, factor = found.candidate.law(), np.exp([deviation.value])
    values = {key: float(v[0]) for key, v in found.candidate.rated(factor).items()}
    own, same = law.with_values(**values), found.candidate
    if not isinstance(same, GivenLaw):  # whose rate has a number of its own, beside those fitted
        same = same.with_values(values)
    error = (deviation.high - deviation.low) / (2 * found.criteria.chance.normal_quantile)
    known = replace(replace(found, candidate=same).rate_uncertainty, between_bolts=error)
    return Bolt(name, tests, deviation, own, replace(model.with_tension_law(own), rate_uncertainty=known))


@with_stored_records
def new_bolt(campaign: Campaign, found: Fit, kind: Model, jobs: int = 1) -> Bolt:
    """Return another bolt of the kind: its model identified, its deviation told by what hits it has had.

    Parameters
    ----------
    campaign : Campaign
        Of the bolt; a few loosening tests, or none.
    found : Fit
        The law, fitted to several bolts.
    kind : Model
        Of one of them.
    jobs : int
        Processes.

    Raises
    ------
    ValueError
        If the campaign's bodies or bolted link are not theirs.
    """
    settings, expected = campaign.settings, kind.structure
    link = (settings.bolt.link,) if settings.bolt else ()
    if settings.body_names != expected.body_names or link != expected.bolted_links:
        raise ValueError(
            f"{campaign.path}: found the bodies {', '.join(settings.body_names)} and the bolted link "
            f"{', '.join(link) or 'none'}, expected {', '.join(expected.body_names)} and "
            f"{', '.join(expected.bolted_links)}: another bolt of the ranking's kind"
        )
    one = specimen(campaign, jobs, lambda _: None, tightening=False, criteria=found.criteria)
    return bolt_of_courses(found, campaign.settings.name, one.found.model, one.courses)


def bolt_of_courses(found: Fit, name: str, model: Model, courses: Sequence[TensionCourse]) -> Bolt:
    """The same from a model and tension histories.

    Parameters
    ----------
    found : Fit
        The law, fitted to several bolts.
    name : str
        Of the bolt.
    model : Model
        Identified from its own tests.
    courses : sequence of TensionCourse
        Its loosening tests.
    """
    if not courses:
        half = found.criteria.chance.normal_quantile * found.sigma
        return _bolt(name, 0, Limited(0.0, -half, half), found, model)
    frozen = freeze_bolts([(replace(model, identification=None), courses)], criteria=found.criteria)
    offsets = np.zeros_like(frozen.change)
    u = np.zeros(len(frozen))
    for left in range(_CORRECTIONS, -1, -1):
        problem = Problem(found.candidate, frozen, offsets)
        state = problem.solve(problem.theta0, np.array(found.scatter), u, steps=12)
        u = state.u
        if left:
            again = correction(replace(found, deviations=u), frozen)
            offsets = np.where(np.isfinite(again), again, offsets)
    deviation = _deviation(found, state, frozen.initial, np.arange(len(frozen)))
    return _bolt(name, len(frozen), deviation, found, model)
