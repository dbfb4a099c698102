"""What could be reached: errors of a model that has the true effects, everything refitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from discovery.attribution import Probe, explain, motion_channels
from discovery.closure import ErrorsByKind
from discovery.explanation import Explanation
from discovery.refinement import _Chosen, _Loop, _State
from discovery.tension_attribution import explain_tension
from rom.campaign import Campaign
from rom.effects import Added, candidates
from rom.identification import identify_campaign

__all__ = ["declared_errors", "oracle_errors"]

Truth = Mapping[str, Any]
"""An effect as a truth file tells it: `name`, `enters`, `parameters` with a `value` each."""

_OF_TENSION = ("tension", "sensor:tension")


def declared_errors(campaign: Campaign) -> ErrorsByKind:
    """Return the errors of the declared model, its numbers refitted to training records."""
    return _started(campaign)[1].errors


def oracle_errors(campaign: Campaign, truths: Sequence[Truth]) -> ErrorsByKind:
    """Return the errors of a model with the true effects in it, all numbers refitted to training records.

    Fits of forces and of sensors of the motion start from the true values; effects in the tension come last,
    since it follows the motion.

    Parameters
    ----------
    campaign : Campaign
        The campaign that was measured with them.
    truths : sequence of mapping
        Effects of the catalogue, as a truth file tells them.

    Raises
    ------
    ValueError
        If an effect cannot enter there, or nothing can be identified.
    """
    loop, state = _started(campaign)
    for truth in sorted(truths, key=lambda one: one["enters"] in _OF_TENSION):
        state = loop.adopt(state, _Chosen(_explained(loop, state, truth), (), 1.0))
    return state.errors


def _started(campaign: Campaign) -> tuple[_Loop, _State]:
    loop = _Loop(campaign, identify_campaign(campaign, 1, None), 1, lambda _: None)
    return loop, loop.start()


def _explained(loop: _Loop, state: _State, truth: Truth) -> Explanation:
    """The true effect, fitted beside the numbers of the model so far."""
    wanted = truth["name"], truth["enters"]
    if truth["enters"] in _OF_TENSION:
        for one in explain_tension(loop.campaign, state.found, state.model, loop.jobs):
            if (one.effect.name, one.effect.enters) == wanted:
                return one
    else:
        for member, effect in candidates(state.model, motion_channels(state.evidence), core=False):
            if (effect.name, effect.enters) == wanted:
                return explain([Probe(member, _true(effect, truth), 0.0, 1.0, 1.0)], state.evidence)
    raise ValueError(f"oracle: found no effect {wanted[0]} at {wanted[1]} that can be added to the model")


def _true(effect: Added, truth: Truth) -> Added:
    """The effect with its true values, cut to its bounds."""
    values = {}
    for name, told in truth["parameters"].items():
        if name in effect.parameters:
            values[name] = float(np.clip(told["value"], *effect.parameters[name].bounds))
    return effect.with_values(**values)
