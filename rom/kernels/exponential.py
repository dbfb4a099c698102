"""Exponential block integrator: exact for the linear part, collocation for everything else.

The structure linearised at a tension is propagated exactly under the piecewise linear force. What the links
do beyond that, and the rates of tensions and internal states, are polynomials through the five nodes of a
block (sixth order at its end), found by sweeps. Blocks of 1/4 to 1024 samples start and end on the force's
knots or within one sample; their length follows from an error estimate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from rom.kernels.bins import add, means, sums_of_blocks
from rom.kernels.block import (
    SHARPNESS,
    Block,
    advance,
    copy_node,
    drifted,
    evaluate,
    free_motion,
    linearise,
)
from rom.kernels.calling import invoke, pointer
from rom.kernels.dense import fill, fill_sample
from rom.kernels.equations import Program
from rom.kernels.propagators import (
    LEVELS,
    NODES,
    SAMPLE,
    TICKS,
    Propagators,
    allocate,
    build,
)
from rom.kernels.sweeps import errors, solve, solve_laws

RUNS = 3  # how often a record is integrated until its own peaks are the scale of its errors


class Task(NamedTuple):
    """What is asked of a run."""

    rate: float  # [Hz]
    driven: Any  # (driven bodies,)
    active: Any  # (active links,): links whose force is not linear, or which have a tension law
    force: Any  # (driven bodies, samples) [N]
    y0: Any  # (2 bodies,): displacements and velocities at the start
    tensions: Any  # (tensions,): at the start [N]
    edges: Any  # (bins + 1,): bins of samples over which tensions are averaged; the run ends with the last
    every: int  # tensions are averaged over each so many samples
    tolerance: float  # of the final tension, relative to its change, and of velocities to their peak


SPREAD, LEAST = 0.5, 0.002  # a block of d seconds may spend d / SPREAD of the tolerance, or LEAST of it
MOTION = 3.0  # tolerance of velocities and states over that of tensions: their estimate is the coarser one
NEGLIGIBLE = 1e-9  # a change of tension, relative to it, below which errors are not measured against it
CHUNK = 16  # samples whose sizes stand for their running sum
SHORT, HIDDEN = 8, 0.02  # blocks above 8 samples hold no hit above this share of the peak velocity
PATIENCE, CALM = 32, 8  # blocks: the longest wait for a longer one; after so many more the next wait is short
MOST_BLOCKS, LEAST_BUDGET = 6, 60_000  # tried a sample, of which the shortest take 4; and in a short record
DRIFT = 0.001  # relative change of a stiffness or damping at which the linear part is taken anew
# places in a report
STEPS, MOTION_ERROR, TENSION_ERROR, REACHED, PEAK, LOSS, STATES = range(7)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _inputs(program: Program, p: Any, active: Any, driven: Any, tables: Propagators) -> None:
    """Where forces on bodies and forces of active links enter the velocities."""
    n = program.size[0]
    for u in range(driven.size):
        tables.b[u, n + driven[u]] = 1.0 / p[driven[u]]
    for a in range(active.size):
        first, second = program.ends[active[a], 0], program.ends[active[a], 1]
        if first >= 0:
            tables.b[driven.size + a, n + first] = -1.0 / p[first]
        if second >= 0:
            tables.b[driven.size + a, n + second] = 1.0 / p[second]


@njit(cache=True, nogil=True, error_model="numpy")
def _prepare(program: Program, p: Any, task: Task) -> Any:
    """Block and tables at the start of a run, with the linear part at the initial tensions."""
    size, width, active = 2 * program.size[0], program.size[1] + program.size[2], task.active.size
    block = Block(
        np.zeros((NODES, size)),
        np.zeros((NODES, size)),
        np.zeros((NODES, active)),
        np.zeros((NODES, width)),
        np.zeros((NODES, width + 1)),
        task.tensions,
        np.zeros((active, 2)),
        np.zeros((NODES, active, 2)),
        task.active,
        np.zeros(1),
        np.zeros(8),
    )
    largest = 1.0
    for T in task.tensions:
        largest = max(largest, T)
    block.change[SHARPNESS] = 10.0 / largest
    tables = allocate(size, task.driven.size, active)
    for i in range(size):
        block.y[0, i] = task.y0[i]
    _inputs(program, p, task.active, task.driven, tables)
    linearise(program, p, block, tables)
    _restart(program, p, block, 0.0)
    return block, tables


@njit(cache=True, nogil=True, error_model="numpy")
def _restart(program: Program, p: Any, block: Block, t: float) -> None:
    """Forces and rates at node 0, by way of all nodes."""
    for node in range(1, NODES):
        copy_node(block, 0, node)
    evaluate(program, p, block, 0, t, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _highest(level: int, tick: int, boundary: int) -> int:
    """The highest level, not above ``level``, whose block starts on its grid and ends by the boundary."""
    while level > 0:
        block = 4 << level
        if tick + block <= boundary and tick % min(block, TICKS) == 0:
            break
        level -= 1
    return level


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _finite(block: Block, error: float) -> bool:
    """Whether the last node can be computed with."""
    for i in range(block.y.shape[1]):
        error += block.y[NODES - 1, i]
    for i in range(block.z.shape[1]):
        error += block.z[NODES - 1, i]
    return bool(np.isfinite(error))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _account(program: Program, block: Block, impulse: float, tension: float, report: Any) -> None:
    """Add a block to the report, and keep the peaks at its end."""
    n = program.size[0]
    report[STEPS] += 1.0
    report[MOTION_ERROR] += impulse
    report[TENSION_ERROR] += tension
    for i in range(n, 2 * n):
        report[PEAK] = max(report[PEAK], abs(block.y[NODES - 1, i]))
    for b in range(block.start.size):
        report[LOSS] = max(report[LOSS], abs(block.z[NODES - 1, b]))
    for i in range(program.size[2]):
        report[STATES + i] = max(report[STATES + i], abs(block.z[NODES - 1, block.start.size + i]))


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


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _open(task: Task, level: int, tick: int, least: float) -> int:
    """Highest level whose block hides no hit of impulse `least` [N s], which no node may feel.

    The impulse is the largest running sum of a force: noise cancels in it, a hit of any length does not.
    """
    while (4 << level) > SHORT * TICKS:
        first, last = tick // TICKS, (tick + (4 << level)) // TICKS
        largest = 0.0
        for u in range(task.force.shape[0]):
            largest = max(largest, largest_impulse(task.force[u, first : last + 1]))
        if largest <= least * task.rate:
            break
        level -= 1
    return level


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _run(  # noqa: C901, PLR0912 - the loop over the blocks, in one place
    program: Program, p: Any, task: Task, scale: Any, sums: Any, report: Any, total: Any, out: Any
) -> None:
    """Integrate over a record with errors relative to ``scale``: a velocity [m/s] and a tension [N]."""
    block, tables = _prepare(program, p, task)
    report[:] = 0.0
    total[:] = 0.0
    tick, level, sample, mobility = 0, 0, 1.0 / task.rate, 0.0
    end, bin = TICKS * (task.edges[-1] - 1), 0
    blocks, most = 0, max(MOST_BLOCKS * (task.edges[-1] - 1), LEAST_BUDGET)
    longer, wait, patience = False, 0, 1  # longer blocks that do not converge are not tried again at once
    for i in range(program.size[0]):
        mobility = max(mobility, 1.0 / p[i])
    if out.size:
        fill_sample(block, tables, task.force, 0, out, 0)
    if task.edges[0] == 0 and task.edges[1] == 1:
        bin = 1  # sample 0 adds nothing: changes are counted from there
    while tick < end:
        blocks += 1
        if blocks > most:
            return
        level = _open(task, _highest(level, tick, end), tick, HIDDEN * scale[0] / mobility)
        if tables.built[0] <= max(level, SAMPLE):
            build(tables, max(level, SAMPLE), sample)
        d, t = sample * float(1 << level) / TICKS, tick * sample / TICKS
        allowed = task.tolerance * max(4.0 * d / SPREAD, LEAST)
        free_motion(block.free, block.y, tables.E, tables.W, task.force, level, tick)
        change = max(0.1 * allowed, 1e-13)  # sweeps end at rounding
        goal = (MOTION * change * scale[0] / mobility, change * scale[1], MOTION * change)
        if program.effects.shape[0] == 0:
            solved = solve_laws(program, p, block, tables.H, level, d, goal, 2.0 * mobility)
        else:
            solved = solve(program, p, block, tables.H, level, t, d, goal)
        impulse, tension, state = errors(block, d, scale)
        error = max(impulse * mobility / scale[0] / MOTION, tension / scale[1], state / MOTION)
        if level > 0 and not (solved and error <= allowed):
            level -= 1
            if longer and not solved:
                patience = wait = min(2 * patience, PATIENCE)
            longer = False
            continue
        if not _finite(block, error):
            return
        tick += 4 << level
        bin = add(block, level, tick, d, task.edges, task.every, sums, bin, total)
        if out.size:
            fill(block, tables, task.force, level, tick, d, out)
        _account(program, block, impulse * mobility, tension, report)
        report[REACHED] = tick // TICKS
        advance(block)
        if drifted(block, DRIFT):
            linearise(program, p, block, tables)
            _restart(program, p, block, tick * sample / TICKS)
        wait -= 1
        patience = 1 if wait < -CALM else patience
        longer = wait <= 0 and error * 40.0 < allowed and level < LEVELS - 1
        if longer:
            level += 1
    report[REACHED] += 1.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _expected(program: Program, p: Any, task: Task) -> Any:
    """First guess of the peak velocity [m/s] and the loss of tension [N]; only the cost depends on it."""
    velocity = 0.0
    n = program.size[0]
    for i in range(n):
        velocity = max(velocity, abs(task.y0[n + i]), 10.0 * abs(task.y0[i]))
    for u in range(task.driven.size):
        velocity = max(velocity, largest_impulse(task.force[u]) / task.rate / p[task.driven[u]])
    loss = 0.0
    for a in range(task.active.size):
        link = task.active[a]
        bolt = program.tension[link]
        if bolt >= 0 and program.laws[link, 4] != 0:
            T, v = task.tensions[bolt], 0.5 * velocity
            D = v * invoke(program.laws[link, 2], (T, pointer(p, program.laws[link, 3])))
            rate = invoke(program.laws[link, 4], (T, 1e-3 * v, v, D, D, pointer(p, program.laws[link, 5])))
            loss = max(loss, min(abs(rate) * 1e-3, T), NEGLIGIBLE * T)
    if not loss > 0.0:
        loss = 1e-3
    scale = np.full(2 + program.size[2], np.inf)  # no state is known before the first run
    scale[0], scale[1] = max(velocity, 1e-12), loss
    return scale


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _integrate(program: Program, p: Any, task: Task, sums: Any, report: Any, out: Any) -> Any:
    """Integrate over a record; its own peak velocity and loss of tension are the scale of its errors.

    ``sums`` are ``sums_of_blocks``. Fills ``report`` and ``out``.
    Returns the sums of the tensions' changes over the bins, shape (bins, tensions); the run is complete where
    ``report[REACHED]`` is the last edge.
    """
    total = np.zeros((task.edges.size - 1, program.size[1]))
    scale = _expected(program, p, task)
    least = 1e-12
    for T in task.tensions:
        least = max(least, NEGLIGIBLE * T)
    for _ in range(RUNS):
        _run(program, p, task, scale, sums, report, total, out)
        motion = report[MOTION_ERROR] > 20.0 * MOTION * task.tolerance * report[PEAK]
        loss = max(report[LOSS], least)
        tension = report[TENSION_ERROR] > 20.0 * task.tolerance * loss
        unknown = program.size[2] > 0 and np.isinf(scale[-1])
        if report[REACHED] < task.edges[-1] or not (motion or tension or unknown):
            break
        for i in range(program.size[2]):
            scale[2 + i] = max(report[STATES + i], 1e-300)
        if motion:
            scale[0] = min(scale[0], report[PEAK])
        if tension:
            scale[1] = min(scale[1], loss)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(program: Program, coefficients: Any, tasks: Task, reports: Any, out: Any) -> Any:
    """Mean tensions of many cases [N], shape (cases, bins, tensions); NaN for a case that diverged.

    ``coefficients``, and the forces, tensions and edges of ``tasks``, have a first axis of cases. Fills
    ``reports`` (cases, 6 + states) and, unless it holds no samples, ``out``, shape (cases, 3 bodies +
    tensions + states, samples): displacements, velocities, tensions, states, accelerations.
    The one door to the integrator: another function that calls it would have all of it compiled again.

    Parameters
    ----------
    program : Program
        The structure.
    coefficients : ndarray, shape (cases, coefficients)
        Its numbers.
    tasks : Task
        What is asked; forces, tensions and edges with a first axis of cases.
    reports : ndarray, shape (cases, 6 + states)
        Filled, by the places STEPS to STATES.
    out : ndarray, shape (cases, 3 bodies + tensions + states, samples)
        Filled, unless it holds no samples.

    Returns
    -------
    ndarray, shape (cases, bins, tensions)
        Mean tensions [N].
    """
    cases = coefficients.shape[0]
    result = np.full((cases, tasks.edges.shape[1] - 1, program.size[1]), np.nan)
    sums = sums_of_blocks(tasks.every)
    for case in range(cases):
        task = Task(
            tasks.rate, tasks.driven, tasks.active, tasks.force[case], tasks.y0,
            tasks.tensions[case], tasks.edges[case], tasks.every, tasks.tolerance,
        )  # fmt: skip
        changes = _integrate(program, coefficients[case], task, sums, reports[case], out[case])
        if reports[case, REACHED] == task.edges[-1]:
            means(changes, task.edges, task.every, task.tensions, result[case])
    return result
