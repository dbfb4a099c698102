"""Fits of a whitened residual of impact tests: all numbers of a model, its effects' among them, together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from discovery.explain.effect_outputs import output_of, slopes_of
from discovery.explain.motion import explain_effect, free_numbers
from discovery.explain.probes import Probe
from discovery.residual.base import cost, level
from discovery.residual.free_parameters import FreeParameters, effect_number, size_of
from discovery.residual.output_error import WhitenedResidual, noise_of, whiten
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Effect, ModelCorrection, SensorFault

_REFITS: Numerical[int] = 5
_FROM_AFAR: Numerical[int] = 40
DAMPINGS: Numerical[tuple[float, ...]] = (0.0, 1e-4, 1e-2, 1.0)
"""Of steps that do not help undamped, in squares of their slopes."""
_SETTLED: Numerical[float] = 1e-4  # of the cost
_PACE: Numerical[int] = 5  # steps that tell how fast a fit goes
_FASTER: Numerical[float] = 10.0  # than that it may become


def refit(residual: WhitenedResidual, most: int = _REFITS, enough: float | None = None) -> WhitenedResidual:
    """Gauss-Newton steps in all numbers of a model, those of its effects among them, on training records.

    Damped ones where a free one does not lower the cost, none where that does not help either.

    Parameters
    ----------
    residual : WhitenedResidual
        Of the model where the fit starts.
    most : int
        Steps.
    enough : float
        Level of residual that a fit is of use below: one that is too slow to come there is given up. None:
        any is.
    """
    levels = [level(residual)]
    for left in reversed(range(most)):
        beside = with_effects(residual)
        steps = (residual.baseline.stepped(beside.steps(beside.residual, d)) for d in DAMPINGS)
        better = next(
            (one for step in steps if (one := residual.below(step, cost(residual))) is not None), None
        )
        if better is None:
            return beside
        done = cost(residual) - cost(better) < _SETTLED * cost(better)
        residual = better
        levels.append(level(residual))
        if done or (enough is not None and _too_slow(levels, left, enough)):
            break
    return with_effects(residual)


def _too_slow(levels: Sequence[float], left: int, enough: float) -> bool:
    """Whether the steps left, each many times as good as the last ones, would not lower a level enough."""
    if len(levels) <= _PACE or levels[-1] <= enough:
        return False
    pace = np.log(levels[-1 - _PACE] / levels[-1]) / _PACE
    return bool(np.log(levels[-1] / enough) > _FASTER * pace * left)


def refit_from_afar(residual: WhitenedResidual, enough: float | None = None) -> WhitenedResidual:
    """The same with as many steps as it takes: small ones, of a start that may be far from the plant."""
    return refit(residual, _FROM_AFAR, enough)


def linearised_start(residual: WhitenedResidual, effect: Effect) -> WhitenedResidual:
    """Return the residual with an effect in its model, whose numbers suit training records as slopes tell."""
    rows = residual.residual - output_of(effect, residual)
    here = float(np.sum(rows[residual.training] ** 2))
    for damping in DAMPINGS:
        moved = residual.baseline.stepped(residual.steps(rows, damping))
        beside = residual.below(replace(moved, model=effect.added_to(moved.model)), here)
        if beside is not None:
            return beside
    same = replace(residual.baseline, model=effect.added_to(residual.baseline.model))
    return residual.at(same)


def refit_fault(residual: WhitenedResidual, fault: SensorFault) -> FreeParameters:
    """Return the baseline with a fault of its model moved to where the records that it corrects want it.

    What is left of a fault that is small adds to it; from afar, slopes by all numbers are off.
    """
    member, baseline = CATALOGUE[fault.name], residual.baseline
    none = fault.with_values(**dict.fromkeys(member.strengths, 0.0))
    more = explain_effect([Probe(member, none, 0.0, 1.0, 1.0)], residual).effect
    values = {
        name: float(np.clip(p.value + more.parameters[name].value, *p.bounds))
        for name, p in fault.parameters.items()
        if name in member.strengths
    }
    moved = fault.with_values(**values)
    effects = tuple(moved if e.path == fault.path else e for e in baseline.model.effects)
    return replace(baseline, model=replace(baseline.model, effects=effects))


def reestimate_noise(residual: WhitenedResidual) -> WhitenedResidual:
    """Refit beside the noise of bodies struck alone as it is now, where an effect had passed for it."""
    floors = noise_of(residual.baseline, residual.traces, residual.criteria)
    both = residual.floors.keys() & floors.keys()  # none of a group's records may be simulable any more
    if all(
        residual.floors[one].sensor.max() < residual.criteria.closing.noise_ratio * floors[one].sensor.max()
        for one in both
    ):
        return residual
    return refit(whiten(residual.traces, residual.baseline, floors, residual.criteria))


def residual_without(residual: WhitenedResidual, effect: Effect) -> WhitenedResidual:
    """What a model leaves over without one of its effects, all other numbers as they are."""
    return residual.at(without_effect(residual.baseline, effect))


def without_effect(baseline: FreeParameters, effect: ModelCorrection) -> FreeParameters:
    """Return the baseline without one of its model's effects."""
    kept = tuple(e for e in baseline.model.effects if e.path != effect.path)
    return replace(baseline, model=replace(baseline.model, effects=kept))


def with_effects(residual: WhitenedResidual) -> WhitenedResidual:
    """The same with slopes by the numbers of the model's own forces; by those that it has once."""
    columns, names = [residual.jacobian], list(residual.names)
    for effect in residual.baseline.model.effects:
        if isinstance(effect, Effect):
            member = CATALOGUE.get(effect.name)
            free = tuple(effect.parameters) if member is None else free_numbers(effect, member)
            free = tuple(name for name in free if effect_number(effect, name) not in names)
            sizes = np.array([size_of(effect.parameters[name].value) for name in free])
            columns.append(slopes_of(effect, free, sizes, residual))
            names += [effect_number(effect, name) for name in free]
    return replace(residual, jacobian=np.concatenate(columns, axis=1), names=tuple(names))
