"""What the coefficients of a law take from the tension at first: the scales of a fit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import Candidate
from discovery.laws.given import GivenLaw
from rom.campaign.channels import FloatArray


def unit_losses(candidate: Candidate, frozen: FrozenMotion) -> dict[str, FloatArray]:
    """Relative loss over a whole test, the tension that before the hit, of every coefficient at 1.

    Parameters
    ----------
    candidate : Candidate
        The law; its inner numbers count, its coefficients do not.
    frozen : FrozenMotion
        Motion of the cases.

    Returns
    -------
    dict of str to ndarray, shape (cases,)
        By the coefficient's name.
    """
    initial = np.maximum(frozen.initial, 1e-9)
    if isinstance(candidate, GivenLaw):
        return {name: _of_given(candidate, name, frozen, initial) for name in candidate.scales}
    return {
        candidate.label("gamma", j): frozen.exposure(term.motion)[:, -1]
        * term.tension.of_tension(initial)
        / initial
        for j, term in enumerate(candidate.terms)
    }


def _of_given(candidate: GivenLaw, name: str, frozen: FrozenMotion, initial: FloatArray) -> FloatArray:
    free = (-math.inf, math.inf)
    parameters = {
        other: replace(p, value=float(other == name), bounds=free) if other in candidate.scales else p
        for other, p in candidate.parameters.items()
    }
    law = replace(candidate.rate, parameters=parameters)
    _, x, v, force, damping, _ = frozen.nodes
    held = np.repeat(initial, np.diff(frozen.starts))
    with np.errstate(all="ignore"):
        rate = np.nan_to_num(law.rate(held, x, v, force, damping), nan=0.0, posinf=0.0, neginf=0.0)
    return -frozen.integral(rate)[:, -1] / initial
