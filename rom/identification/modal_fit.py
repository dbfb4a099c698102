"""Modes of all records and sensors at once, by output error: poles, real shapes, modal masses, with limits.

    y_s = sum_i Phi_si (g_i sum_d Phi_di z_i[F_d] + a_i cos + b_i sin) + sum_d R_sd F_d

with z_i the response of mode i at 1 kg, g_i the inverse of its mass, and the state (a, b) at a record's first
sample its own, projected off at every step (variable projection; L. Kaufman, BIT 15, 49, 1975).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.modal_poles import starting_poles
from rom.identification.modal_responses import ModalRecord

_STEP: Numerical[float] = 1e-6
_ITERATIONS: Numerical[int] = 60
_SETTLED: Numerical[float] = 1e-7  # of the cost
_BLOCKS: Numerical[int] = 8  # of a record, that err as one
_MOST_DAMPED: Numerical[float] = 0.5
_LARGEST_STEP: Numerical[float] = 0.3  # of a logarithm


@dataclass(frozen=True, eq=False)
class Modes:
    """Numbers of some modes.

    Attributes
    ----------
    omega, ratio, inverse_mass : ndarray, shape (modes,)
        Circular frequencies [rad/s], damping ratios, 1 / modal masses [1/kg].
    shapes : ndarray, shape (places, modes)
        At sensors, then at drive points without one.
    at_once : ndarray, shape (sensors, drive points)
        Compliances of the modes above the band [m/N].
    """

    omega: FloatArray
    ratio: FloatArray
    inverse_mass: FloatArray
    shapes: FloatArray
    at_once: FloatArray


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Modes that suit the records best.

    Attributes
    ----------
    modes : Modes
        The numbers.
    free : Modes
        Of each number its place among the columns of the covariances; -1 where it is held.
    covariances : tuple of ndarray
        Of ln omega, ln ratio and all other free numbers: by single rows, and by blocks that err as one.
    level : float
        Mean square of what is left over the noise.
    """

    modes: Modes
    free: Modes
    covariances: tuple[FloatArray, FloatArray]
    level: float
    sensors: tuple[str, ...]
    forces: tuple[str, ...]

    @property
    def places(self) -> tuple[str, ...]:
        """Rows of the shapes."""
        return (*self.sensors, *(p for p in self.forces if p not in self.sensors))

    def error(self, slopes: dict[int, float]) -> float:
        """Standard error of a number with some slopes by free ones, by their columns; the larger of both."""
        index, slope = list(slopes), np.array(list(slopes.values()))
        if not index or -1 in index:
            return float("inf")
        variances = [slope @ c[np.ix_(index, index)] @ slope for c in self.covariances]
        return float(np.sqrt(max(*variances, 0.0)))


def fit_modes(records: Sequence[ModalRecord], count: int, band_hz: tuple[float, float]) -> ModalFit:
    """Fit modes to records.

    Parameters
    ----------
    records : sequence of ModalRecord
        Training records, their sensors alike.
    count : int
        Number of modes.
    band_hz : tuple of float
        Where modes are sought [Hz], from and to.

    Raises
    ------
    ValueError
        If the records tell fewer modes in the band.
    """
    sensors, forces = records[0].ring.channels, records[0].forces
    omega, ratio = np.transpose(starting_poles(records, count, band_hz))
    start = _start(records, omega, ratio, sensors, forces)
    free = _free(start, sensors, forces)
    modes, damping = start, 1e-3
    cost, matrix, right, _ = _normal(records, modes, free)
    for _ in range(_ITERATIONS):
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        whole, moved = matrix / np.outer(scale, scale), False
        while damping < 1e8:
            step = np.linalg.solve(whole + damping * np.eye(len(scale)), right / scale) / scale
            trial = _stepped(modes, free, step)
            found = _normal(records, trial, free)
            if found[0] < cost:
                moved = True
                break
            damping *= 5
        if not moved:
            break
        gain, modes, (cost, matrix, right, _) = cost - found[0], trial, found
        damping = max(damping / 10, 1e-12)
        if gain < _SETTLED * cost:
            break
    modes, cost, matrix, scores = _by_largest(records, modes, sensors, forces)
    free = _free(modes, sensors, forces)
    rows = sum(record.whitened.size for record in records)
    return ModalFit(modes, free, _covariances(matrix, scores, cost / rows), cost / rows, sensors, forces)


def _by_largest(
    records: Sequence[ModalRecord], modes: Modes, sensors: Sequence[str], forces: Sequence[str]
) -> tuple[Modes, float, FloatArray, FloatArray]:
    """The same modes, each shape 1 at the sensor where it is largest, and their normal equations."""
    modes = _scaled(modes, sensors, forces)
    cost, matrix, _, scores = _normal(records, modes, _free(modes, sensors, forces))
    return modes, cost, matrix, scores


def _scaled(modes: Modes, sensors: Sequence[str], forces: Sequence[str]) -> Modes:
    """Every shape 1 at the sensor where it is largest; its mass goes with the square.

    Where no drive point has a sensor shapes are 1 at the first of them, and the masses go with the shape.
    """
    n, m = len(sensors), len(modes.omega)
    shapes, inverse = modes.shapes.copy(), modes.inverse_mass.copy()
    largest = np.abs(shapes[:n]).argmax(axis=0)
    size = shapes[largest, np.arange(m)]
    if forces and not set(forces) & set(sensors):  # the sign goes into the shape: a mass is above zero
        size = np.abs(size) * np.where(inverse < 0, -1.0, 1.0)
        shapes[:n] /= size
        return replace(modes, shapes=shapes, inverse_mass=inverse * size)
    return replace(modes, shapes=shapes / size, inverse_mass=inverse * size**2)


def _free(modes: Modes, sensors: Sequence[str], forces: Sequence[str]) -> Modes:
    """Columns of the free numbers; -1 for those that fix a scale, or that no force tells."""
    m, n, done = len(modes.omega), len(sensors), 0

    def columns(held: FloatArray) -> FloatArray:
        nonlocal done
        found = np.full(held.shape, -1)
        found[~held.astype(bool)] = done + np.arange(int((~held.astype(bool)).sum()))
        done += int((~held.astype(bool)).sum())
        return found

    held = np.zeros(modes.shapes.shape)
    held[np.abs(modes.shapes[:n]).argmax(axis=0), np.arange(m)] = 1
    if forces and not set(forces) & set(sensors):
        held[n] = 1
    nothing = np.zeros(m)
    return Modes(
        columns(nothing), columns(nothing), columns(nothing if forces else np.ones(m)), columns(held),
        columns(np.zeros(modes.at_once.shape)),
    )  # fmt: skip


def _stepped(modes: Modes, free: Modes, step: FloatArray) -> Modes:
    taken = np.append(step, 0.0)  # a held number's column is the last one: no step
    limited = np.clip(taken, -_LARGEST_STEP, _LARGEST_STEP)
    return Modes(
        modes.omega * np.exp(limited[free.omega]),
        np.clip(modes.ratio * np.exp(limited[free.ratio]), 1e-6, _MOST_DAMPED),
        modes.inverse_mass + taken[free.inverse_mass],
        modes.shapes + taken[free.shapes],
        modes.at_once + taken[free.at_once],
    )


def _start(
    records: Sequence[ModalRecord], omega: FloatArray, ratio: FloatArray, sensors: Sequence[str],
    forces: Sequence[str],
) -> Modes:  # fmt: skip
    """Shapes from residues of every sensor by itself: of each mode the vector that most of them share."""
    n, m, d = len(sensors), len(omega), len(forces)
    residues, vectors = np.zeros((n, m, d)), [list[FloatArray]() for _ in range(m)]
    weights, at_once = np.full((m, d), 1e-300), np.zeros((n, d))
    for record in records:
        rows, followed, target = record.of_modes(omega, ratio), record.at_once(), record.whitened
        size = np.linalg.norm(rows, axis=3)
        found = np.zeros((n, m, d + 2))
        for s in range(n):
            table = np.concatenate([rows[s].reshape(m * (d + 2), -1), followed[s]])
            length = _lengths(table)
            solved = np.linalg.lstsq((table / length[:, None]).T, target[s], rcond=1e-12)[0] / length
            found[s] = solved[: m * (d + 2)].reshape(m, d + 2)
            at_once[s] += solved[m * (d + 2) :] / len(records)
        for i in range(m):
            vectors[i] += [found[:, i, k] * size[:, i, k].mean() for k in range(d + 2)]
            weight = size[:, i, :d].mean(axis=0) ** 2
            residues[:, i] += found[:, i, :d] * weight
            weights[i] += weight
    shapes = np.stack([np.linalg.svd(np.stack(v, axis=1))[0][:, 0] for v in vectors], axis=1)
    residues /= weights
    shown, inverse = _participations(shapes, residues, sensors, forces)
    return _scaled(Modes(omega, ratio, inverse, np.concatenate([shapes, shown]), at_once), sensors, forces)


def _lengths(rows: FloatArray) -> FloatArray:
    """Lengths of rows; 1 of one that is zero, such as of a force that a record does not have."""
    length = np.linalg.norm(rows, axis=1)
    return np.where(length > 0, length, 1.0)


def _participations(
    shapes: FloatArray, residues: FloatArray, sensors: Sequence[str], forces: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Shapes at drive points without a sensor, and inverse masses, from residues = shape shape' / mass."""
    m, extra = shapes.shape[1], [k for k, place in enumerate(forces) if place not in sensors]
    along = np.einsum("si,sid->id", shapes, residues)  # participation over mass, of unit shapes
    known = [(k, sensors.index(place)) for k, place in enumerate(forces) if place in sensors]
    inverse = np.ones(m)
    for i in range(m):
        k, s = max(known, key=lambda pair: abs(shapes[pair[1], i]), default=(0, 0))
        if known and shapes[s, i] != 0:  # at a node it is not driven: no force tells its mass
            inverse[i] = along[i, k] / shapes[s, i]
        elif extra:
            inverse[i] = along[i, extra[0]]
    return np.reshape([along[:, k] / inverse for k in extra], (len(extra), m)), inverse


def _normal(
    records: Sequence[ModalRecord], modes: Modes, free: Modes
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Cost, normal matrix and right side of a step, and scores of blocks of rows, (blocks, numbers)."""
    count = 1 + max(int(np.max(part, initial=-1)) for part in vars(free).values())
    cost, matrix, right, scores = 0.0, np.zeros((count, count)), np.zeros(count), []
    for record in records:
        left, slopes = _linearised(record, modes, free, count)
        cost += float(np.sum(left**2))
        flat = slopes.reshape(-1, count)
        matrix += flat.T @ flat
        right += flat.T @ left.ravel()
        for rows in np.array_split(np.arange(left.shape[1]), _BLOCKS):
            scores.append(np.einsum("srp,sr->p", slopes[:, rows], left[:, rows]))
    return cost, matrix, right, np.stack(scores)


def _linearised(record: ModalRecord, modes: Modes, free: Modes, count: int) -> tuple[FloatArray, FloatArray]:
    """What is left of a record, (channels, rows), and the slopes of the model, the states projected off."""
    d, n = len(record.forces), len(record.ring.channels)
    drive = _drive_rows(record, modes)
    rows = record.of_modes(modes.omega, modes.ratio)
    acting = np.einsum("di,i,sidr->sir", drive, modes.inverse_mass, rows[:, :, :d])
    phi = modes.shapes[:n]
    followed = record.at_once()
    forced = np.einsum("si,sir->sr", phi, acting) + np.einsum("sd,sdr->sr", modes.at_once, followed)
    basis = np.einsum("si,sikr->srik", phi, rows[:, :, d:]).reshape(n * rows.shape[3], -1)
    length = _lengths(basis.T)
    q, triangle = np.linalg.qr(basis / length)
    left = (record.whitened - forced).ravel()
    along = q.T @ left
    states = (np.linalg.lstsq(triangle, along, rcond=1e-12)[0] / length).reshape(-1, 2)
    weights = np.concatenate([(drive * modes.inverse_mass).T, states], axis=1)  # (modes, d + 2)
    whole = np.einsum("ik,sikr->sir", weights, rows)
    slopes = np.zeros((n, rows.shape[3], count + 1))  # the last column is of numbers that are held
    turned = modes.omega * (1 + _STEP), modes.ratio * (1 + _STEP)
    for column, pole in ((free.omega, (turned[0], modes.ratio)), (free.ratio, (modes.omega, turned[1]))):
        change = (np.einsum("ik,sikr->sir", weights, record.of_modes(*pole)) - whole) / _STEP
        slopes[:, :, column] += np.einsum("si,sir->sri", phi, change)
    slopes[:, :, free.inverse_mass] += np.einsum("si,di,sidr->sri", phi, drive, rows[:, :, :d])
    for s in range(n):
        slopes[s][:, free.shapes[s]] += whole[s].T
        slopes[s][:, free.at_once[s]] += followed[s].T
    for k, place in enumerate(_drive_places(record)):
        pushed = np.einsum("si,i,sir->sri", phi, modes.inverse_mass, rows[:, :, k])
        slopes[:, :, free.shapes[place]] += pushed
    flat = slopes[:, :, :count].reshape(-1, count)
    flat = flat - q @ (q.T @ flat)
    left = left - q @ along
    return left.reshape(n, -1), flat.reshape(n, -1, count)


def _drive_places(record: ModalRecord) -> list[int]:
    """Row of the shapes of each drive point."""
    sensors = record.ring.channels
    places = (*sensors, *(p for p in record.forces if p not in sensors))
    return [places.index(place) for place in record.forces]


def _drive_rows(record: ModalRecord, modes: Modes) -> FloatArray:
    return np.asarray(modes.shapes[_drive_places(record)])


def _covariances(matrix: FloatArray, scores: FloatArray, spread: float) -> tuple[FloatArray, FloatArray]:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    inverse = inverse / np.outer(scale, scale)
    return inverse * max(spread, 1.0), inverse @ (scores.T @ scores) @ inverse
