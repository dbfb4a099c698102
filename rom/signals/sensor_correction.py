"""A record as its sensors would have shown it without the faults that a model knows of.

Faults are corrected in processing, on the measured side, before anything is filtered: a force must be right
before it drives a simulation, and an error relative to the true motion keeps its meaning. Noise goes with the
samples: gains and skews leave it as strong as the signal makes it, and the slow noise that undoing a roll-off
lets grow lies below the high-pass of the chain. Only a fit must not be judged by it alone, since a fault that
shrinks the measured side shrinks every error in its units with it: errors relative to the motion do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE
from rom.model.effect import SensorFault
from rom.model.model import Model
from rom.signals.motion import Motion
from rom.signals.processing import IMPACT_TESTS, Measurement, TensionRecord, tension_record


def faults_of(model: Model) -> tuple[SensorFault, ...]:
    """Return the faults of sensors that a model holds, in order."""
    return model.effects_of("sensor fault")


def moves_levels(fault: SensorFault) -> bool:
    """Return whether a fault moves a constant level, alike in all records."""
    level = np.full(64, 100.0)
    return not CATALOGUE[fault.name].by_record and not np.allclose(fault.apply(level, 1e3), level)


def corrected(measurement: Measurement, model: Model) -> Measurement:
    """Return a processed record without the faults of sensors that a model holds; see `without_faults`."""
    return without_faults(measurement, faults_of(model))


def without_faults(measurement: Measurement, faults: Sequence[SensorFault]) -> Measurement:
    """Return a processed record without faults of its sensors.

    The last fault is taken out first. A hammer's force, zero outside its contacts, stays so. What no channel
    of the record shows is left alone.

    Raises
    ------
    ValueError
        Where a tension came without the windows over which its means are taken.
    """
    for fault in reversed(faults):
        measurement = _without(measurement, fault)
    return measurement


def true_hit(force: FloatArray, rate_hz: float, faults: Sequence[SensorFault]) -> FloatArray:
    """Return a hammer's force [N], zero outside its contacts, without faults of its channel.

    Parameters
    ----------
    force : ndarray, shape (samples,)
        Force [N].
    rate_hz : float
        Sampling rate [Hz].
    faults : sequence of SensorFault
        Faults of sensors that are known and taken out.

    Returns
    -------
    ndarray
        Force [N], shape (samples,).
    """
    for fault in reversed(faults):
        force = np.where(force != 0.0, fault.remove(force, rate_hz), 0.0)
    return force


def _without(measurement: Measurement, fault: SensorFault) -> Measurement:
    channel = fault.channel
    if channel == "tension" and measurement.tension is not None:
        return replace(measurement, tension=_tension(measurement, measurement.tension, fault))
    if channel in measurement.link:
        shown = measurement.link[channel]
        true = replace(shown, samples=fault.remove(shown.samples, shown.rate_hz))
        return replace(measurement, link={**measurement.link, channel: true})
    quantity, _, body = channel.partition("_")
    if quantity == "force" and body in measurement.force:
        force = measurement.force[body]
        struck = measurement.test in IMPACT_TESTS
        force = (
            true_hit(force, measurement.rate_hz, [fault])
            if struck
            else fault.remove(force, measurement.rate_hz)
        )
        still = {
            b: fault.remove(f, measurement.rate_hz) for b, f in measurement.still_force.items() if b == body
        }
        return replace(
            measurement,
            force={**measurement.force, body: force},
            still_force={**measurement.still_force, **still},
        )
    if body in measurement.motion and measurement.motion[body].kind == quantity:
        return _without_in_motion(measurement, fault, body)
    return measurement


def _without_in_motion(measurement: Measurement, fault: SensorFault, body: str) -> Measurement:
    shown = measurement.motion[body]
    other: FloatArray | None = None
    if fault.other:
        others = [m.samples for b, m in measurement.motion.items() if b != body and m.kind == fault.other]
        if not others:  # the other body rests
            return measurement
        other = others[0]
    samples = fault.remove(shown.samples, measurement.rate_hz, other)
    return replace(measurement, motion={**measurement.motion, body: Motion(shown.kind, samples)})


def _tension(measurement: Measurement, shown: TensionRecord, fault: SensorFault) -> TensionRecord:
    if shown.windows is None:
        raise ValueError(
            f"{measurement.file}: a fault of the tension needs the windows of its means, got none"
        )
    return tension_record(
        fault.remove(shown.samples, shown.rate_hz),
        shown.rate_hz,
        shown.windows,
        impact_s=measurement.impact_s,
        first_mode_hz=measurement.strongest_hz if measurement.test != "hold" else None,
        slope=shown.slope,
        warnings=shown.warnings,
    )
