"""The rig's own equations of motion and integrator, compiled: fourth-order Runge-Kutta."""

from math import exp, log, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from experiments.rig.excitation import FLOOR_RATE_HZ, FloatArray
from experiments.rig.function_addresses import call, pointer

LN10 = log(10.0)
JOINT, FLEXURE_LO, FLEXURE_SO, BODY_LO, BODY_SO = range(5)
"""Places at which an undeclared force enters."""


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


class Table(NamedTuple):
    """Undeclared physics, a row an effect; addresses fit into the 53 digits of a float."""

    forces: FloatArray  # address, place, first state, numbers
    rates: FloatArray  # address, numbers
    reference: float  # relative rate of the law at 0.1 mm, 50 mm/s and 100 N [1/s]


@njit(nogil=True, cache=True, error_model="numpy")
def tension_rate(x: float, v: float, tension: float, terms: Any, dissipated: float = 0.0) -> float:
    """Sum of the terms of the tension law [N/s]; `terms` holds one `LooseningTerm.row` each.

    Parameters
    ----------
    x, v : float
        Relative displacement [m] and velocity [m/s] of the joint.
    tension : float
        In the bolt [N].
    terms : tuple of tuple
        One `LooseningTerm.row` each.
    dissipated : float
        Power that the joint's damping takes, ``|D v|`` [W].

    Returns
    -------
    float
        Negative where it loosens.
    """
    rate = 0.0
    for factor, gamma_d, gamma_i, rho, p, q, v_0, x_0, r in terms:
        speed, shift = abs(v) - v_0, abs(x) - x_0
        if (p > 0.0 and speed <= 0.0) or (q > 0.0 and shift <= 0.0) or (r > 0.0 and dissipated <= 0.0):
            continue
        exponent = LN10 * (gamma_d - gamma_i / (1.0 + exp(rho * tension)))
        if p > 0.0:
            exponent += p * log(speed)
        if q > 0.0:
            exponent += q * log(shift)
        if r > 0.0:
            exponent += r * log(dissipated)
        rate -= factor * exp(exponent) * tension
    return rate


@njit(nogil=True, cache=True, forceinline=True)
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


@njit(nogil=True, cache=True, forceinline=True)
def pulse_at(time: float, pulse: Pulse) -> float:
    """Force of the half-sine pulse [N]."""
    if time <= pulse.start or time >= pulse.end:
        return 0.0
    return pulse.strength * sin(pi * (time - pulse.start) / (pulse.end - pulse.start))


@njit(nogil=True, cache=True, forceinline=True)
def motion_at(place: int, state: Any, ground: float, speed: float) -> tuple[float, float]:
    """Displacement [m] and velocity [m/s] that a force sees: of a link, or of a body.

    Parameters
    ----------
    place : int
        Where the force acts: a link or a body.
    state : tuple of float
        (x_LO, v_LO, x_SO, v_SO, T) [m, m/s, m, m/s, N].
    ground, speed : float
        Displacement [m] and velocity [m/s] of the ground.

    Returns
    -------
    tuple of float
        Displacement and velocity.
    """
    if place == JOINT:
        return state[0] - state[2], state[1] - state[3]
    if place == FLEXURE_LO:
        return state[0] - ground, state[1] - speed
    if place == FLEXURE_SO:
        return state[2] - ground, state[3] - speed
    return (state[0], state[1]) if place == BODY_LO else (state[2], state[3])


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def added_forces(time: float, state: Any, inner: Any, slopes: Any, k: Any, ground: Any, table: Table) -> Any:
    """Undeclared forces on LO, on SO and in the joint [N]; fills the slopes of the effects' own states.

    Parameters
    ----------
    time : float
        Time [s].
    state : tuple of float
        (x_LO, v_LO, x_SO, v_SO, T) [m, m/s, m, m/s, N].
    inner, slopes : ndarray
        States of the effects and, filled, their slopes.
    k : tuple of float
        Stiffness of every link [N/m].
    ground : tuple of float
        Displacement [m] and velocity [m/s] of the ground.
    table : Table
        The undeclared effects; None without.

    Returns
    -------
    tuple of float
        Forces [N].
    """
    on_lo, on_so, joint = 0.0, 0.0, 0.0
    if table is None:
        return on_lo, on_so, joint
    for row in range(table.forces.shape[0]):
        address, place, first = (
            int(table.forces[row, 0]),
            int(table.forces[row, 1]),
            int(table.forces[row, 2]),
        )
        x, v = motion_at(place, state, ground[0], ground[1])
        stiffness = k[place] if place < BODY_LO else 0.0
        motion = (time, x, v, state[4], stiffness)
        numbers = pointer(table.forces, row * table.forces.shape[1] + 3)
        force = call(address, (*motion, pointer(inner, first), numbers, pointer(slopes, first)))
        if place == JOINT:
            joint += force
        elif place in (FLEXURE_LO, BODY_LO):
            on_lo -= force
        else:
            on_so -= force
    return on_lo - joint, on_so + joint, joint


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def relative_rate(tension: float, terms: Any) -> float:
    """Size of the law's relative rate at 0.1 mm, 50 mm/s and 1 W [1/s]: how it goes with tension."""
    return abs(tension_rate(1e-4, 0.05, tension, terms, 1.0) / max(tension, 1e-9))


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def changed_rate(rate: float, tension: float, motion: Any, terms: Any, table: Table) -> float:
    """Tension rate [N/s] as every undeclared effect in turn changes it.

    Parameters
    ----------
    rate : float
        Tension rate of the law [N/s].
    tension : float
        Tension [N].
    motion : tuple of float
        What an effect on the rate sees of the joint.
    terms : tuple
        Terms of the law.
    table : Table
        The undeclared effects; None without.

    Returns
    -------
    float
        Rate [N/s].
    """
    if table is None:
        return rate
    if table.rates.shape[0] > 0:
        follow = relative_rate(tension, terms) / table.reference if table.reference > 0.0 else 0.0
        for row in range(table.rates.shape[0]):
            numbers = pointer(table.rates, row * table.rates.shape[1] + 1)
            rate = call(int(table.rates[row, 0]), (rate, tension, *motion, follow, numbers))
    return rate


@njit(nogil=True, cache=True, error_model="numpy", forceinline=True)
def derivative(time: float, state: Any, inner: Any, slopes: Any, system: Any) -> Any:
    """Slope of (x_LO, v_LO, x_SO, v_SO, T): Eqs. 2, 5, 11, 12 and the undeclared; fills that of `inner`.

    Parameters
    ----------
    time : float
        Time [s].
    state : tuple of float
        Displacements [m], velocities [m/s] and tension [N], in the order of the slope.
    inner, slopes : ndarray, shape (states,), or None
        The effects' own states, and where their slopes go.
    system : tuple
        Constants, terms of the tension law, floor, pulse, table of the undeclared.

    Returns
    -------
    tuple of float
        Slope of the state.
    """
    x_lo, v_lo, x_so, v_so, tension = state
    constants, terms, floor, pulse, table = system
    c = constants
    joint_stiffness = c.k_i / (1.0 + exp(c.alpha * (tension - c.beta)))
    joint_damping = c.c_d - c.c_i / (1.0 + exp(c.eta * tension))
    damping = joint_damping * (v_lo - v_so)
    joint = joint_stiffness * (x_lo - x_so) + damping
    ground, speed = floor_at(time, floor)
    force = pulse_at(time, pulse)
    stiffness = (joint_stiffness, c.stiffness_lo, c.stiffness_so)
    on_lo, on_so, added = added_forces(time, state, inner, slopes, stiffness, (ground, speed), table)
    on_lo += pulse.on_lo * force - joint - c.stiffness_lo * (x_lo - ground) - c.damping_lo * (v_lo - speed)
    on_so += pulse.on_so * force + joint - c.stiffness_so * (x_so - ground) - c.damping_so * (v_so - speed)
    a_lo, a_so = on_lo / c.mass_lo, on_so / c.mass_so
    rate = tension_rate(x_lo - x_so, v_lo - v_so, tension, terms, damping * (v_lo - v_so))
    motion = (x_lo - x_so, v_lo - v_so, a_lo - a_so, joint + added, damping)
    return v_lo, a_lo, v_so, a_so, changed_rate(rate, tension, motion, terms, table)


@njit(nogil=True, cache=True, forceinline=True)
def advance(state: Any, step: float, slope: Any) -> Any:
    """Return state + step * slope, both tuples of five.

    Parameters
    ----------
    state, slope : tuple of float
        (x_LO, v_LO, x_SO, v_SO, T) and its slope.
    step : float
        Step of time [s].

    Returns
    -------
    tuple of float
        (x_LO, v_LO, x_SO, v_SO, T) after the step.
    """
    return (
        state[0] + step * slope[0],
        state[1] + step * slope[1],
        state[2] + step * slope[2],
        state[3] + step * slope[3],
        state[4] + step * slope[4],
    )


@njit(nogil=True, cache=True, forceinline=True)
def advance_inner(inner: Any, step: float, slope: Any, out: Any) -> Any:
    """Fill and return out = inner + step * slope, arrays.

    Parameters
    ----------
    inner, slope, out : ndarray, shape (states,)
        States of the effects, their slopes, what is filled; None without.
    step : float
        Step of time [s].

    Returns
    -------
    ndarray
        ``out``.
    """
    if inner is not None:
        for i in range(inner.size):
            out[i] = inner[i] + step * slope[i]
    return out


@njit(nogil=True, cache=True, forceinline=True)
def runge_kutta(time: float, state: Any, inner: Any, k1: Any, s: Any, h: float, system: Any) -> Any:
    """One step of length h from the slopes k1 and s[0] at its start.

    Returns the state; advances `inner` in place.

    Parameters
    ----------
    time : float
        Time at the start [s].
    state : tuple of float
        (x_LO, v_LO, x_SO, v_SO, T) [m, m/s, m, m/s, N].
    inner : ndarray, shape (states,)
        States of the effects; None without.
    k1 : tuple of float
        Slope at the start.
    s : tuple of ndarray
        Five arrays like ``inner``; the first holds its slope at the start.
    h : float
        Step of time [s].
    system : tuple
        What ``derivative`` takes.
    """
    trial = advance_inner(inner, 0.5 * h, s[0], s[4])
    k2 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k1), trial, s[1], system)
    trial = advance_inner(inner, 0.5 * h, s[1], s[4])
    k3 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k2), trial, s[2], system)
    trial = advance_inner(inner, h, s[2], s[4])
    k4 = derivative(time + h, advance(state, h, k3), trial, s[3], system)
    if inner is not None:
        for i in range(inner.size):
            inner[i] += h / 6.0 * (s[0][i] + 2.0 * s[1][i] + 2.0 * s[2][i] + s[3][i])
    total = advance(advance(advance(k1, 2.0, k2), 2.0, k3), 1.0, k4)
    return advance(state, h / 6.0, total)


def scratch(inner: FloatArray | None) -> tuple[FloatArray | None, ...]:
    """Five arrays like `inner`, or as many times None, for `integrate` to work in."""
    return tuple(None if inner is None else np.empty_like(inner) for _ in range(5))


# given all arrays, it need not count at every step who holds them: with effects most of its time
@njit(nogil=True, cache=True, _nrt=False)  # type: ignore[call-overload,untyped-decorator]
def integrate(start: float, rate: float, state: Any, inner: Any, s: Any, system: Any, out: FloatArray) -> Any:
    """Fill `out`, shape (7, steps), with state and both accelerations; return the state at the end.

    `inner`, the effects' own states, is advanced in place; None where nothing is undeclared: then what is not
    needed is not compiled either.

    Parameters
    ----------
    start : float
        Time of the first step [s].
    rate : float
        Steps a second [Hz].
    state : tuple of float
        x_LO, v_LO, x_SO, v_SO [m], [m/s] and T [N] at the start.
    inner : ndarray, shape (states,), or None
        The effects' own states at the start.
    s : tuple
        Of `scratch`.
    system : tuple
        As for `derivative`.
    out : ndarray, shape (7, steps)
        Where the motion goes.

    Returns
    -------
    tuple of float
        The state at the end.
    """
    pulse = system[3]
    for step in range(out.shape[1]):
        now, end, first = start + step / rate, start + (step + 1) / rate, True
        for place in range(5):
            out[place, step] = state[place]
        # The pulse has a kink at either end: a step never runs across one.
        for edge in (pulse.start, pulse.end, end):
            if now < edge <= end:
                slope = derivative(now, state, inner, s[0], system)
                if first:
                    out[5, step], out[6, step], first = slope[1], slope[3], False
                state = runge_kutta(now, state, inner, slope, s, edge - now, system)
                now = edge
    return state
