"""Exact propagation of the linear part over a sub-block, for a ladder of lengths.

With ``y' = A y + sum_i b_i u_i(t)`` a sub-block of length d takes ``y`` to ``E y`` plus what the inputs add.
An input that runs linearly between samples adds ``W u`` with u its samples; one that is a polynomial over
the block of four sub-blocks adds ``H N`` with N its values at the block's five nodes. All three follow from
the moments ``P_q = int_0^d exp(A (d - s)) b (s / d)^q ds``, which double exactly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float64, int64, njit, void
from numpy.polynomial import Polynomial

from rom.kernels.function_addresses import floats, for_size, integers, named, separate

NODES = 5
LEVELS = 17  # sub-blocks of 1/256, 1/128 ... 1/2, 1, 2 ... 256 samples
SAMPLE = 8  # the level whose sub-block is one sample
TICKS = 2**SAMPLE  # ticks in a sample; the shortest sub-block is a tick
LONGEST = 2 ** (LEVELS - 1 - SAMPLE)

FloatArray = npt.NDArray[np.float64]


def _lagrange() -> list[Polynomial]:
    """Lagrange polynomials of the nodes 0 ... 4."""
    basis = []
    for node in range(NODES):
        others = [other for other in range(NODES) if other != node]
        product = Polynomial.fromroots(others)
        basis.append(product / product(node))
    return basis


def _upper(matrix: FloatArray) -> FloatArray:
    """Upper factor of a matrix, rows as they are."""
    upper = matrix.copy()
    for i in range(len(upper)):
        upper[i + 1 :] -= np.outer(upper[i + 1 :, i] / upper[i, i], upper[i])
    return upper


def _local(node: int, place: int) -> FloatArray:
    """Coefficients of a Lagrange polynomial about the start of sub-block ``place``."""
    coefficients = np.zeros(NODES)
    shifted = _lagrange()[node](Polynomial([place, 1.0])).coef
    coefficients[: shifted.size] = shifted
    return coefficients


# shape (sub-block, node, power)
LOCAL = np.array([[_local(node, place) for node in range(NODES)] for place in range(NODES - 1)])
# shape (node, node): integral from node 0 to node i of the polynomial through the values, in sub-blocks
INTEGRAL = np.array([[basis.integ()(i) - basis.integ()(0) for basis in _lagrange()] for i in range(NODES)])
# the same, lower triangular from node 1 on: what sweeps of stiff states take in place of it
TRIANGULAR = np.zeros((NODES, NODES))
TRIANGULAR[1:, 1:] = _upper(INTEGRAL[1:, 1:].T).T
# the two-panel rule of Simpson on the same nodes, in sub-blocks
SIMPSON = np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 3.0
_BINOMIAL = np.array([[1, 0, 0, 0, 0], [1, 1, 0, 0, 0], [1, 2, 1, 0, 0], [1, 3, 3, 1, 0], [1, 4, 6, 4, 1.0]])


class Propagators(NamedTuple):
    """Tables by level; ``built[0]`` counts the levels that are up to date."""

    A: FloatArray  # (state, state)
    b: FloatArray  # (inputs, state): first those of the driven bodies, then those of the active links
    E: FloatArray  # (level, state, state), transposed
    P: FloatArray  # (level, input, power, state)
    W: FloatArray  # (level, driven, state, sample)
    H: FloatArray  # (level, active link, node with N, node with y times state): from the block's start
    built: npt.NDArray[np.int64]
    series: FloatArray  # (2, state): a term, and the matrix times it


PROPAGATORS = named(
    Propagators, floats(2), floats(2), floats(3), floats(4), floats(4), floats(4), integers(1), floats(2)
)


def allocate(size: int, driven: int, active: int) -> Propagators:
    """Empty tables.

    Parameters
    ----------
    size : int
        Displacements and velocities.
    driven, active : int
        Driven bodies and active links.

    Returns
    -------
    Propagators
        All zero.
    """
    return Propagators(
        np.zeros((size, size)),
        np.zeros((driven + active, size)),
        np.zeros((LEVELS, size, size)),
        np.zeros((LEVELS, driven + active, NODES, size)),
        np.zeros((LEVELS, driven, size, LONGEST + 1)),
        np.zeros((LEVELS, active, NODES, NODES * size)),
        np.zeros(1, dtype=np.int64),
        np.zeros((2, size)),
    )


@njit(cache=True, nogil=True)
def _next_term(A: Any, factor: float, term: Any, image: Any) -> float:
    """``term = factor A term``; its largest element."""
    size, largest = term.size, 0.0
    for i in range(size):
        image[i] = 0.0
        for j in range(size):
            image[i] += A[i, j] * term[j]
    for i in range(size):
        term[i] = image[i] * factor
        largest = max(largest, abs(term[i]))
    return largest


@njit(cache=True, nogil=True, inline="always")
def _exponential(A: Any, d: float, result: Any, term: Any, image: Any) -> None:
    """``exp(A d) term`` by its series."""
    for i in range(term.size):
        result[i] = term[i]
    for k in range(1, 80):
        largest, total = _next_term(A, d / k, term, image), 0.0
        for i in range(term.size):
            result[i] += term[i]
            total = max(total, abs(result[i]))
        if largest <= 1e-20 * total:
            break


@njit(cache=True, nogil=True, inline="always")
def _moments(A: Any, start: Any, d: float, result: Any, term: Any, image: Any) -> None:
    """``int_0^d exp(A (d - s)) start (s / d)^q ds`` for all powers q, one series of ``(A d)^k start / k!``.

    The k-th term of power q has the factor ``d k! q! / (k + q + 1)!``.
    """
    size, total = term.size, 0.0
    for i in range(size):
        term[i], total = start[i], max(total, abs(start[i]))
    for q in range(NODES):
        for i in range(size):
            result[q, i] = 0.0
    for k in range(80):
        factor = d / (k + 1.0)
        for q in range(NODES):
            for i in range(size):
                result[q, i] += factor * term[i]
            factor *= (q + 1.0) / (k + q + 2.0)
        if _next_term(A, d / (k + 1.0), term, image) <= 1e-20 * total:
            break


@njit(cache=True, nogil=True, inline="always")
def _build_first(tables: Propagators, d: float) -> None:
    """Exponential and moments of the shortest sub-block, by series."""
    size = tables.A.shape[0]
    term, image = tables.series[0], tables.series[1]
    for i in range(size):
        for j in range(size):
            term[j] = 0.0
        term[i] = 1.0
        _exponential(tables.A, d, tables.E[0, i], term, image)
    for i in range(tables.b.shape[0]):
        _moments(tables.A, tables.b[i], d, tables.P[0, i], term, image)


@njit(cache=True, nogil=True, inline="always")
def _double(tables: Propagators, level: int) -> None:
    """Exponential and moments of a level from those of the level below."""
    size = tables.A.shape[0]
    E, P = tables.E, tables.P
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += E[level - 1, i, k] * E[level - 1, k, j]
            E[level, i, j] = total
    for u in range(P.shape[1]):
        for q in range(NODES):
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += E[level - 1, j, i] * P[level - 1, u, q, j]
                for j in range(q + 1):
                    total += _BINOMIAL[q, j] * P[level - 1, u, j, i]
                P[level, u, q, i] = total / 2.0**q


@njit(cache=True, nogil=True, inline="always")
def _input_weights(tables: Propagators, level: int) -> None:
    """Weights of the samples within a sub-block."""
    driven, size = tables.W.shape[1], tables.W.shape[2]
    W, E = tables.W, tables.E
    half = 2 ** (level - 1 - SAMPLE) if level > SAMPLE else 0
    for u in range(driven):
        for i in range(size):
            if level <= SAMPLE:
                W[level, u, i, 1] = tables.P[level, u, 1, i]
                W[level, u, i, 0] = tables.P[level, u, 0, i] - tables.P[level, u, 1, i]
                continue
            for j in range(half + 1):
                total = 0.0
                for k in range(size):
                    total += E[level - 1, k, i] * W[level - 1, u, k, j]
                W[level, u, i, j] = total
            W[level, u, i, half] += W[level - 1, u, i, 0]
            for j in range(1, half + 1):
                W[level, u, i, half + j] = W[level - 1, u, i, j]


@njit(cache=True, nogil=True, inline="always")
def _node_weights(tables: Propagators, level: int) -> None:
    """Weights of the nodes of the block."""
    driven = tables.W.shape[1]
    size, H, E = tables.A.shape[0], tables.H, tables.E
    for a in range(H.shape[1]):
        for node in range(NODES):
            for place in range(NODES - 1):
                for i in range(size):
                    total = 0.0
                    for j in range(size):
                        total += E[level, j, i] * H[level, a, node, place * size + j]
                    for q in range(NODES):
                        total += LOCAL[place, node, q] * tables.P[level, driven + a, q, i]
                    H[level, a, node, place * size + size + i] = total


@separate(void, PROPAGATORS, int64, float64)
def build(tables: Propagators, level: int, sample: float) -> None:
    """Bring the tables up to date as far as ``level``; ``sample`` is the length of a sample [s].

    Parameters
    ----------
    tables : Propagators
        With the matrix and the inputs; filled.
    level : int
        Highest level that is needed.
    sample : float
        Time from sample to sample [s].
    """
    for_size()
    while tables.built[0] <= level:
        now = tables.built[0]
        if now == 0:
            _build_first(tables, sample / 2.0**SAMPLE)
        else:
            _double(tables, now)
        _input_weights(tables, now)
        _node_weights(tables, now)
        tables.built[0] = now + 1


def _within(level: int) -> FloatArray:
    """Where the samples of a block lie behind its start, in sub-blocks."""
    samples = max((4 << level) // TICKS, 1)
    places: FloatArray = 4.0 / samples * np.arange(1, samples + 1)
    return places


def _at_samples(polynomials: list[Polynomial]) -> FloatArray:
    """Polynomials at the samples of a block of every level, shape (level, node, sample)."""
    table = np.zeros((LEVELS, NODES, 4 * LONGEST))
    for level in range(LEVELS):
        places = _within(level)
        for node, polynomial in enumerate(polynomials):
            table[level, node, : places.size] = polynomial(places)
    return table


def _integrals() -> list[Polynomial]:
    return [basis.integ() - basis.integ()(0) for basis in _lagrange()]


# the polynomial through the nodes, and its integral from node 0, at the samples of a block
VALUE_AT = _at_samples(_lagrange())
INTEGRAL_AT = _at_samples(_integrals())
