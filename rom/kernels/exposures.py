"""The tension along given exposures: one scalar equation, exact where its rate is proportional to T."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.calling import invoke, pointer


@njit(cache=True, nogil=True, error_model="numpy")
def _relative_rate(addresses: Any, p: Any, T: float, weights: Any) -> float:
    """Sum over terms of weight times tension factor, over the tension."""
    total = 0.0
    for term in range(addresses.size):
        if weights[term] != 0.0:
            total += weights[term] * invoke(addresses[term], (T, pointer(p, term * p.shape[1])))
    return total / T


@njit(cache=True, nogil=True, error_model="numpy")
def follow_exposures(
    addresses: Any, p: Any, weights: Any, exposures: Any, starts: Any, highest: float
) -> Any:
    """Tension at every knot, shape (cases, knots), of ``dT = sum_j w_j g_j(T) dM_j``.

    ``addresses`` and ``p``, shape (terms, parameters): the tension factors g; ``weights``, (cases, terms):
    the signed coefficients w; ``exposures``, (terms, cases, knots): the cumulative integrals M of the motion
    factors. ``ln T`` is advanced by the midpoint rule, so that T stays positive; cut at ``highest``.
    """
    terms, cases, knots = exposures.shape
    result = np.empty((cases, knots))
    step = np.empty(terms)
    lowest = 1e-9
    for case in range(cases):
        T = max(starts[case], lowest)
        result[case, 0] = T
        for knot in range(1, knots):
            for term in range(terms):
                gain = exposures[term, case, knot] - exposures[term, case, knot - 1]
                step[term] = weights[case, term] * gain
            half = 0.5 * _relative_rate(addresses, p, T, step)
            middle = min(max(T * np.exp(min(half, 50.0)), lowest), highest)
            whole = _relative_rate(addresses, p, middle, step)
            T = min(max(T * np.exp(min(whole, 50.0)), lowest), highest)
            result[case, knot] = T
    return result
