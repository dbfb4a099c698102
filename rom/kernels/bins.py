"""Means of the tensions over bins of samples, from the polynomials of the blocks."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import float64, int64, njit

from rom.kernels.block import BLOCK, Block
from rom.kernels.equations import IntArray
from rom.kernels.function_addresses import floats, for_size, integers, separate
from rom.kernels.propagators import INTEGRAL_AT, LEVELS, NODES, TICKS, FloatArray


@cache
def sums_of_blocks(every: int) -> FloatArray:
    """Sums over the samples of whole blocks, shape (level, phase, NODES + 1); the last one is their count.

    Only samples that are multiples of ``every`` count; the phase is that of the sample at the block's start.
    """
    sums = np.zeros((LEVELS, every, NODES + 1))
    for level in range(LEVELS):
        for phase in range(every):
            counted = INTEGRAL_AT[level, :, (-phase - 1) % every : max((4 << level) // TICKS, 1) : every]
            sums[level, phase, NODES] = counted.shape[1]
            if counted.size:
                sums[level, phase, :NODES] = np.cumsum(counted, axis=1)[:, -1]  # one by one, as in a block
    return sums


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add_samples(
    block: Block, level: int, start: int, first: int, stop: int, d: float, every: int, total: Any
) -> None:
    """Add the tension changes at samples from ``first`` to before ``stop`` of the block behind ``start``."""
    for sample in range((first + every - 1) // every * every, stop, every):
        for b in range(total.size):
            total[b] += block.z[0, b]
            for node in range(NODES):
                total[b] += d * INTEGRAL_AT[level, node, sample - start - 1] * block.r[node, b]


@separate(int64, BLOCK, int64, int64, float64, integers(1), int64, floats(3), int64, floats(2))
def add(
    block: Block, level: int, tick: int, d: float, edges: Any, every: int, sums: Any, bin: int, total: Any
) -> int:
    """Add the tension changes at the samples of the block that ends at ``tick`` to the bins from ``bin`` on.

    The sample at a block's start belongs to the block before. Returns the bin of the next sample.

    Parameters
    ----------
    block : Block
        Solved.
    level : int
        Of its sub-blocks.
    tick : int
        Where it ends, in ticks.
    d : float
        Length of a sub-block [s].
    edges : ndarray, shape (bins + 1,)
        Samples at which bins begin and end.
    every : int
        Only multiples of so many samples count.
    sums : ndarray, shape (level, phase, NODES + 1)
        As from `sums_of_blocks`.
    bin : int
        Bin of the first sample.
    total : ndarray, shape (bins, tensions)
        Added to.

    Returns
    -------
    int
        Bin of the next sample.
    """
    for_size()
    start, last = (tick - (4 << level)) // TICKS, tick // TICKS
    sample = max(start + 1, edges[bin]) if bin < edges.size - 1 else last + 1
    while sample <= last and bin < edges.size - 1:
        stop = min(last + 1, edges[bin + 1])
        if sample == start + 1 and stop == last + 1:
            weights = sums[level, start % every]
            for b in range(block.start.size):
                value = 0.0
                for node in range(NODES):
                    value += weights[node] * block.r[node, b]
                total[bin, b] += weights[NODES] * block.z[0, b] + d * value
        else:
            _add_samples(block, level, start, sample, stop, d, every, total[bin])
        sample = stop
        if stop == edges[bin + 1]:
            bin += 1
    return bin


def means(sums: FloatArray, edges: IntArray, every: int, starts: FloatArray) -> FloatArray:
    """Mean tensions from the sums of their changes; none falls below zero.

    Parameters
    ----------
    sums : ndarray, shape (..., bins, tensions)
        Over the samples of a bin [N].
    edges : ndarray, shape (..., bins + 1)
        Samples at which bins begin and end.
    every : int
        Only multiples of so many samples count.
    starts : ndarray, shape (..., tensions)
        Tensions at the start [N].

    Returns
    -------
    ndarray, shape (..., bins, tensions)
        Means [N].
    """
    counts = np.diff(-(-edges // every))
    result: FloatArray = np.maximum(starts[..., None, :] + sums / counts[..., None], 0.0)
    return result
