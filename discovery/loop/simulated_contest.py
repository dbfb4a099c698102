"""Which of several effects that balance the forces of driven bodies as well also moves them as measured.

What turns sharply is lost where a motion is differentiated, and a rounded form may balance the forces better
there than the right one. A simulation differentiates nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from discovery.criteria.criteria import Criteria
from discovery.decide.acceptance import noise_by_chance
from discovery.decide.explanation import Explanation
from discovery.explain.driven_fit import driven_residual
from discovery.explain.force_balance import explanation
from discovery.explain.simulation_fit import together
from discovery.residual.base import level
from rom.model.model import Model
from rom.signals.processing import Measurement

Contender = tuple[Explanation, Model]
"""What an effect explains of the forces, and the model with it."""


def contested(
    contenders: Sequence[Contender],
    without: Model,
    names: Sequence[str],
    measured: Sequence[Measurement],
    criteria: Criteria,
) -> list[Explanation]:
    """Explanations with the costs of simulations in place of those of the balances.

    Those with fewest numbers come first, and the last is the first that leaves noise alone. States are fitted
    too: noise of the samples that tell them would stand in for a form.

    Parameters
    ----------
    contenders : sequence of Contender
        Of one residual.
    without : Model
        That has none of them.
    names : sequence of str
        Paths of the declared model's numbers that a fit moves.
    measured : sequence of Measurement
        Records, held-out ones too.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    list of Explanation
        Empty where no record has a force that drives a body.
    """
    before, found = driven_residual(without, names, measured, criteria), list[Explanation]()
    if before is None:
        return found
    chance = noise_by_chance(int(before.training.sum()), before.noise_freedom, criteria)
    for one, model in sorted(contenders, key=lambda pair: pair[0].free_numbers - len(pair[0].at_bound)):
        start = driven_residual(model, names, measured, criteria)
        assert start is not None
        after = together(replace(start, started=frozenset(), thorough=True))
        seen = explanation(after.model.effects[-1], before, after)
        found.append(replace(seen, effect=one.effect, p_value=one.p_value, residual=one.residual))
        if level(after) <= chance:
            break
    return found
