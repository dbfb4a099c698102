"""What an effect changes in the whitened output of a model, and its slopes by the effect's numbers.

A force acts along the motion that was measured; a fault changes what the sensor shows of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discovery.explain.probes import cut_to_bounds
from discovery.residual.effect_forces import effect_lines
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.trajectory import MeasuredTrajectory
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Effect, ModelCorrection, SensorFault
from rom.identification.spectral_model import Linearised

_DIFFERENCE: Numerical[float] = 1e-3  # of a parameter's size


def output_of(effect: ModelCorrection, residual: WhitenedResidual) -> FloatArray:
    """Whitened change of the output that an effect makes on all records, (rows,)."""
    return outputs_of([effect], residual)[:, 0]


def outputs_of(effects: Sequence[ModelCorrection], residual: WhitenedResidual) -> FloatArray:
    """Whitened changes of the output by effects at one place, each by itself, (rows, effects)."""
    out = np.zeros((len(residual.residual), len(effects)))
    forces = [effect for effect in effects if isinstance(effect, Effect)]
    for trace, parts in residual.by_record():
        if forces:
            found = effect_lines(trace, forces, residual.baseline.model)
            if found is not None:
                for (rows, linear), lines in zip(parts, found[0], strict=True):
                    out[rows] = linear.projected_forces(found[1], lines)
            continue
        for column, effect in enumerate(effects):
            assert isinstance(effect, SensorFault)
            _add_fault(effect, trace, parts, out[:, column])
    return out


def _add_fault(
    fault: SensorFault, trace: MeasuredTrajectory, parts: Sequence[tuple[slice, Linearised]], out: FloatArray
) -> None:
    """Fill the rows of a record with what a fault changes in them."""
    quantity, _, body = fault.channel.partition("_")
    change = _change_of_channel(fault, trace) if body in trace.bodies else None
    if change is None:
        return
    place = trace.bodies.index(body)
    for (rows, linear), part in zip(parts, trace.parts, strict=True):
        lines = trace.lines(change, part)
        if quantity == "force":
            out[rows] = linear.projected(linear.gain[:, :, place] * lines[:, None])
        else:
            shown = np.zeros(part.motion.shape, dtype=np.complex128)
            shown[:, place] = lines
            out[rows] = linear.projected(shown)


def _change_of_channel(fault: SensorFault, trace: MeasuredTrajectory) -> FloatArray | None:
    """What the true force exceeds the shown one by, or the shown motion the true one; None without it."""
    seen, (quantity, _, body) = trace.measurement, fault.channel.partition("_")
    if quantity == "force":
        if body not in seen.force:
            return None
        shown = seen.force[body].astype(np.float64)
        return np.where(shown != 0, fault.remove(shown, seen.rate_hz) - shown, 0.0)
    if seen.motion[body].kind != quantity:
        return None
    others = [m.samples for other, m in seen.motion.items() if other != body and m.kind == quantity]
    if fault.other and not others:
        return None
    shown = seen.motion[body].samples.astype(np.float64)
    return np.asarray(shown - fault.remove(shown, seen.rate_hz, others[0] if fault.other else None))


def slopes_of(
    effect: ModelCorrection, names: Sequence[str], sizes: FloatArray, residual: WhitenedResidual
) -> FloatArray:
    """Slopes of an effect's output by its numbers, (rows, numbers).

    By differences; by a strength that alone is not zero an output with memory is its multiple.

    Parameters
    ----------
    effect : ModelCorrection
        A force or a sensor's fault.
    names : sequence of str
        Its numbers.
    sizes : ndarray, shape (numbers,)
        What each is counted in, in its own unit.
    residual : WhitenedResidual
        The records, and the model beside which it is.

    Returns
    -------
    ndarray, shape (rows, numbers)
        Change of the whitened output by one size of each number.
    """
    if not names:
        return np.zeros((len(residual.residual), 0))
    alone, steps, moved = _lone_strength(effect), {}, []
    for name, size in zip(names, sizes, strict=True):
        old = effect.parameters[name]
        ahead = old.value + _DIFFERENCE * size
        ahead = ahead if ahead <= old.bounds[1] else old.value - _DIFFERENCE * size
        if name != alone:
            moved.append(cut_to_bounds(effect, {name: ahead}))
        steps[name] = ahead - old.value
    outputs = outputs_of([effect, *moved], residual)
    here, changes = outputs[:, 0], iter(outputs.T[1:])
    slopes = np.empty((len(here), len(names)))
    for column, (name, size) in enumerate(zip(names, sizes, strict=True)):
        if name == alone:
            slopes[:, column] = here * (size / effect.parameters[name].value)
        else:
            slopes[:, column] = (next(changes) - here) * (size / steps[name])
    return slopes


def _lone_strength(effect: ModelCorrection) -> str | None:
    """The one strength of an effect with memory that is linear in it and has no other."""
    member = CATALOGUE.get(effect.name)
    if member is None or not member.linear or not (isinstance(effect, Effect) and effect.states):
        return None
    strengths = [name for name in member.strengths if effect.parameters[name].value]
    return strengths[0] if len(member.strengths) == len(strengths) == 1 else None
