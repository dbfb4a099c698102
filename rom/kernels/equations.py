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

from rom.kernels.calling import invoke

IntArray = npt.NDArray[np.int64]


class Program(NamedTuple):
    """A structure as tables; what changes between candidates and cases is in the coefficients."""

    ends: IntArray  # (links, 2): body indices, -1 for ground
    tension: IntArray  # (links,): the tension that a link's laws see, -1 for none
    laws: IntArray  # (links, 6): address and coefficient offset of stiffness, damping, tension rate (0: none)
    effects: IntArray  # (effects, 3): address, coefficient offset, state offset; ordered by link
    effect_start: IntArray  # (links + 1,): first effect of every link
    size: IntArray  # (bodies, tensions, effect states)


@njit(cache=True, nogil=True, error_model="numpy")
def link_force(
    program: Program, p: Any, link: int, t: float, x: float, v: float, T: float, s: Any, ds: Any, dT: Any
) -> Any:
    """Force of a link on its second body [N]; adds to ``dT[0]`` and fills ``ds`` on the way."""
    laws = program.laws
    k = invoke(laws[link, 0], (T, p[laws[link, 1] :]))
    c = invoke(laws[link, 2], (T, p[laws[link, 3] :]))
    damping_force = c * v
    force = k * x + damping_force
    for e in range(program.effect_start[link], program.effect_start[link + 1]):
        address, offset, place = program.effects[e]
        before = dT[0]
        dT[0] = 0.0
        force += invoke(address, (t, x, v, T, k, c, s[place:], p[offset:], ds[place:], dT))
        dT[0] += before
    if laws[link, 4] != 0:
        dT[0] += invoke(laws[link, 4], (T, x, v, force, damping_force, p[laws[link, 5] :]))
    return force


@njit(cache=True, nogil=True, error_model="numpy")
def derivative(program: Program, p: Any, t: float, force: Any, y: Any, dy: Any) -> None:
    """Time derivative ``dy`` of the state ``y`` under the forces on the bodies [N].

    Both hold one number more than the state: where links without tension put their rate.
    """
    n, tensions, states = program.size
    for i in range(n):
        dy[i] = y[n + i]
        dy[n + i] = force[i] / p[i]
    dy[2 * n :] = 0.0
    s, ds = y[2 * n + tensions :], dy[2 * n + tensions :]
    nowhere = dy[2 * n + tensions + states :]
    for link in range(program.ends.shape[0]):
        first, second = program.ends[link]
        x = v = T = 0.0
        if first >= 0:
            x, v = y[first], y[n + first]
        if second >= 0:
            x, v = x - y[second], v - y[n + second]
        bolt = program.tension[link]
        dT = nowhere
        if bolt >= 0:
            T = y[2 * n + bolt]
            dT = dy[2 * n + bolt : 2 * n + bolt + 1]
        f = link_force(program, p, link, t, x, v, T, s, ds, dT)
        if first >= 0:
            dy[n + first] -= f / p[first]
        if second >= 0:
            dy[n + second] += f / p[second]
