"""What could be reached: errors of a model with the true effects, refitted from where nothing is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from discovery.attribution import motion_channels
from discovery.closure import ErrorsByKind
from discovery.state import refitted, set_aside, settled
from discovery.tracing import Evidence, gather, starting
from rom.campaign import Campaign
from rom.effects import Added, LawChange, candidates
from rom.identification import identify_campaign

__all__ = ["declared_errors", "oracle_errors"]

Truth = Mapping[str, Any]
"""An effect as a truth file tells it: `name`, `enters`, `parameters` with a `value` each."""


def declared_errors(campaign: Campaign) -> ErrorsByKind:
    """Return the errors of the declared model, its numbers refitted to training records."""
    found = identify_campaign(campaign)
    evidence = gather(campaign, starting(found, found.model), set_aside(found))
    return settled(campaign, found, evidence).errors


def oracle_errors(campaign: Campaign, twin: Campaign, truths: Sequence[Truth]) -> ErrorsByKind:
    """Return the errors of a model with the true effects in it, refitted to training records.

    The fit starts from the true effects and from the model that is identified from a twin: an undeclared
    effect can lead the identification itself astray, and what starts from there is no oracle. Numbers of the
    model, of forces and of gamma(T) are refitted; faults of sensors and changes of the tension law stay true.
    Beside such a change gamma(T) is the twin's: learned test by test, as it is, it would be that of what a
    change which brings nearly all of a loss leaves over, of either sign.

    Parameters
    ----------
    campaign : Campaign
        The campaign that was measured with the effects.
    twin : Campaign
        The same measured without them.
    truths : sequence of mapping
        Effects of the catalogue, as a truth file tells them.

    Raises
    ------
    ValueError
        If an effect cannot enter there, or nothing can be identified.
    """
    own, sound = identify_campaign(campaign), identify_campaign(twin)
    plant = replace(sound.model, filter_cutoff_hz=own.model.filter_cutoff_hz)  # errors as a closure has them
    found = replace(own, model=plant, linear=sound.linear)
    baseline = starting(found, plant)
    aside = set_aside(own)
    declared = gather(campaign, baseline, aside)
    model = baseline.model
    for truth in truths:
        model = _true(truth, declared).added_to(model)
    evidence = gather(campaign, replace(baseline, model=model), aside, declared.floors)
    changed = any(isinstance(effect, LawChange) for effect in model.effects)
    return settled(campaign, found, refitted(evidence), learned=changed).errors


def _true(truth: Truth, evidence: Evidence) -> Added:
    """The effect with its true values, cut to its bounds."""
    channels = (*motion_channels(evidence), "tension")
    for _, effect in candidates(evidence.baseline.model, channels, core=False):
        if (effect.name, effect.enters) == (truth["name"], truth["enters"]):
            told = {name: number["value"] for name, number in truth["parameters"].items()}
            return effect.with_values(
                **{
                    name: float(np.clip(told[name], *number.bounds))
                    for name, number in effect.parameters.items()
                    if name in told
                }
            )
    raise ValueError(f"oracle: found no effect {truth['name']} that can enter at {truth['enters']}")
