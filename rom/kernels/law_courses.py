"""Courses of the tension along a motion that is given: means over bins for a law and many cases."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import invoke, pointer


@njit(cache=True, nogil=True, error_model="numpy")
def follow_courses(
    address: int, p: Any, nodes: Any, starts: Any, edges: Any, initial: Any, highest: float, result: Any
) -> None:
    """Mean tensions in bins, shape (cases, bins), along ``nodes``, shape (t x v F D, nodes of all cases).

    Heun's rule between nodes, the rate at a predicted tension taken for that at the node; ``p`` has a row of
    parameters for every case, ``edges`` [s] are those of the bins of all. NaN where a tension is not finite,
    or a parameter is not a number: such a case is not followed.

    Parameters
    ----------
    address : int
        Of the compiled tension rate.
    p : ndarray, shape (cases, parameters)
        Its numbers.
    nodes : ndarray, shape (5, nodes of all cases)
        Time from the hit [s], x [m], v [m/s], F and D [N].
    starts : ndarray, shape (cases + 1,)
        First node of every case.
    edges : ndarray, shape (bins + 1,)
        Of the bins, from the hit [s].
    initial : ndarray, shape (cases,)
        Tensions at the first node [N].
    highest : float
        Where a tension is cut [N].
    result : ndarray, shape (cases, bins)
        Filled [N].
    """
    for case in range(starts.size - 1):
        if np.isnan(p[case].sum()):
            result[case] = np.nan
            continue
        i, last = starts[case], starts[case + 1] - 1
        T, total, at_edge, edge = initial[case], 0.0, 0.0, 0
        rate = invoke(
            address, (T, nodes[1, i], nodes[2, i], nodes[3, i], nodes[4, i], pointer(p, case * p.shape[1]))
        )
        while i < last and edge < edges.size:
            h, before = nodes[0, i + 1] - nodes[0, i], T
            T = min(max(before + h * rate, 0.0), highest)
            i += 1
            end = invoke(
                address,
                (T, nodes[1, i], nodes[2, i], nodes[3, i], nodes[4, i], pointer(p, case * p.shape[1])),
            )
            T = min(max(before + 0.5 * h * (rate + end), 0.0), highest)
            rate = end
            while edge < edges.size and (edges[edge] <= nodes[0, i] or i == last):
                a = max(min(edges[edge] - nodes[0, i - 1], h), 0.0)
                here = total + a * (before + 0.5 * (T - before) * a / h)
                here += max(edges[edge] - nodes[0, i], 0.0) * T  # behind the last node the tension rests
                if edge > 0:
                    result[case, edge - 1] = (here - at_edge) / (edges[edge] - edges[edge - 1])
                at_edge = here
                edge += 1
            total += 0.5 * h * (T + before)
        if not np.isfinite(T):
            result[case] = np.nan
