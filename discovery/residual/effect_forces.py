"""Forces of a model's effects along the motion that was measured in a record, and their spectra."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from discovery.residual.array_cache import ArrayCache
from discovery.residual.trajectory import MeasuredTrajectory
from rom.campaign.channels import FloatArray
from rom.effects import Effect, ModelCorrection, in_record, with_stiffness
from rom.effects.free_form import FreeForm
from rom.identification.spectral_model import ComplexArray, SpectralRecord
from rom.kernels.prescribed import force_of_effects, forces_of_effects
from rom.model.laws import Law
from rom.model.model import Model
from rom.signals.per_record_parameters import per_record_names

_CACHE = ArrayCache(300_000_000)


def effect_lines(
    trace: MeasuredTrajectory, effects: Sequence[Effect], model: Model
) -> tuple[list[ComplexArray], FloatArray] | None:
    """Spectra of the forces of effects at one place along a record's motion; None where they cannot act.

    Parameters
    ----------
    trace : MeasuredTrajectory
        The record; it keeps the spectra that were asked for last.
    effects : sequence of Effect
        All at one place, each by itself.
    model : Model
        An effect may depend on the stiffness and damping of its link.

    Returns
    -------
    lines : list of ndarray, each of shape (lines, effects)
        Spectra of the forces [N s], by part of the record.
    direction : ndarray, shape (bodies,)
        What such a force does to the bodies: it pulls the first end back.
    """
    ends = _ends(trace, effects[0].enters, model)
    if ends is None:
        return None
    if trace.measurement.given:
        model = in_record(model, trace.measurement.given)
        effects = [with_stiffness(effect, model) for effect in effects]
    own = [
        effect.with_values(**trace.own[effect.path]) if effect.path in trace.own else effect
        for effect in effects
    ]
    place = (trace.token, effects[0].enters, *_laws(model, effects[0].enters))
    keys = [(*place, effect.equation, *effect.values.tolist()) for effect in own]
    known = {key: lines for key in keys if (lines := _CACHE.get(key)) is not None}
    new = {key: effect for key, effect in zip(keys, own, strict=True) if key not in known}
    if new:
        forces = _forces(
            list(new.values()), trace.rate_hz, _motion(trace, effects[0].enters, model, ends, place)
        )
        parts = [trace.force_lines(forces, part) for part in range(len(trace.parts))]
        for row, key in enumerate(new):
            known[key] = [lines[row].copy() for lines in parts]
            _CACHE.keep(key, known[key])
    lines = [
        np.stack([known[key][part] for key in keys], axis=1, dtype=np.complex128)
        for part in range(len(trace.parts))
    ]
    return lines, trace.direction(ends)


def lines_beyond_linear(trace: MeasuredTrajectory, model: Model) -> list[ComplexArray]:
    """Spectra of the forces on the bodies that are not in the model's linear part, (lines, bodies) by part.

    Those of its effects, and of a bolted link whose stiffness and damping change as the tension falls.
    """
    total = [np.zeros_like(part.force) for part in trace.parts]
    for link in model.structure.links:
        if link.law == "bolted" and trace.measurement.test != "uncoupled" and np.ptp(trace.tension) > 0:
            ends = (link.first, link.second)
            x, v = trace.relative(ends)
            laws = model.link_laws[link.name]
            stiffness = np.asarray(laws.stiffness(trace.tension)) - float(laws.stiffness(trace.level))
            damping = np.asarray(laws.damping(trace.tension)) - float(laws.damping(trace.level))
            force = (stiffness * x + damping * v)[None]
            for place, on_bodies in enumerate(total):
                on_bodies += trace.force_lines(force, place)[0][:, None] * trace.direction(ends)
    for effect in model.effects:
        found = effect_lines(trace, [effect], model) if isinstance(effect, Effect) else None
        if found is not None:
            for on_bodies, lines in zip(total, found[0], strict=True):
                on_bodies += lines * found[1]
    return total


def lasting_force(trace: MeasuredTrajectory, effects: Sequence[ModelCorrection], samples: int) -> FloatArray:
    """Force [N] of a record's first samples on its bodies that acts all the time, (samples, bodies).

    That of effects with numbers of each record's own; others wait for the hit.

    Parameters
    ----------
    trace : MeasuredTrajectory
        The record, with its own numbers of the effects.
    effects : sequence of ModelCorrection
        All of the model.
    samples : int
        Samples at the record's own rate.

    Returns
    -------
    ndarray, shape (samples, bodies)
        Force [N], zero where no effect has numbers of the record's own.
    """
    out = np.zeros((samples, len(trace.bodies)))
    for effect in effects:
        body = effect.enters.partition(":")[2]
        if isinstance(effect, Effect) and per_record_names(effect) and body in trace.bodies:
            own = effect.with_values(**trace.own.get(effect.path, {}))
            table, still = np.array([[own.address, 0, 0]]), np.zeros((5, samples))
            step_s = 1 / trace.measurement.rate_hz
            force = force_of_effects(table, own.values, still, step_s, np.zeros(own.states + 1), 0.0)
            out[:, trace.bodies.index(body)] -= np.asarray(force)
    return out


def lasting_lines(trace: MeasuredTrajectory, effects: Sequence[Effect]) -> list[ComplexArray]:
    """Spectra of forces that depend on time alone, (lines, effects) by part; the same in records alike."""
    samples, places = len(trace.tension), range(len(trace.parts))
    key = (trace.stride, samples, *(_grid(trace, part) for part in trace.parts), *_equations(effects))
    lines = _CACHE.get(key)
    if lines is None:
        forces = _forces_in_time(effects, trace.rate_hz, samples)
        lines = [trace.force_lines(forces, place).T for place in places]
        _CACHE.keep(key, lines)
    return list(lines)


def lines_from_start(
    trace: MeasuredTrajectory, effects: Sequence[Effect], segment: SpectralRecord
) -> ComplexArray:
    """Spectra of forces that depend on time alone in a segment of a record, (lines, effects).

    Parameters
    ----------
    trace : MeasuredTrajectory
        The record, at whose own rate the forces are.
    effects : sequence of Effect
        Forces on one body, each by itself.
    segment : SpectralRecord
        Part of the record.

    Returns
    -------
    ndarray of complex, shape (lines, effects)
        Spectra of the forces [N s].
    """
    key = (_grid(trace, segment), *_equations(effects))
    held = _CACHE.get(key)
    if held is None:
        forces = _forces_in_time(effects, trace.measurement.rate_hz, segment.samples[1])
        held = [np.stack([trace.lines(force, segment) for force in forces], axis=1)]
        _CACHE.keep(key, held)
    return np.asarray(held[0])


def _grid(trace: MeasuredTrajectory, part: SpectralRecord) -> tuple[Hashable, ...]:
    """What tells the samples and the lines of a part from those of others."""
    return trace.measurement.rate_hz, part.samples, float(part.frequency[0]), len(part.frequency)


def _equations(effects: Sequence[Effect]) -> list[tuple[Hashable, ...]]:
    return [(effect.equation, *effect.values.tolist()) for effect in effects]


def _ends(trace: MeasuredTrajectory, enters: str, model: Model) -> tuple[str, str] | None:
    """What an effect acts between; None where that does not move in the record, or is not bolted."""
    link = next((one for one in model.structure.links if one.name == enters), None)
    ends = (link.first, link.second) if link is not None else (enters.partition(":")[2], "ground")
    if not set(ends) & set(trace.bodies):
        return None
    if link is not None and link.law == "bolted" and trace.measurement.test == "uncoupled":
        return None
    return ends


def _laws(model: Model, enters: str) -> tuple[Hashable, ...]:
    """What tells the stiffness and damping laws of a link from others."""
    laws = model.link_laws.get(enters)
    both: tuple[Law, ...] = () if laws is None else (laws.stiffness, laws.damping)
    return tuple((law.equation, *law.values.tolist()) for law in both)


def _motion(
    trace: MeasuredTrajectory, enters: str, model: Model, ends: tuple[str, str], key: Hashable
) -> FloatArray:
    """Relative displacement and velocity, tension, stiffness and damping of the link, (5, samples)."""
    held = _CACHE.get(key)
    if held is not None:
        return np.asarray(held[0], dtype=np.float64)
    motion = np.zeros((5, len(trace.tension)))
    motion[0], motion[1] = trace.relative(ends)
    motion[2] = trace.tension
    laws = model.link_laws.get(enters)
    if laws is not None:
        motion[3], motion[4] = laws.stiffness(trace.tension), laws.damping(trace.tension)
    _CACHE.keep(key, [motion])
    return motion


def _forces_in_time(effects: Sequence[Effect], rate_hz: float, samples: int) -> FloatArray:
    """Force [N] of effects that depend on time alone, (effects, samples)."""
    key = (rate_hz, samples, *_equations(effects))
    held = _CACHE.get(key)
    if held is None:
        held = [_forces(effects, rate_hz, np.zeros((5, samples)))]
        _CACHE.keep(key, held)
    return np.asarray(held[0])


def _forces(effects: Sequence[Effect], rate_hz: float, motion: FloatArray) -> FloatArray:
    """Force [N] of every effect along the motion, (effects, samples)."""
    if all(isinstance(effect, FreeForm) for effect in effects):
        return np.stack([effect.along(motion) for effect in effects if isinstance(effect, FreeForm)])
    numbers = [effect.values for effect in effects]
    first = np.cumsum([0, *(len(values) for values in numbers)])
    table = np.array([[e.address, at, e.states] for e, at in zip(effects, first, strict=False)])
    p = np.array([*np.concatenate(numbers), 0.0])
    states = np.zeros((len(effects), max((effect.states for effect in effects), default=0)))
    for row, effect in zip(states, effects, strict=True):
        row[: effect.states] = effect.first_states(*motion[:2, 0])
    return np.asarray(forces_of_effects(table, p, motion, 1 / rate_hz, states))
