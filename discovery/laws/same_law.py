"""Whether two laws are one equation, whatever their numbers are called.

Rates are compared at states drawn within the measured range, x, v, F, D and T independent of each other: what
agrees along one motion alone, as ``|D v|`` and ``v^2`` do at constant damping, is two equations. Two laws
with as many free numbers are the same law if for several values of the numbers of one there are numbers of
the other that give the same rate at every state, to within rounding. Where the rate is zero at almost all,
as below a threshold, numbers agree by chance: that is no identity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from discovery.laws.candidate import Candidate
from discovery.laws.given import GivenLaw, starts_of
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.laws import Parameter, free_form_law

Mask = npt.NDArray[np.bool_]

_STATES: Numerical[int] = 256
_MOVING: Numerical[int] = 8  # states of a rate that is not zero, at least, for each free number
_DECADES: Numerical[float] = 2.0  # below the largest motion and tension
_TRIALS: Numerical[int] = 3  # values of a law's numbers
_VARIED: Numerical[float] = 1.25  # factor, up and down
_ROUNDING: Numerical[float] = 1e-7  # of the logarithm of a rate
_FAR: Numerical[float] = 100.0  # log rate in place of one that is zero or not finite


def states_of(nodes: FloatArray) -> FloatArray:
    """Return states within the range of a motion, (5, states): T, x, v, F, D.

    Parameters
    ----------
    nodes : ndarray, shape (6, nodes)
        Time, x, v, F, D and T along the motion, as `FrozenMotion.nodes`.
    """
    rng = np.random.default_rng(0)
    largest = np.abs(nodes[[5, 1, 2, 3, 4]]).max(axis=1)[:, None]
    sizes = largest * 10.0 ** -rng.uniform(0.0, _DECADES, (5, _STATES))
    signs = rng.choice([-1.0, 1.0], (5, _STATES))
    signs[0] = 1.0
    return np.asarray(sizes * signs)


def same_law(one: Candidate, other: Candidate, states: FloatArray) -> bool:
    """Whether two laws are the same equation with as many free numbers, whatever ranges these have.

    Parameters
    ----------
    one, other : Candidate
        The laws.
    states : ndarray, shape (5, states)
        As `states_of` returns them.
    """
    if len(one.free) != len(other.free):
        return False
    return all(numbers_at_rate_of(trial, one, states) is not None for trial in _varied(other))


def numbers_at_rate_of(target: Candidate, law: Candidate, states: FloatArray) -> dict[str, float] | None:
    """Return the free numbers at which a law has the rate of another one; None where there are none.

    Parameters
    ----------
    target : Candidate
        The law whose rate is to be had.
    law : Candidate
        The law whose free numbers are sought, also beyond their ranges.
    states : ndarray, shape (5, states)
        As `states_of` returns them.
    """
    wanted = _rate(target, states)
    moving = wanted != 0
    if moving.sum() < _MOVING * len(law.free):
        return None
    for start in map(_unbounded, starts_of(law)):
        try:
            found = _solved(start, wanted, states, moving)
            rate = _rate(found, states)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # as in a fit: no numbers from here
            continue
        with np.errstate(all="ignore"):
            off = np.log(rate[moving] / wanted[moving])
        if bool((np.abs(off) < _ROUNDING).all()) and not rate[~moving].any():
            return {name: found.parameters[name].value for name in found.free}
    return None


def _unbounded(law: Candidate) -> Candidate:
    if not isinstance(law, GivenLaw):
        return law
    free = {name: Parameter(p.value, p.unit) for name, p in law.parameters.items()}
    return replace(law, rate=free_form_law(law.name, law.equation, "tension rate", free))


def _solved(start: Candidate, wanted: FloatArray, states: FloatArray, moving: Mask) -> Candidate:
    """The law with the numbers at which the logarithm of its rate is nearest to the one wanted."""
    if not start.free:
        return start
    here = start.parameters
    logs = [name in start.coefficient_names and here[name].value > 0 for name in start.free]
    first = [np.log(here[n].value) if log else here[n].value for n, log in zip(start.free, logs, strict=True)]

    def at(vector: FloatArray) -> Candidate:
        numbers = [np.exp(np.clip(x, -690, 690)) if log else x for x, log in zip(vector, logs, strict=True)]
        return start.with_values(dict(zip(start.free, map(float, numbers), strict=True)))

    def off(vector: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            ratio = np.log(np.abs(_rate(at(vector), states)[moving] / wanted[moving]))
        return np.asarray(np.nan_to_num(ratio, nan=_FAR, posinf=_FAR, neginf=-_FAR))

    tight = 1e-15
    return at(least_squares(off, first, method="lm", x_scale="jac", xtol=tight, ftol=tight, gtol=tight).x)


def _rate(law: Candidate, states: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        return law.law().rate(*states)


def _varied(law: Candidate) -> Iterator[Candidate]:
    """The law with its free numbers as they are, and somewhat larger or smaller."""
    rng = np.random.default_rng(1)
    yield law
    for _ in range(_TRIALS - 1):
        factors = _VARIED ** rng.uniform(-1.0, 1.0, len(law.free))
        here = law.parameters
        yield law.with_values({n: here[n].value * f for n, f in zip(law.free, factors, strict=True)})
