r"""Linear output-error fit of a lumped structure, all records at once, in the frequency domain.

For a record of length D the Fourier integral of M x'' + C x' + K x = F over [0, D] gives, with no leakage
left out,

    X = Z(s)^-1 (F - M (dv + s dx) - C dx),   Z = s^2 M + s C + K,   s = 2 pi i f,

where dx and dv are what displacement and velocity gain between the record's ends. They enter linearly, are
eliminated for each record, and carry a free decay's initial state. By Parseval's theorem the weighted misfit
of the spectra is the time-domain output error after ideal band-pass filtering, so no integration or filter
bias enters (maximum likelihood for stationary noise; R. Pintelon and J. Schoukens, System Identification: A
Frequency Domain Approach, 2012, ch. 9-12).

The weight is the inverse of S = G Q(f) G^H + R, G = s^q Z^-1: ambient forces Q(f), smooth in frequency, reach
a channel through the structure's own resonances; sensor noise R does not. Both are estimated from what the
model leaves over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complexfloating[Any, Any]]

DERIVATIVE_ORDER = {"displacement": 0, "velocity": 1, "acceleration": 2}
STRUCTURAL = ("stiffness", "damping", "mass")
_LARGEST_LOG_STEP = 0.7
_OUTER_ITERATIONS = 12
_INNER_ITERATIONS = 12
_SMOOTHING_HZ = 2.0
_NEGLIGIBLE = 1e-7  # share of the cost that a step may still promise
_UNTOLD = 1e-12
_SETTLED = 0.05  # square of a change in standard errors


@dataclass(frozen=True)
class Term:
    """One coefficient: a stiffness, damping or mass along a direction in body space, or the corner of the
    sensors.

    K, C or M gains value * direction direction^T. Terms of equal `name` share one value over all records. The
    one term "corner" w [rad/s] stands for the AC coupling s / (s + w) of all accelerometers.
    """

    name: str
    matrix: str  # "stiffness" | "damping" | "mass" | "corner"
    direction: FloatArray
    value: float
    free: bool = True

    @property
    def power(self) -> int:
        """Return the power of s that the term carries in Z(s)."""
        return STRUCTURAL.index(self.matrix)


@dataclass(frozen=True)
class SpectralRecord:
    """Spectra of one record: force (lines, bodies) and motion (lines, channels), one channel a moving body.

    `local` names the terms that belong to this record alone; the others have one value for all records.
    `force_errors` are the standard errors of the force's relative gain and of its delay [s] that the hammer's
    noise leaves, `sampling_errors` those that a pulse of few samples leaves, in the acceleration during the
    contact as well; they are estimated beside the end states, within their own spread.
    """

    file: str
    group: str
    frequency: FloatArray
    force: ComplexArray
    motion: ComplexArray
    orders: tuple[int, ...]
    terms: tuple[Term, ...]
    local: frozenset[str] = frozenset()
    force_errors: tuple[float, float] = (0.0, 0.0)
    sampling_errors: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class OutputErrorFit:
    """Estimates, natural-log covariance and residual of a joint fit.

    `values` maps "name" (shared) or "name@file" (local) to the estimate; `covariance` is that of the natural
    logarithms in the order of `names`.
    """

    names: tuple[str, ...]
    logarithms: FloatArray
    covariance: FloatArray
    reduced_chi_square: float
    converged: bool

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


@dataclass(frozen=True)
class _Linearised:
    """Whitened residual and Jacobian of one record, the record's end states projected out."""

    residual: FloatArray
    jacobian: FloatArray
    columns: tuple[str, ...]
    unweighted: ComplexArray
    gain: ComplexArray


def spectrum(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray, ComplexArray]:
    """Return frequencies [Hz] and Fourier integral of `samples` (n,) or (n, channels) within a band."""
    frequency = np.fft.rfftfreq(len(samples), 1 / rate_hz)
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    return np.asarray(frequency[inside], dtype=np.float64), np.fft.rfft(samples, axis=0)[inside] / rate_hz


def _key(record: SpectralRecord, term: Term) -> str:
    return f"{term.name}@{record.file}" if term.name in record.local else term.name


def _linearise(record: SpectralRecord, values: Mapping[str, float], whitener: ComplexArray) -> _Linearised:
    """Return the projected residual and the derivative of the output by the logarithm of each free term."""
    n = record.force.shape[1]
    s = 2j * np.pi * record.frequency
    matrices = {name: np.zeros((n, n)) for name in STRUCTURAL}
    corner = 0.0
    for term in record.terms:
        if term.matrix == "corner":
            corner = values[_key(record, term)]
        else:
            matrices[term.matrix] += values[_key(record, term)] * np.outer(term.direction, term.direction)
    mass, damping = matrices["mass"], matrices["damping"]
    s_ = s[:, None, None]
    receptance = np.linalg.inv(s_**2 * mass + s_ * damping + matrices["stiffness"])
    coupled = np.stack(
        [s / (s + corner) if order == 2 else np.ones_like(s) for order in record.orders], axis=1
    )
    gain = (coupled * np.stack([s**order for order in record.orders], axis=1))[:, :, None] * receptance
    by_velocity, by_displacement = -mass, -(s_ * mass + damping)
    ends = np.concatenate(
        [
            gain @ by_velocity + coupled[:, :, None] * _polynomial(s, record.orders, 1),
            gain @ by_displacement + coupled[:, :, None] * _polynomial(s, record.orders, 0),
            *([_sensor_ends(s, corner, record.orders)] if corner else []),
        ],
        axis=2,
    )
    forced = (gain @ record.force[:, :, None])[:, :, 0]
    aliased = forced - coupled * (np.array(record.orders) == 2) * (record.force / np.diag(mass))
    spread = np.array([*record.force_errors, *record.sampling_errors])
    errors = np.stack([forced, s[:, None] * forced, aliased, s[:, None] * aliased], axis=2) * spread
    ends = np.concatenate([ends, errors], axis=2)
    prior = np.eye(ends.shape[2])[ends.shape[2] - len(spread) :]
    nuisance = np.concatenate([_whitened(ends, whitener), prior])
    white = np.concatenate([_whitened(record.motion - forced, whitener), np.zeros(len(spread))])
    inverse = _left_inverse(nuisance)
    states, left_over = _projected_out(nuisance, inverse, white)
    gain_v, gain_x = states[:n], states[n : 2 * n]
    total = record.force + (by_velocity @ gain_v) + by_displacement @ gain_x
    motion = (receptance @ total[:, :, None])[:, :, 0]
    derivative = (
        motion,
        s[:, None] * motion + gain_x,
        (s**2)[:, None] * motion + s[:, None] * gain_x + gain_v,
    )
    residual = record.motion - forced - ends @ states
    free = [term for term in record.terms if term.free]
    columns = [
        values[_key(record, t)]
        * (
            -(gain @ t.direction) * (derivative[t.power] @ t.direction)[:, None]
            if t.matrix in STRUCTURAL
            else -np.where(
                np.array(record.orders) == 2, (record.motion - residual) / (s + corner)[:, None], 0.0
            )
        )
        for t in free
    ]
    jacobian = np.zeros((len(white), len(columns)))
    if columns:
        jacobian[: len(white) - len(spread)] = _whitened(np.stack(columns, axis=2), whitener)
    return _Linearised(
        left_over,
        _projected_out(nuisance, inverse, jacobian)[1],
        tuple(_key(record, term) for term in free),
        residual,
        gain,
    )


def _sensor_ends(s: ComplexArray, corner: float, orders: Sequence[int]) -> ComplexArray:
    """Return what the state of each accelerometer's AC coupling at the record's ends adds: (lines, channels,
    sensors).
    """
    sensors = [channel for channel, order in enumerate(orders) if order == 2]
    out = np.zeros((len(s), len(orders), len(sensors)), dtype=np.complex128)
    for place, channel in enumerate(sensors):
        out[:, channel, place] = 1 / (s + corner)
    return out


def _left_inverse(columns: FloatArray) -> FloatArray:
    """Return (A^T A)^-1 A^T of tall A, its columns scaled; a fifth of the work of an orthogonal basis."""
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns)) + np.finfo(float).tiny
    unit = columns / size
    return np.asarray(np.linalg.pinv(unit.T @ unit, rcond=1e-13, hermitian=True) @ unit.T / size[:, None])


def _projected_out(
    columns: FloatArray, inverse: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of `values` in the columns and what is left; twice, for the digits."""
    first = inverse @ values
    left = values - columns @ first
    second = inverse @ left
    return first + second, left - columns @ second


def _polynomial(s: ComplexArray, orders: Sequence[int], state: int) -> ComplexArray:
    """Return what the end states add to the transform of x' (dx) and x'' (dv + s dx): (lines, channels,
    bodies).
    """
    n = len(orders)
    out = np.zeros((len(s), n, n), dtype=np.complex128)
    for channel, order in enumerate(orders):
        exponent = order - 1 - state
        if exponent >= 0:
            out[:, channel, channel] = s**exponent
    return out


def _whitened(values: ComplexArray, whitener: ComplexArray) -> FloatArray:
    """Return real rows of whitener @ values: (2 * lines * channels, ...)."""
    shaped = values if values.ndim == 3 else values[:, :, None]
    white = whitener @ shaped
    rows = np.concatenate([white.real, white.imag]).reshape(-1, shaped.shape[2])
    return rows if values.ndim == 3 else rows[:, 0]


def _whiteners(records: Sequence[SpectralRecord], parts: Sequence[_Linearised]) -> list[ComplexArray]:
    """Return S^-1/2 of every record; Q and R are pooled over the records of a group with equal lines."""
    groups: dict[tuple[str, int], list[int]] = {}
    for i, record in enumerate(records):
        groups.setdefault((record.group, len(record.frequency)), []).append(i)
    out: list[ComplexArray] = [np.empty(0, dtype=np.complex128)] * len(records)
    for members in groups.values():
        sensor = np.median(
            np.abs(np.stack([parts[i].unweighted for i in members])) ** 2, axis=(0, 1)
        ) / np.log(2)
        sensor = np.maximum(sensor, 1e-12 * sensor.max() + np.finfo(float).tiny)
        ambient = _ambient(records[members[0]].frequency, [parts[i] for i in members], sensor)
        for i in members:
            gain = parts[i].gain
            total = gain @ ambient @ gain.conj().swapaxes(1, 2) + np.diag(sensor)
            out[i] = np.linalg.inv(np.linalg.cholesky(total / 2))
    return out


def _ambient(frequency: FloatArray, parts: Sequence[_Linearised], sensor: FloatArray) -> ComplexArray:
    """Return the cross-spectrum Q(f) of the ambient forces: residuals brought to the joint of force, less
    their noise.

    The running mean weights lines by the inverse variance that sensor noise has there, so resonances speak.
    """
    total = np.zeros((len(frequency), len(sensor), len(sensor)), dtype=np.complex128)
    weights = np.zeros(len(frequency))
    for part in parts:
        inverse = np.linalg.inv(part.gain)
        noise = (inverse * sensor) @ inverse.conj().swapaxes(1, 2)
        force = (inverse @ part.unweighted[:, :, None])[:, :, 0]
        weight = 1 / np.einsum("nii->n", noise).real ** 2
        total += weight[:, None, None] * (force[:, :, None] * force.conj()[:, None, :] - noise)
        weights += weight
    half = max(2, round(_SMOOTHING_HZ / (frequency[1] - frequency[0])))
    mean = _running_sum(total, half) / _running_sum(weights, half).reshape(-1, 1, 1)
    level, direction = np.linalg.eigh((mean + mean.conj().swapaxes(1, 2)) / 2)
    return np.asarray((direction * np.maximum(level, 0.0)[:, None, :]) @ direction.conj().swapaxes(1, 2))


def _running_sum(values: npt.NDArray[Any], half: int) -> npt.NDArray[Any]:
    """Return sums over windows of 2 half + 1 lines, shortened at the ends."""
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    index = np.arange(len(values))
    return np.asarray(total[np.minimum(index + half + 1, len(values))] - total[np.maximum(index - half, 0)])


@dataclass
class _State:
    """Where the search stands: coefficients, linearisation and normal equations."""

    values: dict[str, float]
    parts: list[_Linearised]
    hessian: FloatArray
    gradient: FloatArray
    cost: float


def _evaluate(
    records: Sequence[SpectralRecord],
    values: dict[str, float],
    whiteners: Sequence[ComplexArray],
    names: Sequence[str],
) -> _State:
    position = {name: i for i, name in enumerate(names)}
    parts = [_linearise(r, values, w) for r, w in zip(records, whiteners, strict=True)]
    hessian, gradient, cost = np.zeros((len(names), len(names))), np.zeros(len(names)), 0.0
    for part in parts:
        index = [position[name] for name in part.columns]
        hessian[np.ix_(index, index)] += part.jacobian.T @ part.jacobian
        gradient[index] += part.jacobian.T @ part.residual
        cost += float(part.residual @ part.residual)
    return _State(values, parts, hessian, gradient, cost)


def _levenberg_marquardt(
    records: Sequence[SpectralRecord],
    state: _State,
    whiteners: Sequence[ComplexArray],
    names: Sequence[str],
    tolerance: float,
) -> tuple[_State, bool]:
    """Return the minimum for fixed weights, and whether the last step was within the tolerance."""
    damping = 1e-3
    for _ in range(_INNER_ITERATIONS):
        step = np.linalg.lstsq(
            state.hessian + damping * np.diag(np.diag(state.hessian)), state.gradient, rcond=None
        )[0]
        settled = float(np.abs(step).max(initial=0.0)) < tolerance or float(
            state.gradient @ step
        ) < _NEGLIGIBLE * max(state.cost, 1.0)
        step = np.clip(step, -_LARGEST_LOG_STEP, _LARGEST_LOG_STEP)  # one that nothing tells slows no other
        values = state.values | {
            n: state.values[n] * float(np.exp(d)) for n, d in zip(names, step, strict=True)
        }
        trial = _evaluate(records, values, whiteners, names)
        if trial.cost <= state.cost * (1 + 1e-12):
            state, damping = trial, max(damping / 10, 1e-9)
            if settled:
                return state, True
        elif settled:
            return state, True
        else:
            damping = min(damping * 10, 1e8)
    return state, False


def fit_output_error(
    records: Sequence[SpectralRecord],
    *,
    tolerance: float = 1e-4,
    progress: Callable[[int, int], None] | None = None,
) -> OutputErrorFit:
    """Fit all free terms of `records` together by Levenberg-Marquardt on the weighted spectra.

    The logarithms of the coefficients are the unknowns, so that masses, stiffnesses and dampings stay
    positive. The weights start equal over the lines and are re-estimated from the residual after every
    minimisation until both settle.

    Raises
    ------
    ValueError
        Where there is no record.
    """
    if not records:
        raise ValueError("an output-error fit needs at least one record, instead got none")
    names = tuple(dict.fromkeys(_key(r, t) for r in records for t in r.terms if t.free))
    whiteners = [_equal_weights(record) for record in records]
    state = _evaluate(records, {_key(r, t): t.value for r in records for t in r.terms}, whiteners, names)
    converged = False
    for iteration in range(_OUTER_ITERATIONS):
        if progress is not None:
            progress(iteration + 1, _OUTER_ITERATIONS)
        before = np.array([state.values[name] for name in names])
        state, inner = _levenberg_marquardt(records, state, whiteners, names, tolerance)
        change = np.log([state.values[name] for name in names] / before)
        settled = (
            float(change @ state.hessian @ change) < _SETTLED or np.abs(change).max(initial=0) < tolerance
        )
        if iteration > 1 and inner and settled:
            converged = True
            break
        whiteners = _whiteners(records, state.parts)
        state = _evaluate(records, state.values, whiteners, names)
    rows = sum(len(part.residual) for part in state.parts) - len(names)
    return OutputErrorFit(
        names,
        np.log([state.values[name] for name in names]),
        _covariance(state.hessian),
        state.cost / max(rows, 1),
        converged,
    )


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
