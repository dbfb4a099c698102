"""Where a fit to ring-downs starts: masses, springs and dampers that go with the modes of its records.

    (lambda_r^2 M + lambda_r C + K) phi_r = 0   for every mode r of every setting of the structure,

linear in what is not given, by non-negative least squares; a mode counts as much as it stands above noise.
Poles and shapes are those of the eigensystem realisation of all records of one setting together (J.-N. Juang
and R. S. Pappa, J. Guidance 8, 620, 1985): white noise, alike in all rows, leaves its subspace alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.free_scale import Scale, mass_of
from rom.identification.ring_down import RingDown

ComplexArray = npt.NDArray[np.complex128]
_BLOCK: Numerical[int] = 400  # rows of all channels that are realised together: slow modes need long ones
_ORDERS: Numerical[dict[str, int]] = {"displacement": 0, "velocity": 1, "acceleration": 2}
_LEAST_DAMPED: Numerical[float] = -0.05  # by noise a pole may grow a little
_MOST_DAMPED: Numerical[float] = 0.3  # what a high-pass leaves of noise looks like a mode damped more


@dataclass(frozen=True, eq=False)
class _Modes:
    """Poles [rad/s] and, by mode, displacements of the bodies, as large as they are over the noise."""

    bodies: tuple[str, ...]
    given: Mapping[str, float]
    poles: ComplexArray
    shapes: ComplexArray


def of_modes(
    rings: Sequence[RingDown], settings: CampaignSettings, scale: Scale, simple: Mapping[str, float]
) -> dict[str, float]:
    """Return starting values by path from the modes of the records.

    Parameters
    ----------
    rings : sequence of RingDown
        Training records.
    settings : CampaignSettings
        For the links.
    scale : Scale
        What is sought.
    simple : mapping of str to float
        Values by path, for what no mode tells.
    """
    groups: dict[tuple[object, ...], list[RingDown]] = {}
    for ring in rings:
        setting = (tuple(sorted(ring.measurement.given.items())), ring.channels, ring.kinds, ring.row_rate_hz)
        groups.setdefault(setting, []).append(ring)
    found = [_modes(group) for group in groups.values()]
    names = list(scale.free)
    blocks = [_balance(modes, settings, scale.values, names) for modes in found if modes is not None]
    if not blocks or not names:
        return dict(simple)
    matrix = np.concatenate([block for block, _ in blocks])
    size = np.linalg.norm(matrix, axis=0)
    told = size > 0
    matrix = matrix[:, told] / size[told]
    solution = optimize.nnls(matrix, np.concatenate([right for _, right in blocks]))[0] / size[told]
    values = zip(np.array(names)[told].tolist(), solution.tolist(), strict=True)
    return {**simple, **{name: value for name, value in values if value > 0}}


def _modes(rings: Sequence[RingDown]) -> _Modes | None:
    """Modes of records of one setting; None where they are too short."""
    first = rings[0]
    n = len(first.channels)
    records = [ring.measured / ring.noise.mean() for ring in rings]
    rows = min(_BLOCK // n, min(record.shape[1] for record in records) // 2)
    if rows < 4 * n:
        return None
    step, vectors, seen = _realised(records, rows, 2 * n)
    poles = np.log(step.astype(np.complex128)) * first.row_rate_hz
    ratio = -poles.real / np.maximum(np.abs(poles), 1e-300)
    kept = (poles.imag > 0) & (ratio > _LEAST_DAMPED) & (ratio < _MOST_DAMPED)
    if not kept.any():
        return None
    shapes = (seen @ vectors) * _amplitudes(records, step, seen @ vectors)
    orders = np.array([_ORDERS[kind] for kind in first.kinds])
    shapes = shapes[:, kept] / poles[kept] ** orders[:, None]
    return _Modes(first.bodies, first.measurement.given, poles[kept], np.asarray(shapes.T, dtype=complex))


def _realised(
    records: Sequence[FloatArray], rows: int, order: int
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Eigenvalues and eigenvectors of the step from row to row, and what the channels show of its state."""
    n = len(records[0])
    gram = np.zeros((rows * n, rows * n))
    for record in records:
        windows = np.lib.stride_tricks.sliding_window_view(record, rows, axis=1)
        hankel = windows.transpose(2, 0, 1).reshape(rows * n, -1)
        gram += hankel @ hankel.T
    seen = np.linalg.eigh(gram)[1][:, -order:]
    step = np.linalg.lstsq(seen[:-n], seen[n:], rcond=None)[0]
    values, vectors = np.linalg.eig(step)
    return values, vectors, seen[:n]


def _amplitudes(records: Sequence[FloatArray], step: ComplexArray, shapes: ComplexArray) -> FloatArray:
    """Root of the sum of squares over all records of each mode's coordinate."""
    total = np.zeros(len(step))
    for record in records:
        decays = step ** np.arange(record.shape[1])[:, None]
        table = (shapes.T[None] * decays[:, :, None]).transpose(2, 0, 1).reshape(record.size, len(step))
        state = np.linalg.lstsq(table, record.ravel().astype(np.complex128), rcond=None)[0]
        total += np.sum(np.abs(decays * state) ** 2, axis=0)
    return np.sqrt(total)


def _balance(
    modes: _Modes, settings: CampaignSettings, values: Mapping[str, float], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Real rows of the modes' balance of forces over omega^2, by what is sought, and right-hand side."""
    bodies, weight = modes.bodies, 1 / np.abs(modes.poles) ** 2
    columns: dict[str, ComplexArray] = {}
    for i, body in enumerate(bodies):
        inertia = np.zeros_like(modes.shapes)
        inertia[:, i] = modes.poles**2 * modes.shapes[:, i]
        columns[mass_of(body)] = inertia
    for link in settings.link:
        row = np.array([(b == link.between[0]) * 1.0 - (b == link.between[1]) for b in bodies])
        spring = (modes.shapes @ row)[:, None] * row
        columns[f"{link.name}.stiffness.k"] = spring
        columns[f"{link.name}.damping.c"] = modes.poles[:, None] * spring
    real = {}
    for path, column in columns.items():
        rows = (column * weight[:, None]).ravel()
        real[path] = np.concatenate([rows.real, rows.imag])
    held = [path for path in real if path in modes.given or path not in names]
    right = -sum(
        (real[path] * modes.given.get(path, values[path]) for path in held),
        np.zeros(2 * modes.shapes.size),
    )
    empty = np.zeros(2 * modes.shapes.size)
    block = np.stack([empty if n in held or n not in real else real[n] for n in names], axis=1)
    return block, right
