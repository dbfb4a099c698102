"""Effects that others have made needless: beside these they explain no more than chance, and are dropped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from discovery.decide.acceptance import harms, in_tension, is_accepted
from discovery.decide.explanation import Explanation
from discovery.explain import at_rest
from discovery.explain.motion import explanation
from discovery.explain.tension import TensionFindings
from discovery.loop.history import LoopHistory, Selection, alike
from discovery.loop.refits import Refits
from discovery.loop.state import State, refitted, residual_without, with_effects, without_effect
from discovery.residual.output_error import WhitenedResidual
from rom.effects import CATALOGUE, Effect, LawChange, SensorFault

Findings = Callable[[State, str], TensionFindings]


def without_needless(path: LoopHistory, refits: Refits) -> LoopHistory:
    """Return the trail without the forces and faults in the motion that explain nothing beside the others.

    Of forces of the catalogue the last one is judged too: the fit that it came with may be better by the
    model's own numbers alone.
    """
    learned = any(isinstance(e, LawChange) for e in path.last.model.effects)
    for place in range(len(path.chosen)):
        rest = _left_without(path, place, refits)
        if rest is not None:
            return without_needless(path.without(place, refits.settled(rest, learned=learned)), refits)
    return path


def _left_without(path: LoopHistory, place: int, refits: Refits) -> WhitenedResidual | None:
    """What the others leave over, refitted, where an effect is needless; None where it is not."""
    one, last = path.chosen[place].best, path.last.evidence
    effect = one.effect
    if isinstance(effect, Effect) and effect.name in CATALOGUE:
        rest = residual_without(last, effect)
        own = next(e for e in last.baseline.model.effects if e.path == effect.path)
        needed = is_accepted(explanation(own, CATALOGUE[effect.name], with_effects(rest)))
        return None if needed else refitted(rest)
    judged = isinstance(effect, Effect | SensorFault) and not in_tension(one)
    if not judged or place + 1 == len(path.chosen):
        return None
    if isinstance(effect, Effect):
        rest = refitted(residual_without(last, effect))
    else:  # what it corrects is another motion
        traced = refits.gathered(without_effect(last.baseline, effect), last.floors)
        if any(
            is_accepted(e) and e.effect.path == effect.path for e in at_rest.explain(traced, refits.options())
        ):
            return None
        rest = refitted(traced)
    return None if _needs(one, rest, last) else rest


def _needs(one: Explanation, rest: WhitenedResidual, last: WhitenedResidual) -> bool:
    """Whether fits of everything without an effect and with it differ by more than chance."""
    before, after = rest.costs(rest.residual), last.costs(last.residual)
    if before.keys() != after.keys():  # some cannot be simulated without it
        return True
    unseen = frozenset(t.settings.file for t in last.traces if t.settings.hold_out)
    told = replace(
        one, before=before, after=after, samples=last.samples, hold_out=unseen, left=None, p_value=None
    )
    return is_accepted(told)


def without_needless_in_tension(
    path: LoopHistory, first: int, explain: Findings, adopt: Callable[[State, Explanation], State]
) -> LoopHistory:
    """Return the trail without effects in the tension that the last one has made needless.

    Parameters
    ----------
    path : LoopHistory
        Its effects from the ``first`` on are in the tension or its gauge.
    first : int
        Place of the first of these.
    explain : callable
        What effects explain beside a state's model, all or one by its path
        (`discovery.explain.tension.findings`).
    adopt : callable
        The state with an effect in its model.
    """
    for place in range(first, len(path.chosen) - 1):
        shorter = _over_again(path, place, explain, adopt)
        if shorter is not None and not harms(path.last.errors, shorter.last.errors):
            return without_needless_in_tension(shorter, first, explain, adopt)
    return path


def _over_again(
    path: LoopHistory, place: int, explain: Findings, adopt: Callable[[State, Explanation], State]
) -> LoopHistory | None:
    """The trail as it is without one of its effects, if that explains nothing at its end; None otherwise."""
    dropped, *later = path.chosen[place:]
    shorter = replace(path, states=path.states[: place + 1], chosen=path.chosen[:place])
    for one in later:
        told = explain(shorter.last, "")
        best = _of(told, one)
        if best is None or not is_accepted(best):
            return None
        shorter = replace(shorter, tension=(*path.tension[:1], told.misfit))
        shorter = shorter.longer(Selection(best, alike(told.explanations, best)), adopt(shorter.last, best))
    again = _of(explain(shorter.last, dropped.best.effect.path), dropped)
    return shorter if again is not None and not is_accepted(again) else None


def _of(told: TensionFindings, one: Selection) -> Explanation | None:
    return next((e for e in told.explanations if e.effect.path == one.best.effect.path), None)
