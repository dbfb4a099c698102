"""Gamma of every loosening case by re-simulation.

The final tension falls monotonically with gamma, so that a bracketing root-finder finds what the pattern
search of He et al. (2025), Section 3.5, finds: the gamma whose simulated final tension is the measured one,
negative for net tightening.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.optimize import elementwise

from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.effects import LawChange, in_record
from rom.model.effect import SensorFault
from rom.model.laws import Parameter, power_loosening
from rom.model.model import Model
from rom.progress import Progress
from rom.signals.sensor_correction import true_hit
from rom.signals.tension_bins import TensionCourse

_PROBE: Numerical[float] = 100.0  # loosens by a small share, yet far above rounding
_PROBED: Numerical[tuple[float, float]] = (1e-8, 1e-4)  # ln(T_0 / T_1) that such a share is
_STEP_OF_UNIT: Numerical[float] = 1e3  # fewer decades than between those
_UNITS: Numerical[int] = 20  # tried at most
_LEAST_EXPOSURE: Numerical[float] = 1e-30  # a touch so weak that the probe's loss is lost in rounding
_BRACKETS: Numerical[int] = 16  # at most
_HALVINGS: Numerical[int] = 80  # at most; so many steps end within 1e-3 of the bound, in asinh(gamma)
_LOSS_TOLERANCE: Numerical[float] = 1e-10  # [N]
_NEVER: Numerical[float] = 1e12  # stands for the tension of a simulation that tightened beyond all bounds [N]


@dataclass(frozen=True, eq=False)
class LooseningCase:
    """One impact, the tension before and after [N], and the standard error of the loss.

    `given` are masses and stiffnesses of this record alone, by path.
    """

    file: str
    body: str
    force: FloatArray
    rate_hz: float
    initial: float
    final: float
    loss_error: float
    given: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, course: TensionCourse, hammer_faults: Sequence[SensorFault]) -> LooseningCase:
        """The case of a tension history, its hit [N] without faults of the hammer."""
        force, error = true_hit(course.force, course.rate_hz, hammer_faults), course.final_error
        final = max(course.final, error)
        return cls(
            course.file, course.body, force, course.rate_hz, course.initial, final, error, course.given
        )


@dataclass(frozen=True)
class GammaEstimate:
    """Gamma of one case [s^3/m^4]; `log_error` is the standard error of ln |gamma|."""

    file: str
    initial: float
    final: float
    loss_error: float
    gamma: float
    log_error: float
    at_bound: bool

    @property
    def loss(self) -> float:
        """Initial minus final tension [N]."""
        return self.initial - self.final


def final_tensions(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    gamma: FloatArray | None = None,
    path: str | None = None,
) -> FloatArray:
    """Return simulated final tensions [N], (cases,): means over the final window; nan where it diverged.

    ``gamma``, one a case, stands for the law's own, or for another number of the model at ``path``.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    gamma : ndarray, shape (cases,)
        A value for each case; None for the law's own.
    path : str
        Parameter that ``gamma`` stands for; None for the law's own gamma.

    Returns
    -------
    ndarray
        Shape (cases,) [N].
    """
    out = np.empty(len(cases))
    path = path or f"{model.structure.bolted_links[0]}.tension_rate.gamma"
    keys = [(c.body, c.rate_hz, len(c.force), tuple(sorted(c.given.items()))) for c in cases]
    for key in dict.fromkeys(keys):
        index = [i for i, other in enumerate(keys) if other == key]
        out[index] = in_record(model, dict(key[3])).final_tension(
            np.stack([cases[i].force for i in index]),
            key[1],
            np.array([cases[i].initial for i in index]),
            vary=None if gamma is None else {path: gamma[index]},
            window_s=window_s,
            body=key[0],
        )
    return out


def identify_gamma(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    exponent: float = 4.0,
    progress: Progress | None = None,
) -> tuple[GammaEstimate, ...]:
    """Return gamma per case such that simulated and measured final tension agree; bounds +-1e10,
    in a unit that is 1 s^3/m^4 for velocities as in He et al. (2025).

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    exponent : float
        Power of the velocity in the law.
    progress : callable
        Called with the number of cases that are solved and their total.

    Returns
    -------
    tuple
        One for each case.
    """
    if not cases:
        return ()
    trial = _with_power(model, exponent)
    gamma, at_bound = matching_gammas(model, cases, window_s, exponent, progress=progress)
    step = 1e-3 * np.abs(gamma)
    slope = np.abs(
        final_tensions(trial, cases, window_s, gamma + step)
        - final_tensions(trial, cases, window_s, gamma - step)
    ) / (2e-3)
    error = np.array([case.loss_error for case in cases]) / np.maximum(slope, 1e-12)
    return tuple(
        GammaEstimate(c.file, c.initial, c.final, c.loss_error, float(g), float(e), bool(b))
        for c, g, e, b in zip(cases, gamma, error, at_bound, strict=True)
    )


def matching_gammas(
    model: Model,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    exponent: float = 4.0,
    tolerance: float = 1e-10,
    progress: Progress | None = None,
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return gammas [s^3/m^4] to a tolerance of asinh(gamma), (cases,), and which of them are at a bound.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    exponent : float
        Power of the velocity in the law.
    tolerance : float
        Tolerance of the root.
    progress : callable
        Called with the number of cases that are solved and their total.

    Returns
    -------
    tuple
        Gammas, shape (cases,), and whether each is at a bound.
    """
    trial = _with_power(model, exponent)
    near, unit = _small_loss_gamma(trial, cases, window_s)
    return _matching(trial, None, cases, window_s, near, tolerance, progress, unit)


def own_rate(factor: float) -> LawChange:
    """One test's own factor on the rate of loosening, after all other changes of the law."""
    return LawChange("own-rate", "tension", "factor * rate", {"factor": Parameter(factor, "1")})


def matching_factors(
    model: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float], tolerance: float = 1e-10
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return factors on a model's own rate of loosening, (cases,), and which of them are at a bound.

    Parameters
    ----------
    model : Model
        The model.
    cases : sequence of LooseningCase
        Impacts with the tensions before and after.
    window_s : tuple of float
        Window [s], from and to.
    tolerance : float
        Tolerance of the root.

    Returns
    -------
    tuple
        Factors, shape (cases,), and whether each is at a bound.
    """
    own = own_rate(1.0)
    path = f"{own.path}.factor"
    return _matching(model.with_effect(own), path, cases, window_s, np.ones(len(cases)), tolerance)


def _matching(
    trial: Model,
    path: str | None,
    cases: Sequence[LooseningCase],
    window_s: tuple[float, float],
    near: FloatArray,
    tolerance: float,
    progress: Progress | None = None,
    unit: float = 1.0,
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the values at a path near some with which the final tensions are the measured ones.

    They are sought as multiples of a unit.
    """
    measured = np.array([case.final for case in cases])

    def miss(place: FloatArray, index: FloatArray) -> FloatArray:
        rows = index.astype(int).ravel()
        if progress is not None:  # only cases that are not solved are asked for
            progress(len(cases) - len(rows), len(cases))
        values = unit * np.sinh(place.ravel())
        final = final_tensions(trial, [cases[i] for i in rows], window_s, values, path)
        final = np.where(np.isfinite(final), final, _NEVER)
        return np.asarray((final - measured[rows]).reshape(place.shape))

    index = np.arange(len(cases), dtype=float)
    guess, limit = np.arcsinh(near / unit), float(np.arcsinh(RULES.gamma_bound))
    bracket = elementwise.bracket_root(
        miss, np.clip(guess - 1, -limit, limit - 1), np.clip(guess + 1, 1 - limit, limit), xmin=-limit,
        xmax=limit, args=(index,), maxiter=_BRACKETS,
    )  # fmt: skip
    root = elementwise.find_root(
        miss,
        bracket.bracket,
        args=(index,),
        tolerances={"xatol": 0.0, "xrtol": tolerance, "fatol": _LOSS_TOLERANCE, "frtol": 0.0},
        maxiter=_HALVINGS,
    )
    if progress is not None:
        progress(len(cases), len(cases))
    at_bound = ~np.asarray(bracket.success)
    ends = np.where(guess > 0, limit, -limit)
    return unit * np.sinh(np.where(at_bound, ends, root.x)), at_bound


def _with_power(model: Model, exponent: float) -> Model:
    """The model with ``gamma |v|^n T`` for its tension's law."""
    return model.with_tension_law(power_loosening(1.0, exponent))


def _small_loss_gamma(
    trial: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Return ln(T_0 / T_1) / integral |v|^n dt, gamma as if the falling tension left the motion alone, and
    the power of ten in which gammas of such motions are counted.
    """
    initial, unit = np.array([case.initial for case in cases]), 1.0
    exposure = first = _exposure(trial, cases, window_s, unit)
    for _ in range(_UNITS):
        share = _PROBE * unit * float(np.median(exposure))
        if _PROBED[0] <= share <= _PROBED[1]:
            break
        unit *= _STEP_OF_UNIT if share < _PROBED[0] else 1 / _STEP_OF_UNIT
        exposure = _exposure(trial, cases, window_s, unit)
    else:  # nothing moves
        exposure, unit = first, 1.0
    final = np.maximum([case.final for case in cases], 1e-3 * initial)
    exposure = np.where(np.isfinite(exposure), exposure, 0.0)
    return np.asarray(np.log(initial / final) / np.maximum(exposure, _LEAST_EXPOSURE / unit)), unit


def _exposure(
    trial: Model, cases: Sequence[LooseningCase], window_s: tuple[float, float], unit: float
) -> FloatArray:
    """Return integral |v|^n dt of each case by a small loss; infinite where that is all of the tension."""
    probe = _PROBE * unit
    initial = np.array([case.initial for case in cases])
    final = final_tensions(trial, cases, window_s, np.full(len(cases), probe))
    lost = np.isnan(final) | (final <= 0)
    return np.asarray(np.where(lost, np.inf, np.log(initial / np.where(lost, initial, final)) / probe))
