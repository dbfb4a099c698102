"""Tension laws along a motion that is given: one scalar equation for a law and a case."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.calling import invoke, pointer


@njit(cache=True, nogil=True, error_model="numpy")
def follow(address: int, p: Any, nodes: Any, steps: Any, start: float) -> float:
    """Final tension along ``nodes``, shape (x v F D, 2 steps + 1), with ``steps`` of two intervals each [s].

    Simpson's rule in time with predicted tensions; the rate at the end of a step starts the next one.
    """
    T = start
    rate = invoke(address, (T, nodes[0, 0], nodes[1, 0], nodes[2, 0], nodes[3, 0], pointer(p, 0)))
    for step in range(steps.size):
        h, i = 0.5 * steps[step], 2 * step + 1
        trial = max(T + h * rate, 0.0)
        half = invoke(address, (trial, nodes[0, i], nodes[1, i], nodes[2, i], nodes[3, i], pointer(p, 0)))
        i += 1
        trial = max(T + 2.0 * h * half, 0.0)
        end = invoke(address, (trial, nodes[0, i], nodes[1, i], nodes[2, i], nodes[3, i], pointer(p, 0)))
        T = max(T + h / 3.0 * (rate + 4.0 * half + end), 0.0)
        rate = end
    return T


@njit(cache=True, nogil=True, error_model="numpy")
def follow_all(addresses: Any, parameters: Any, nodes: Any, steps: Any, starts: Any, result: Any) -> None:
    """Final tensions of laws (rows of ``parameters``) over cases; NaN where a tension is not finite."""
    for law in range(addresses.size):
        for case in range(starts.size):
            T = follow(addresses[law], parameters[law], nodes[case], steps, starts[case])
            result[law, case] = T if np.isfinite(T) else np.nan
