"""A lumped structure's answer to measured forces as spectra, linearised in its coefficients.

For a record of length D the Fourier integral of M x'' + C x' + K x = F over [0, D] gives, with no leakage
left out,

    X = Z(s)^-1 (F - M (dv + s dx) - C dx),   Z = s^2 M + s C + K,   s = 2 pi i f,

where dx and dv are what displacement and velocity gain between the record's ends. They enter linearly, are
eliminated for each record, and carry a free decay's initial state. Of samples h apart the sum stands for the
integral: of motion y' = A y that gains dy between the ends it is (s - A)^-1 + h / 2 + h^2 (s - A) / 12 times
-dy in place of (s - A)^-1 times -dy (Euler and Maclaurin), which shows where sensors are quiet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rom.criteria.number import Numerical
from rom.identification.small_matrices import by_one, inverse, product

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complexfloating[Any, Any]]

DERIVATIVE_ORDER = {"displacement": 0, "velocity": 1, "acceleration": 2}
STRUCTURAL = ("stiffness", "damping", "mass")
CORNER = "sensor.corner"
_CORNER_STEP: Numerical[float] = 0.5


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
    `force_errors` (lines, bodies, shapes) are spectra that the hammer's noise adds to the force, each times a
    number of unit variance; None where there are none. `sampling_errors` are the standard errors of the
    force's relative gain and of its delay [s] that a pulse of few samples leaves, in the acceleration during
    the contact as well. Both are estimated beside the end states, within their own spread. `samples` are the
    first sample of the record that the spectra cover, and the one after the last, `step_s` apart.
    """

    file: str
    group: str
    frequency: FloatArray
    force: ComplexArray
    motion: ComplexArray
    orders: tuple[int, ...]
    terms: tuple[Term, ...]
    local: frozenset[str] = frozenset()
    force_errors: ComplexArray | None = None
    sampling_errors: tuple[float, float] = (0.0, 0.0)
    samples: tuple[int, int] = (0, 0)
    step_s: float = 0.0


@dataclass(frozen=True)
class Linearised:
    """Whitened residual and Jacobian of one record, the record's end states projected out."""

    residual: FloatArray
    jacobian: FloatArray
    columns: tuple[str, ...]
    unweighted: ComplexArray
    gain: ComplexArray
    ends: FloatArray = field(repr=False)
    inverse: FloatArray = field(repr=False)
    whitener: ComplexArray = field(repr=False)

    def thin(self) -> Linearised:
        """Return the same without what only a fit of this record alone needs, for many are kept."""
        none = np.zeros((0, 0))
        return replace(self, jacobian=none, columns=(), unweighted=none.astype(np.complex128))

    def projected(self, change: ComplexArray) -> FloatArray:
        """Return a change of the output (lines, channels) whitened, the end states projected out."""
        white = _whitened(change, self.whitener)
        rows = np.concatenate([white, np.zeros(len(self.ends) - len(white))])
        return _projected_out(self.ends, self.inverse, rows)[1]

    def projected_forces(self, direction: FloatArray, lines: ComplexArray) -> FloatArray:
        """Whitened output of forces in one direction, the end states projected out.

        Parameters
        ----------
        direction : ndarray, shape (bodies,)
            What such a force does to the bodies.
        lines : ndarray, shape (lines, forces)
            Spectra of the forces [N s].

        Returns
        -------
        ndarray, shape (rows, forces)
        """
        along = product(self.whitener, by_one(self.gain, direction[:, None])) * lines[:, None, :]
        white = np.zeros((len(self.ends), lines.shape[1]))
        half = along.shape[0] * along.shape[1]
        white[:half] = along.real.reshape(half, -1)
        white[half : 2 * half] = along.imag.reshape(half, -1)
        return _projected_out(self.ends, self.inverse, white)[1]


def spectrum(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> tuple[FloatArray, ComplexArray]:
    """Return frequencies [Hz] and Fourier integral of `samples` (n,) or (n, channels) within a band.

    Parameters
    ----------
    samples : ndarray, shape (n,) or (n, channels)
        Samples.
    rate_hz : float
        Sampling rate [Hz].
    band_hz : tuple of float
        From and to [Hz].

    Returns
    -------
    tuple
        Frequencies [Hz], shape (lines,), and the integral, shape (lines,) or (lines, channels).
    """
    frequency = np.fft.rfftfreq(len(samples), 1 / rate_hz)
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    return np.asarray(frequency[inside], dtype=np.float64), np.fft.rfft(samples, axis=0)[inside] / rate_hz


def key(record: SpectralRecord, term: Term) -> str:
    """Return the name under which a term's value is kept: shared, or of this record alone."""
    return f"{term.name}@{record.file}" if term.name in record.local else term.name


def step_unit(name: str, value: float) -> float:
    """Return in what a coefficient's steps and derivatives are counted: its value; 0.5 rad/s for a corner.

    A corner may be zero, and a share of nothing is nothing: it could never grow again.
    """
    return _CORNER_STEP if name.startswith(CORNER) else value


@np.errstate(over="ignore", invalid="ignore")  # a step of a fit too far has no number for a cost
def linearise(record: SpectralRecord, values: Mapping[str, float], whitener: ComplexArray) -> Linearised:
    """Return the projected residual and the derivative of the output by each free term in its `step_unit`.

    Parameters
    ----------
    record : SpectralRecord
        Spectra and terms of a record.
    values : mapping of str to float
        Values by name.
    whitener : ndarray, shape (lines, channels, channels)
        S^-1/2 of the noise at every line.

    Returns
    -------
    Linearised
        Residual and derivatives.
    """
    system = _system(record, values)
    forced = product(system.gain, record.force[:, :, None])[:, :, 0]
    ends, errors = _nuisance(record, system, forced)
    prior = np.eye(ends.shape[2])[ends.shape[2] - errors :]
    columns = np.concatenate([_whitened(ends, whitener), prior])
    white = np.concatenate([_whitened(record.motion - forced, whitener), np.zeros(errors)])
    inverse = _inverse_gram(columns)
    states, left_over = _projected_out(columns, inverse, white)
    residual = record.motion - forced - ends @ states
    free = [term for term in record.terms if term.free]
    jacobian = np.zeros((len(white), len(free)))
    if free:
        derivatives = _derivatives(record, values, system, states, residual)
        jacobian[: len(white) - errors] = _whitened(derivatives, whitener)
    return Linearised(
        left_over,
        _projected_out(columns, inverse, jacobian)[1],
        tuple(key(record, term) for term in free),
        residual,
        system.gain,
        columns,
        inverse,
        whitener,
    )


def transfer(record: SpectralRecord, values: Mapping[str, float]) -> ComplexArray:
    """Return the matrices from forces on the bodies to the channels, (lines, channels, bodies)."""
    return _system(record, values).gain


@dataclass(frozen=True)
class _System:
    """Matrices and transfer functions of one record at given coefficients."""

    s: ComplexArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner: float
    receptance: ComplexArray
    coupled: ComplexArray
    gain: ComplexArray


def _system(record: SpectralRecord, values: Mapping[str, float]) -> _System:
    n = record.force.shape[1]
    s = 2j * np.pi * record.frequency
    matrices = {name: np.zeros((n, n)) for name in STRUCTURAL}
    corner = 0.0
    for term in record.terms:
        if term.matrix == "corner":
            corner = values[key(record, term)]
        else:
            matrices[term.matrix] += values[key(record, term)] * np.outer(term.direction, term.direction)
    s_ = s[:, None, None]
    receptance = inverse(s_**2 * matrices["mass"] + s_ * matrices["damping"] + matrices["stiffness"])
    coupled = np.stack(
        [s / (s + corner) if order == 2 else np.ones_like(s) for order in record.orders], axis=1
    )
    gain = (coupled * np.stack([s**order for order in record.orders], axis=1))[:, :, None] * receptance
    mass, damping, stiffness = (matrices[name] for name in ("mass", "damping", "stiffness"))
    return _System(s, mass, damping, stiffness, corner, receptance, coupled, gain)


def _nuisance(record: SpectralRecord, system: _System, forced: ComplexArray) -> tuple[ComplexArray, int]:
    """Return columns of the end states and, last, of the force's errors, and how many the latter are."""
    s, gain, coupled = system.s, system.gain, system.coupled
    accelerations = np.array(record.orders) == 2
    aliased = forced - coupled * accelerations * (record.force / np.diag(system.mass))
    errors = np.stack([aliased, s[:, None] * aliased], axis=2) * np.array(record.sampling_errors)
    if record.force_errors is not None:
        errors = np.concatenate([product(gain, record.force_errors), errors], axis=2)
    of_velocity, of_displacement = _of_samples(system, record)
    columns = [
        by_one(gain, -system.mass) + coupled[:, :, None] * (_polynomial(s, record.orders, 1) - of_velocity),
        -s[:, None, None] * by_one(gain, system.mass)
        - by_one(gain, system.damping)
        + coupled[:, :, None] * (_polynomial(s, record.orders, 0) - of_displacement),
        *([_sensor_ends(s, system.corner, record.orders)] if any(accelerations) else []),
        errors,
    ]
    return np.concatenate(columns, axis=2), errors.shape[2]


def _derivatives(
    record: SpectralRecord,
    values: Mapping[str, float],
    system: _System,
    states: FloatArray,
    residual: ComplexArray,
) -> ComplexArray:
    """Return the derivative of the output by each free term in its `step_unit`: (lines, channels, terms)."""
    n, s = record.force.shape[1], system.s[:, None]
    gain_v, gain_x = states[:n], states[n : 2 * n]
    total = record.force - gain_v @ system.mass - (s * (gain_x @ system.mass) + gain_x @ system.damping)
    motion = product(system.receptance, total[:, :, None])[:, :, 0]
    powers = (motion, s * motion + gain_x, s**2 * motion + s * gain_x + gain_v)
    accelerations = np.array(record.orders) == 2
    columns = [
        -by_one(system.gain, t.direction[:, None])[:, :, 0] * (powers[t.power] @ t.direction)[:, None]
        if t.matrix in STRUCTURAL
        else -np.where(accelerations, (record.motion - residual) / (s + system.corner), 0.0)
        for t in record.terms
        if t.free
    ]
    weights = [step_unit(t.name, values[key(record, t)]) for t in record.terms if t.free]
    return np.asarray(np.stack(columns, axis=2) * weights)


def _sensor_ends(s: ComplexArray, corner: float, orders: Sequence[int]) -> ComplexArray:
    """Return what the state of each accelerometer's AC coupling at the record's ends adds: (lines, channels,
    sensors).
    """
    sensors = [channel for channel, order in enumerate(orders) if order == 2]
    out = np.zeros((len(s), len(orders), len(sensors)), dtype=np.complex128)
    for place, channel in enumerate(sensors):
        out[:, channel, place] = 1 / (s + corner)
    return out


def _inverse_gram(columns: FloatArray) -> FloatArray:
    """Return (A^T A)^-1 of tall A, its columns scaled; a fifth of the work of an orthogonal basis."""
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns)) + np.finfo(float).tiny
    gram = (columns.T @ columns) / np.multiply.outer(size, size)
    if not np.isfinite(gram).all():
        return np.full_like(gram, np.nan)
    return np.asarray(np.linalg.pinv(gram, rcond=1e-13, hermitian=True) / np.multiply.outer(size, size))


def _projected_out(
    columns: FloatArray, inverse: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of `values` in the columns and what is left; twice, for the digits."""
    first = inverse @ (columns.T @ values)
    left = values - columns @ first
    second = inverse @ (columns.T @ left)
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


def _of_samples(system: _System, record: SpectralRecord) -> tuple[ComplexArray, ComplexArray]:
    """Return by how much sums over samples differ from integrals for each gain in velocity, and in
    displacement: (lines, channels, bodies).
    """
    n, h, s = len(record.orders), record.step_s, system.s[:, None, None]
    none, one = np.zeros((n, n)), np.eye(n)
    by_damping = -np.linalg.solve(system.mass, system.damping)
    by_stiffness = -np.linalg.solve(system.mass, system.stiffness)
    # displacement and its first three derivatives, of a gain in velocity and of one in displacement
    of_velocity = np.stack([none, one, by_damping, by_damping @ by_damping + by_stiffness])
    of_displacement = np.stack([one, none, by_stiffness, by_damping @ by_stiffness])
    orders, channels = np.array(record.orders), np.arange(n)
    first, second = (
        gained[orders, channels] * (h / 2 + s * h**2 / 12) - gained[orders + 1, channels] * h**2 / 12
        for gained in (of_velocity, of_displacement)
    )
    return first, second


def _whitened(values: ComplexArray, whitener: ComplexArray) -> FloatArray:
    """Return real rows of whitener @ values: (2 * lines * channels, ...)."""
    shaped = values if values.ndim == 3 else values[:, :, None]
    white = product(whitener, shaped)
    rows = np.concatenate([white.real, white.imag]).reshape(-1, shaped.shape[2])
    return rows if values.ndim == 3 else rows[:, 0]
