"""Exponential block integrator: exact for the linear part, collocation for everything else.

The structure linearised at a tension is propagated exactly under the piecewise linear force. What the links
do beyond that, and the rates of tensions and internal states, are polynomials through the five nodes of a
block (sixth order at its end), found by sweeps. Blocks of 1/64 to 1024 samples start and end on the force's
knots or within one sample; their length follows from an error estimate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import float64, int64, njit, types, void

from rom.kernels.bins import add, means, sums_of_blocks
from rom.kernels.block import (
    BLOCK,
    Block,
    advance,
    drifted,
    free_motion,
    linearise,
    restart,
)
from rom.kernels.dense import fill
from rom.kernels.equations import COEFFICIENTS, FORCES, PROGRAM, Program
from rom.kernels.function_addresses import (
    ALLOCATES_NOTHING,
    floats,
    for_size,
    integers,
    invoke,
    named,
    pointer,
    separate,
)
from rom.kernels.propagators import (
    LEVELS,
    NODES,
    PROPAGATORS,
    SAMPLE,
    TICKS,
    Propagators,
    allocate,
    build,
)
from rom.kernels.start import clear, empty_block, enter, largest_impulse
from rom.kernels.sweeps import errors, solve, solve_laws

RUNS = 3  # how often a record is integrated until its own peaks are the scale of its errors
SMALLER = 0.8  # of a scale: peaks above do not make the next run finer


class Task(NamedTuple):
    """What is asked of a run."""

    rate: float  # [Hz]
    driven: Any  # (driven bodies,)
    active: Any  # (active links,): links whose force is not linear, or which have a tension law
    force: Any  # (driven bodies, samples) [N]
    y0: Any  # (2 bodies + states,): displacements, velocities and states at the start
    tensions: Any  # (tensions,): at the start [N]
    edges: Any  # (bins + 1,): bins of samples over which tensions are averaged; the run ends with the last
    every: int  # tensions are averaged over each so many samples
    tolerance: float  # of the final tension, relative to its change, and of velocities to their peak


TASK = named(
    Task, float64, integers(1), integers(1), FORCES, floats(1), floats(1), integers(1), int64, float64
)


class Parts(NamedTuple):
    """Addresses of what is compiled by itself; zero where a run does not need it."""

    run: int
    linearise: int
    restart: int
    build: int
    free_motion: int
    solve_laws: int
    solve: int
    add: int
    fill: int


PARTS = types.NamedUniTuple(int64, len(Parts._fields), Parts)  # type: ignore[no-untyped-call]
SPREAD, LEAST = 0.5, 0.002  # a block of d seconds may spend d / SPREAD of the tolerance, or LEAST of it
MOTION = 3.0  # tolerance of velocities and states over that of tensions: their estimate is the coarser one
NEGLIGIBLE = 1e-9  # a change of tension, relative to it, below which errors are not measured against it
SHORT, HIDDEN = 8, 0.02  # blocks above 8 samples hold no hit above this share of the peak velocity
PATIENCE, CALM = 32, 8  # blocks: the longest wait for a longer one; after so many more the next wait is short
FINE_BLOCKS, LEAST_FINE = 12, 20_000  # of any length: tried a sample, and in a short record
COARSE, COARSE_BLOCKS = SAMPLE - 4, 6  # then of a quarter of a sample at least: tried a sample
TURN = 0.25  # share of the expected peak velocity by which velocities may change over a block with effects
DRIFT = 0.001  # relative change of a stiffness or damping at which the linear part is taken anew
# places in a report
STEPS, MOTION_ERROR, TENSION_ERROR, REACHED, PEAK, LOSS, STATES = range(7)


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
def _turns_little(program: Program, block: Block, most: float) -> bool:
    """Whether velocities change by little over a block: nodes far apart would miss a slip or a contact."""
    n = program.size[0]
    if program.effects.shape[0] > 0:
        for node in range(1, NODES):
            for i in range(n, 2 * n):
                if abs(block.y[node, i] - block.y[0, i]) > most:
                    return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _account(program: Program, block: Block, impulse: float, tension: float, scale: Any, report: Any) -> None:
    """Add a block to the report, keep the peaks at its end, and foresee those of states.

    The scale of a state's errors is its peak so far, as much larger as the velocity is still to become.
    """
    n = program.size[0]
    report[STEPS] += 1.0
    report[MOTION_ERROR] += impulse
    report[TENSION_ERROR] += tension
    for i in range(n, 2 * n):
        report[PEAK] = max(report[PEAK], abs(block.y[NODES - 1, i]))
    for b in range(block.start.size):
        report[LOSS] = max(report[LOSS], abs(block.z[NODES - 1, b]))
    ahead = max(scale[0] / max(report[PEAK], 1e-9 * scale[0]), 1.0)
    for i in range(program.size[2]):
        report[STATES + i] = max(report[STATES + i], abs(block.z[NODES - 1, block.start.size + i]))
        scale[2 + i] = max(ahead * report[STATES + i], 1e-300)


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


@separate(
    void, PARTS, PROGRAM, COEFFICIENTS, TASK, BLOCK, PROPAGATORS,
    floats(1), floats(3), floats(1), floats(2), floats(2),
)  # fmt: skip
def run(  # noqa: C901, PLR0912 - the loop over the blocks, in one place
    at: Parts, program: Program, p: Any, task: Task, block: Block, tables: Propagators,
    scale: Any, sums: Any, report: Any, total: Any, out: Any,
) -> None:  # fmt: skip
    """Integrate over a record with errors relative to ``scale``: a velocity [m/s] and a tension [N].

    Parameters
    ----------
    at : Parts
        Addresses.
    program : Program
        The structure.
    p : ndarray, shape (coefficients,)
        Its numbers.
    task : Task
        What is asked, of one case.
    block, tables : Block, Propagators
        Space.
    scale : ndarray, shape (2 + states,)
        Of the errors.
    sums : ndarray, shape (level, phase, NODES + 1)
        As from `sums_of_blocks`.
    report, total, out : ndarray
        Filled.
    """
    for_size()
    clear(block, task.y0, task.tensions)
    enter(program, p, task.driven, block.active, tables)
    linearise(at.linearise, (program, p, block, tables))
    restart(at.restart, (program, p, block, 0.0))
    for i in range(report.size):
        report[i] = 0.0
    for i in range(total.shape[0]):
        for b in range(total.shape[1]):
            total[i, b] = 0.0
    tick, level, sample, mobility = 0, 0, 1.0 / task.rate, 0.0
    end, bin = TICKS * (task.edges[-1] - 1), 0
    blocks, floor, fine = 0, 0, max(FINE_BLOCKS * (task.edges[-1] - 1), LEAST_FINE)
    longer, wait, patience = False, 0, 1  # longer blocks that do not converge are not tried again at once
    for i in range(program.size[0]):
        mobility = max(mobility, 1.0 / p[i])
    if out.size:
        fill(at.fill, (block, tables, task.force, 0, 0, 0.0, out))
    if task.edges[0] == 0 and task.edges[1] == 1:
        bin = 1  # sample 0 adds nothing: changes are counted from there
    while tick < end:
        blocks += 1
        if blocks > fine:
            floor = COARSE
        if blocks > fine + COARSE_BLOCKS * task.edges[-1]:
            return
        level = _open(task, _highest(max(level, floor), tick, end), tick, HIDDEN * scale[0] / mobility)
        if tables.built[0] <= max(level, SAMPLE):
            build(at.build, (tables, max(level, SAMPLE), sample))
        d, t = sample * float(1 << level) / TICKS, tick * sample / TICKS
        allowed = task.tolerance * max(4.0 * d / SPREAD, LEAST)
        free_motion(at.free_motion, (block.free, block.y, tables.E, tables.W, task.force, level, tick))
        change = max(0.1 * allowed, 1e-13)  # sweeps end at rounding
        goal = (MOTION * change * scale[0] / mobility, change * scale[1], MOTION * change)
        if program.effects.shape[0] == 0:
            solved = solve_laws(at.solve_laws, (program, p, block, tables.H, level, d, goal, 2.0 * mobility))
        else:
            solved = solve(at.solve, (program, p, block, tables.H, level, t, d, goal))
        impulse, tension, state = errors(block, d, scale)
        error = max(impulse * mobility / scale[0] / MOTION, tension / scale[1], state / MOTION)
        if level > floor and not (
            solved and error <= allowed and _turns_little(program, block, TURN * scale[0])
        ):
            level -= 1
            if longer and not solved:
                patience = wait = min(2 * patience, PATIENCE)
            longer = False
            continue
        if not _finite(block, error):
            return
        tick += 4 << level
        bin = add(at.add, (block, level, tick, d, task.edges, task.every, sums, bin, total))
        if out.size:
            fill(at.fill, (block, tables, task.force, level, tick, d, out))
        _account(program, block, impulse * mobility, tension, scale, report)
        report[REACHED] = tick // TICKS
        advance(block)
        if drifted(block, DRIFT):
            linearise(at.linearise, (program, p, block, tables))
            restart(at.restart, (program, p, block, tick * sample / TICKS))
        wait -= 1
        patience = 1 if wait < -CALM else patience
        longer = wait <= 0 and error * 40.0 < allowed and level < LEVELS - 1
        if longer:
            level += 1
    report[REACHED] += 1.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _let_go(program: Program, p: Any, task: Task) -> float:
    """Largest velocity [m/s] of two bodies whose link is let go as it is stretched at the start."""
    velocity = 0.0
    for link in range(program.ends.shape[0]):
        x = mobility = 0.0
        for row in range(2):
            body = program.ends[link, row]
            if body >= 0:
                x, mobility = task.y0[body] - x, mobility + 1.0 / p[body]
        bolt = program.tension[link]
        T = task.tensions[bolt] if bolt >= 0 else 0.0
        k = invoke(program.laws[link, 0], (T, pointer(p, program.laws[link, 1])))
        velocity = max(velocity, abs(x) * np.sqrt(abs(k) * mobility))
    return velocity


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _expected(program: Program, p: Any, task: Task, scale: Any) -> None:
    """First guess of the peak velocity [m/s] and the loss of tension [N]; only the cost depends on it."""
    velocity = 0.0
    n = program.size[0]
    for i in range(n):
        velocity = max(velocity, abs(task.y0[n + i]))
    velocity = max(velocity, _let_go(program, p, task))
    for u in range(task.driven.size):
        velocity = max(velocity, largest_impulse(task.force[u]) / task.rate / p[task.driven[u]])
    if velocity == 0.0:
        for i in range(n):
            velocity = max(velocity, 10.0 * abs(task.y0[i]))
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
    scale[0], scale[1] = max(velocity, 1e-12), loss
    for i in range(program.size[2]):
        scale[2 + i] = 1e-300  # no state is known before the first block


@njit(nogil=True, **ALLOCATES_NOTHING)  # type: ignore[untyped-decorator]
def _cases(
    at: Parts, program: Program, coefficients: Any, tasks: Task, block: Block, tables: Propagators,
    scale: Any, sums: Any, totals: Any, reports: Any, out: Any,
) -> None:  # fmt: skip
    """Integrate case by case; a case's own peak velocity and loss of tension are the scale of its errors."""
    for_size()
    for case in range(coefficients.shape[0]):
        task = Task(
            tasks.rate, tasks.driven, tasks.active, tasks.force[case], tasks.y0,
            tasks.tensions[case], tasks.edges[case], tasks.every, tasks.tolerance,
        )  # fmt: skip
        p, report = coefficients[case], reports[case]
        _expected(program, p, task, scale)
        least = 1e-12
        for T in task.tensions:
            least = max(least, NEGLIGIBLE * T)
        for _ in range(RUNS):
            run(at.run, (at, program, p, task, block, tables, scale, sums, report, totals[case], out[case]))
            motion = report[MOTION_ERROR] > 20.0 * MOTION * task.tolerance * report[PEAK]
            motion = motion and report[PEAK] < SMALLER * scale[0]
            loss = max(report[LOSS], least)
            tension = report[TENSION_ERROR] > 20.0 * task.tolerance * loss and loss < SMALLER * scale[1]
            if report[REACHED] < task.edges[-1] or not (motion or tension):
                break
            if motion:
                scale[0] = min(scale[0], report[PEAK])
            if tension:
                scale[1] = min(scale[1], loss)


def parts(effects: bool) -> Parts:
    """Compile, or find on disk, what a run with or without effects needs.

    Samples may be wanted first in many processes at once: what writes them is compiled with the rest.
    """
    return Parts(
        run=run.address(),
        linearise=linearise.address(),
        restart=restart.address(),
        build=build.address(),
        free_motion=free_motion.address(),
        solve_laws=0 if effects else solve_laws.address(),
        solve=solve.address() if effects else 0,
        add=add.address(),
        fill=fill.address(),
    )


def integrate(program: Program, coefficients: Any, tasks: Task, reports: Any, out: Any) -> Any:
    """Mean tensions of many cases [N], shape (cases, bins, tensions); NaN for a case that diverged.

    ``coefficients``, and the forces, tensions and edges of ``tasks``, have a first axis of cases. Fills
    ``reports`` (cases, 6 + states) and, unless it holds no samples, ``out``, shape (cases, 3 bodies +
    tensions + states, samples): displacements, velocities, tensions, states, accelerations.

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
    n, tensions, states = (int(size) for size in program.size)
    inputs = tasks.driven.size + tasks.active.size
    _cases(
        parts(len(program.effects) > 0), program, coefficients, tasks,
        empty_block(program, tasks.active, inputs if out.size else 0),
        allocate(2 * n, tasks.driven.size, tasks.active.size),
        np.empty(2 + states), sums_of_blocks(tasks.every),
        totals := np.empty((len(coefficients), tasks.edges.shape[1] - 1, tensions)), reports, out,
    )  # fmt: skip
    result = means(totals, tasks.edges, tasks.every, tasks.tensions)
    result[reports[:, REACHED] != tasks.edges[:, -1]] = np.nan
    return result
