"""The tension along given exposures: one scalar equation, exact where its rate is proportional to T."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.function_addresses import invoke, pointer

_STILL = 1e-6  # relative change of T within which its factors are taken as unchanged


@njit(cache=True, nogil=True, error_model="numpy")
def _factors(addresses: Any, p: Any, T: float, weights: Any, result: Any) -> None:
    """Weight times tension factor over the tension, term by term."""
    for term in range(addresses.size):
        result[term] = weights[term] * invoke(addresses[term], (T, pointer(p, term * p.shape[1]))) / T


@njit(cache=True, nogil=True, error_model="numpy")
def follow_exposures(
    addresses: Any, p: Any, weights: Any, exposures: Any, starts: Any, highest: float
) -> Any:
    """Tension at every knot, shape (cases, knots), of ``dT = sum_j w_j g_j(T) dM_j``.

    ``addresses`` and ``p``, shape (terms, parameters): the tension factors g; ``weights``, (cases, terms):
    the signed coefficients w; ``exposures``, (terms, cases, knots): the cumulative integrals M of the motion
    factors. ``ln T`` is advanced by the trapezoidal rule, so that T stays positive; cut at ``highest``. Its
    factors are evaluated once a step, at the predicted end, and not at all while T hardly changes.

    Parameters
    ----------
    addresses : ndarray, shape (terms,)
        Of the compiled tension factors g.
    p : ndarray, shape (terms, parameters)
        Their numbers.
    weights : ndarray, shape (cases, terms)
        Signed coefficients w.
    exposures : ndarray, shape (terms, cases, knots)
        Cumulative integrals M of the motion factors.
    starts : ndarray, shape (cases,)
        Initial tensions [N].
    highest : float
        Where T is cut [N].

    Returns
    -------
    ndarray, shape (cases, knots)
        Tensions [N].
    """
    terms, cases, knots = exposures.shape
    result = np.empty((cases, knots))
    here, there, gain = np.zeros(terms), np.zeros(terms), np.zeros(terms)
    lowest = 1e-9
    for case in range(cases):
        T = max(starts[case], lowest)
        result[case, 0] = T
        _factors(addresses, p, T, weights[case], here)
        since = 0.0
        for knot in range(1, knots):
            change = 0.0
            for term in range(terms):
                gain[term] = exposures[term, case, knot] - exposures[term, case, knot - 1]
                change += here[term] * gain[term]
            since += abs(change)
            if since > _STILL:
                since = 0.0
                predicted = min(max(T * np.exp(min(change, 50.0)), lowest), highest)
                _factors(addresses, p, predicted, weights[case], there)
                change = 0.0
                for term in range(terms):
                    change += 0.5 * (here[term] + there[term]) * gain[term]
                    here[term] = there[term]
            T = min(max(T * np.exp(min(change, 50.0)), lowest), highest)
            result[case, knot] = T
    return result
