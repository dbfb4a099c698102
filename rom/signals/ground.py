"""A record whose ground moves, told relative to it: the ground then rests, and a force acts on every mass.

m_i (y_i'' + a_g) + ... = F_i,   y_i = x_i - x_g   <=>   m_i y_i'' + ... = F_i - m_i a_g
"""

from __future__ import annotations

import numpy as np
from scipy import interpolate

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import GROUND_CHANNELS, Channel, FloatArray
from rom.signals.decimation import decimate
from rom.signals.processing import driven_displacement


def relative_to_ground(record: Record, settings: CampaignSettings) -> Record:
    """Return the record as seen from its ground; itself where no motion of the ground was measured.

    Where both were measured the acceleration tells the force and the displacement the relative motion.
    """
    shown = [record.channels[name] for name in GROUND_CHANNELS if name in record.channels]
    if not shown:
        return record
    used = [*shown, *(record.motion(body)[1] for body in record.bodies)]
    used += [force for body in record.bodies if (force := record.force(body)) is not None]
    rate = min(channel.rate_hz for channel in used)
    samples = min(len(_at(channel, rate)) for channel in used)
    ground = {c.name.partition("_")[0]: _at(c, rate)[:samples] for c in shown}
    masses = {body.name: body.mass_kg or 0.0 for body in settings.body}
    push = _derived(ground, "acceleration", rate)
    channels = {name: c for name, c in record.channels.items() if name not in GROUND_CHANNELS}
    for body in record.bodies:
        kind, channel = record.motion(body)
        force, mass = record.force(body), record.settings.given.get(f"body.{body}.mass", masses[body])
        moved = _at(channel, rate)[:samples] - _derived(ground, kind, rate)
        acting = (0.0 if force is None else _at(force, rate)[:samples]) - mass * push
        channels[channel.name] = Channel(channel.name, moved, rate)
        channels[f"force_{body}"] = Channel(f"force_{body}", acting, rate)
    return Record(record.settings, channels, record.bodies, relative=True)


def _at(channel: Channel, rate_hz: float) -> FloatArray:
    samples = channel.samples
    return samples if channel.rate_hz == rate_hz else decimate(samples, channel.rate_hz, rate_hz)


def _derived(ground: dict[str, FloatArray], kind: str, rate_hz: float) -> FloatArray:
    """Motion of the ground of a kind: as measured, or derived from its displacement without the noise above.

    By a quintic spline.
    """
    if kind in ground:
        return ground[kind]
    order = {"velocity": 1, "acceleration": 2}[kind]
    time = np.arange(len(ground["displacement"])) / rate_hz
    smooth = driven_displacement(Channel("", ground["displacement"], rate_hz))
    spline = interpolate.make_interp_spline(time, smooth, k=5)
    return np.asarray(spline.derivative(order)(time))
