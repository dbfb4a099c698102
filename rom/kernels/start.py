"""Space for a run, the state that it starts from, and the size of a force."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rom.kernels.block import SHARPNESS, Block
from rom.kernels.equations import IntArray, Program
from rom.kernels.propagators import LONGEST, NODES, Propagators

CHUNK = 16  # samples whose sizes stand for their running sum


def empty_block(program: Program, active: IntArray, inputs: int) -> Block:
    """Space for a block.

    Parameters
    ----------
    program : Program
        The structure.
    active : ndarray, shape (active links,)
        Links whose force is not linear, or which have a tension law.
    inputs : int
        Driven bodies and active links; 0 if samples are not written.

    Returns
    -------
    Block
        All zero.
    """
    size, width, links = 2 * program.size[0], program.size[1] + program.size[2], active.size
    samples = 4 * LONGEST + 1 if inputs else 0
    y, free = np.zeros((NODES, size)), np.zeros((NODES, size))
    return Block(
        y,
        free,
        y[1:].reshape(-1),
        free[1:].reshape(-1),
        np.zeros((NODES, links)),
        np.zeros((NODES, width)),
        np.zeros((NODES, width + 1)),
        np.zeros(program.size[1]),
        np.zeros((links, 2)),
        np.zeros((NODES, links, 2)),
        active,
        np.zeros(1),
        np.zeros((2, NODES, width)),
        np.zeros((NODES, width)),
        np.zeros(8),
        np.zeros((inputs, samples)),
        np.zeros((size, samples)),
        np.zeros((2, inputs, size)),
        np.zeros((size + inputs, LONGEST if inputs else 0, 4)),
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def clear(block: Block, y0: Any, tensions: Any) -> None:
    """Node 0 at the start of a run, before its forces and rates are known.

    Parameters
    ----------
    block : Block
        Takes them.
    y0 : ndarray, shape (2 bodies + states,)
        Displacements [m], velocities [m/s] and states.
    tensions : ndarray, shape (tensions,)
        Tensions [N].
    """
    largest = 1.0
    for b in range(tensions.size):
        block.start[b] = tensions[b]
        largest = max(largest, tensions[b])
    for i in range(block.y.shape[1]):
        block.y[0, i] = y0[i]
    for i in range(tensions.size):
        block.z[0, i] = 0.0
    for i in range(tensions.size, block.z.shape[1]):
        block.z[0, i], block.slope[0, i] = y0[block.y.shape[1] + i - tensions.size], 0.0
    block.change[SHARPNESS] = 10.0 / largest


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def enter(program: Program, p: Any, driven: Any, active: Any, tables: Propagators) -> None:
    """Where forces on bodies and forces of active links enter the velocities.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    driven, active : ndarray
        Bodies and links.
    tables : Propagators
        Takes it.
    """
    n = program.size[0]
    for u in range(driven.size):
        tables.b[u, n + driven[u]] = 1.0 / p[driven[u]]
    for a in range(active.size):
        first, second = program.ends[active[a], 0], program.ends[active[a], 1]
        if first >= 0:
            tables.b[driven.size + a, n + first] = -1.0 / p[first]
        if second >= 0:
            tables.b[driven.size + a, n + second] = 1.0 / p[second]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "nsz"})
def largest_impulse(force: Any) -> float:
    """An upper bound, within some samples' sizes, of the largest running sum of a force."""
    largest = running = 0.0
    whole = force.size // CHUNK * CHUNK
    for i in range(whole, force.size):
        running += force[i]
    for start in range(0, whole, CHUNK):
        part = force[start : start + CHUNK]
        total = size = 0.0
        for i in range(CHUNK):
            total += part[i]
            size += abs(part[i])
        largest = max(largest, abs(running) + size)
        running += total
    return largest
