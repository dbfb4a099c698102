"""Effects that others have made redundant: beside these they explain no more than chance, and are dropped."""

from __future__ import annotations

from dataclasses import replace

from discovery.decide.acceptance import harms, is_accepted
from discovery.decide.explanation import Explanation
from discovery.explain import tension
from discovery.loop.history import LoopHistory, Selection, indistinguishable
from discovery.loop.refits import Refits
from discovery.residual.tension import TensionResidual


def without_redundant(refits: Refits, history: LoopHistory) -> LoopHistory:
    """Return the history without forces and faults in the motion that explain nothing beside the others."""
    law_is_fitted = bool(history.last.model.effects_of("law change"))
    for place in range(len(history.selections)):
        rest = refits.without(history, place)
        if rest is not None:
            state = refits.evaluated(rest, law_is_fitted=law_is_fitted)
            return without_redundant(refits, history.without(place, state))
    return history


def without_redundant_in_tension(refits: Refits, history: LoopHistory, first: int) -> LoopHistory:
    """Return the history without effects in the tension that the last one has made redundant.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    history : LoopHistory
        Its effects from the ``first`` on are in the tension or its gauge.
    first : int
        Place of the first of these.

    Returns
    -------
    LoopHistory
        The same object where none is redundant.
    """
    for place in range(first, len(history.selections) - 1):
        shorter = _over_again(refits, history, place)
        if shorter is not None and not harms(history.last.errors, shorter.last.errors, history.criteria):
            return without_redundant_in_tension(refits, shorter, first)
    return history


def _over_again(refits: Refits, history: LoopHistory, place: int) -> LoopHistory | None:
    """The history without one of its effects, if that explains nothing at its end; None otherwise."""
    options, criteria = refits.options, history.criteria
    dropped, *later = history.selections[place:]
    shorter = replace(history, states=history.states[: place + 1], selections=history.selections[:place])
    for selection in later:
        findings = tension.findings(_tension(refits, shorter), options)
        explanations = findings.explanations
        best = _same(explanations, selection)
        if best is None or not is_accepted(best, criteria):
            return None
        shorter = replace(shorter, tension=(*history.tension[:1], findings.misfit))
        rivals = indistinguishable(explanations, best, criteria=criteria)
        state = refits.evaluated(refits.refit_with(shorter.last, best), law_is_fitted=bool(best.beside))
        shorter = shorter.extended(Selection(best, rivals), state)
    path = dropped.best.effect.path
    again = tension.explain_one(_tension(refits, shorter), options, path)
    return shorter if again is not None and not is_accepted(again, criteria) else None


def _tension(refits: Refits, history: LoopHistory) -> TensionResidual:
    residual = refits.tension(history.last)
    assert residual is not None
    return residual


def _same(explanations: tuple[Explanation, ...], selection: Selection) -> Explanation | None:
    return next((e for e in explanations if e.effect.path == selection.best.effect.path), None)
