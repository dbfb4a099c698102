"""The rig's own equations of motion and integrator: fourth-order Runge-Kutta far above the sampling rates."""

from collections.abc import Callable
from functools import cache
from math import exp, log, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from experiments.rig.excitation import FLOOR_RATE_HZ, FloatArray, Hit, floor_motion
from experiments.rig.plant import LooseningTerm, Plant

STEP_RATE_HZ = 76_800.0
"""Steps per second: four for every sample of force and acceleration, sixteen for every one of strain."""

SETTLING_RATE_HZ = 9_600.0
"""Steps per second while the structure settles on the moving floor before the record."""

LN10 = log(10.0)


class Pulse(NamedTuple):
    """A hit in the integrator's terms: share on LO and SO, peak [N], first and last contact [s]."""

    on_lo: float
    on_so: float
    strength: float
    start: float
    end: float


class Floor(NamedTuple):
    """Floor displacement [m] and velocity [m/s] at knots from `start` [s]."""

    start: float
    displacement: FloatArray
    velocity: FloatArray


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


@njit(nogil=True, cache=True, error_model="numpy")
def tension_rate(x: float, v: float, tension: float, terms: Any) -> float:
    """Sum of the terms of the tension law [N/s]; `terms` holds one `LooseningTerm.row` each."""
    rate = 0.0
    for factor, gamma_d, gamma_i, rho, p, q, v_0, x_0 in terms:
        speed, shift = abs(v) - v_0, abs(x) - x_0
        if (p > 0.0 and speed <= 0.0) or (q > 0.0 and shift <= 0.0):
            continue
        exponent = LN10 * (gamma_d - gamma_i / (1.0 + exp(rho * tension)))
        if p > 0.0:
            exponent += p * log(speed)
        if q > 0.0:
            exponent += q * log(shift)
        rate -= factor * exp(exponent) * tension
    return rate


@njit(nogil=True, cache=True)
def floor_at(time: float, floor: Floor) -> tuple[float, float]:
    """Floor displacement [m] and velocity [m/s]: the cubic through values and slopes of two knots."""
    if floor.displacement.size == 0:
        return 0.0, 0.0
    position = (time - floor.start) * FLOOR_RATE_HZ
    knot = min(max(int(position), 0), floor.displacement.size - 2)
    s, h = position - knot, 1.0 / FLOOR_RATE_HZ
    first, second = floor.displacement[knot], floor.displacement[knot + 1]
    slope, last = h * floor.velocity[knot], h * floor.velocity[knot + 1]
    square, cube = 3.0 * (second - first) - 2.0 * slope - last, 2.0 * (first - second) + slope + last
    return first + s * (slope + s * (square + s * cube)), (slope + s * (2.0 * square + 3.0 * s * cube)) / h


@njit(nogil=True, cache=True)
def pulse_at(time: float, pulse: Pulse) -> float:
    """Force of the half-sine pulse [N]."""
    if time <= pulse.start or time >= pulse.end:
        return 0.0
    return pulse.strength * sin(pi * (time - pulse.start) / (pulse.end - pulse.start))


@njit(nogil=True, cache=True)
def advance(state: Any, step: float, slope: Any) -> Any:
    """Return state + step * slope, both tuples of five."""
    return (
        state[0] + step * slope[0],
        state[1] + step * slope[1],
        state[2] + step * slope[2],
        state[3] + step * slope[3],
        state[4] + step * slope[4],
    )


@njit(nogil=True)
def no_effect(*_: Any) -> tuple[float, float, float]:
    """Nothing beyond the declared physics."""
    return 0.0, 0.0, 0.0


def combine(contributions: tuple[Callable[..., tuple[float, float, float]], ...]) -> Callable[..., Any]:
    """Compile one function that adds up the contributions of several effects."""
    if not contributions:
        return no_effect
    first, rest = contributions[0], combine(contributions[1:])

    @njit(nogil=True)
    def both(time: float, state: Any, parameters: Any) -> Any:
        one = first(time, state[0], state[1], state[2], state[3], state[4], parameters[0])
        others = rest(time, state, parameters[1:])
        return one[0] + others[0], one[1] + others[1], one[2] + others[2]

    return both


@cache
def compiled(contributions: tuple[Callable[..., tuple[float, float, float]], ...]) -> Callable[..., Any]:
    """Compile the integrator for one set of effects (once a process)."""
    effect = combine(contributions)

    @njit(nogil=True, error_model="numpy")
    def derivative(
        time: float, state: Any, constants: Any, terms: Any, floor: Any, pulse: Any, extra: Any
    ) -> Any:
        x_lo, v_lo, x_so, v_so, tension = state
        c = constants
        joint_stiffness = c.k_i / (1.0 + exp(c.alpha * (tension - c.beta)))
        joint_damping = c.c_d - c.c_i / (1.0 + exp(c.eta * tension))
        joint = joint_stiffness * (x_lo - x_so) + joint_damping * (v_lo - v_so)
        ground, speed = floor_at(time, floor)
        force = pulse_at(time, pulse)
        added = effect(time, state, extra)
        on_lo = pulse.on_lo * force - joint + added[0]
        on_so = pulse.on_so * force + joint + added[1]
        on_lo -= c.stiffness_lo * (x_lo - ground) + c.damping_lo * (v_lo - speed)
        on_so -= c.stiffness_so * (x_so - ground) + c.damping_so * (v_so - speed)
        rate = tension_rate(x_lo - x_so, v_lo - v_so, tension, terms) + added[2]
        return v_lo, on_lo / c.mass_lo, v_so, on_so / c.mass_so, rate

    @njit(nogil=True)
    def runge_kutta(time: float, state: Any, k1: Any, h: float, system: Any) -> Any:
        k2 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k1), *system)
        k3 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k2), *system)
        k4 = derivative(time + h, advance(state, h, k3), *system)
        total = advance(advance(advance(k1, 2.0, k2), 2.0, k3), 1.0, k4)
        return advance(state, h / 6.0, total)

    @njit(nogil=True)
    def integrate(start: float, rate: float, state: Any, system: Any, out: FloatArray) -> Any:
        pulse = system[3]
        for step in range(out.shape[1]):
            now, end = start + step / rate, start + (step + 1) / rate
            out[:5, step] = state
            slope = derivative(now, state, *system)
            out[5, step], out[6, step] = slope[1], slope[3]
            # The pulse has a kink at either end: a step never runs across one.
            for edge in (pulse.start, pulse.end):
                if now < edge < end:
                    state = runge_kutta(now, state, slope, edge - now, system)
                    now, slope = edge, derivative(edge, state, *system)
            state = runge_kutta(now, state, slope, end - now, system)
        return state

    return integrate


def system(plant: Plant, hit: Hit, floor: Floor, gamma_factor: float) -> tuple[Any, ...]:
    """Collect what the compiled derivative needs besides time and state."""
    # Compiled code cannot loop over nothing: a bolt that holds has one term without weight.
    terms = tuple(term.row(gamma_factor) for term in plant.loosening) or (LooseningTerm().row(0.0),)
    on_lo = float(hit.body == "lo")
    pulse = Pulse(on_lo, 1.0 - on_lo, hit.strength, hit.start, hit.start + hit.duration)
    return plant.constants(), terms, floor, pulse, tuple(effect.parameters for effect in plant.effects)


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
    integrate = compiled(tuple(effect.contribution for effect in plant.effects))
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
