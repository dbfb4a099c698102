"""The force of an effect along a motion that is given."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.calling import invoke, pointer

_SUBSTEPS = 4  # of Heun's method between two samples: states may be as fast as some kHz


@njit(cache=True, nogil=True, error_model="numpy")
def force_along(
    address: int, p: Any, states: int, rate_hz: float, x: Any, v: Any, T: Any, k: Any, c: Any
) -> Any:
    """Force [N] of an effect at every sample of displacement x, velocity v, tension T, stiffness k, damping c.

    Internal states start from zero; between samples the motion is linear.
    """
    n = x.size
    force, s, predicted = np.empty(n), np.zeros(max(states, 1)), np.zeros(max(states, 1))
    slope, next_slope, spare = np.zeros(max(states, 1)), np.zeros(max(states, 1)), np.zeros(1)
    h = 1.0 / (rate_hz * _SUBSTEPS)
    for i in range(n):
        t = i / rate_hz
        force[i] = invoke(
            address,
            (
                t,
                x[i],
                v[i],
                T[i],
                k[i],
                c[i],
                pointer(s, 0),
                pointer(p, 0),
                pointer(slope, 0),
                pointer(spare, 0),
            ),
        )
        if states == 0 or i == n - 1:
            continue
        for j in range(_SUBSTEPS):
            if j > 0:
                slope[:] = next_slope
            share = (j + 1) / _SUBSTEPS
            x_next, v_next = x[i] + share * (x[i + 1] - x[i]), v[i] + share * (v[i + 1] - v[i])
            for q in range(states):
                predicted[q] = s[q] + h * slope[q]
            invoke(
                address,
                (t + (j + 1) * h, x_next, v_next, T[i], k[i], c[i], pointer(predicted, 0), pointer(p, 0),
                 pointer(next_slope, 0), pointer(spare, 0)),
            )  # fmt: skip
            for q in range(states):
                s[q] += 0.5 * h * (slope[q] + next_slope[q])
            invoke(
                address,
                (t + (j + 1) * h, x_next, v_next, T[i], k[i], c[i], pointer(s, 0), pointer(p, 0),
                 pointer(next_slope, 0), pointer(spare, 0)),
            )  # fmt: skip
    return force
