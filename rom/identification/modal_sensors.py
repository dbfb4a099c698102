"""Between modal bodies and sensors: what sensors show of a simulation, and what forces do to the modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rom.campaign.channels import FloatArray
from rom.model.assembly import Response
from rom.model.model import Model
from rom.signals.processing import Measurement


def as_sensors_show(
    model: Model, response: Response, measurement: Measurement
) -> Mapping[str, Mapping[str, FloatArray]]:
    """Return a response's motion by quantity and body; of a model of modes, by quantity and sensor.

    Parameters
    ----------
    model : Model
        What was simulated.
    response : Response
        Of its bodies.
    measurement : Measurement
        The record, for its sensors and forces.
    """
    kinds = dict.fromkeys(motion.kind for motion in measurement.motion.values())
    if model.shapes is None:
        return {kind: getattr(response, kind) for kind in kinds}
    motion: dict[str, Mapping[str, FloatArray]] = {kind: getattr(response, kind) for kind in kinds}
    sensors = tuple(measurement.motion)
    return model.shapes.seen(motion, measurement.applied_force, measurement.rate_hz, sensors)


def forces_of(model: Model, measurement: Measurement) -> Mapping[str, FloatArray]:
    """Return the forces of a record on the bodies of a model [N], by body."""
    if model.shapes is None:
        return measurement.applied_force
    return model.shapes.on_modes(measurement.applied_force)


def slowest_mode(model: Model) -> float:
    """Frequency of the slowest mode [Hz]: parts of a record must hold periods of all."""
    masses = {body.name: body.mass for body in model.structure.bodies}
    squares = [float(model.link_laws[mode].stiffness(0.0)) / masses[mode] for mode in masses]
    return float(np.sqrt(max(min(squares), 0.0)) / (2 * np.pi))
