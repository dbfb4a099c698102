"""One test on the rig: settle on the moving floor, strike, ring down."""

from typing import Any, NamedTuple

import numpy as np

from experiments.rig.equations import Floor, Pulse, Table, derivative, integrate, relative_rate, scratch
from experiments.rig.excitation import STEP_RATE_HZ, FloatArray, Hit, floor_motion
from experiments.rig.function_addresses import FORCE, RATE, address_of
from experiments.rig.plant import LooseningTerm, Plant
from experiments.rig.undeclared import Undeclared

SETTLING_RATE_HZ = 2_400.0
"""Steps per second while the structure settles on the moving floor before the record; more where needed.

Shaken below 30 Hz, the plain rig then stands where finer steps lead, to a hundredth of a converter's step.
"""

FORCED = ("joint", "flexure_lo", "flexure_so", "body:lo", "body:so")
"""Places of forces in the order of `equations`."""

NUMBERS = 5
"""Largest number of parameters of an effect."""


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


def table(effects: tuple[Undeclared, ...], terms: tuple[Any, ...]) -> tuple[Table | None, int]:
    """Return the forces and rates among effects as the integrator takes them, and their number of states.

    `terms` are the rows of the tension law. None for none: then the integrator compiles to one without.
    """
    forces = [effect for effect in effects if effect.kind.acts == "force"]
    rates = [effect for effect in effects if effect.kind.acts == "rate"]
    if not forces and not rates:
        return None, 0
    first = np.cumsum([0, *(effect.kind.states for effect in forces)])
    forcing = [
        (address_of(effect.kind.function, FORCE), FORCED.index(effect.enters), state, *padded(effect))
        for effect, state in zip(forces, first, strict=False)
    ]
    changing = [(address_of(effect.kind.function, RATE), *padded(effect)) for effect in rates]
    return Table(
        np.array(forcing, dtype=np.float64).reshape(len(forces), 3 + NUMBERS),
        np.array(changing, dtype=np.float64).reshape(len(rates), 1 + NUMBERS),
        relative_rate(100.0, terms),
    ), int(first[-1])


def padded(effect: Undeclared) -> tuple[float, ...]:
    """Return the numbers of an effect, as many as any has."""
    return effect.values + (NUMBERS - len(effect.values)) * (0.0,)


def at_rest(system: Any, time: float, tension: float, states: int) -> tuple[FloatArray, float]:
    """Return where an undeclared force lets the rig rest, and a rate at which it settles stably [Hz].

    Both from the slopes about zero: x_0 = -J^-1 f(0), and a step under 2 of the fastest time constant.

    Parameters
    ----------
    system : tuple
        As for `derivative`.
    time : float
        [s].
    tension : float
        In the bolt [N].
    states : int
        Number of the effects' own states.

    Returns
    -------
    rest : ndarray, shape (4 + states,)
        x_LO, v_LO, x_SO, v_SO [m], [m/s] and the effects' states.
    rate : float
        Steps a second [Hz].
    """

    def slope(y: FloatArray) -> FloatArray:
        filled = np.zeros(states)
        whole = derivative(time, (*y[:4], tension), y[4:].copy(), filled, system)
        return np.concatenate([whole[:4], filled])

    size = 4 + states
    zero, nudge = slope(np.zeros(size)), 1e-8
    jacobian = np.stack([(slope(nudge * unit) - zero) / nudge for unit in np.eye(size)], axis=1)
    fastest = float(np.max(np.abs(np.linalg.eigvals(jacobian))))
    rate = SETTLING_RATE_HZ * 2.0 ** max(np.ceil(np.log2(fastest / (2.0 * SETTLING_RATE_HZ))), 0.0)
    rest = -np.linalg.lstsq(jacobian, zero)[0] if np.any(zero) else np.zeros(size)
    return np.asarray(rest), float(rate)


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
    # Compiled code cannot loop over nothing: a bolt that holds has one term without weight.
    terms = tuple(term.row(gamma_factor) for term in plant.loosening) or (LooseningTerm().row(0.0),)
    on_lo = float(hit.body == "lo")
    pulse = Pulse(on_lo, 1.0 - on_lo, hit.strength, hit.start, hit.start + hit.duration)
    constants, early, floor = plant.constants(), start - settling, Floor(0.0, np.empty(0), np.empty(0))
    state, inner, rate = (0.0, 0.0, 0.0, 0.0, float(tension)), None, SETTLING_RATE_HZ
    added, states = table(plant.effects, terms)
    # Before the record the tension is not watched.
    still = None if added is None else added._replace(rates=added.rates[:0])
    if added is not None:
        rest, rate = at_rest((constants, terms, floor, pulse, still), early, float(tension), states)
        state, inner = (*rest[:4].tolist(), float(tension)), rest[4:]
    if floor_rms > 0.0:
        if rng is None:
            raise ValueError("a moving floor needs a random generator, got none")
        floor = Floor(early, *floor_motion(floor_rms, early, start + duration, rng))
    if floor_rms > 0.0 or any(state[:4]):
        before = np.empty((7, round(settling * rate)))
        settled = integrate(
            early, rate, state, inner, scratch(inner), (constants, terms, floor, pulse, still), before
        )
        state = (*settled[:4], float(tension))
    out = np.empty((7, round(duration * step_rate_hz) + 1))
    integrate(start, step_rate_hz, state, inner, scratch(inner), (constants, terms, floor, pulse, added), out)
    if not np.all(np.isfinite(out)):
        names = ", ".join(effect.name for effect in plant.effects) or "none"
        raise ValueError(f"undeclared: the rig's motion diverges with {names}; expected weaker ones")
    return Motion(start + np.arange(out.shape[1]) / step_rate_hz, *out)
