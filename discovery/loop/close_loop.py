"""The closed loop: residual, missing effect, refined model, until the residual is noise or nothing helps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.detection.limit import DetectionLimit, limits_of
from discovery.loop.balance_refits import BalanceRefits
from discovery.loop.declared_law import declared_law
from discovery.loop.found_effects import label_of
from discovery.loop.free_form_stage import or_free_form
from discovery.loop.free_refits import FreeRefits
from discovery.loop.history import LoopHistory
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.motion_stage import settled_at_end, with_later_disturbances
from discovery.loop.refits import Refits
from discovery.loop.refitted_numbers import refitted_numbers, with_limits
from discovery.loop.rest_refits import RestRefits
from discovery.loop.rest_stage import before_hits, gauged
from discovery.loop.result import Closure, FoundEffect, Step
from discovery.loop.tension_stage import along_found_law, in_tension, law_first
from discovery.options import Options, Stages, no_progress
from rom.campaign.campaign import Campaign
from rom.evaluation.noise_floor import floors_by_kind
from rom.identification.balance_warnings import noise_warnings
from rom.identification.force_balance import is_driven
from rom.identification.free_decay import is_followed, is_free, is_mixed
from rom.jobs import processes
from rom.model.laws import Law
from rom.model.model import Model
from rom.one_thread import one_threaded
from rom.signals.measured_records import judged_by, screened, with_something_left, with_stored_records

_Search = tuple[Refits, LoopHistory]


@one_threaded
@with_stored_records
def close_loop(
    campaign: Campaign,
    jobs: int | None = None,
    progress: Stages | None = None,
    seed: int = 0,
    criteria: Criteria = CRITERIA,
    model: Model | None = None,
) -> Closure:
    """Find what a campaign's declared model lacks, add it, and report the errors before and after.

    Impact tests, ring-downs, driven bodies, cycled links and bolts at rest go through one loop
    (`discovery.loop.refits`).

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`; nothing is fitted to its held-out records.
    jobs : int
        Processes and threads, on which the numbers do not depend; all cores if not given.
    progress : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    seed : int
        Of the ensembles of the sparse fits.
    criteria : Criteria
        The numbers that decide.
    model : Model
        A model of the same structure whose tension law is declared in place of gamma(T): its form, its
        numbers as start. Nothing else of the model is used.

    Returns
    -------
    Closure
        Verdict, effects, refined model, errors after every step.

    Raises
    ------
    ValueError
        If nothing can be identified from the campaign, or the model is one of another structure.
    """
    jobs = processes(jobs)
    options = Options(jobs, progress or no_progress, seed, criteria)
    law = None if model is None else declared_law(model, campaign)
    sound = with_something_left(screened(judged_by(campaign, criteria.of_records), jobs))
    return _closure(*_by_both(sound, *_searched(refits_of(sound, options, law))))


def _searched(refits: Refits) -> _Search:
    """The loop from the declared model to its end."""
    refits, history = gauged(refits, LoopHistory((refits.start(),), criteria=refits.options.criteria))
    start = law_first(refits, before_hits(refits, history))
    history = with_later_disturbances(refits, start)
    history = refits.in_simulation(settled_at_end(refits, or_free_form(refits, history, start)))
    history = along_found_law(refits, in_tension(refits, history))
    return refits, settled_at_end(refits, history)


def _by_both(campaign: Campaign, refits: Refits, history: LoopHistory) -> tuple[_Search, ...]:
    """The search, and that by the other residual of driven bodies where nothing is named; the result first.

    Balances of forces show what is quick, and noise of a motion that is differentiated hides the rest; a
    simulation adds up what is small but lasts.
    """
    silent = history.at_noise_floor and not history.selections
    if not (silent and is_driven(campaign) and is_followed(campaign)) or is_mixed(campaign):
        return ((refits, history),)
    if isinstance(refits, BalanceRefits):
        other = _searched(FreeRefits.of_driven(campaign, refits.options))
        if not other[1].at_noise_floor:
            return ((refits, history),)
        return (other,) if other[1].selections else ((refits, history), other)
    balances = BalanceRefits.of(campaign, refits.options)
    quiet = LoopHistory((balances.start(),), criteria=refits.options.criteria).at_noise_floor
    return ((refits, history),) if quiet else (_searched(balances),)


def refits_of(campaign: Campaign, options: Options, law: Law | None = None) -> Refits:
    """Return the fits of a kind of campaign; impact tests of a bolt may have a declared tension law.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    options : Options
        How the loop is run.
    law : Law
        Form of the tension law; gamma(T) of the paper if not given.

    Raises
    ------
    ValueError
        If nothing can be identified from the campaign.
    """
    if campaign.settings.is_at_rest:
        return RestRefits.of(campaign, options)
    if campaign.settings.modes is not None:
        return FreeRefits.of_modes(campaign, options)
    if is_free(campaign):
        return FreeRefits.of(campaign, options)
    if is_driven(campaign) and (told := _balanced(campaign, options)) is not None:
        return told
    if is_followed(campaign):
        return FreeRefits.of_driven(campaign, options)
    return ImpactRefits.of(campaign, options, law=law)


def _balanced(campaign: Campaign, options: Options) -> BalanceRefits | None:
    """Fits to balances of forces; None where a displacement is too noisy for them and simulations can follow.

    Noise in what numbers multiply makes them too small, and what that leaves over passes for an effect. It
    makes them so in ring-downs and under forces by different shares, so that none suit both.
    """
    if is_mixed(campaign):
        return None
    refits = BalanceRefits.of(campaign, options)
    return None if is_followed(campaign) and noise_warnings(refits.balances) else refits


def _detection_limits(*searches: _Search) -> tuple[DetectionLimit, ...]:
    """What the last residual would have shown of every effect that no model holds; the lowest."""
    held = {effect.path for _, history in searches for effect in history.last.model.effects}
    found: dict[tuple[str, str, str], DetectionLimit] = {}
    for refits, history in searches:
        options = refits.options
        for meter in refits.meters(history):
            for limit in limits_of(meter, options.stage("detection limits"), options.jobs):
                key = limit.enters, limit.name, limit.parameter
                if f"{limit.enters}.{limit.name}" not in held:
                    found[key] = min(found.get(key, limit), limit, key=_lowest)
    return tuple(found.values())


def _lowest(limit: DetectionLimit) -> float:
    return np.inf if limit.value is None else limit.value


def _with_their_limits(model: Model, found: Iterable[FoundEffect]) -> Model:
    """The model with effects whose numbers have the limits with which they were found."""
    limited = {one.effect.path: one.effect for one in found}
    return replace(model, effects=tuple(limited.get(effect.path, effect) for effect in model.effects))


def _warnings(refits: Refits, history: LoopHistory, doubts: Iterable[str]) -> Iterator[str]:
    """What to know; of a refined model, which warnings are those of the declared one."""
    yield from history.last.warnings
    files = tuple(record.file for record in refits.campaign.settings.record)
    for line in refits.of_declared:
        of_record = line.startswith(files)
        yield line if of_record or not history.selections else f"of the declared model: {line}"
    yield from (*refits.warnings, *doubts, *history.remarks())


def _closure(search: _Search, *others: _Search) -> Closure:
    refits, history = search
    history = refits.with_known_rate(history)
    first, last = history.states[0], history.last
    doubts = refits.doubts(history)
    effects = tuple(refits.described(selection, last) for selection in history.selections)
    refitted = refitted_numbers(last.residual.stated)
    labels = ["", *(label_of(selection.best.effect) for selection in history.selections)]
    errors = [state.errors for state in history.states]
    for place in {0, len(errors) - 1}:
        errors[place] = refits.with_coverage(history.states[place])
    return Closure(
        verdict=history.verdict(doubts),
        effects=effects,
        model=with_limits(_with_their_limits(last.model, effects), refitted),
        refitted=refitted,
        steps=tuple(map(Step, labels, errors)),
        residual_before=refits.localise(first, history.tension[:1]),
        residual_after=refits.localise(last, history.tension[1:]),
        screened=history.screened,
        detection_limits=_detection_limits((refits, history), *others),
        criteria=refits.options.criteria,
        declared=first.model,
        set_aside=refits.set_aside,
        noise_floor=floors_by_kind(last.evaluations),
        warnings=tuple(dict.fromkeys(_warnings(refits, history, doubts))),
    )
