"""The rig's own equations of motion and integrator, compiled: fourth-order Runge-Kutta."""

from collections.abc import Callable
from functools import cache
from math import exp, log, pi, sin
from types import FunctionType
from typing import Any, NamedTuple

from numba import njit

from experiments.rig.excitation import FLOOR_RATE_HZ, FloatArray

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


@njit(nogil=True, cache=True)
def beyond(_time: float, _state: Any, _parameters: Any) -> tuple[float, float, float]:
    """Forces on LO and SO [N] and tension rate [N/s] of undeclared physics; `integrator` may replace it."""
    return 0.0, 0.0, 0.0


@njit(nogil=True, cache=True, error_model="numpy")
def derivative(time: float, state: Any, system: Any) -> Any:
    """Slope of (x_LO, v_LO, x_SO, v_SO, T): Eqs. 2, 5, 11, 12 and whatever the effect adds."""
    x_lo, v_lo, x_so, v_so, tension = state
    constants, terms, floor, pulse, parameters = system
    c = constants
    joint_stiffness = c.k_i / (1.0 + exp(c.alpha * (tension - c.beta)))
    joint_damping = c.c_d - c.c_i / (1.0 + exp(c.eta * tension))
    joint = joint_stiffness * (x_lo - x_so) + joint_damping * (v_lo - v_so)
    ground, speed = floor_at(time, floor)
    force = pulse_at(time, pulse)
    on_lo, on_so, rate = beyond(time, state, parameters)
    on_lo += pulse.on_lo * force - joint - c.stiffness_lo * (x_lo - ground) - c.damping_lo * (v_lo - speed)
    on_so += pulse.on_so * force + joint - c.stiffness_so * (x_so - ground) - c.damping_so * (v_so - speed)
    rate += tension_rate(x_lo - x_so, v_lo - v_so, tension, terms)
    return v_lo, on_lo / c.mass_lo, v_so, on_so / c.mass_so, rate


@njit(nogil=True, cache=True)
def runge_kutta(time: float, state: Any, k1: Any, h: float, system: Any) -> Any:
    """One step of length h from the slope k1 at its start."""
    k2 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k1), system)
    k3 = derivative(time + 0.5 * h, advance(state, 0.5 * h, k2), system)
    k4 = derivative(time + h, advance(state, h, k3), system)
    total = advance(advance(advance(k1, 2.0, k2), 2.0, k3), 1.0, k4)
    return advance(state, h / 6.0, total)


@njit(nogil=True, cache=True)
def integrate(start: float, rate: float, state: Any, system: Any, out: FloatArray) -> Any:
    """Fill `out`, shape (7, steps), with state and both accelerations; return the state at the end."""
    pulse = system[3]
    for step in range(out.shape[1]):
        now, end = start + step / rate, start + (step + 1) / rate
        out[:5, step] = state
        slope = derivative(now, state, system)
        out[5, step], out[6, step] = slope[1], slope[3]
        # The pulse has a kink at either end: a step never runs across one.
        for edge in (pulse.start, pulse.end):
            if now < edge < end:
                state = runge_kutta(now, state, slope, edge - now, system)
                now, slope = edge, derivative(edge, state, system)
        state = runge_kutta(now, state, slope, end - now, system)
    return state


@cache
def integrator(effect: Callable[..., Any] | None) -> Callable[..., Any]:
    """Return `integrate` with a compiled effect in the place of `beyond`.

    Compiled once a process and not kept on disk, where every effect would leave its files.
    """
    if effect is None:
        return integrate
    slope = rebuilt(derivative, beyond=effect)
    step = rebuilt(runge_kutta, derivative=slope)
    return rebuilt(integrate, derivative=slope, runge_kutta=step)


def rebuilt(function: Any, **replaced: Any) -> Callable[..., Any]:
    """Compile a function anew with some of the names it calls standing for others."""
    source = function.py_func
    names = {**source.__globals__, **replaced}
    return njit(nogil=True, error_model="numpy")(FunctionType(source.__code__, names, source.__name__))
