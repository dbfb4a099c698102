"""Effects in the motion, one after the other, until none of the catalogue helps beyond chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from discovery.decide.acceptance import at_noise_floor, harms, is_accepted, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.probes import by_chance
from discovery.loop.found_effects import screened
from discovery.loop.history import (
    LoopHistory,
    Selection,
    best_explanation,
    indistinguishable,
    simplest,
)
from discovery.loop.redundant import without_redundant
from discovery.loop.refits import Refits
from discovery.loop.rest_stage import before_hits
from discovery.loop.result import Screened
from discovery.loop.state import State
from discovery.residual.base import Residual, cost, level
from rom.campaign.channels import FloatArray

Candidate = tuple[Selection, Residual]
"""An effect, and what is left over with it."""


def with_later_disturbances(
    refits: Refits, history: LoopHistory, given: Selection | None = None
) -> LoopHistory:
    """Add effects in the motion; then what shows before the hits once more, examined after them.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    history : LoopHistory
        The loop so far.
    given : Selection or None
        Effect that is added first, without another screen.

    Returns
    -------
    LoopHistory
        With all effects in the motion that were accepted.
    """
    after = in_motion(refits, history, given)
    if after.names == history.names:
        return after
    rested = before_hits(refits, after)
    return after if rested is after else in_motion(refits, without_redundant(refits, rested))


def in_motion(refits: Refits, history: LoopHistory, given: Selection | None = None) -> LoopHistory:
    """Add effects in the motion, ``given`` the first, until none of the catalogue helps beyond chance.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    history : LoopHistory
        The loop so far.
    given : Selection or None
        Effect that is added first, without another screen.

    Returns
    -------
    LoopHistory
        With all effects in the motion that were accepted.
    """
    criteria = refits.options.criteria
    if given is not None:
        after = refits.evaluated(refitted_beside(refits, history.last, given))
        if not history.improves(after):
            return history
        history = history.extended(given, after)
    lowest = {history.names: cost(history.last.residual)}
    while not (history.selections and history.last.simulated_to_noise):
        candidate, first, chance = _most_helpful(refits, history)
        history = replace(history, screened=history.screened or first, chance=chance)
        if candidate is None:
            return history
        selection, residual = candidate
        restarted, selection = _restarted(refits, history, selection, residual)
        accepted = is_accepted(selection.best, criteria)
        state = refits.evaluated(refits.settled(residual)) if accepted else restarted.last
        if restarted.improves(state):
            history = without_redundant(refits, restarted.extended(selection, state))
            remaining = cost(history.last.residual)
            material = 1 - criteria.acceptance.material_share
            if remaining > material * lowest.get(history.names, np.inf):
                return history  # of two effects each takes the other's place
            lowest[history.names] = remaining
        elif restarted is history:
            return history
        else:
            history = restarted  # with another residual, to be screened anew
    return history


def refitted_beside(refits: Refits, state: State, selection: Selection) -> Residual:
    """What is left over with one more effect, everything refitted, beside the noise as it is then.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    state : State
        The model so far.
    selection : Selection
        The effect that is added.

    Returns
    -------
    Residual
        Of the model with the effect.
    """
    return refits.settled(refits.refit_with(state, selection.best))


def settled_at_end(refits: Refits, history: LoopHistory) -> LoopHistory:
    """The history whose last model is settled where a later stage has moved it since, if nothing is worse."""
    last = history.last
    settled = refits.settled(last.residual) if last.model.effects_of("force") else last.residual
    if settled is last.residual:
        return history
    state = refits.evaluated(settled, law_is_fitted=bool(last.model.effects_of("law change")))
    if state.level > last.level or harms(last.errors, state.errors, history.criteria):
        return history
    return history.ending(state)


def _most_helpful(
    refits: Refits, history: LoopHistory
) -> tuple[Candidate | None, tuple[Screened, ...], FloatArray | None]:
    """The effect that leaves least, what it leaves; the first screen, and what the last gains by chance."""
    found: Candidate | None = None
    first: tuple[Screened, ...] = ()
    chance: FloatArray | None = None
    for view in refits.views(history):
        probes = refits.screen(view.residual)
        first, chance = first or screened(probes, view.residual), by_chance(probes, refits.options.criteria)
        other = _best_refitted(refits, view, refits.explain(probes, view.residual))
        found = min((one for one in (found, other) if one), key=_remaining, default=None)
        if found and at_noise_floor(level(found[1]), history.last.level, refits.options.criteria):
            break
    return found, first, chance


def _restarted(
    refits: Refits, history: LoopHistory, selection: Selection, residual: Residual
) -> tuple[LoopHistory, Selection]:
    """Refit the last model from where a fit beside one more effect ended, if that leaves less.

    A fit that was stuck may be freed by any further effect, which would get the credit for it.
    """
    anew = refits.refit_from(residual, selection.best.effect) if history.selections else None
    material = 1 - refits.options.criteria.acceptance.material_share
    if anew is None or cost(anew) > material * cost(history.last.residual):
        return history, selection
    best = between(selection.best, anew, residual)
    settled = refits.evaluated(refits.settled(anew))
    return history.ending(settled), replace(selection, best=best)


def _best_refitted(refits: Refits, state: State, explanations: Sequence[Explanation]) -> Candidate | None:
    """The effect that leaves least where everything is refitted beside it, and what it leaves.

    That is the one that explains most. Far from the structure, where more than noise is left, hold-out costs,
    told by straight lines in the model's numbers, may be wrong: what suits the training records better than
    all others is then tried too, and examined where its fit ends.
    """
    criteria = refits.options.criteria
    selection = best_explanation(explanations, criteria)
    found = [] if selection is None else [(selection, refits.refit_with(state, selection.best))]
    first = max(explanations, key=lambda e: float(e.gains(hold_out=False).sum()), default=None)
    if first is not None:
        first = simplest(explanations, first, hold_out=False, criteria=criteria)
    loud = state.level > criteria.acceptance.noise_level
    other = first is not None and (selection is None or first is not selection.best)
    if loud and other and first is not None and is_accepted(first.of_training(), criteria):
        after = refits.refit_with(state, first)
        fitted = between(first, state.residual, after)
        rivals = indistinguishable(explanations, first, hold_out=False, criteria=criteria)
        found += [(Selection(fitted, rivals), after)] if is_accepted(fitted, criteria) else []
    return min(found, key=_remaining, default=None)


def _remaining(candidate: Candidate) -> tuple[int, float]:
    """Records that can be simulated with an effect, most first, then the cost of what it leaves of all.

    With that of its free numbers: a form of many that imitates one of few gains a little by chance.
    """
    selection, residual = candidate
    chance = 2 * spread_of(selection.best) * selection.best.free_numbers
    return -residual.record_count, float(np.sum(residual.residual**2)) + chance


def between(explanation: Explanation, before: Residual, after: Residual) -> Explanation:
    """What an effect explains by fits of everything without it and with it.

    Parameters
    ----------
    explanation : Explanation
        Of the effect.
    before, after : Residual
        Without the effect and with it, everything refitted.

    Returns
    -------
    Explanation
        The same effect with the costs of these two fits.
    """
    return replace(explanation, before=before.costs(before.residual), after=after.costs(after.residual))
