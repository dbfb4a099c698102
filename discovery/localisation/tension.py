"""At which preload, speed and time from the hit a law leaves over what of the tension's courses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from discovery.courses.prediction import bin_edges
from discovery.courses.variability import tau
from discovery.localisation.localise import PRELOADS_N, Profile, class_label
from discovery.residual.course_fit import CourseFit, Misfit
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_SPEEDS: Numerical[tuple[float, ...]] = (1.0, 3.0, 10.0, 30.0, 100.0)  # [mm/s]
_TIMES: Numerical[tuple[float, ...]] = (10.0, 30.0, 100.0, 300.0, 1000.0)  # [ms]


def tension_views(misfit: Misfit) -> Mapping[str, Profile]:
    """Mean square of what a law leaves over of the training courses, 1 being noise, along three views.

    Whitened residuals are those of each bin given the bins before it, so that they belong to what the rate
    was between these. Squares are divided by what noise alone would leave in the same bins: less than their
    number, since every course has a rate of its own, and two directions of which nothing is told.

    Parameters
    ----------
    misfit : Misfit
        With the law's fit to the training courses; there are no views without it.

    Returns
    -------
    mapping of str to tuple of (str, float)
        ``tension_by_preload``: tension before the hit [N]; ``tension_by_velocity``: largest relative velocity
        in the bin [mm/s]; ``tension_by_time``: middle of the bin from the hit [ms]. A label of the class and
        the mean square there; classes of too few free numbers are left out.
    """
    slow = misfit.fit
    if slow is None:
        return {}
    frozen = slow.problem.frozen
    squares, numbers = slow.state.residual**2, _free_numbers(slow)
    bins = bin_edges(frozen)
    fewest, middle = frozen.criteria.localisation.class_numbers, 0.5 * (bins[1:] + bins[:-1]) * 1e3
    views = {
        "tension_by_preload": (np.broadcast_to(frozen.initial[:, None], squares.shape), PRELOADS_N, "N"),
        "tension_by_velocity": (_speeds(slow) * 1e3, _SPEEDS, "mm/s"),
        "tension_by_time": (np.broadcast_to(middle, squares.shape), _TIMES, "ms"),
    }
    return {
        name: _profile(values, edges, unit, squares, numbers, fewest)
        for name, (values, edges, unit) in views.items()
    }


def _free_numbers(slow: CourseFit) -> FloatArray:
    """Mean square of every whitened residual were it noise, (cases, bins)."""
    frozen, state, whitener = slow.problem.frozen, slow.state, slow.problem.whitener
    noise = np.stack([course.covariance for course in frozen.courses])
    by_noise = np.einsum("cij,cjk,cik->ci", whitener, noise, whitener)
    information = (state.slope**2).sum(axis=1)
    variance = 1 / (information + 1 / tau(state.scatter, frozen.initial, frozen.criteria.courses) ** 2)
    return np.asarray(np.maximum(by_noise - variance[:, None] * state.slope**2, 0.0))


def _speeds(slow: CourseFit) -> FloatArray:
    """Largest relative velocity in every bin [m/s], (cases, bins)."""
    frozen = slow.problem.frozen
    edges = bin_edges(frozen)
    found = np.zeros_like(slow.state.residual)
    for case in range(len(frozen)):
        nodes = frozen.of_case(case)
        time, speed = nodes[0], nodes[2]
        place = np.searchsorted(edges, time, side="right") - 1
        inside = (place >= 0) & (place < found.shape[1])
        np.maximum.at(found[case], place[inside], np.abs(speed[inside]))
    return found


def _profile(
    values: FloatArray,
    edges: Sequence[float],
    unit: str,
    squares: FloatArray,
    numbers: FloatArray,
    fewest: float,
) -> Profile:
    place = np.searchsorted(edges, values)
    found = []
    for k in range(len(edges) + 1):
        inside = place == k
        if (count := float(numbers[inside].sum())) >= fewest:
            found.append((class_label(k, edges, unit), float(squares[inside].sum()) / count))
    return tuple(found)
