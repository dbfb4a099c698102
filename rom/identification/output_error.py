"""Linear output-error fit of a lumped structure, all records at once, in the frequency domain.

By Parseval's theorem the weighted misfit of the spectra (`rom.identification.spectral_model`) is the
time-domain output error after
ideal band-pass filtering, so no integration or filter bias enters (maximum likelihood for stationary noise;
R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2012, ch. 9-12).

The weight is the inverse of S = G Q(f) G^H + R, G = s^q Z^-1: ambient forces Q(f), smooth in frequency, reach
a channel through the structure's own resonances; sensor noise R does not. Both are estimated from what the
model leaves over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rom.criteria.number import Numerical
from rom.identification.ambient_noise import ambient_forces, sensor_noise, share_left, whitener
from rom.identification.priors import Misfit, PriorConstraint, misfits, pull
from rom.identification.secant_steps import Normal, Secant, box, decrease, step_within
from rom.identification.small_matrices import root_of
from rom.identification.spectral_model import (
    CORNER,
    ComplexArray,
    FloatArray,
    Linearised,
    SpectralRecord,
    key,
    linearise,
    step_unit,
)
from rom.identification.unexplained import Unexplained, unexplained_resonances

_OUTER_ITERATIONS: Numerical[int] = 12
# weights taken from a half-done fit would make its misfit look like noise
_FIRST_ITERATIONS: Numerical[int] = 60
_BETWEEN_WEIGHTS: Numerical[int] = 3  # their minimum is left at the next ones anyway
_LAST_ITERATIONS: Numerical[int] = 12
_DAMPING: Numerical[float] = 1e-3  # share of the diagonal that is added to it, at first
_REJECTED: Numerical[float] = 1e-4  # at least, after a step that has raised the cost
_POOR: Numerical[float] = 0.25  # of the fall that was expected
_TOLERANCE: Numerical[float] = 1e-4  # of a step
_NEGLIGIBLE: Numerical[float] = 1e-7  # share of the cost that a step may still promise
_UNTOLD: Numerical[float] = 1e-12
_TINY: Numerical[float] = 1e-6  # stands for a sensor's corner that comes out at zero or below [rad/s]
_SETTLED: Numerical[float] = 0.05  # square of a change in standard errors


@dataclass(frozen=True)
class OutputErrorFit:
    """Estimates, natural-log covariance and residual of a joint fit.

    `values` maps "name" (shared) or "name@file" (local) to the estimate; `covariance` is that of the natural
    logarithms in the order of `names`. `misfits` tell how much of the residual is no noise, `ties` what the
    coefficients lean on there, `unexplained` the resonances without a mode of the structure.
    """

    names: tuple[str, ...]
    logarithms: FloatArray
    covariance: FloatArray
    reduced_chi_square: float
    converged: bool
    misfits: tuple[Misfit, ...] = ()
    ties: tuple[PriorConstraint, ...] = field(default=(), repr=False)
    unexplained: tuple[Unexplained, ...] = ()

    def value(self, name: str) -> float:
        """Return the estimate of one coefficient."""
        return float(np.exp(self.logarithms[self.names.index(name)]))

    def relative_error(self, name: str) -> float:
        """Return the standard error of the natural logarithm of one coefficient."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def block(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return estimates (n,) and the covariance (n, n) of their logarithms."""
        index = [self.names.index(name) for name in names]
        return np.exp(self.logarithms[index]), self.covariance[np.ix_(index, index)]


def _whiteners(records: Sequence[SpectralRecord], state: _State, names: Sequence[str]) -> list[ComplexArray]:
    """Return S^-1/2 of every record; Q and R are pooled over the records of a group with equal lines."""
    parts, covariance = state.parts, _covariance(state.hessian)
    position = {name: i for i, name in enumerate(names)}
    index = [[position[name] for name in part.columns] for part in parts]
    left = [share_left(part, covariance[np.ix_(own, own)]) for part, own in zip(parts, index, strict=True)]
    groups: dict[tuple[str, int], list[int]] = {}
    for i, record in enumerate(records):
        groups.setdefault((record.group, len(record.frequency)), []).append(i)
    out: list[ComplexArray] = [np.empty(0, dtype=np.complex128)] * len(records)
    for members in groups.values():
        sensor = sensor_noise([parts[i] for i in members])
        ambient = ambient_forces(
            records[members[0]].frequency, [parts[i] for i in members], sensor, [left[i] for i in members]
        )
        root = root_of(ambient / 2)
        for i in members:
            out[i] = whitener(parts[i].gain, root, sensor / 2)
    return out


@dataclass
class _State:
    """Where the search stands: coefficients, linearisation and normal equations, and J^T r without ties."""

    values: dict[str, float]
    parts: list[Linearised]
    hessian: FloatArray
    gradient: FloatArray
    cost: float
    untied: FloatArray

    def normal(self, names: Sequence[str]) -> Normal:
        """Return the normal equations, each coefficient counted in its `step_unit`."""
        units = np.array([step_unit(name, self.values[name]) for name in names])
        return Normal(self.hessian, self.gradient, self.cost, units)


def _evaluate(
    records: Sequence[SpectralRecord],
    values: dict[str, float],
    whiteners: Sequence[ComplexArray],
    names: Sequence[str],
    tied: Sequence[tuple[PriorConstraint, float]],
) -> _State:
    position = {name: i for i, name in enumerate(names)}
    parts = [linearise(r, values, w) for r, w in zip(records, whiteners, strict=True)]
    hessian, gradient, cost = np.zeros((len(names), len(names))), np.zeros(len(names)), 0.0
    for part in parts:
        index = [position[name] for name in part.columns]
        hessian[np.ix_(index, index)] += part.jacobian.T @ part.jacobian
        gradient[index] += part.jacobian.T @ part.residual
        cost += float(part.residual @ part.residual)
    return _tied(_State(values, parts, hessian, gradient, cost, gradient), names, tied)


def _tied(state: _State, names: Sequence[str], tied: Sequence[tuple[PriorConstraint, float]]) -> _State:
    """Return the state with ties in its cost."""
    hessian, gradient, cost = state.hessian, state.gradient, state.cost
    for tie, weight in tied:
        offset = tie.offset(state.values)
        row = np.array([tie.factors.get(name, 0.0) for name in names]) / tie.error
        hessian = hessian + weight * np.outer(row, row)
        gradient = gradient + weight * offset * row
        cost += weight * offset**2
    return replace(state, hessian=hessian, gradient=gradient, cost=cost)


def _weighed(
    records: Sequence[SpectralRecord],
    values: dict[str, float],
    whiteners: Sequence[ComplexArray],
    names: Sequence[str],
    ties: Sequence[PriorConstraint],
) -> tuple[_State, tuple[tuple[PriorConstraint, float], ...]]:
    """Return the state at new weights of the lines, and the ties with the weights that its misfit gives."""
    state = _evaluate(records, values, whiteners, names, ())
    weights = pull(ties, records, misfits(records, state.parts)) if ties else ()
    tied = tuple((tie, weight) for tie, weight in zip(ties, weights, strict=True) if weight > 0)
    return (_tied(state, names, tied) if tied else state), tied


def _minimise(
    records: Sequence[SpectralRecord],
    state: _State,
    whiteners: Sequence[ComplexArray],
    names: Sequence[str],
    tied: Sequence[tuple[PriorConstraint, float]],
    *,
    starts: FloatArray,
    iterations: int,
) -> tuple[_State, bool]:
    """Return the minimum for fixed weights, and whether the last step was within the tolerance."""
    damping, secant = _DAMPING, Secant(np.zeros((len(names), len(names))))
    positive = np.array([not name.startswith(CORNER) for name in names])
    for _ in range(iterations):
        values, normal = np.array([state.values[name] for name in names]), state.normal(names)
        hessian = secant.of(normal)
        step = step_within(
            hessian + damping * np.diag(np.diag(state.hessian)),
            state.gradient,
            *box(values, starts, normal.units, positive),
        )
        expected = decrease(hessian, state.gradient, step)
        settled = float(np.abs(step).max(initial=0.0)) < _TOLERANCE or expected < _NEGLIGIBLE * max(
            state.cost, 1.0
        )
        stepped = dict(zip(names, values + step * normal.units, strict=True))
        trial = _evaluate(records, state.values | stepped, whiteners, names, tied)
        misfit = (state.untied, trial.untied, _across(state, trial, names))
        secant = secant.after(step, normal, trial.normal(names), misfit)
        if trial.cost <= state.cost * (1 + 1e-12):
            poor = state.cost - trial.cost < _POOR * expected
            state, damping = trial, damping * 2 if poor else max(damping / 10, 1e-9)
            if settled:
                return state, True
        elif settled:
            return state, True
        else:
            damping = min(max(damping * 10, _REJECTED), 1e8)
    return state, False


def _across(before: _State, after: _State, names: Sequence[str]) -> FloatArray:
    """Return J before a step, transposed, times r after it."""
    out, position = np.zeros(len(names)), {name: i for i, name in enumerate(names)}
    for old, new in zip(before.parts, after.parts, strict=True):
        out[[position[name] for name in old.columns]] += old.jacobian.T @ new.residual
    return out


def fit_output_error(
    records: Sequence[SpectralRecord],
    *,
    ties: Sequence[PriorConstraint] = (),
) -> OutputErrorFit:
    """Fit all free terms of `records` together by least squares on the weighted spectra.

    Steps are shares of the coefficients, none below -60 % (`rom.identification.secant_steps`): all but a
    sensor's corner stay positive, and stiffnesses of which only the sum is well told can trade along a
    straight line. The weights start equal over the lines and are re-estimated from the residual, after a
    minimum with equal weights and then every few steps, until both settle. `ties` count as much as the misfit
    asks for (`rom.identification.priors`).

    Parameters
    ----------
    records : sequence of SpectralRecord
        Spectra of the records.
    ties : sequence of PriorConstraint
        Prior constraints on the terms.

    Returns
    -------
    OutputErrorFit
        Estimates with covariance.

    Raises
    ------
    ValueError
        Where there is no record.
    """
    if not records:
        raise ValueError("an output-error fit needs at least one record, instead got none")
    names = tuple(dict.fromkeys(key(r, t) for r in records for t in r.terms if t.free))
    whiteners = [_equal_weights(record) for record in records]
    values = {key(r, t): t.value for r in records for t in r.terms}
    state, tied = _weighed(records, values, whiteners, names, ties)
    starts, converged = np.array([values[name] for name in names]), False
    between = (_OUTER_ITERATIONS - 2) * [_BETWEEN_WEIGHTS]
    for iteration, steps in enumerate([_FIRST_ITERATIONS, *between, _LAST_ITERATIONS]):
        before = np.array([state.values[name] for name in names])
        state, inner = _minimise(records, state, whiteners, names, tied, starts=starts, iterations=steps)
        change = np.array([state.values[name] for name in names]) - before
        change /= [step_unit(name, value) for name, value in zip(names, before, strict=True)]
        settled = (
            float(change @ state.hessian @ change) < _SETTLED or np.abs(change).max(initial=0) < _TOLERANCE
        )
        if iteration > 1 and inner and settled:
            converged = True
            break
        whiteners = _whiteners(records, state, names)
        state, tied = _weighed(records, state.values, whiteners, names, ties)
    return _estimate(records, state, names, ties, converged=converged)


def start_cost(records: Sequence[SpectralRecord]) -> float:
    """Return what starting values leave over at equal weights."""
    parts = (linearise(r, {key(r, t): t.value for t in r.terms}, _equal_weights(r)) for r in records)
    return sum(float(part.residual @ part.residual) for part in parts)


def _estimate(
    records: Sequence[SpectralRecord],
    state: _State,
    names: tuple[str, ...],
    ties: Sequence[PriorConstraint],
    *,
    converged: bool,
) -> OutputErrorFit:
    """Return the fit at the place where its steps have ended."""
    rows = sum(len(part.residual) for part in state.parts) - len(names)
    cost = sum(float(part.residual @ part.residual) for part in state.parts)
    least = {name: _TINY if name.startswith(CORNER) else np.finfo(float).tiny for name in names}
    values = np.array([max(state.values[name], least[name]) for name in names])
    share = np.array([step_unit(name, value) / value for name, value in zip(names, values, strict=True)])
    return OutputErrorFit(
        names,
        np.log(values),
        _covariance(state.hessian) * np.outer(share, share),
        cost / max(rows, 1),
        converged,
        misfits(records, state.parts),
        tuple(ties),
        unexplained_resonances(records, state.parts),
    )


def values_of(records: Sequence[SpectralRecord], fit: OutputErrorFit) -> dict[str, float]:
    """Return all coefficients of records, those that are given too."""
    return {key(r, t): t.value for r in records for t in r.terms} | {n: fit.value(n) for n in fit.names}


def _covariance(hessian: FloatArray) -> FloatArray:
    """Return the inverse; a direction that no record tells has a huge variance, not none."""
    size = np.sqrt(np.maximum(np.diag(hessian), _UNTOLD))
    level, direction = np.linalg.eigh(hessian / np.outer(size, size))
    return np.asarray((direction / np.maximum(level, _UNTOLD)) @ direction.T / np.outer(size, size))


def _equal_weights(record: SpectralRecord) -> ComplexArray:
    """Return equal weights for every line, each channel scaled by its own size."""
    size = np.sqrt(np.mean(np.abs(record.motion) ** 2, axis=0)) + np.finfo(float).tiny
    return np.broadcast_to(
        np.diag(1 / size).astype(np.complex128), (len(record.frequency), len(size), len(size))
    )
