"""The response at every sample within a solved block."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.block import Block
from rom.kernels.propagators import INTEGRAL_AT, NODES, SAMPLE, TICKS, VALUE_AT, Propagators


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _put(
    block: Block, tables: Propagators, force: Any, y: Any, z: Any, N: Any, out: Any, sample: int
) -> None:
    """Write a sample: motion ``y``, changes of tension and states ``z``, and accelerations."""
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
    if samples > 2:
        _fill_long(block, tables, force, level, tick // TICKS - samples, d, out)
        return
    if samples == 2:
        fill_sample(block, tables, force, NODES // 2, out, tick // TICKS - 1)
    if tick % TICKS == 0:
        fill_sample(block, tables, force, NODES - 1, out, tick // TICKS)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add(row: Any, factor: float, values: Any) -> None:
    """``row += factor * values``."""
    for i in range(row.size):
        row[i] += factor * values[i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _follow(y: Any, E: Any, inputs: Any, starts: Any, ends: Any, count: int) -> None:
    """Motion ``y`` (state, samples) at ``count`` samples of four sub-blocks, all four side by side.

    A sample follows from the one before by ``E`` and by ``inputs`` (input, samples + 1), linear between
    samples, with the weights ``starts`` and ``ends`` (input, state).
    """
    size = y.shape[0]
    for step in range(1, count):
        for i in range(size):
            for place in range(4):
                y[i, place * count + step] = 0.0
            for u in range(inputs.shape[0]):
                for place in range(4):
                    at = place * count + step
                    y[i, at] += starts[u, i] * inputs[u, at - 1] + ends[u, i] * inputs[u, at]
            for j in range(size):
                for place in range(4):
                    at = place * count + step
                    y[i, at] += E[j, i] * y[j, at - 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_long(
    block: Block, tables: Propagators, force: Any, level: int, start: int, d: float, out: Any
) -> None:
    """Write the samples of a block of four or more, row by row."""
    size, width, driven, count = block.y.shape[1], block.z.shape[1], force.shape[0], 2 ** (level - SAMPLE)
    span = 4 * count
    inputs, y = np.zeros((tables.b.shape[0], span + 1)), np.zeros((size, span + 1))
    inputs[:driven] = force[:, start : start + span + 1]
    for a in range(block.active.size):
        inputs[driven + a, 0] = block.N[0, a]
        for node in range(NODES):
            _add(inputs[driven + a, 1:], block.N[node, a], VALUE_AT[level, node, :span])
    for node in range(NODES):
        y[:, node * count] = block.y[node]
    ends = tables.P[SAMPLE, :, 1, :]
    _follow(y, tables.E[SAMPLE], inputs, tables.P[SAMPLE, :, 0, :] - ends, ends, count)
    rows = out[:, start + 1 : start + span + 1]
    rows[:size] = y[:, 1:]
    rows[size:] = 0.0
    for i in range(width):
        rows[size + i] = block.z[0, i]
        for node in range(NODES):
            _add(rows[size + i], d * block.r[node, i], INTEGRAL_AT[level, node, :span])
    for b in range(block.start.size):
        rows[size + b] = np.maximum(block.start[b] + rows[size + b], 0.0)
    for i in range(size // 2):
        for j in range(size):
            _add(rows[size + width + i], tables.A[size // 2 + i, j], rows[j])
        for u in range(inputs.shape[0]):
            _add(rows[size + width + i], tables.b[u, size // 2 + i], inputs[u, 1:])
