"""From a simulated response to what a gauge shows of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rom.model.effect import FloatArray, Motion
from rom.model.link_force import force_of_effects

if TYPE_CHECKING:
    from rom.model.assembly import Response
    from rom.model.model import Model


def motion_of(model: Model, response: Response, impact_s: float = 0.0) -> Motion:
    """Motion of a model's bolted link, and of its bodies, at the samples of a response.

    The link's force is ``k(T) x + c(T) v`` and that of its effects.

    Parameters
    ----------
    model : Model
        The model.
    response : Response
        Its simulated response.
    impact_s : float
        Time of the impact [s] from the first sample.

    Returns
    -------
    Motion
        At the samples of the response.

    Raises
    ------
    ValueError
        If the model has not one bolted link.
    """
    bolted = [link for link in model.structure.links if link.law == "bolted"]
    if len(bolted) != 1:
        raise ValueError(f"a reading of the tension needs one bolted link, the model has {len(bolted)}")
    (link,), laws, tension = bolted, model.link_laws[bolted[0].name], np.asarray(response.tension)
    still = np.zeros_like(response.time)
    x, v = (
        of_body.get(link.first, still) - of_body.get(link.second, still)
        for of_body in (response.displacement, response.velocity)
    )
    stiffness, damping = laws.stiffness(tension), laws.damping(tension)
    force = stiffness * x + damping * v
    if len(response.time) > 1:
        along = np.stack([x, v, tension, stiffness, damping])
        force = force + force_of_effects(
            model.assembly, link.name, along, float(response.time[1] - response.time[0])
        )
    return Motion(response.time, impact_s, x, np.asarray(force), response.displacement)


def tension_reading(model: Model, response: Response, impact_s: float = 0.0) -> FloatArray:
    """What the bolt's gauge shows of a response: its tension and all readings of the model [N].

    Parameters
    ----------
    model : Model
        The model.
    response : Response
        Its simulated response.
    impact_s : float
        Time of the impact [s] from the first sample.

    Returns
    -------
    ndarray
        Reading [N], shape (samples,).

    Raises
    ------
    ValueError
        If the model has not one bolted link.
    """
    motion, shown = motion_of(model, response, impact_s), np.asarray(response.tension, dtype=np.float64)
    for reading in model.effects_of("reading"):
        shown = reading.apply(shown, motion)
    return shown
