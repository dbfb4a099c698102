"""Tensions of many cases that start at rest: ``Model.final_tension`` and ``Model.mean_tensions``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rom.model.assembly import DENSE_BODIES, TOLERANCE, Assembly, finite, fixed, forces_on, number
from rom.model.link_force import equilibrium

if TYPE_CHECKING:
    from rom.kernels.exponential_integrator import Task

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
_ROUNDING = 1e-6  # samples


def final_tension(
    assembly: Assembly,
    forces: npt.ArrayLike,
    rate_hz: float,
    initial_tension: npt.ArrayLike,
    vary: Mapping[str, npt.ArrayLike],
    window_s: tuple[float, float] | None,
    body: str | None,
    tolerance: float,
) -> FloatArray:
    """See ``Model.final_tension``."""
    rate = number("rate_hz", rate_hz, 0.0, strict=True)
    force = _records(forces)
    edges = np.tile(_window(window_s, rate, force.shape[1]), (len(force), 1))
    means = _means(assembly, force, rate, initial_tension, edges, 1, vary, body, tolerance)
    return np.ascontiguousarray(means[:, 0, 0] if means.shape[2] == 1 else means[:, 0])


def mean_tensions(
    assembly: Assembly,
    forces: npt.ArrayLike,
    rate_hz: float,
    initial_tension: npt.ArrayLike,
    edges_s: npt.ArrayLike,
    tension_rate_hz: float | None,
    vary: Mapping[str, npt.ArrayLike],
    body: str | None,
    tolerance: float,
) -> FloatArray:
    """See ``Model.mean_tensions``."""
    rate = number("rate_hz", rate_hz, 0.0, strict=True)
    force = _records(forces)
    every = _every(rate, tension_rate_hz)
    edges = _edges(edges_s, rate, every, *force.shape)
    means = _means(assembly, force, rate, initial_tension, edges, every, vary, body, tolerance)
    return np.ascontiguousarray(means[:, :, 0] if means.shape[2] == 1 else means)


def _means(
    assembly: Assembly,
    force: FloatArray,
    rate: float,
    initial_tension: npt.ArrayLike,
    edges: IntArray,
    every: int,
    vary: Mapping[str, npt.ArrayLike],
    body: str | None,
    tolerance: float,
) -> FloatArray:
    """Mean tensions, shape (cases, bins, bolted links), over bins of samples."""
    from rom.kernels.exponential_integrator import Task

    structure, cases = assembly.structure, len(force)
    tension = _starts(len(structure.bolted_links), cases, initial_tension)
    coefficients = np.tile(assembly.coefficients, (cases, 1))
    varied = {path: finite(path, np.broadcast_to(values, (cases,))) for path, values in vary.items()}
    for path, values in varied.items():
        if path not in assembly.places:
            raise ValueError(f"vary must name what a simulation depends on, got {path!r}")
        coefficients[:, assembly.places[path]] = values
    driven = forces_on(structure, {body or structure.body_names[0]: np.zeros(2)})[0]
    still = assembly.full_start(np.zeros(2 * len(structure.bodies)))
    records = fixed(force[:, None])
    own = edges.copy()  # writable: kernels are compiled for one kind of array
    task = Task(rate, driven, assembly.active, records, still, tension, own, every, tolerance)
    rests = _rests(assembly, tension, coefficients, varied)
    if rests is None:
        result = _cases(assembly, coefficients, task)
    else:
        result = np.concatenate(
            [
                _cases(assembly, coefficients[i : i + 1], _of_case(task, i, rest))
                for i, rest in enumerate(rests)
            ]
        )
    if np.isnan(result).any():  # looked for here alone, to read the records once
        finite("forces", force)
    return result


def _rests(
    assembly: Assembly, tension: FloatArray, coefficients: FloatArray, vary: Iterable[str]
) -> FloatArray | None:
    """Where cases start, (cases, 2 bodies + states), if effects push; None where all is zero."""
    effects = assembly.program.effects
    if not len(effects):
        return None
    bolts, bodies = assembly.structure.bolted_links, assembly.structure.body_names
    of_effects = any(assembly.places[path] >= effects[0, 1] for path in vary)  # theirs come last
    if not of_effects and not equilibrium(assembly, dict(zip(bolts, tension[0], strict=True))):
        return None
    rests = np.zeros((len(tension), 2 * len(bodies)))
    for case, held in enumerate(tension):
        own = replace(assembly, coefficients=coefficients[case])
        rest = equilibrium(own, dict(zip(bolts, held, strict=True)))
        rests[case, : len(bodies)] = [rest.get(body, 0.0) for body in bodies]
    return np.stack([assembly.full_start(rest) for rest in rests]) if rests.any() else None


def _of_case(task: Task, case: int, rest: FloatArray) -> Task:
    """The task of one case, from where it rests."""
    one = slice(case, case + 1)
    return task._replace(y0=rest, force=task.force[one], tensions=task.tensions[one], edges=task.edges[one])


def _cases(assembly: Assembly, coefficients: FloatArray, tasks: Task) -> FloatArray:
    """Mean tensions, shape (cases, bins, tensions); NaN for a case that diverged.

    Effects with memory bend too sharply for long blocks: unless more is asked for, they go link by link.
    """
    from rom.kernels.bins import means
    from rom.kernels.exponential_integrator import REACHED, integrate
    from rom.kernels.runge_kutta import integrate_links

    program = assembly.program
    reports = np.zeros((len(coefficients), 6 + int(program.size[2])))
    if len(assembly.structure.bodies) <= DENSE_BODIES and not (
        program.size[2] and tasks.tolerance >= TOLERANCE
    ):
        nothing = np.empty((len(coefficients), 0, 0))
        result: FloatArray = integrate(program, coefficients, tasks, reports, nothing)
        return result
    result = np.full((len(coefficients), tasks.edges.shape[1] - 1, int(program.size[1])), np.nan)
    for case, p in enumerate(coefficients):
        force, tensions, edges = tasks.force[case], tasks.tensions[case], tasks.edges[case]
        task = tasks._replace(force=force, tensions=tensions, edges=edges)
        sums = integrate_links(program, p, task, reports[case], np.empty((0, 0)))
        if reports[case, REACHED] == edges[-1]:
            result[case] = means(sums, edges, tasks.every, tensions)
    return result


def _records(forces: npt.ArrayLike) -> FloatArray:
    array = np.ascontiguousarray(forces, dtype=np.float64)
    if array.ndim != 2 or 0 in array.shape:
        raise ValueError(f"forces must have the shape (cases, samples), got {array.shape}")
    return array


def _starts(bolts: int, cases: int, initial_tension: npt.ArrayLike) -> FloatArray:
    """Initial tensions, shape (cases, bolted links)."""
    if bolts == 0:
        raise ValueError("the tension of a bolted link was asked for, but the structure has none")
    shape = (cases, bolts) if bolts > 1 else (cases,)
    if np.shape(initial_tension) not in (shape, ()):
        raise ValueError(f"initial_tension must have the shape {shape}, got {np.shape(initial_tension)}")
    tension = finite("initial_tension", np.broadcast_to(initial_tension, shape).copy())
    if (tension < 0).any():
        raise ValueError(f"initial_tension must be 0 N or more, got {float(tension.min()):g} N")
    return tension.reshape(cases, bolts)


def _window(window_s: tuple[float, float] | None, rate: float, samples: int) -> IntArray:
    """First sample of a window and the one behind its last; the record's last sample without a window."""
    if window_s is None:
        return np.array([samples - 1, samples])
    first = int(np.ceil(window_s[0] * rate - _ROUNDING))
    last = min(int(np.floor(window_s[1] * rate + _ROUNDING)), samples - 1)
    if not 0 <= first <= last:
        raise ValueError(f"window_s must hold samples of 0 to {(samples - 1) / rate:g} s, got {window_s}")
    return np.array([first, last + 1])


def _every(rate: float, tension_rate_hz: float | None) -> int:
    """How many samples of the force come on one of the tension."""
    tension_rate = (
        rate if tension_rate_hz is None else number("tension_rate_hz", tension_rate_hz, 0.0, strict=True)
    )
    every = round(rate / tension_rate)
    if every < 1 or abs(every * tension_rate - rate) > _ROUNDING * rate:
        raise ValueError(f"tension_rate_hz must divide the rate of {rate:g} Hz, got {tension_rate:g} Hz")
    return every


def _edges(edges_s: npt.ArrayLike, rate: float, every: int, cases: int, samples: int) -> IntArray:
    """Edges as samples, shape (cases, bins + 1): a bin holds the samples from its edge to before the next."""
    given = finite("edges_s", edges_s)
    if given.ndim not in (1, 2) or given.shape[-1] < 2 or given.shape[:-1] not in ((), (cases,)):
        raise ValueError(f"edges_s must have the shape (bins + 1,) or ({cases}, bins + 1), got {given.shape}")
    behind = np.ceil(np.clip(given * rate - _ROUNDING, 0, samples)).astype(np.int64)
    if (np.diff(-(-behind // every)) < 1).any():
        raise ValueError(
            f"edges_s must rise and hold a sample in every bin, within 0 to {samples / rate:g} s at"
            f" {rate / every:g} Hz, got bins of {np.diff(given).min():g} s and more"
        )
    return np.ascontiguousarray(np.broadcast_to(behind, (cases, given.shape[-1])))
