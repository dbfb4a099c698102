"""Whether a free form of the tension's rate is kept: beside what the catalogue named, or in place of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from discovery.decide.acceptance import SURELY, harms
from discovery.decide.explanation import Explanation
from discovery.loop.history import CLOSES, LoopHistory, Selection
from discovery.loop.state import State
from discovery.residual.course_fit import Misfit


def with_free_form(
    named: LoopHistory,
    starts: Iterable[LoopHistory],
    explain: Callable[[State], Sequence[Explanation]],
    misfit_of: Callable[[State], Misfit],
    adopt: Callable[[State, Explanation], State],
) -> LoopHistory:
    """Return the first trail with a free form of the rate that explains the courses, as no name does.

    A name of the catalogue that leaves more than noise may be the wrong one, which is worse than none; but a
    model that predicts the tension of held-out records much worse than with these names takes no one's place.

    Parameters
    ----------
    named : LoopHistory
        With what the catalogue named in the tension; it leaves more than noise of the courses.
    starts : iterable of LoopHistory
        To which a free form is added, those with fewer effects first.
    explain : callable
        What the best free form beside a state's model explains (`discovery.explain.free_rate`).
    misfit_of : callable
        What a state's model leaves over of the courses.
    adopt : callable
        The state with an effect in its model.

    Returns
    -------
    LoopHistory
        ``named`` where no free form does.
    """
    for start in starts:
        explanations = explain(start.last)
        if not explanations:
            continue
        one = Selection(explanations[0], ())
        after = adopt(start.last, one.best)
        if any(harms(other.last.errors, after.errors) for other in (start, named)):
            continue
        left = misfit_of(after)
        if _explains(named.tension[-1], left):
            return replace(start.longer(one, after), tension=(named.tension[0], left))
    return named


def _explains(before: Misfit, after: Misfit) -> bool:
    """Whether next to nothing is left of what was beyond noise, or noise alone where surely more was."""
    closes = after.level - 1 <= CLOSES * (before.level - 1)
    return closes or (after.is_noise and -before.loss_to(after) > SURELY)
