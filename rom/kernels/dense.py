"""The response at every sample within a solved block."""

from __future__ import annotations

from typing import Any

from numba import njit

from rom.kernels.block import Block
from rom.kernels.propagators import INTEGRAL_AT, NODES, SAMPLE, TICKS, VALUE_AT, Propagators


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _put(
    block: Block, tables: Propagators, force: Any, y: Any, z: Any, N: Any, out: Any, sample: int
) -> None:
    """Write a sample: motion ``y``, changes of tension and states ``z``, accelerations from both and ``N``."""
    size, width, driven = y.size, z.size, force.shape[0]
    for i in range(size):
        out[i, sample] = y[i]
    for i in range(width):
        out[size + i, sample] = z[i]
    for b in range(block.start.size):
        out[size + b, sample] = max(block.start[b] + z[b], 0.0)
    for i in range(size // 2):
        row = size // 2 + i
        total = 0.0
        for j in range(size):
            total += tables.A[row, j] * y[j]
        for u in range(driven):
            total += tables.b[u, row] * force[u, sample]
        for a in range(N.size):
            total += tables.b[driven + a, row] * N[a]
        out[size + width + i, sample] = total


@njit(cache=True, nogil=True, error_model="numpy")
def fill_sample(block: Block, tables: Propagators, force: Any, node: int, out: Any, sample: int) -> None:
    """Write the sample at a node."""
    _put(block, tables, force, block.y[node], block.z[node], block.N[node], out, sample)


@njit(cache=True, nogil=True, error_model="numpy")
def fill(block: Block, tables: Propagators, force: Any, level: int, tick: int, d: float, out: Any) -> None:
    """Write the samples of the block that ends at ``tick``."""
    samples = 4 * 2**level // TICKS
    if samples <= 2:
        for i in range(samples - 1):
            fill_sample(block, tables, force, NODES // 2, out, tick // TICKS - 1)
        if tick % TICKS == 0:
            fill_sample(block, tables, force, NODES - 1, out, tick // TICKS)
        return
    _fill_long(block, tables, force, level, tick // TICKS - samples, d, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_long(
    block: Block, tables: Propagators, force: Any, level: int, start: int, d: float, out: Any
) -> None:
    """Write the samples of a block of four or more, sample by sample from its nodes.

    Between nodes the nodes' polynomial stands for N, taken linear between samples.
    """
    size, driven = block.y.shape[1], force.shape[0]
    E, W, P = tables.E[SAMPLE], tables.W[SAMPLE], tables.P[SAMPLE]
    count = 2 ** (level - SAMPLE)
    y, last, z = block.y[0].copy(), block.y[0].copy(), block.z[0].copy()
    N, before = block.N[0].copy(), block.N[0].copy()
    for i in range(4 * count):
        sample = start + i + 1
        before[:] = N
        last[:] = y
        for a in range(N.size):
            N[a] = 0.0
            for node in range(NODES):
                N[a] += VALUE_AT[level, i, node] * block.N[node, a]
        for j in range(z.size):
            z[j] = 0.0
            for node in range(NODES):
                z[j] += INTEGRAL_AT[level, i, node] * block.r[node, j]
            z[j] = block.z[0, j] + d * z[j]
        if (i + 1) % count == 0:
            y[:] = block.y[(i + 1) // count]
        else:
            for j in range(size):
                total = 0.0
                for k in range(size):
                    total += E[k, j] * last[k]
                for u in range(driven):
                    total += W[u, j, 0] * force[u, sample - 1] + W[u, j, 1] * force[u, sample]
                for a in range(N.size):
                    total += (P[driven + a, 0, j] - P[driven + a, 1, j]) * before[a]
                    total += P[driven + a, 1, j] * N[a]
                y[j] = total
        _put(block, tables, force, y, z, N, out, sample)
