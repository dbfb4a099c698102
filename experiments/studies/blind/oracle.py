"""What could be reached: errors of a model with the true effects, refitted from where nothing is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from discovery.explain import at_rest, tension
from discovery.explain.motion import motion_channels
from discovery.explain.motion_fit import refit, refit_fault, without_effect
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.state import State
from discovery.loop.tension_stage import adopted
from discovery.options import Options
from discovery.residual.base import cost
from discovery.residual.output_error import WhitenedResidual, starting
from rom.campaign.campaign import Campaign
from rom.effects import ModelCorrection, SensorFault, candidates
from rom.evaluation.error_measures import ErrorsByKind
from rom.identification.identify import identify_campaign
from rom.signals.measured_records import with_stored_records

__all__ = ["declared_errors", "oracle_errors"]

_SETTLED = 1e-3  # of the cost

Truth = Mapping[str, Any]
"""An effect as a truth file tells it: `name`, `enters`, `parameters` with a `value` each."""


@with_stored_records
def declared_errors(campaign: Campaign) -> ErrorsByKind:
    """Return the errors of the declared model, its numbers refitted to training records."""
    return ImpactRefits.of(campaign, Options()).start().errors


@with_stored_records
def oracle_errors(campaign: Campaign, twin: Campaign, truths: Sequence[Truth]) -> list[ErrorsByKind]:
    """Return the errors of a model with the true effects in it, refitted to training records.

    A refitted number may predict worse than the true one, so the errors with the true numbers of faults,
    readings and laws follow where there are any, gamma(T) beside a law being the twin's then.

    The fit starts from the true effects and from the model that is identified from a twin: an undeclared
    effect can lead the identification itself astray, and what starts from there is no oracle. Numbers of the
    model and of forces are refitted together, those of a sensor's fault from where they are, those of effects
    in the tension or its gauge with its law beside them; gamma(T) is learned anew.

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
    refits = ImpactRefits(campaign, replace(own, model=plant, linear=sound.linear), Options())
    baseline = starting(refits.identification, plant)
    declared = refits.followed(baseline)
    effects = [_true(truth, declared) for truth in truths]
    model = baseline.model
    for effect in effects:
        model = effect.added_to(model)
    evidence = refit(refits.followed(replace(baseline, model=model), declared.floors))
    true = [] if all(e.kind == "force" for e in effects) else [
        refits.evaluated(evidence, law_is_fitted=any(e.kind == "law change" for e in effects)).errors
    ]  # fmt: skip
    faults = [e for e in effects if isinstance(e, SensorFault) and e.channel != "tension"]
    for fault in faults * len(faults):  # one may mislead the other's fit
        evidence = _fault_refit(fault, evidence, refits)
    in_tension = [effect for effect in effects if effect.enters in ("tension", "sensor:tension")]
    for effect in in_tension:  # the motion is traced along them
        evidence = replace(evidence, baseline=without_effect(evidence.baseline, effect))
    state = refits.evaluated(evidence)
    for effect in in_tension:
        state = _with_tension(effect, state, refits)
    return [state.errors, *true]


def _fault_refit(fault: SensorFault, evidence: WhitenedResidual, refits: ImpactRefits) -> WhitenedResidual:
    """A fault's numbers by the records before the hits, or else by what is left of it after these."""
    bare = refits.followed(without_effect(evidence.baseline, fault), evidence.floors)
    told = next(
        (e.effect for e in at_rest.explain(bare, refits.options) if e.effect.path == fault.path), None
    )
    if told is not None:
        near = replace(bare.baseline, model=told.added_to(bare.baseline.model))
        return refit(refits.followed(near, evidence.floors))
    while True:
        (own,) = (e for e in evidence.baseline.model.effects if e.path == fault.path)
        assert isinstance(own, SensorFault)
        again = refit(refits.followed(refit_fault(evidence, own), evidence.floors))
        if not cost(again) < (1 - _SETTLED) * cost(evidence):
            return min(evidence, again, key=cost)
        evidence = again


def _with_tension(effect: ModelCorrection, state: State, refits: ImpactRefits) -> State:
    """The state with an effect in the tension fitted beside the law; as it is where that asks for none."""
    residual = refits.tension(state)
    one = None if residual is None else tension.explain_one(residual, refits.options, effect.path)
    if one is None:
        raise ValueError(f"oracle: the tension tells nothing of {effect.name}")
    return adopted(refits, state, one) if any(one.gains(hold_out=False)) else state


def _true(truth: Truth, evidence: WhitenedResidual) -> ModelCorrection:
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
