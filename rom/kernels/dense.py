"""The response at every sample within a solved block."""

from __future__ import annotations

from typing import Any

from numba import float64, int64, njit, void

from rom.kernels.block import BLOCK, Block
from rom.kernels.equations import FORCES
from rom.kernels.function_addresses import floats, separate
from rom.kernels.propagators import (
    INTEGRAL_AT,
    NODES,
    PROPAGATORS,
    SAMPLE,
    TICKS,
    VALUE_AT,
    Propagators,
)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill_sample(block: Block, tables: Propagators, force: Any, node: int, out: Any, sample: int) -> None:
    """Write the sample at a node: motion, tensions and states, accelerations.

    Parameters
    ----------
    block : Block
        Solved.
    tables : Propagators
        Matrix and inputs of the linear part.
    force : ndarray, shape (driven bodies, samples)
        Forces [N].
    node : int
        The node.
    out : ndarray, shape (3 bodies + tensions + states, samples)
        Filled: displacements, velocities, tensions, states, accelerations.
    sample : int
        The sample.
    """
    size, width, driven = block.y.shape[1], block.z.shape[1], force.shape[0]
    for i in range(size):
        out[i, sample] = block.y[node, i]
    for i in range(width):
        out[size + i, sample] = block.z[node, i]
    for b in range(block.start.size):
        out[size + b, sample] = max(block.start[b] + block.z[node, b], 0.0)
    for i in range(size // 2):
        row, total = size // 2 + i, 0.0
        for j in range(size):
            total += tables.A[row, j] * block.y[node, j]
        for u in range(driven):
            total += tables.b[u, row] * force[u, sample]
        for a in range(block.active.size):
            total += tables.b[driven + a, row] * block.N[node, a]
        out[size + width + i, sample] = total


@separate(void, BLOCK, PROPAGATORS, FORCES, int64, int64, float64, floats(2))
def fill(block: Block, tables: Propagators, force: Any, level: int, tick: int, d: float, out: Any) -> None:
    """Write the samples of the block that ends at ``tick``.

    Parameters
    ----------
    block : Block
        Solved.
    tables : Propagators
        Tables of the linear part.
    force : ndarray, shape (driven bodies, samples)
        Forces [N].
    level : int
        Of the sub-blocks.
    tick : int
        Where the block ends, in ticks.
    d : float
        Length of a sub-block [s].
    out : ndarray, shape (3 bodies + tensions + states, samples)
        Filled: displacements, velocities, tensions, states, accelerations.
    """
    samples = (4 << level) // TICKS
    if samples > 2:
        _fill_long(block, tables, force, level, tick // TICKS - samples, d, out)
        return
    for node in (NODES // 2, NODES - 1):
        last = node == NODES - 1
        if tick % TICKS == 0 if last else samples == 2:
            _fill_sample(block, tables, force, node, out, tick // TICKS - (0 if last else 1))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add(row: Any, factor: float, values: Any) -> None:
    """``row += factor * values``."""
    if factor == 0.0:  # of a tension that rests, of a force on another body
        return
    for i in range(row.size):
        row[i] += factor * values[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _side_by_side(row: Any, count: int, lanes: Any) -> None:
    """``count`` samples of four sub-blocks, which follow each other in a row, as (sample, 4)."""
    for place in range(4):
        for step in range(count):
            lanes[step, place] = row[place * count + step]


@njit(cache=True, nogil=True, error_model="numpy")
def _in_order(lanes: Any, count: int, row: Any) -> None:
    """The inverse of ``_side_by_side``."""
    for place in range(4):
        for step in range(count):
            row[place * count + step] = lanes[step, place]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _follow(y: Any, E: Any, inputs: Any, starts: Any, ends: Any, count: int, lanes: Any) -> None:
    """Motion ``y`` (state, samples) at ``count`` samples of four sub-blocks, all four side by side.

    A sample follows from the one before by ``E`` and by ``inputs`` (input, samples + 1), linear between
    samples, with the weights ``starts`` and ``ends`` (input, state). In ``lanes`` (state and input, sample,
    4) the same samples of the four lie together and are summed up at once.
    """
    size = y.shape[0]
    for i in range(size):
        for place in range(4):
            lanes[i, 0, place] = y[i, place * count]
    for u in range(inputs.shape[0]):
        _side_by_side(inputs[u], count, lanes[size + u])
    for step in range(1, count):
        for i in range(size):
            first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
            for u in range(starts.shape[0]):
                before, after = lanes[size + u, step - 1], lanes[size + u, step]
                old, new = starts[u, i], ends[u, i]
                first += old * before[0] + new * after[0]
                second += old * before[1] + new * after[1]
                third += old * before[2] + new * after[2]
                fourth += old * before[3] + new * after[3]
            for j in range(size):
                along, before = E[j, i], lanes[j, step - 1]
                first += along * before[0]
                second += along * before[1]
                third += along * before[2]
                fourth += along * before[3]
            here = lanes[i, step]
            here[0], here[1], here[2], here[3] = first, second, third, fourth
    for i in range(size):
        _in_order(lanes[i], count, y[i])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill_motion(block: Block, tables: Propagators, y: Any, inputs: Any, level: int) -> None:
    """Motion ``y`` at the samples of a block, and the forces of active links among the ``inputs``."""
    driven, count = tables.W.shape[1], (1 << (level - SAMPLE))
    for a in range(block.active.size):
        for i in range(4 * count):
            inputs[driven + a, i + 1] = 0.0
        for node in range(NODES):
            _add(inputs[driven + a, 1:], block.N[node, a], VALUE_AT[level, node])
        inputs[driven + a, 0] = block.N[0, a]
    for node in range(NODES):
        for i in range(y.shape[0]):
            y[i, node * count] = block.y[node, i]
    size, inputs_count = y.shape[0], inputs.shape[0]
    weights = block.weights
    for u in range(inputs_count):
        for i in range(size):
            weights[1, u, i] = tables.P[SAMPLE, u, 1, i]
            weights[0, u, i] = tables.P[SAMPLE, u, 0, i] - weights[1, u, i]
    _follow(y, tables.E[SAMPLE], inputs, weights[0], weights[1], count, block.lanes)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill_change(block: Block, row: int, level: int, d: float, values: Any) -> None:
    """A tension or state at the samples of a block."""
    for i in range(values.size):
        values[i] = block.z[0, row]
    for node in range(NODES):
        _add(values, d * block.r[node, row], INTEGRAL_AT[level, node])
    if row < block.start.size:
        for i in range(values.size):
            values[i] = max(block.start[row] + values[i], 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill_long(
    block: Block, tables: Propagators, force: Any, level: int, start: int, d: float, out: Any
) -> None:
    """Write the samples of a block of four or more, row by row."""
    size, width, span = block.y.shape[1], block.z.shape[1], 4 * (1 << (level - SAMPLE))
    inputs, y = block.inputs, block.motion
    for u in range(force.shape[0]):
        for i in range(span + 1):
            inputs[u, i] = force[u, start + i]
    _fill_motion(block, tables, y, inputs, level)
    for row in range(out.shape[0]):
        values = out[row, start + 1 : start + span + 1]
        if size <= row < size + width:
            _fill_change(block, row - size, level, d, values)
            continue
        for i in range(span):
            values[i] = y[row, i + 1] if row < size else 0.0
        if row >= size:
            rate = row - size - width + size // 2
            for j in range(size):
                _add(values, tables.A[rate, j], y[j, 1:])
            for u in range(inputs.shape[0]):
                _add(values, tables.b[u, rate], inputs[u, 1:])
