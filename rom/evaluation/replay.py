"""A record run again by a model: what drives it and how it starts comes from the record alone.

Faults of sensors that the model holds are taken out of the record first (``rom.signals.sensor_correction``),
numbers that
are each record's own are estimated from before its impact (``rom.signals.per_record_parameters``), and what
a gauge shows
beyond the tension is added to the simulated one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rom.campaign.channels import Channel, FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.effects.observation import motion_of
from rom.identification.modal_sensors import as_sensors_show, by_measured_force, forces_of
from rom.identification.ring_down import of_moving, ring_down
from rom.identification.ring_down_states import fitted_state
from rom.model.assembly import TOLERANCE, Response
from rom.model.model import Model
from rom.signals.filters import displacement
from rom.signals.per_record_parameters import at_rest, own_numbers
from rom.signals.processing import (
    Measurement,
    TensionRecord,
    driven_displacement,
    grows_from_rest,
    non_oscillatory,
)
from rom.signals.sensor_correction import corrected

_STATE_ITERATIONS: Numerical[int] = 3
_FIRST: Numerical[int] = 64  # samples tell the start of a driven record


@dataclass(frozen=True)
class Replay:
    """A record without the faults that a model knows of, the model as it is in that record, its response."""

    model: Model
    measurement: Measurement
    response: Response


def replay(model: Model, measurement: Measurement, tolerance: float = TOLERANCE) -> Replay:
    """Run a record again from its measured force and initial tension.

    The initial state of a free record is fitted to it. A driven record may have been cut from a longer run:
    where its displacement was measured and a force acts, its state is fitted to its first samples, else to
    the whole record. Others, and all with a bolt, start at rest.

    Parameters
    ----------
    model : Model
        The model.
    measurement : Measurement
        The record.
    tolerance : float
        That of ``Model.simulate``, of records that start at rest.

    Returns
    -------
    Replay
        The record without faults, the model as it is there, and its response.

    Raises
    ------
    ValueError
        Where a bolted model is asked for a record that gives no initial tension.
    """
    model = in_record(model, measurement.given)
    if measurement.test == "uncoupled":
        model = model.without_bolt()
    model = of_moving(model, tuple(measurement.motion))
    model, state = own_numbers(model, measurement, _initial_tension(model, corrected(measurement, model)))
    seen = corrected(measurement, model)
    acting = forces_of(model, seen)
    force = {body: f for body, f in acting.items() if body in model.structure.body_names}
    if not force:
        force = {model.structure.body_names[0]: np.zeros(seen.samples)}
    tension = _initial_tension(model, seen)
    if seen.motion and (seen.test == "free" or _shows_no_start(model, seen)):
        ring = ring_down(seen, model)
        return Replay(model, seen, ring.response(model, fitted_state(ring, model, tension=tension), tension))
    if starts_at_first_samples(model, seen):
        return Replay(model, seen, _from_first_samples(model, seen, force, tension, _FIRST))
    at, moving = (state.displacement, state.velocity) if state is not None else (None, None)
    return Replay(model, seen, model.simulate(force, seen.rate_hz, tension, at, moving, tolerance))


def simulate_measurement(model: Model, measurement: Measurement) -> Response:
    """Simulate a record from its measured force and initial tension: the response of ``replay``.

    Of a model of modes its motion is that of the sensors.
    """
    run = replay(model, measurement)
    if run.model.shapes is None:
        return run.response
    motion = {kind: getattr(run.response, kind) for kind in ("displacement", "velocity", "acceleration")}
    seen = run.measurement
    motion["acceleration"] = {
        **motion["acceleration"], **by_measured_force(run.model, run.response, seen)
    }  # fmt: skip
    shown = run.model.shapes.sensed(motion, seen.applied_force, seen.rate_hz, tuple(seen.motion))
    x, v, a = (shown[kind] for kind in motion)
    return replace(run.response, displacement=x, velocity=v, acceleration=a)


def displacements(runs: Sequence[Replay]) -> tuple[Mapping[str, FloatArray], ...]:
    """Return displacements [m] of one record's replays, by body or sensor, as the filter chain shows them."""
    if not runs:
        return ()
    measurement = runs[0].measurement
    motions = [as_sensors_show(run.model, run.response, run.measurement) for run in runs]
    found: list[dict[str, FloatArray]] = [{} for _ in runs]
    for kind in {motion.kind for motion in measurement.motion.values()}:
        bodies = [body for body, motion in measurement.motion.items() if motion.kind == kind]
        rows = [motion[kind][body] for motion in motions for body in bodies]
        filtered = iter(displacement(kind, np.stack(rows), measurement.rate_hz, measurement.chain))
        for of_run in found:
            of_run.update((body, next(filtered)) for body in bodies)
    return tuple(found)


def shown_tension(run: Replay, tension: TensionRecord) -> tuple[FloatArray, FloatArray]:
    """Return what the gauge shows of a simulated tension [N], and that without its oscillation.

    At the samples of the measured tension, and through the split that it passed: this spreads the steps in
    which a tension falls too.
    """
    time = np.arange(len(tension.samples)) / tension.rate_hz
    shown = np.interp(time, run.response.time, np.asarray(run.response.tension))
    readings, seen = run.model.effects_of("reading"), run.measurement
    if readings:
        motion = motion_of(run.model, run.response, seen.impact_s or 0.0)
        added = sum(reading.added(motion) for reading in readings)
        shown = shown + np.interp(time, run.response.time, added)
    first_mode = seen.strongest_hz if seen.test != "hold" else None
    return shown, non_oscillatory(shown, tension.rate_hz, seen.impact_s, first_mode)


def window_mean(samples: FloatArray, rate_hz: float, window_s: tuple[float, float]) -> float:
    """Return the mean over a time window, cut at the record's end.

    Parameters
    ----------
    samples : ndarray, shape (..., samples)
        Samples.
    rate_hz : float
        Sampling rate [Hz].
    window_s : tuple of float
        Window [s], from and to.

    Returns
    -------
    float
        In the unit of the samples.
    """
    inside = samples[int(window_s[0] * rate_hz) : int(window_s[1] * rate_hz)]
    return float(inside.mean()) if len(inside) else float(samples[-1])


def driven_forces(model: Model, measurement: Measurement) -> Mapping[str, tuple[FloatArray, FloatArray]]:
    """Return simulated and measured force [N] of every link that a cycled record drives, by link.

    The link sees the measured normal force as its tension where there is one. Effects with memory start as
    the same motion backwards leaves them, what was before the record not being known, or without force where
    the cycles grow from rest.
    """
    model = in_record(model, measurement.given)
    seen, found = corrected(measurement, model), {}
    for name in model.structure.link_names:
        force, motion = seen.link.get(f"link_force_{name}"), seen.link.get(f"link_displacement_{name}")
        if force is None or motion is None:
            continue
        normal = seen.link.get(f"normal_force_{name}")
        x = driven_displacement(motion)
        if normal is not None:
            tension: FloatArray | float = _at_times(normal, motion)
        else:
            bolted = name in model.structure.bolted_links
            tension = (_initial_tension(model, seen) or {}).get(name, 0.0) if bolted else 0.0
        simulated = model.link_force(name, x, motion.rate_hz, tension, settled=not grows_from_rest(x))
        found[name] = _at_times(Channel(force.name, simulated, motion.rate_hz), force), force.samples
    return found


def _at_times(channel: Channel, of: Channel) -> FloatArray:
    """Samples of one channel at the times of another."""
    if channel.rate_hz == of.rate_hz and len(channel.samples) == len(of.samples):
        return channel.samples
    return np.asarray(np.interp(of.time, channel.time, channel.samples))


def tension_known(model: Model, measurement: Measurement) -> bool:
    """Return whether a record tells the tension at which its simulation starts, or the model needs none."""
    if measurement.test == "uncoupled":
        return True
    needed = any(
        law.sees_tension
        for link in model.structure.bolted_links
        for law in (model.link_laws[link].stiffness, model.link_laws[link].damping)
    )
    return not needed or measurement.tension is not None or measurement.preload_n is not None


def _initial_tension(model: Model, measurement: Measurement) -> Mapping[str, float] | None:
    bolts = model.structure.bolted_links
    if not bolts:
        return None
    if measurement.tension is not None:
        initial = measurement.tension.initial - _shown_at_rest(model, measurement, measurement.tension)
        return dict.fromkeys(bolts, max(initial, 0.0))
    if measurement.preload_n is not None:
        return dict.fromkeys(bolts, measurement.preload_n)
    if tension_known(model, measurement):
        return dict.fromkeys(bolts, 0.0)
    raise ValueError(
        f"{measurement.file}: found no strain, tension or preload_n, "
        "expected one of them as the initial tension of the bolted link"
    )


def _shown_at_rest(model: Model, measurement: Measurement, tension: TensionRecord) -> float:
    """Mean of what the readings of a model add to the tension [N] in the window of its initial value."""
    readings = model.effects_of("reading")
    if not readings or tension.windows is None:
        return 0.0
    first, last = tension.windows.initial_s
    last = min(last, measurement.impact_s or last)
    rest = at_rest(max(int(last * tension.rate_hz), 1), tension.rate_hz, measurement)
    return float(sum(reading.added(rest)[int(first * tension.rate_hz) :].mean() for reading in readings))


def starts_at_first_samples(model: Model, measurement: Measurement) -> bool:
    """Whether a driven record tells its own start: no bolt, and displacements, which no filter changes."""
    unfiltered = measurement.chain.band_hz is None
    shown = [unfiltered and motion.kind == "displacement" for motion in measurement.motion.values()]
    return measurement.test == "driven" and bool(shown) and all(shown) and not model.structure.bolted_links


def _shows_no_start(model: Model, measurement: Measurement) -> bool:
    """Whether a driven record without a bolt tells its state only as a whole."""
    if measurement.test != "driven" or model.structure.bolted_links:
        return False
    if model.shapes is not None:
        return True
    forced = any(np.any(force) for force in measurement.force.values())
    return not (forced and starts_at_first_samples(model, measurement))


def _from_first_samples(
    model: Model,
    measurement: Measurement,
    force: Mapping[str, FloatArray],
    tension: Mapping[str, float] | None,
    first: int,
) -> Response:
    """Fit every body's initial displacement and velocity by Gauss-Newton steps on its first displacements."""
    bodies = model.structure.body_names
    scale = max(float(np.abs(measurement.displacement(body)).max()) for body in measurement.motion)
    speed = scale * 2 * np.pi * _fastest_motion(measurement)
    unit = np.concatenate([np.full(len(bodies), scale or 1.0), np.full(len(bodies), speed or 1.0)])
    measured = np.concatenate([measurement.displacement(body)[:first] for body in measurement.motion])

    def respond(state: FloatArray, first: int | None = first) -> tuple[Response, FloatArray]:
        at, speed_at = np.split(state * unit, 2)
        response = model.simulate(
            {body: samples[:first] for body, samples in force.items()},
            measurement.rate_hz,
            tension,
            initial_displacement=dict(zip(bodies, at.tolist(), strict=True)),
            initial_velocity=dict(zip(bodies, speed_at.tolist(), strict=True)),
        )
        shown = displacements([Replay(model, measurement, response)])[0]
        return response, np.concatenate([shown[body][:first] for body in measurement.motion])

    state = np.zeros(2 * len(bodies))
    simulated = respond(state)[1]
    for _ in range(_STATE_ITERATIONS):
        step = 1e-2
        jacobian = np.stack(
            [(respond(state + step * e)[1] - simulated) / step for e in np.eye(len(state))], axis=1
        )
        if not np.isfinite(jacobian).all():
            break
        state = state + np.linalg.lstsq(jacobian, measured - simulated, rcond=None)[0]
        simulated = respond(state)[1]
    return respond(state, None)[0]


def _fastest_motion(measurement: Measurement) -> float:
    """Return a frequency [Hz] typical of the motion: RMS velocity over RMS displacement."""
    ratios = []
    for body in measurement.motion:
        x = measurement.displacement(body)
        ratios.append(
            float(np.std(np.diff(x)) * measurement.rate_hz / (2 * np.pi * max(float(np.std(x)), 1e-300)))
        )
    return max(ratios)
