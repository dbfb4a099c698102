"""Courses of the tension under a candidate law: along frozen exposures, and by full re-simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import Candidate
from discovery.laws.given import OWN_RATE, GivenLaw
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.model.laws import Law
from rom.model.model import Model

HIGHEST: Numerical[float] = 10.0  # no tension beyond so many times the highest initial one


def predict(candidate: Candidate, frozen: FrozenMotion, deviations: FloatArray | None = None) -> FloatArray:
    """Changes of tension [N] in every bin along the frozen motion, (cases, bins).

    Parameters
    ----------
    candidate : Candidate
        The law.
    frozen : FrozenMotion
        Motion along which it is followed.
    deviations : ndarray, shape (cases,), optional
        Deviation u of every case's rate; typical rates if not given.

    Returns
    -------
    ndarray, shape (cases, bins)
        Mean tension in the bin less that before the hit [N].
    """
    if candidate.holds:
        return np.zeros_like(frozen.change)
    if isinstance(candidate, GivenLaw):
        rates = frozen.factors(deviations)
        means = followed(candidate.law(), OWN_RATE, frozen, rates, frozen.initial, frozen.edges_s)
        return np.asarray(means - np.maximum(frozen.initial, 0.0)[:, None])
    return _along_exposures(candidate, frozen, deviations)


def _along_exposures(candidate: Candidate, frozen: FrozenMotion, deviations: FloatArray | None) -> FloatArray:
    """Changes of tension [N] of a sum of terms, (cases, bins)."""
    from rom.kernels.exposures import follow_exposures

    tension = [term.tension for term in candidate.terms]
    width = max(max(len(factor.inner) for factor in tension), 1)
    parameters = np.zeros((len(tension), width))
    for row, factor in enumerate(tension):
        parameters[row, : len(factor.inner)] = [inner.value for inner in factor.inner.values()]
    addresses = np.array([factor.address for factor in tension], dtype=np.int64)
    parts = [frozen.exposure(term.motion) for term in candidate.terms]
    exposures = np.stack(parts) if len(parts) > 1 else parts[0][None]
    signs = [term.sign or 1 for term in candidate.terms]
    weights = np.array(candidate.coefficients) * signs
    rates = frozen.factors(deviations)
    initial = frozen.initial
    with np.errstate(over="ignore"):  # steps of a fit may go anywhere; the course is not finite there
        coefficients = np.multiply.outer(rates, weights)
    course = follow_exposures(
        addresses, parameters, coefficients, exposures, initial, HIGHEST * initial.max()
    )
    return np.asarray(course @ frozen.averages.T - np.maximum(initial, 0.0)[:, None])


def followed(
    law: Law,
    own_rate: str,
    frozen: FrozenMotion,
    rates: FloatArray,
    initial: FloatArray,
    edges_s: FloatArray,
) -> FloatArray:
    """Mean tension [N] in every bin under any law, followed node by node along the motion, (cases, bins).

    Parameters
    ----------
    law : Law
        A tension rate.
    own_rate : str
        Its number that differs from case to case.
    frozen : FrozenMotion
        Motion along which it is followed.
    rates : ndarray, shape (cases,)
        That number in every case.
    initial : ndarray, shape (cases,)
        Tension before the hit [N].
    edges_s : ndarray, shape (bins + 1,)
        Edges of the bins from the hit [s].

    Returns
    -------
    ndarray, shape (cases, bins)
        Not finite where the law was lost.
    """
    from rom.kernels.law_courses import follow_courses

    p = np.tile(law.values, (len(frozen), 1))
    p[:, list(law.parameters).index(own_rate)] = rates
    held = np.maximum(initial, 0.0)
    means = np.empty((len(frozen), len(edges_s) - 1))
    highest = HIGHEST * max(float(held.max()), 1.0)
    follow_courses(law.address, p, frozen.nodes[:5], frozen.starts, edges_s, held, highest, means)
    return means


def bin_edges(frozen: FrozenMotion) -> FloatArray:
    """Edges of the bins [s] from the hit: those of one record, to a sample those of all."""
    return np.asarray(frozen.courses[0].edges_s - frozen.courses[0].impact_s)


def resimulate(
    candidate: Candidate, frozen: FrozenMotion, deviations: FloatArray | None = None
) -> FloatArray:
    """Changes of tension [N] by full coupled re-simulation, (cases, bins); nan where it diverged.

    Parameters
    ----------
    candidate : Candidate
        The law.
    frozen : FrozenMotion
        The model and the forces of all cases.
    deviations : ndarray, shape (cases,), optional
        Deviation u of every case's rate; typical rates if not given.

    Returns
    -------
    ndarray, shape (cases, bins)
        Mean tension in the bin less that before the hit [N].
    """
    if candidate.holds:
        return np.zeros_like(frozen.change)
    law, initial = candidate.law(), np.maximum(frozen.initial, 0.0)
    rated = candidate.rated(frozen.factors(deviations))
    means = np.empty_like(frozen.change)
    for model, cases in frozen.by_bolt():
        part = frozen if len(cases) == len(frozen) else frozen.subset(cases)
        own = {name: values[cases] for name, values in rated.items()}
        acting = model.with_tension_law(law, frozen.link)
        means[cases] = simulated_means(acting, part, initial[cases], own)
    return np.asarray(means - initial[:, None])


def simulated_means(
    model: Model, frozen: FrozenMotion, initial: FloatArray, own: Mapping[str, FloatArray]
) -> FloatArray:
    """Mean tension [N] in every bin by full simulation, (cases, bins); nan where it diverged.

    Parameters
    ----------
    model : Model
        With the tension law.
    frozen : FrozenMotion
        Forces and bins of all cases.
    initial : ndarray, shape (cases,)
        Tension before the hit [N].
    own : mapping of str to ndarray, shape (cases,)
        Numbers of the law that are each case's own, by name.
    """
    out = np.empty_like(frozen.change)
    keys = [
        (c.body, c.rate_hz, len(c.force), c.tension_rate_hz, tuple(sorted(c.given.items())))
        for c in frozen.courses
    ]
    for key in dict.fromkeys(keys):
        index = [i for i, other in enumerate(keys) if other == key]
        courses = [frozen.courses[i] for i in index]
        out[index] = in_record(model, dict(key[4])).mean_tensions(
            np.stack([course.force for course in courses]), key[1], initial[index],
            np.stack([course.edges_s for course in courses]),
            {f"{frozen.link}.tension_rate.{name}": values[index] for name, values in own.items()}, key[0],
            tension_rate_hz=_common(key[1], key[3]),
        )  # fmt: skip
    return out


def _common(rate_hz: float, tension_rate_hz: float) -> float | None:
    """The rate of the measured means where the simulation has it too."""
    ratio = rate_hz / tension_rate_hz
    return tension_rate_hz if ratio >= 1 and abs(ratio - round(ratio)) < 1e-9 else None
