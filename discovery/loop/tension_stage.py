"""Effects in the tension and its gauge, followed along the motion of the model so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from discovery.courses.tension_likelihood import acts_at_rest
from discovery.decide.acceptance import harms, is_accepted
from discovery.decide.acceptance import in_tension as is_in_tension
from discovery.decide.explanation import Explanation
from discovery.explain import free_rate, tension
from discovery.explain.tension_law import numbers_of
from discovery.loop.history import LoopHistory, Selection, best_explanation
from discovery.loop.redundant import without_redundant, without_redundant_in_tension
from discovery.loop.refits import Refits
from discovery.loop.state import State
from discovery.residual.course_fit import Misfit
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection

_TURNS: Numerical[int] = 4  # of following the records along a law and fitting it along these
_SETTLED: Numerical[float] = 0.02  # of what is left of the courses: for less there is no further turn


def in_tension(refits: Refits, history: LoopHistory) -> LoopHistory:
    """Add effects in the tension and its gauge; a free form where the catalogue leaves too much.

    They are fitted along the motion, so where that is not explained none is asked for.
    """
    residual = refits.tension(history.last)
    if residual is None:
        return history
    if not history.is_explained:
        if not residual.misfit.numbers:
            return history
        return replace(history, tension=(*(history.tension or (residual.misfit,))[:1], residual.misfit))
    named = _named(refits, history)
    if named.tension_at_noise_floor:
        return named
    longer = len(named.selections) > len(history.selections)
    return _with_free_rate(refits, named, [history, named] if longer else [history])


def _named(refits: Refits, history: LoopHistory, *, until_law: bool = False) -> LoopHistory:
    """Add effects of the catalogue in the tension, which hardly show in the motion, until none helps.

    One that makes the simulated errors worse, or the histories by more than it explains, is not kept; nor is
    a law believed that only a reading brought up which follows the motion.
    """
    options, criteria = refits.options, history.criteria
    before, accepted, seen, count = history, set[str](), [history.names], len(history.selections)
    has_law = False
    while True:
        last, residual = history.last, refits.tension(history.last)
        if residual is None:
            return history
        findings = tension.findings(residual, options)
        explanations, misfit = findings.explanations, findings.misfit
        if history.tension and history.tension[-1].loss_to(misfit) > history.selections[-1].training_gain:
            return before
        history = replace(history, tension=(*(history.tension or (misfit,))[:1], misfit))
        if until_law and has_law:
            return history
        apart = history.selections and _is_apart(history.selections[-1].best.effect)
        known = [e for e in explanations if e.effect.kind != "law change" or e.effect.path in accepted]
        selection = best_explanation(known if apart else explanations, criteria)
        accepted = {e.effect.path for e in explanations if is_accepted(e, criteria)}
        if selection is None:
            return history
        after = adopted(refits, last, selection.best)
        if harms(last.errors, after.errors, criteria):
            return history
        before, history = history, history.extended(selection, after)
        history = without_redundant_in_tension(refits, history, count)
        if history.names in seen:  # of two effects each takes the other's place
            return before
        seen.append(history.names)
        has_law = selection.best.effect.kind == "law change"


def adopted(refits: Refits, state: State, explanation: Explanation) -> State:
    """The state with one more effect, everything refitted.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    state : State
        The model so far.
    explanation : Explanation
        Of the effect that is added.

    Returns
    -------
    State
        With its errors.
    """
    residual = refits.refit_with(state, explanation)
    return refits.evaluated(residual, law_is_fitted=bool(explanation.beside))


def _is_apart(effect: ModelCorrection) -> bool:
    """Whether an effect is a reading that tension histories are blind to: nothing of a law hangs on it."""
    return effect.kind == "reading" and not acts_at_rest(effect)


def _with_free_rate(refits: Refits, named: LoopHistory, starts: Sequence[LoopHistory]) -> LoopHistory:
    """Return the first history with a free form of the rate that explains the tension, as no name does.

    A name of the catalogue that leaves more than noise may be the wrong one, which is worse than none; but a
    model that predicts the tension of hold-out records much worse than with these names takes no one's place.

    Parameters
    ----------
    refits : Refits
        Of the campaign.
    named : LoopHistory
        With what the catalogue named in the tension; it leaves more than noise of the histories.
    starts : sequence of LoopHistory
        To which a free form is added, those with fewer effects first.
    """
    criteria = named.criteria
    for start in starts:
        residual = refits.tension(start.last)
        explanations = free_rate.explain(residual, refits.options) if residual is not None else ()
        if not explanations:
            continue
        selection = Selection(explanations[0])
        after = adopted(refits, start.last, selection.best)
        if any(harms(other.last.errors, after.errors, criteria) for other in (start, named)):
            continue
        beside = refits.tension(after)
        if beside is not None and _explains(named, beside.misfit):
            return replace(start.extended(selection, after), tension=(named.tension[0], beside.misfit))
    return named


def _explains(named: LoopHistory, after: Misfit) -> bool:
    """Whether next to nothing is left of what was beyond noise, or noise alone where surely more was."""
    rules, before = named.criteria, named.tension[-1]
    closes = after.level - 1 <= rules.closing.closing_share * (before.level - 1)
    gain = -before.loss_to(after)
    return closes or (after.is_noise and gain > rules.acceptance.training_gain_tension)


def law_first(refits: Refits, history: LoopHistory) -> LoopHistory:
    """Add another law of loosening before all effects in the motion, where it is what is plainly wrong.

    Records are followed along a tension that falls by the declared law. Where another one holds, tension
    histories are off by far more than the motion, or the motion is off for want of the right tension: then
    next to nothing is left of that along the law found, as no law does for what acts in the motion itself.
    """
    last = history.last
    residual = None if history.is_explained else refits.tension(last)
    if residual is None or residual.misfit.is_noise:
        return history
    named = _named(refits, history, until_law=True)
    new = named.selections[len(history.selections) :]
    if not any(selection.best.effect.kind == "law change" for selection in new):
        return history
    followed = _followed(refits, named.last)
    share = 1.0 if residual.misfit.level > last.level else history.criteria.closing.closing_share
    if followed.level - 1 >= share * (last.level - 1):
        return history
    return replace(named.ending(followed), tension=named.tension[:1])


def _followed(refits: Refits, state: State) -> State:
    """The state along its law, whose numbers are then those of the courses along that motion.

    They were fitted along the motion of the law before. Each moves the other, so both are done in turn for
    as long as that leaves less of the courses, and the simulated errors are no worse.
    """
    followed = refits.along_law(state)
    residual = refits.tension(followed)
    for _ in range(_TURNS):
        if residual is None or residual.baseline is None:
            break
        again = refits.along_law(followed, numbers_of(residual.baseline))
        before, residual = residual.misfit.level, refits.tension(again)
        left = before if residual is None else residual.misfit.level
        if left > before or harms(followed.errors, again.errors, refits.options.criteria):
            break
        followed = again
        if left > (1 - _SETTLED) * before:
            break
    return followed


def along_found_law(refits: Refits, history: LoopHistory) -> LoopHistory:
    """Follow the motion along a tension that falls by the law that was found; drop what is redundant then.

    Until then records are followed along a tension that falls by the quartic law, whose history is a little
    wrong where another law holds; so is the joint's stiffness then, which an effect may make up for.
    """
    best = [selection.best for selection in history.selections]
    if not any(explanation.effect.kind == "law change" for explanation in best):
        return history
    if all(is_in_tension(explanation) for explanation in best):
        followed = _followed(refits, history.last)
        nearer = followed.level < history.last.level
        worse = harms(history.last.errors, followed.errors, history.criteria)
        return history.ending(followed) if nearer and not worse else history
    after = without_redundant(refits, history.ending(_followed(refits, history.last)))
    return after if len(after.selections) < len(history.selections) and after.is_explained else history
