"""Between modal bodies and sensors: what sensors show of a simulation, and what forces do to the modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import signal

from rom.campaign.channels import Channel, FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.model.assembly import Response
from rom.model.model import Model
from rom.signals.frequency_band import Band
from rom.signals.processing import Measurement

_ABOVE_BAND: Numerical[float] = 1.2  # times its upper end
_LEAST: Numerical[float] = 0.5  # of half the rate, from which lines tell noise
_MOST: Numerical[float] = 0.8  # the same where the band reaches higher


def as_sensors_show(
    model: Model, response: Response, measurement: Measurement
) -> Mapping[str, Mapping[str, FloatArray]]:
    """Return a response's motion by quantity and body; of a model of modes, by quantity and sensor.

    A simulation joins samples of force that are a little sharper than the measured ones, so that straight
    lines have their spectrum; an accelerometer shows the measured ones at once. (Of a hit that is nothing
    beside what samples leave open of its pulse.)

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
    motion: dict[str, Mapping[str, FloatArray]] = {kind: getattr(response, kind) for kind in kinds}
    if measurement.test == "driven" and "acceleration" in motion:
        by_samples = by_measured_force(model, response, measurement)
        motion["acceleration"] = {**motion["acceleration"], **by_samples}
    if model.shapes is None:
        return motion
    sensors = tuple(measurement.motion)
    return model.shapes.sensed(motion, measurement.applied_force, measurement.rate_hz, sensors)


def by_measured_force(model: Model, response: Response, measurement: Measurement) -> dict[str, FloatArray]:
    """Return accelerations of the bodies that forces act on, with the forces as they were sampled.

    Parameters
    ----------
    model : Model
        What was simulated.
    response : Response
        Of its bodies.
    measurement : Measurement
        The record, for its forces.

    Returns
    -------
    dict of str to ndarray
        By body [m/s2].
    """
    masses = in_record(model, measurement.given).structure.bodies
    blunter = {place: measurement.force[place] - f for place, f in measurement.applied_force.items()}
    acting = blunter if model.shapes is None else model.shapes.on_modes(blunter)
    return {
        body.name: response.acceleration[body.name] + acting[body.name] / body.mass
        for body in masses
        if body.name in acting and body.name in response.acceleration
    }


def forces_of(model: Model, measurement: Measurement) -> Mapping[str, FloatArray]:
    """Return the forces of a record on the bodies of a model [N], by body.

    Raises
    ------
    ValueError
        If the modes are not known where the record is driven: no sensor stands there and no training record
        was driven there.
    """
    if model.shapes is None:
        return measurement.applied_force
    known = (*model.shapes.sensors, *model.shapes.forces)
    if unknown := [place for place in measurement.applied_force if place not in known]:
        raise ValueError(
            f"{measurement.file}: force_{unknown[0]}: found no mode shape there, expected a sensor or a "
            f"training record driven there; known are {', '.join(dict.fromkeys(known))}"
        )
    return model.shapes.on_modes(measurement.applied_force)


def slowest_mode(model: Model) -> float:
    """Frequency of the slowest mode [Hz]: parts of a record must hold periods of all."""
    masses = {body.name: body.mass for body in model.structure.bodies}
    squares = [float(model.link_laws[mode].stiffness(0.0)) / masses[mode] for mode in masses]
    return float(np.sqrt(max(min(squares), 0.0)) / (2 * np.pi))


def quiet_noise(channel: Channel, band_hz: Band | None) -> float:
    """Standard deviation of a sensor's white noise, by the median line above the band: modes ring there too.

    The median of the power of white noise is ln 2 of its mean.
    """
    samples = channel.samples - channel.samples.mean()
    window = signal.windows.hann(len(samples))
    power = np.abs(np.fft.rfft(samples * window)) ** 2 / float(np.sum(window**2))
    frequency = np.fft.rfftfreq(len(samples), 1 / channel.rate_hz)
    first = _ABOVE_BAND * (0.0 if band_hz is None else band_hz[1])
    above = power[frequency >= min(max(first, _LEAST * frequency[-1]), _MOST * frequency[-1])]
    return float(np.sqrt(np.median(above) / np.log(2)))
