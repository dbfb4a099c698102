"""Screening of tension laws: the motion of a model is frozen and each law solved along it alone.

Exact where the tension hardly feeds back on the motion; for the best candidates, full simulations follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from rom.kernels.function_addresses import invoke, pointer
from rom.model.laws import Law
from rom.model.model import Model

FloatArray = npt.NDArray[np.float64]
# after the hit the samples are taken ever more sparsely: from so many seconds on, every so many samples
_SPACING = ((0.0, 1), (0.012, 4), (0.06, 16), (0.25, 64), (1.0, 128))


@dataclass(frozen=True)
class FrozenMotion:
    """The motion of a bolted link in many cases, at the nodes of Simpson's rule.

    Attributes
    ----------
    nodes : ndarray, shape (cases, 4, 2 steps + 1)
        Relative displacement [m] and velocity [m/s], link force and its damping part [N].
    steps : ndarray, shape (steps,)
        Lengths of the steps [s]; a node lies at either end and in the middle of each.
    initial_tension : ndarray, shape (cases,)
        Tensions at the start [N].
    """

    nodes: FloatArray
    steps: FloatArray
    initial_tension: FloatArray


def freeze(
    model: Model, forces: npt.ArrayLike, rate_hz: float, initial_tension: npt.ArrayLike, impact_s: float
) -> FrozenMotion:
    """Simulate every case with a model and keep the motion of its bolted link.

    Parameters
    ----------
    model : Model
        Model with one bolted link.
    forces : array, shape (cases, samples)
        Force on the first body [N].
    rate_hz : float
        Sampling rate [Hz].
    initial_tension : array, shape (cases,)
        Tensions at the start [N].
    impact_s : float
        Time of the hit [s]: nodes are dense behind it.

    Raises
    ------
    ValueError
        If the model has not one bolted link, or a simulation diverges.
    """
    bolts = [link for link in model.structure.links if link.law == "bolted"]
    if len(bolts) != 1:
        raise ValueError(f"screening needs one bolted link, the model has {len(bolts)}")
    records = np.asarray(forces, dtype=np.float64)
    tensions = np.asarray(initial_tension, dtype=np.float64)
    places = _places(records.shape[1], rate_hz, impact_s)
    driven, link, laws = model.structure.body_names[0], bolts[0], model.link_laws[bolts[0].name]
    nodes = np.empty((len(records), 4, places.size))
    for case, (force, tension) in enumerate(zip(records, tensions, strict=True)):
        response = model.simulate({driven: force}, rate_hz, float(tension))
        if response.status != "ok":
            raise ValueError(f"case {case} must be simulated to its end, got status {response.status!r}")
        x, v = (
            _at(motion, link.first, places) - _at(motion, link.second, places)
            for motion in (response.displacement, response.velocity)
        )
        held = np.asarray(response.tension)[places]
        damping_force = laws.damping(held) * v
        nodes[case] = x, v, laws.stiffness(held) * x + damping_force, damping_force
    return FrozenMotion(nodes, np.diff(places[::2]) / rate_hz, tensions)


def _at(motion: object, body: str, places: npt.NDArray[np.int64]) -> FloatArray | float:
    return motion[body][places] if body != "ground" else 0.0  # type: ignore[index]


def _places(samples: int, rate_hz: float, impact_s: float) -> npt.NDArray[np.int64]:
    """Samples of the nodes: pairs of equal intervals, dense behind the hit; the last may be left out."""
    start = max(min(int(impact_s * rate_hz), samples) // 2 - 1, 0) * 2
    places = [0, start // 2, start] if start else [0]
    while True:
        behind = (places[-1] - start) / rate_hz
        spacing = [every for since, every in _SPACING if behind >= since or since == 0.0][-1]
        if places[-1] + 2 * spacing >= samples:
            return np.array(places, dtype=np.int64)
        places += [places[-1] + spacing, places[-1] + 2 * spacing]


def screen(motion: FrozenMotion, laws: Sequence[Law], jobs: int = 1) -> FloatArray:
    """Final tensions of many tension laws along a frozen motion.

    Parameters
    ----------
    motion : FrozenMotion
        What ``freeze`` gives.
    laws : sequence of Law
        Laws of the tension rate; those of one function are compiled once.
    jobs : int
        Threads; the numbers do not depend on it.

    Returns
    -------
    ndarray, shape (laws, cases)
        Tension [N]; NaN where it grows beyond all bounds.

    Raises
    ------
    ValueError
        If a law does not enter as a tension rate.
    """
    wrong = sorted({law.name for law in laws if law.enters != "tension rate"})
    if wrong:
        raise ValueError(f"laws must enter as tension rate, got {', '.join(wrong)}")
    addresses = np.array([law.address for law in laws], dtype=np.int64)
    parameters = np.zeros((len(laws), max((len(law.parameters) for law in laws), default=0) + 1))
    for row, law in enumerate(laws):
        parameters[row, : len(law.parameters)] = law.values
    result = np.empty((len(laws), len(motion.initial_tension)))
    parts = np.array_split(np.arange(len(laws)), max(jobs, 1))

    def work(part: npt.NDArray[np.int64]) -> None:
        span = slice(part[0], part[-1] + 1) if part.size else slice(0, 0)
        _follow_all(
            addresses[span],
            parameters[span],
            motion.nodes,
            motion.steps,
            motion.initial_tension,
            result[span],
        )

    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        list(pool.map(work, parts))
    return result


@njit(nogil=True, error_model="numpy")
def _follow(address: int, p: Any, nodes: Any, steps: Any, start: float) -> float:
    """Final tension along ``nodes``, shape (x v F D, 2 steps + 1), with ``steps`` of two intervals each [s].

    Simpson's rule in time with predicted tensions; the rate at the end of a step starts the next one.
    """
    T = start
    rate = invoke(address, (T, nodes[0, 0], nodes[1, 0], nodes[2, 0], nodes[3, 0], pointer(p, 0)))
    for step in range(steps.size):
        h, i = 0.5 * steps[step], 2 * step + 1
        trial = max(T + h * rate, 0.0)
        half = invoke(address, (trial, nodes[0, i], nodes[1, i], nodes[2, i], nodes[3, i], pointer(p, 0)))
        i += 1
        trial = max(T + 2.0 * h * half, 0.0)
        end = invoke(address, (trial, nodes[0, i], nodes[1, i], nodes[2, i], nodes[3, i], pointer(p, 0)))
        T = max(T + h / 3.0 * (rate + 4.0 * half + end), 0.0)
        rate = end
    return T


@njit(nogil=True, error_model="numpy")
def _follow_all(addresses: Any, parameters: Any, nodes: Any, steps: Any, starts: Any, result: Any) -> None:
    """Final tensions of laws (rows of ``parameters``) over cases; NaN where a tension is not finite."""
    for law in range(addresses.size):
        for case in range(starts.size):
            T = _follow(addresses[law], parameters[law], nodes[case], steps, starts[case])
            result[law, case] = T if np.isfinite(T) else np.nan
