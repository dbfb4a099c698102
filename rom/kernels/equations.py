"""Equations of motion of a lumped structure, compiled.

``m_i x_i'' = F_i - sum_l B_li f_l``, ``f_l = k_l(T) x_l + c_l(T) v_l + effects``, and
``T_l' = rate_l(T_l, x_l, v_l, f_l, c_l v_l) + effects``.
The state is ``y = [x (bodies), v (bodies), T (tensions), s (effect states)]``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from rom.kernels.function_addresses import floats, integers, invoke, named, pointer

IntArray = npt.NDArray[np.int64]


class Program(NamedTuple):
    """A structure as tables; what changes between candidates and cases is in the coefficients."""

    ends: IntArray  # (links, 2): body indices, -1 for ground
    tension: IntArray  # (links,): the tension that a link's laws see, -1 for none
    laws: IntArray  # (links, 6): address and coefficient offset of stiffness, damping, tension rate (0: none)
    effects: IntArray  # (effects, 3): address, coefficient offset, state offset; ordered by link
    effect_start: IntArray  # (links + 1,): first effect of every link
    size: IntArray  # (bodies, tensions, effect states)


PROGRAM = named(Program, integers(2), integers(1), integers(2), integers(2), integers(1), integers(1))
COEFFICIENTS = floats(1)
FORCES = floats(2, readonly=True)


@njit(cache=True, nogil=True, error_model="numpy")
def derivative(  # noqa: C901 - one flat pass over the links
    program: Program, p: Any, t: float, force: Any, y: Any, dy: Any, spare: Any
) -> None:
    """Time derivative ``dy`` of the state ``y`` under the forces on the bodies [N], link by link.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers; masses [kg] come first.
    t : float
        Time [s].
    force : ndarray, shape (bodies,)
        Forces [N].
    y : ndarray, shape (2 bodies + tensions + states,)
        The state.
    dy : ndarray, of the same shape
        Filled.
    spare : ndarray, shape (1,)
        Where an effect puts its tension rate.
    """
    n, tensions, _ = program.size
    ends, laws = program.ends, program.laws
    for i in range(n):
        dy[i] = y[n + i]
        dy[n + i] = force[i] / p[i]
    for i in range(2 * n, dy.size):
        dy[i] = 0.0
    for link in range(ends.shape[0]):
        first, second, bolt = ends[link, 0], ends[link, 1], program.tension[link]
        x = v = T = 0.0
        if first >= 0:
            x, v = y[first], y[n + first]
        if second >= 0:
            x, v = x - y[second], v - y[n + second]
        if bolt >= 0:
            T = max(y[2 * n + bolt], 0.0)
        k = invoke(laws[link, 0], (T, pointer(p, laws[link, 1])))
        c = invoke(laws[link, 2], (T, pointer(p, laws[link, 3])))
        damping_force = c * v
        f = k * x + damping_force
        rate = 0.0
        for e in range(program.effect_start[link], program.effect_start[link + 1]):
            address, offset, place = program.effects[e, 0], program.effects[e, 1], program.effects[e, 2]
            s = pointer(y, 2 * n + tensions + place)
            ds = pointer(dy, 2 * n + tensions + place)
            spare[0] = 0.0
            f += invoke(address, (t, x, v, T, k, c, s, pointer(p, offset), ds, pointer(spare, 0)))
            rate += spare[0]
        if laws[link, 4] != 0:
            rate += invoke(laws[link, 4], (T, x, v, f, damping_force, pointer(p, laws[link, 5])))
        if bolt >= 0:
            dy[2 * n + bolt] += rate
        if first >= 0:
            dy[n + first] -= f / p[first]
        if second >= 0:
            dy[n + second] += f / p[second]
