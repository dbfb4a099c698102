"""The sweeps that solve a block, and the estimate of its error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, float64, int64, njit, types

from rom.kernels.block import (
    BLOCK,
    FORCE,
    SHARPNESS,
    SIZE,
    SPEED,
    STATE,
    TENSION,
    Block,
    evaluate,
    evaluate_laws,
    evaluate_rates,
)
from rom.kernels.equations import COEFFICIENTS, PROGRAM, Program
from rom.kernels.function_addresses import INNER, floats, for_size, separate
from rom.kernels.propagators import INTEGRAL, NODES, SIMPSON, TRIANGULAR

GOAL = types.UniTuple(float64, 3)  # type: ignore[no-untyped-call]
SWEEPS = 12
LEAST_RATIO = 0.1  # of a sweep's change to that before: a single small one foretells nothing
NO_MOVE = 1e-9  # of a state, below which its rate tells no slope
SMOOTH = 10  # up to this level a first guess of the tension goes on at the rate of node 0


@njit(**INNER)  # type: ignore[untyped-decorator]
def _collocate_motion(y: Any, free: Any, N: Any, H: Any) -> None:
    """Motion at nodes 1 to 4, in one row, from the forces at all nodes; alone, as it gains by vectorising."""
    for i in range(y.size):
        y[i] = free[i]
    for a in range(N.shape[1]):
        for node in range(NODES):
            value, weights = N[node, a], H[a, node, H.shape[2] - y.size :]
            for i in range(y.size):
                y[i] += weights[i] * value


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _integral(block: Block, d: float, node: int, i: int) -> float:
    """A tension change or state at a node from its rates at all nodes."""
    total: float = block.z[0, i]
    for other in range(NODES):
        total += INTEGRAL[node, other] * d * block.r[other, i]
    return total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _collocate_tensions(block: Block, d: float) -> None:
    """Tension changes at nodes 1 to 4 from the rates at all nodes."""
    block.change[TENSION] = 0.0
    for i in range(block.start.size):
        for node in range(1, NODES):
            total = _integral(block, d, node, i)
            block.change[TENSION] = max(block.change[TENSION], abs(total - block.z[node, i]))
            block.z[node, i] = total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _take_slopes(block: Block, i: int, first: bool) -> None:
    """How a state's rate falls with the state at nodes 1 to 4: as in the last two sweeps, or as at node 0."""
    z, r, past, slope = block.z, block.r, block.past, block.slope
    for node in range(1, NODES):
        moved = z[node, i] - past[0, node, i]
        if first:
            slope[node, i] = slope[0, i]
        elif abs(moved) > NO_MOVE * abs(z[node, i]):
            slope[node, i] = min((r[node, i] - past[1, node, i]) / moved, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _collocate_states(program: Program, block: Block, d: float, first: bool) -> None:
    """States at nodes 1 to 4 from the rates at all nodes.

    A slider's rate falls so fast with its state that plain sweeps diverge over a tenth of a slip. That of an
    effect with one state is taken along implicitly (M. Weiser, BIT Numer. Math. 55, 1219, 2015).
    """
    effects, past, slope = program.effects, block.past, block.slope
    block.change[STATE] = 0.0
    for e in range(effects.shape[0]):
        begin = effects[e, 2]
        end = effects[e + 1, 2] if e + 1 < effects.shape[0] else program.size[2]
        for i in range(block.start.size + begin, block.start.size + end):
            if end - begin == 1:
                _take_slopes(block, i, first)
            change = size = 0.0
            for node in range(1, NODES):
                past[0, node, i], past[1, node, i] = block.z[node, i], block.r[node, i]
            for node in range(1, NODES):
                step = _integral(block, d, node, i) - past[0, node, i]
                change = max(change, abs(step))
                for other in range(1, node):
                    moved = block.z[other, i] - past[0, other, i]
                    step += d * TRIANGULAR[node, other] * slope[other, i] * moved
                step /= 1.0 - d * TRIANGULAR[node, node] * slope[node, i]
                block.z[node, i] += step
                size = max(size, abs(block.z[node, i]))
            if size > 0.0:
                block.change[STATE] = max(block.change[STATE], change / size)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _guess_forces(program: Program, block: Block) -> None:
    """First guess of the forces: laws as at node 0, along the free motion."""
    n = program.size[0]
    for a in range(block.active.size):
        first, second = program.ends[block.active[a], 0], program.ends[block.active[a], 1]
        k, c = block.beyond[0, a, 0], block.beyond[0, a, 1]
        for node in range(1, NODES):
            x = v = 0.0
            if first >= 0:
                x, v = block.free[node, first], block.free[node, n + first]
                x, v = x - block.y[0, first], v - block.y[0, n + first]
            if second >= 0:
                x, v = x - block.free[node, second], v - block.free[node, n + second]
                x, v = x + block.y[0, second], v + block.y[0, n + second]
            block.N[node, a] = block.N[0, a] + k * x + c * v


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _guess_changes(block: Block, d: float) -> None:
    """First guess of the tensions and states: they go on for ``d`` a node at the rates of node 0."""
    for node in range(1, NODES):
        for i in range(block.z.shape[1]):
            block.z[node, i] = block.z[0, i] + node * d * block.r[0, i]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _link_forces(program: Program, block: Block, motion: Any) -> float:
    """Forces beyond the linear part from stiffness, damping and ``motion`` at nodes 1 to 4; their change."""
    n, moved = program.size[0], 0.0
    block.change[SPEED] = block.change[SIZE] = 0.0
    for a in range(block.active.size):
        first, second = program.ends[block.active[a], 0], program.ends[block.active[a], 1]
        for node in range(1, NODES):
            x = v = 0.0
            if first >= 0:
                x, v = motion[node, first], motion[node, n + first]
            if second >= 0:
                x, v = x - motion[node, second], v - motion[node, n + second]
            force = block.beyond[node, a, 0] * x + block.beyond[node, a, 1] * v
            moved = max(moved, abs(force - block.N[node, a]))
            size = abs(force + block.base[a, 0] * x + block.base[a, 1] * v)
            block.change[SPEED], block.change[SIZE] = (
                max(block.change[SPEED], abs(v)),
                max(block.change[SIZE], size),
            )
            block.N[node, a] = force
    return moved


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _next_tension(block: Block, moved: float, span: float, mobility: float) -> float:
    """What a further sweep would change a tension by [N], after one that changed forces by ``moved``.

    A rate goes with about the fourth power of velocity, and with the tension by its sharpness.
    """
    change, over = block.change, block.change[TENSION]
    for b in range(block.start.size):
        over = max(over, abs(block.z[NODES - 1, b] - block.z[0, b]))
    relative = change[SHARPNESS] * change[TENSION]
    if change[SPEED] > 0.0 and change[SIZE] > 0.0:
        relative += 4.0 * moved * (mobility * span / change[SPEED] + 1.0 / change[SIZE])
    tension: float = min(over * relative, change[TENSION])
    return tension


@separate(boolean, PROGRAM, COEFFICIENTS, BLOCK, floats(4), int64, float64, GOAL, float64)
def solve_laws(
    program: Program, p: Any, block: Block, H: Any, level: int, d: float, goal: Any, mobility: float
) -> bool:
    """As ``solve`` for links with laws alone: first the tensions along the motion, then forces and motion.

    Parameters
    ----------
    program, p, block, H, level, d
        As for `solve`.
    goal : tuple of float
        Impulse [N s] and tension [N] below which the next change is small enough.
    mobility : float
        Twice the inverse of the smallest mass [1/kg]: relative velocity for an impulse, at most.

    Returns
    -------
    bool
        False where the sweeps do not settle.
    """
    for_size()
    for node in range(1, NODES):
        for a in range(block.active.size):
            block.beyond[node, a, 0], block.beyond[node, a, 1] = block.beyond[0, a, 0], block.beyond[0, a, 1]
    _guess_changes(block, d if level <= SMOOTH else 0.0)
    _link_forces(program, block, block.free)
    _collocate_motion(block.y_row, block.free_row, block.N, H[level])
    change, span = block.change, NODES * d - d
    for _ in range(SWEEPS):
        evaluate_rates(program, p, block)
        _collocate_tensions(block, d)
        evaluate_laws(program, p, block)
        moved = last = 0.0
        for turn in range(SWEEPS + 1):  # each function in one place: it is compiled as often as it is written
            if turn > 0:
                _collocate_motion(block.y_row, block.free_row, block.N, H[level])
            last = _link_forces(program, block, block.y)
            moved += last
            if turn > 0 and span * last <= goal[0]:
                break
        if not np.isfinite(moved + change[TENSION]):
            return False
        if span * last <= goal[0] and _next_tension(block, moved, span, mobility) <= goal[1]:
            return True
    return False


@separate(boolean, PROGRAM, COEFFICIENTS, BLOCK, floats(4), int64, float64, float64, GOAL)
def solve(program: Program, p: Any, block: Block, H: Any, level: int, t: float, d: float, goal: Any) -> bool:
    """Sweep until the next change would be below the goals: impulse [N s], tension [N], state (relative).

    Parameters
    ----------
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    block : Block
        With node 0 and the free motion; takes the rest.
    H : ndarray
        As in `Propagators`.
    level : int
        Of the sub-blocks.
    t : float
        Time of node 0 [s].
    d : float
        Length of a sub-block [s].
    goal : tuple of float
        The goals.

    Returns
    -------
    bool
        False where the sweeps do not settle.
    """
    for_size()
    _guess_changes(block, d if level <= SMOOTH else 0.0)
    _guess_forces(program, block)
    change, before = block.change, 0.0
    for sweep in range(-1, SWEEPS):
        if sweep >= 0:
            evaluate(program, p, block, 1, t, d)
        _collocate_motion(block.y_row, block.free_row, block.N, H[level])
        if sweep < 0:
            continue
        _collocate_tensions(block, d)
        _collocate_states(program, block, d, sweep == 0)
        now = max(4.0 * d * change[FORCE] / goal[0], change[TENSION] / goal[1], change[STATE] / goal[2])
        if not np.isfinite(now):
            return False
        if now <= 1.0 or (sweep > 0 and now * min(max(now / before, LEAST_RATIO), 1.0) <= 1.0):
            return True
        before = now
    return False


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _quadrature_error(values: Any, column: int, d: float) -> float:
    """Error of the integral over a block: that of Simpson's rule taken to the order of the rule in use.

    For an oscillation both errors are powers of frequency times length, e6 = 5.1 e4^(3/2).
    """
    simpson = boole = size = 0.0
    for node in range(NODES):
        simpson += SIMPSON[node] * values[node, column]
        boole += INTEGRAL[NODES - 1, node] * values[node, column]
        size += INTEGRAL[NODES - 1, node] * abs(values[node, column])
    if size == 0.0:
        return 0.0
    ratio = abs(simpson - boole) / size
    error: float = d * size * min(ratio, 5.1 * ratio * np.sqrt(ratio))
    return error


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def errors(block: Block, d: float, scale: Any) -> Any:
    """Estimated errors of a block: the largest of impulses [N s], of tensions [N], of states (relative).

    Parameters
    ----------
    block : Block
        A block after its last sweep.
    d : float
        Step between its nodes [s].
    scale : ndarray, shape (2 + states,)
        Sizes of velocity [m/s], tension [N] and states, which errors are relative to.

    Returns
    -------
    tuple of float
        Of impulses [N s], tensions [N] and states [1].
    """
    impulse = tension = state = 0.0
    for a in range(block.active.size):
        impulse = max(impulse, _quadrature_error(block.N, a, d))
    tensions = block.start.size
    for i in range(block.z.shape[1]):
        error = _quadrature_error(block.r, i, d)
        if i < tensions:
            tension = max(tension, error)
        else:
            state = max(state, error / scale[2 + i - tensions])
    return impulse, tension, state
