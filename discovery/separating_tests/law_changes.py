"""Which hits would tell two changes of a bolt's law apart that the courses at hand cannot."""

from __future__ import annotations

from dataclasses import replace

from discovery.residual.course_fit import CourseFit
from discovery.separating_tests.impacts import propose_tests


def separating_hits(best: CourseFit | None, rival: CourseFit | None) -> str:
    """Return in words how often to hit, how hard and at which tension; `discovery.separating_tests.impacts`
    tells how.

    Parameters
    ----------
    best, rival : CourseFit or None
        Two effects as they were fitted to the same courses; None for one that is not in these.

    Returns
    -------
    str
        Empty unless both are laws; of a reading no tension that a hit leaves tells.
    """
    if best is None or rival is None or best.candidate.effect or rival.candidate.effect:
        return ""
    frozen = best.problem.frozen
    # the changes are in the laws that are compared
    guide = replace(frozen, model=frozen.model.without_effects_of("law change"))
    tests = propose_tests([best.fit, rival.fit], guide, most_tests=1)
    if not tests:
        rules = frozen.criteria.separating
        most, hardest = f"{rules.hits:g}", f"{rules.hardest:g}"
        return f"none of the hits tried, up to {most} of them {hardest} times as hard as those at hand"
    (test,) = tests
    return f"{test.hit}: {test.outcome}"
