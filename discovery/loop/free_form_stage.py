"""A term without the catalogue in place of names, where it leaves far less."""

from __future__ import annotations

from dataclasses import replace

from discovery.decide.acceptance import is_accepted, is_significant, penalised_gain, spread_of
from discovery.decide.explanation import Explanation
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.motion_stage import between, refitted_beside, with_later_disturbances
from discovery.loop.refits import Refits
from discovery.loop.state import State
from discovery.residual.base import cost


def or_free_form(refits: Refits, history: LoopHistory, start: LoopHistory) -> LoopHistory:
    """The history, or from its start one with a term without the catalogue, where that leaves far less.

    Where names leave next to nothing of much the term must do better by itself: no others follow it.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    history : LoopHistory
        With what the catalogue named in the motion.
    start : LoopHistory
        The same before the first of these effects.

    Returns
    -------
    LoopHistory
        The history that was given, or one from the start with the free form.
    """
    criteria = refits.options.criteria
    if history.last.level <= criteria.acceptance.noise_level:
        return _or_nearer(refits, history, start)
    formed = _free_form(refits, start.last)
    if formed is None:
        return history
    if not history.at_noise_floor:
        return history.or_better(with_later_disturbances(refits, start, formed))
    if spread_of(formed.best) >= history.last.level:
        return history
    after = refits.evaluated(refitted_beside(refits, start.last, formed))
    return history.or_better(start.extended(formed, after))


def _or_nearer(refits: Refits, history: LoopHistory, start: LoopHistory) -> LoopHistory:
    """The history, or from its start a term by itself where one beside the names shows their form wrong.

    A drag with |v|^1.5 leaves next to noise where one with v^2 is put in its place. The right form with
    another knee leaves as much, but no term by itself does better than that. A fit of the right name that was
    stuck leaves more than it should: it is freed first, from where one beside the term ends.
    """
    criteria = refits.options.criteria
    new = history.selections[len(start.selections) :]
    if not any(selection.best.effect.kind == "force" for selection in new):
        return history
    beside = [one for one in refits.free_forms(history.last) if is_significant(one, criteria)]
    if not beside:
        return history
    formed = _free_form(refits, start.last)
    if formed is None:
        return history
    history = _refitted_from(refits, history, max(beside, key=penalised_gain))
    named, after = history.last.residual, refitted_beside(refits, start.last, formed)
    if after.record_count < named.record_count:
        return history
    if not is_significant(between(formed.best, named.stated, after.stated), criteria):
        return history
    return replace(start.extended(formed, refits.evaluated(after)), screened=history.screened)


def _refitted_from(refits: Refits, history: LoopHistory, beside: Explanation) -> LoopHistory:
    """The history, its last model refitted from where one beside another term ended, if that leaves less."""
    anew = refits.refit_from(refits.refit_with(history.last, beside), beside.effect)
    if anew is None or cost(anew) >= cost(history.last.residual):
        return history
    return history.ending(refits.evaluated(refits.settled(anew)))


def _free_form(refits: Refits, state: State) -> Selection | None:
    """The best term without the catalogue; None where even that does not predict hold-out records."""
    criteria = refits.options.criteria
    accepted = [one for one in refits.free_forms(state) if is_accepted(one, criteria)]
    return Selection(max(accepted, key=penalised_gain)) if accepted else None
