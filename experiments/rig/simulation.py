"""One test on the rig: settle on the moving floor, strike, ring down."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from experiments.rig.equations import Floor, Pulse, integrator
from experiments.rig.excitation import FloatArray, Hit, floor_motion
from experiments.rig.plant import LooseningTerm, Plant

STEP_RATE_HZ = 76_800.0
"""Steps per second: four for every sample of force and acceleration, sixteen for every one of strain."""

SETTLING_RATE_HZ = 9_600.0
"""Steps per second while the structure settles on the moving floor before the record."""


class Motion(NamedTuple):
    """Absolute motion of both bodies and bolt tension at every step, SI units, shape (steps + 1,)."""

    time: FloatArray
    displacement_lo: FloatArray
    velocity_lo: FloatArray
    displacement_so: FloatArray
    velocity_so: FloatArray
    tension: FloatArray
    acceleration_lo: FloatArray
    acceleration_so: FloatArray


Contribution = Callable[..., tuple[float, float, float]]


@cache
def combine(contributions: tuple[Contribution, ...]) -> Contribution | None:
    """Compile one function that adds up the contributions of several effects; None for none."""
    if not contributions:
        return None
    first, rest = contributions[0], combine(contributions[1:])

    @njit(nogil=True)
    def total(time: float, state: Any, parameters: Any) -> tuple[float, float, float]:
        x_lo, v_lo, x_so, v_so, tension = state
        one = first(time, x_lo, v_lo, x_so, v_so, tension, parameters[0])
        if rest is None:
            return one
        others = rest(time, state, parameters[1:])
        return one[0] + others[0], one[1] + others[1], one[2] + others[2]

    return total


def system(plant: Plant, hit: Hit, floor: Floor, gamma_factor: float) -> tuple[Any, ...]:
    """Collect what the compiled derivative needs besides time and state."""
    # Compiled code cannot loop over nothing: a bolt that holds has one term without weight.
    terms = tuple(term.row(gamma_factor) for term in plant.loosening) or (LooseningTerm().row(0.0),)
    on_lo = float(hit.body == "lo")
    pulse = Pulse(on_lo, 1.0 - on_lo, hit.strength, hit.start, hit.start + hit.duration)
    parameters = tuple(effect.parameters for effect in plant.effects)
    return plant.constants(), terms, floor, pulse, parameters


def run(
    plant: Plant,
    hit: Hit,
    tension: float,
    duration: float,
    *,
    start: float = 0.0,
    gamma_factor: float = 1.0,
    floor_rms: float = 0.0,
    settling: float = 12.0,
    rng: np.random.Generator | None = None,
    step_rate_hz: float = STEP_RATE_HZ,
) -> Motion:
    """Integrate the rig through one hit.

    Equation: Eqs. 2, 5, 11-13 of He et al. (2025), the flexures standing on a floor that moves by x_g:
    ``m_i x_i'' + c_i (x_i' - x_g') + k_i (x_i - x_g) +- F_joint = F_i``.

    Parameters
    ----------
    plant : Plant
        The rig as assembled.
    hit : Hit
        The blow.
    tension : float
        Bolt tension at `start` [N].
    duration : float
        Time covered from `start` [s].
    start : float
        First instant returned [s].
    gamma_factor : float
        This record's factor on gamma; negative tightens.
    floor_rms : float
        RMS displacement of the floor [m].
    settling : float
        Time for which the structure has moved with the floor before `start` [s].
    rng : numpy.random.Generator
        Source of the floor's motion; needed where there is one.
    step_rate_hz : float
        Steps per second.

    Returns
    -------
    Motion
        ``round(duration * step_rate_hz) + 1`` instants.
    """
    integrate = integrator(combine(tuple(effect.contribution for effect in plant.effects)))
    state = (0.0, 0.0, 0.0, 0.0, float(tension))
    floor = Floor(0.0, np.empty(0), np.empty(0))
    if floor_rms > 0.0:
        if rng is None:
            raise ValueError("a moving floor needs a random generator, got none")
        early = start - settling
        floor = Floor(early, *floor_motion(floor_rms, early, start + duration, rng))
        before = np.empty((7, round(settling * SETTLING_RATE_HZ)))
        settled = integrate(early, SETTLING_RATE_HZ, state, system(plant, hit, floor, gamma_factor), before)
        state = (*settled[:4], float(tension))
    out = np.empty((7, round(duration * step_rate_hz) + 1))
    integrate(start, step_rate_hz, state, system(plant, hit, floor, gamma_factor), out)
    return Motion(start + np.arange(out.shape[1]) / step_rate_hz, *out)
