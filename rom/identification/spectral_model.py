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

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
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
_TINY = np.finfo(float).tiny
_SAME: Numerical[float] = 1e-13  # of the largest variance: columns alike


@dataclass(frozen=True)
class Term:
    """One coefficient: a stiffness, damping or mass along a direction in body space, or the corner of the
    sensors.

    K, C or M gains value * direction direction^T. Terms of equal `name` share one value over all records. The
    one term "corner" w [rad/s] stands for the AC coupling s / (s + w) of all accelerometers. A `given` one is
    known, in its record alone: it shares its name with the others, not its value.
    """

    name: str
    matrix: str  # "stiffness" | "damping" | "mass" | "corner"
    direction: FloatArray
    value: float
    free: bool = True
    given: bool = False

    @property
    def power(self) -> int:
        """Return the power of s that the term carries in Z(s); -1 for the corner."""
        return STRUCTURAL.index(self.matrix) if self.matrix in STRUCTURAL else -1


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

    @cached_property
    def outer(self) -> tuple[FloatArray, ...]:
        """``direction direction^T`` of every term, (bodies, bodies) each."""
        return tuple(np.outer(term.direction, term.direction) for term in self.terms)


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

    def beside(self, change: FloatArray) -> Linearised:
        """Return the same with one more thing estimated beside the end states, of unit variance.

        ``change`` (rows,) is what one standard error of it changes of the output, whitened and projected.
        """
        along = np.append(change, 1.0)
        square = float(along @ along)

        def beyond(rows: FloatArray) -> FloatArray:
            padded = np.concatenate([rows, np.zeros((1, *rows.shape[1:]))])
            return np.asarray(padded - np.multiply.outer(along, along @ padded / square))

        count = self.ends.shape[1]
        ends, inverse = np.zeros((len(along), count + 1)), np.zeros((count + 1, count + 1))
        ends[:-1, :-1], ends[:, -1] = self.ends, along
        inverse[:-1, :-1], inverse[-1, -1] = self.inverse, 1 / square
        return replace(
            self,
            residual=beyond(self.residual),
            jacobian=beyond(self.jacobian),
            ends=ends,
            inverse=inverse,
        )

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
    return f"{term.name}@{record.file}" if term.given or term.name in record.local else term.name


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
    whitener = np.require(whitener, requirements=("C", "W"))  # kernels are compiled for one kind of array
    gain, forced, ends, columns, errors = _nuisance(record, system, whitener)
    white = np.concatenate([_whitened(record.motion - forced, whitener), np.zeros(errors)])
    inverse = _inverse_gram(columns)
    states, left_over = _projected_out(columns, inverse, white)
    residual = record.motion - forced - ends @ states
    jacobian = np.zeros((len(white), sum(term.free for term in record.terms)))
    _derivatives(record, values, system, gain, states, residual, whitener, jacobian)
    return Linearised(
        left_over,
        _projected_out(columns, inverse, jacobian)[1],
        tuple(key(record, term) for term in record.terms if term.free),
        residual,
        gain,
        columns,
        inverse,
        whitener,
    )


def transfer(record: SpectralRecord, values: Mapping[str, float]) -> ComplexArray:
    """Return the matrices from forces on the bodies to the channels, (lines, channels, bodies)."""
    system = _system(record, values)
    shown = [
        system.s**order / (1 + (system.corner / system.s if order == 2 else 0)) for order in record.orders
    ]
    return np.asarray(np.stack(shown, axis=1)[:, :, None] * system.receptance)


@dataclass(frozen=True)
class _System:
    """Matrices and receptance of one record at given coefficients."""

    s: ComplexArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner: float
    receptance: ComplexArray


def _system(record: SpectralRecord, values: Mapping[str, float]) -> _System:
    n = record.force.shape[1]
    matrices = np.zeros((len(STRUCTURAL), n, n))
    corner = 0.0
    for term, along in zip(record.terms, record.outer, strict=True):
        value = values[key(record, term)]
        if term.power < 0:
            corner = value
        else:
            matrices[term.power] += value * along
    stiffness, damping, mass = matrices
    s = 2j * np.pi * record.frequency
    return _System(s, mass, damping, stiffness, corner, _receptance(s, mass, damping, stiffness))


def _receptance(
    s: ComplexArray, mass: FloatArray, damping: FloatArray, stiffness: FloatArray
) -> ComplexArray:
    """Inverse dynamic stiffness at every line, (lines, bodies, bodies)."""
    from rom.kernels.spectral_outputs import receptances

    if len(mass) > 2:
        s_ = s[:, None, None]
        return inverse(s_ * (s_ * mass + damping) + stiffness)
    out = np.empty((len(s), *mass.shape), dtype=np.complex128)
    if not receptances(s, mass, damping, stiffness, out):
        raise np.linalg.LinAlgError("Singular matrix")
    return out


def _nuisance(
    record: SpectralRecord, system: _System, whitener: ComplexArray
) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray, int]:
    """Gain, forced output, and the columns of the end states and, last, of the force's errors.

    Those as they are and whitened, a row below for each of the errors' unit variance; and how many they are.
    """
    from rom.kernels.spectral_outputs import outputs

    lines, n = record.force.shape
    orders = np.array(record.orders, dtype=np.int64)
    given = record.force_errors
    given = np.zeros((lines, n, 0), dtype=np.complex128) if given is None else given
    errors = given.shape[2] + 2
    count = 2 * n + int(np.sum(orders == 2)) + errors
    gain, forced = np.empty((lines, n, n), dtype=np.complex128), np.empty((lines, n), dtype=np.complex128)
    ends = np.empty((lines, n, count), dtype=np.complex128)
    columns = np.zeros((2 * lines * n + errors, count))
    columns[2 * lines * n :, count - errors :] = np.eye(errors)
    outputs(
        system.s, system.mass, system.damping, _of_samples(system, record), system.corner, orders,
        system.receptance, record.force, given, np.array(record.sampling_errors), whitener,
        gain, forced, ends, columns,
    )  # fmt: skip
    return gain, forced, ends, columns, errors


def _derivatives(
    record: SpectralRecord,
    values: Mapping[str, float],
    system: _System,
    gain: ComplexArray,
    states: FloatArray,
    residual: ComplexArray,
    whitener: ComplexArray,
    jacobian: FloatArray,
) -> None:
    """Fill the derivative of the whitened output by each free term in its `step_unit`: (rows, terms)."""
    from rom.kernels.spectral_outputs import derivatives

    free = [term for term in record.terms if term.free]
    if not free:
        return
    lines, n = record.force.shape
    derivatives(
        system.s, system.mass, system.damping, system.corner, np.array(record.orders, dtype=np.int64),
        system.receptance, gain, record.force, record.motion - residual, states,
        np.array([t.direction for t in free]),
        np.array([t.power for t in free]),
        np.array([step_unit(t.name, values[key(record, t)]) for t in free]),
        whitener, np.empty((2, n), dtype=np.complex128), np.empty((lines, n, len(free)), dtype=np.complex128),
        jacobian,
    )  # fmt: skip


def _inverse_gram(columns: FloatArray) -> FloatArray:
    """Return (A^T A)^-1 of tall A, its columns scaled; a fifth of the work of an orthogonal basis."""
    gram = columns.T @ columns
    size = np.sqrt(np.diag(gram)) + _TINY
    gram /= np.multiply.outer(size, size)
    if not np.isfinite(gram).all():
        return np.full_like(gram, np.nan)
    values, vectors = np.linalg.eigh(gram)
    kept = vectors[:, values > _SAME * values[-1]] / size[:, None]
    return np.asarray((kept / values[values > _SAME * values[-1]]) @ kept.T)


def _projected_out(
    columns: FloatArray, inverse: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of `values` in the columns and what is left; twice, for the digits."""
    first = inverse @ (columns.T @ values)
    left = values - columns @ first
    second = inverse @ (columns.T @ left)
    return first + second, left - columns @ second


def _of_samples(system: _System, record: SpectralRecord) -> FloatArray:
    """By how much sums over samples differ from integrals for each gain in velocity, and in displacement.

    ``a + s b``: (velocity and displacement, a and b, channels, bodies).
    """
    n, h = len(record.orders), record.step_s
    by_damping, by_stiffness = -np.linalg.solve(system.mass, np.stack([system.damping, system.stiffness]))
    # displacement and its first three derivatives, of a gain in velocity and of one in displacement
    gained = np.zeros((2, 4, n, n))
    gained[0, 1] = gained[1, 0] = np.eye(n)
    gained[0, 2], gained[0, 3] = by_damping, by_damping @ by_damping + by_stiffness
    gained[1, 2], gained[1, 3] = by_stiffness, by_damping @ by_stiffness
    orders, channels = np.array(record.orders), np.arange(n)
    shown, after = gained[:, orders, channels], gained[:, orders + 1, channels]
    return np.ascontiguousarray(
        np.stack([shown * (h / 2) - after * (h**2 / 12), shown * (h**2 / 12)], axis=1)
    )


def _whitened(values: ComplexArray, whitener: ComplexArray) -> FloatArray:
    """Return real rows of whitener @ values: (2 * lines * channels, ...)."""
    shaped = values if values.ndim == 3 else values[:, :, None]
    white = product(whitener, shaped)
    rows = np.concatenate([white.real, white.imag]).reshape(-1, shaped.shape[2])
    return rows if values.ndim == 3 else rows[:, 0]
