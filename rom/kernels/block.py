"""One block of the exponential integrator: its nodes and their equations."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import float64, int64, njit, void

from rom.kernels.equations import COEFFICIENTS, FORCES, PROGRAM, Program
from rom.kernels.function_addresses import floats, for_size, integers, invoke, named, pointer, separate
from rom.kernels.propagators import NODES, PROPAGATORS, SAMPLE, TICKS, Propagators

# places in Block.change: what the last sweep changed, and what decides how much the next one would
FORCE, TENSION, STATE, STIFFNESS, DAMPING, SPEED, SHARPNESS, SIZE = range(8)


class Block(NamedTuple):
    """Values at the nodes of a block; ``z`` holds the changes of the tensions, then the states."""

    y: Any  # (node, displacements and velocities)
    free: Any  # (node, displacements and velocities): what they would be without N
    y_row: Any  # y, and free, at nodes 1 to 4 in one row
    free_row: Any
    N: Any  # (node, active link): force beyond the linear part
    z: Any  # (node, tensions + states)
    r: Any  # (node, tensions + states + 1): rates of z, and a place for links without tension
    start: Any  # (tensions,): initial tensions
    base: Any  # (active link, 2): stiffness and damping of the linear part
    beyond: Any  # (node, active link, 2): stiffness and damping beyond it
    active: Any  # (active links,)
    spare: Any  # (1,): where an effect puts its tension rate
    past: Any  # (2, node, tensions + states): z and r of the last sweep
    slope: Any  # (node, tensions + states): of a state's rate by the state, where it is known
    change: Any  # (8,): see above
    inputs: Any  # (input, samples of the longest block + 1): what a block is written from, as the next two
    motion: Any  # (displacements and velocities, samples + 1)
    weights: Any  # (2, input, displacements and velocities)
    lanes: Any  # (displacements, velocities and inputs, sample, 4): those of four sub-blocks side by side


BLOCK = named(
    Block, floats(2), floats(2), floats(1), floats(1), floats(2), floats(2), floats(2), floats(1), floats(2),
    floats(3), integers(1), floats(1), floats(3), floats(2), floats(1), floats(2), floats(2), floats(3),
    floats(3),
)  # fmt: skip


@separate(void, PROGRAM, COEFFICIENTS, BLOCK, PROPAGATORS)
def linearise(program: Program, p: Any, block: Block, tables: Propagators) -> None:
    """Take the linear part at the tensions of node 0.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    block : Block
        Takes stiffness and damping of the linear part.
    tables : Propagators
        Takes their matrix; none of its levels is up to date then.
    """
    for_size()
    n = program.size[0]
    A, laws = tables.A, program.laws
    for i in range(2 * n):
        for j in range(2 * n):
            A[i, j] = 0.0
    for i in range(n):
        A[i, n + i] = 1.0
    at = 0
    for link in range(laws.shape[0]):
        bolt = program.tension[link]
        T = max(block.start[bolt] + block.z[0, bolt], 0.0) if bolt >= 0 else 0.0
        k = invoke(laws[link, 0], (T, pointer(p, laws[link, 1])))
        c = invoke(laws[link, 2], (T, pointer(p, laws[link, 3])))
        if at < block.active.size and block.active[at] == link:
            block.base[at, 0], block.base[at, 1] = k, c
            at += 1
        for row in range(2):
            i = program.ends[link, row]
            for column in range(2):
                j = program.ends[link, column]
                if i >= 0 and j >= 0:
                    sign = -1.0 if row == column else 1.0
                    A[n + i, j] += sign * k / p[i]
                    A[n + i, n + j] += sign * c / p[i]
    tables.built[0] = 0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def evaluate(program: Program, p: Any, block: Block, from_node: int, t: float, d: float) -> None:
    """Forces beyond the linear part and rates at the nodes from ``from_node`` on.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    block : Block
        With motion, tensions and states; takes forces, rates, and how much the forces changed.
    from_node : int
        First node.
    t : float
        Time of node 0 [s].
    d : float
        Length of a sub-block [s].
    """
    n, tensions, _ = program.size
    laws, change, width = program.laws, block.change, block.r.shape[1]
    for node in range(from_node, NODES):
        for i in range(width):
            block.r[node, i] = 0.0
    change[FORCE] = change[STIFFNESS] = change[DAMPING] = change[SPEED] = 0.0
    for a in range(block.active.size):
        link = block.active[a]
        first, second, bolt = program.ends[link, 0], program.ends[link, 1], program.tension[link]
        place = bolt if bolt >= 0 else width - 1
        for node in range(from_node, NODES):
            x = v = T = 0.0
            if first >= 0:
                x, v = block.y[node, first], block.y[node, n + first]
            if second >= 0:
                x, v = x - block.y[node, second], v - block.y[node, n + second]
            if bolt >= 0:
                T = max(block.start[bolt] + block.z[node, bolt], 0.0)
            k = invoke(laws[link, 0], (T, pointer(p, laws[link, 1])))
            c = invoke(laws[link, 2], (T, pointer(p, laws[link, 3])))
            damping_force = c * v
            force = k * x + damping_force
            for e in range(program.effect_start[link], program.effect_start[link + 1]):
                address, offset, state = program.effects[e, 0], program.effects[e, 1], program.effects[e, 2]
                states = pointer(block.z, node * block.z.shape[1] + tensions + state)
                rates = pointer(block.r, node * width + tensions + state)
                added = pointer(block.spare, 0)
                block.spare[0] = 0.0
                force += invoke(
                    address, (t + node * d, x, v, T, k, c, states, pointer(p, offset), rates, added)
                )
                block.r[node, place] += block.spare[0]
            if laws[link, 4] != 0:
                block.r[node, place] += invoke(
                    laws[link, 4], (T, x, v, force, damping_force, pointer(p, laws[link, 5]))
                )
            k, c = k - block.base[a, 0], c - block.base[a, 1]
            force -= block.base[a, 0] * x + block.base[a, 1] * v
            change[FORCE] = max(change[FORCE], abs(force - block.N[node, a]))
            change[STIFFNESS] = max(change[STIFFNESS], abs(k))
            change[DAMPING] = max(change[DAMPING], abs(c))
            change[SPEED] = max(change[SPEED], abs(v))
            block.beyond[node, a, 0], block.beyond[node, a, 1] = k, c
            block.N[node, a] = force


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def evaluate_rates(program: Program, p: Any, block: Block) -> None:
    """Rates of the tensions at nodes 1 to 4 without effects, from the stiffness and damping known so far.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    block : Block
        With motion, tensions and stiffness; takes the rates.
    """
    n, width = program.size[0], block.r.shape[1]
    for node in range(1, NODES):
        for i in range(width):
            block.r[node, i] = 0.0
    for a in range(block.active.size):
        link = block.active[a]
        first, second, bolt = program.ends[link, 0], program.ends[link, 1], program.tension[link]
        if program.laws[link, 4] == 0:
            continue
        for node in range(1, NODES):
            x = v = 0.0
            if first >= 0:
                x, v = block.y[node, first], block.y[node, n + first]
            if second >= 0:
                x, v = x - block.y[node, second], v - block.y[node, n + second]
            T = max(block.start[bolt] + block.z[node, bolt], 0.0)
            damping_force = (block.base[a, 1] + block.beyond[node, a, 1]) * v
            force = (block.base[a, 0] + block.beyond[node, a, 0]) * x + damping_force
            block.r[node, bolt] += invoke(
                program.laws[link, 4], (T, x, v, force, damping_force, pointer(p, program.laws[link, 5]))
            )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def evaluate_laws(program: Program, p: Any, block: Block) -> None:
    """Stiffness and damping beyond the linear part at nodes 1 to 4, of links with a tension.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers: k [N/m], c [N s/m] and what their laws hold.
    block : Block
        Tensions [N] at its nodes; filled.
    """
    for a in range(block.active.size):
        link, bolt = block.active[a], program.tension[block.active[a]]
        stiffness, damping = program.laws[link, 1], program.laws[link, 3]
        for node in range(1, NODES):
            T = max(block.start[bolt] + block.z[node, bolt], 0.0)
            k = invoke(program.laws[link, 0], (T, pointer(p, stiffness)))
            c = invoke(program.laws[link, 2], (T, pointer(p, damping)))
            block.beyond[node, a, 0], block.beyond[node, a, 1] = k - block.base[a, 0], c - block.base[a, 1]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _long_response(forced: Any, weights: Any, force: Any, count: int) -> None:
    """Add the response to ``4 count + 1`` samples to four sub-blocks of ``count`` samples each."""
    for i in range(forced.shape[1]):
        first = second = third = fourth = 0.0
        for j in range(count):
            weight = weights[i, j]
            first += weight * force[j]
            second += weight * force[j + count]
            third += weight * force[j + 2 * count]
            fourth += weight * force[j + 3 * count]
        weight = weights[i, count]
        forced[0, i] += first + weight * force[count]
        forced[1, i] += second + weight * force[2 * count]
        forced[2, i] += third + weight * force[3 * count]
        forced[3, i] += fourth + weight * force[4 * count]


@separate(void, floats(2), floats(2), floats(3), floats(4), FORCES, int64, int64)
def free_motion(free: Any, y: Any, E: Any, W: Any, force: Any, level: int, tick: int) -> None:
    """Linear motion at nodes 1 to 4 from the motion ``y`` at node 0.

    Parameters
    ----------
    free : ndarray, shape (NODES, 2 bodies)
        Filled.
    y : ndarray, shape (NODES, 2 bodies)
        Motion, of which node 0 is read.
    E, W : ndarray
        As in `Propagators`.
    force : ndarray, shape (driven bodies, samples)
        Forces [N].
    level : int
        Of the sub-blocks.
    tick : int
        Where the block starts, in ticks.
    """
    forced = free[1:]
    for i in range(free.shape[1]):
        free[0, i] = y[0, i]
        for place in range(NODES - 1):
            forced[place, i] = 0.0
    for u in range(force.shape[0]):
        if level >= SAMPLE:
            count, sample = (1 << (level - SAMPLE)), tick // TICKS
            _long_response(forced, W[level, u], force[u, sample : sample + 4 * count + 1], count)
            continue
        for place in range(NODES - 1):
            at = tick + (place << level)
            sample = at // TICKS
            slope = (force[u, sample + 1] - force[u, sample]) / TICKS
            start = force[u, sample] + slope * (at - sample * TICKS)
            end = start + slope * (1 << level)
            for i in range(forced.shape[1]):
                forced[place, i] += W[level, u, i, 0] * start + W[level, u, i, 1] * end
    for node in range(1, NODES):
        for i in range(free.shape[1]):
            total = free[node, i]
            for j in range(free.shape[1]):
                total += E[level, j, i] * free[node - 1, j]
            free[node, i] = total


@separate(void, PROGRAM, COEFFICIENTS, BLOCK, float64)
def restart(program: Program, p: Any, block: Block, t: float) -> None:
    """Forces and rates at node 0, by way of all nodes.

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    block : Block
        With motion, tensions and states at node 0; takes forces and rates.
    t : float
        Time of node 0 [s].
    """
    for_size()
    for node in range(1, NODES):
        copy_node(block, 0, node)
    evaluate(program, p, block, 0, t, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def copy_node(block: Block, node: int, target: int) -> None:
    """Take the values at a node for those at another.

    Parameters
    ----------
    block : Block
        Motion, forces and rates at nodes.
    node, target : int
        Places of the nodes.
    """
    for i in range(block.y.shape[1]):
        block.y[target, i] = block.y[node, i]
    for a in range(block.N.shape[1]):
        block.N[target, a] = block.N[node, a]
        block.beyond[target, a, 0] = block.beyond[node, a, 0]
        block.beyond[target, a, 1] = block.beyond[node, a, 1]
    for i in range(block.r.shape[1]):
        block.r[target, i] = block.r[node, i]
    for i in range(block.z.shape[1]):
        block.z[target, i], block.slope[target, i] = block.z[node, i], block.slope[node, i]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def advance(block: Block) -> None:
    """Make the last node the first; a tension does not fall below zero."""
    copy_node(block, NODES - 1, 0)
    for b in range(block.start.size):
        block.z[0, b] = max(block.z[0, b], -block.start[b])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def drifted(block: Block, limit: float) -> bool:
    """Whether the linear part has moved away from that of node 0."""
    for a in range(block.active.size):
        for part in range(2):
            beyond = abs(block.beyond[0, a, part])
            if beyond > limit * max(
                abs(block.base[a, part]), abs(block.base[a, part] + block.beyond[0, a, part])
            ):
                return True
    return False
