"""Where a fit to ring-downs starts: masses, springs and dampers that go with the modes of its records.

    phi_s^T (lambda_r^2 M + lambda_r C + K) phi_r / (|lambda_r|^2 + |lambda_s|^2) = 0

for all modes r, s of every setting of the structure,
linear in what is not given, by non-negative least squares; a mode counts as much as it stands above noise.
Poles and shapes are those of the eigensystem realisation of all records of one setting together (J.-N. Juang
and R. S. Pappa, J. Guidance 8, 620, 1985): white noise, alike in all rows, leaves its subspace alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
# a period of the slowest strongest line, at least: faster modes are to be told too
_SAMPLES: Numerical[float] = 96.0
_WINDOWS: Numerical[int] = 4000  # that are looked at, more or less
_STEPS: Numerical[int] = 1000
_LEAST_DAMPED: Numerical[float] = -0.05  # by noise a pole may grow a little
_MOST_DAMPED: Numerical[float] = 0.3  # what a high-pass leaves of noise looks like a mode damped more


@dataclass(frozen=True, eq=False)
class _Modes:
    """Poles [rad/s], and by mode the bodies' displacements.

    Times omega to the `order` of what was measured, they are as large as the mode stands above the noise.
    """

    bodies: tuple[str, ...]
    given: Mapping[str, float]
    poles: ComplexArray
    shapes: ComplexArray
    order: float

    def directions(self) -> tuple[FloatArray, FloatArray]:
        """Directions that forces are balanced in, (bodies, bodies), and weights, (modes, bodies).

        Those of the modes, where what noise adds to a shape from another mode does not outweigh its own
        spring, as it does at the bodies where links are stiff; then those that no mode has.
        """
        largest = np.take_along_axis(self.shapes, np.abs(self.shapes).argmax(axis=1)[:, None], axis=1)
        shapes = (self.shapes / largest).real.T
        others = np.linalg.svd(shapes)[0][:, shapes.shape[1] :]
        own = np.abs(self.poles) ** 2
        of_direction = np.concatenate([own, np.zeros(others.shape[1])])
        weight = np.sqrt(own)[:, None] ** self.order / (own[:, None] + of_direction)
        return np.concatenate([shapes, others], axis=1), weight


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
        seen = ring.measurement
        setting = (tuple(sorted(seen.given.items())), ring.channels, ring.kinds, seen.rate_hz)
        groups.setdefault(setting, []).append(ring)
    found = [_modes(group) for group in groups.values()]
    names = list(scale.free)
    blocks = [_balance(modes, settings, scale.values, names) for modes in found if modes is not None]
    if not blocks or not names:
        return dict(simple)
    matrix = np.concatenate([block for block, _ in blocks])
    size = np.linalg.norm(matrix, axis=0)
    told = size > 0
    if not told.any():
        return dict(simple)
    matrix = matrix[:, told] / size[told]
    solution = (
        optimize.nnls(matrix, np.concatenate([right for _, right in blocks]), maxiter=_STEPS)[0] / size[told]
    )
    values = zip(np.array(names)[told].tolist(), solution.tolist(), strict=True)
    return {**simple, **{name: value for name, value in values if value > 0}}


def _modes(rings: Sequence[RingDown]) -> _Modes | None:
    """Modes of records of one setting; None where they are too short."""
    first = rings[0]
    n = len(first.channels)
    slowest = min(ring.measurement.strongest_hz or np.inf for ring in rings)
    rate = first.measurement.rate_hz
    rate /= max(1, int(rate / (_SAMPLES * slowest)))
    rings = [_at_rate(ring, rate) for ring in rings]
    noise = np.sqrt(np.mean([ring.noise**2 for ring in rings], axis=0))
    records = [ring.measured / noise[:, None] for ring in rings]
    rows = min(_BLOCK // n, min(record.shape[1] for record in records) // 2)
    if rows < 4 * n:
        return None
    step, shapes = _realised(records, rows, 2 * n)
    poles = np.asarray(rate * np.log(step), dtype=np.complex128)
    ratio = -poles.real / np.maximum(np.abs(poles), np.finfo(float).tiny)
    kept = (poles.imag > 0) & (ratio > _LEAST_DAMPED) & (ratio < _MOST_DAMPED)
    if not kept.any():
        return None
    step, shapes, poles = step[kept], shapes[:, kept], poles[kept]
    shapes = shapes * _amplitudes(records, step / np.maximum(np.abs(step), 1.0), shapes)
    orders = np.array([_ORDERS[kind] for kind in first.kinds])
    displacements: ComplexArray = shapes * noise[:, None] / noise.mean() / poles ** orders[:, None]
    return _Modes(first.bodies, first.measurement.given, poles, displacements.T, float(orders.mean()))


def _at_rate(ring: RingDown, rate_hz: float) -> RingDown:
    """A record with rows at another rate [Hz]."""
    motion, noise = ring.measurement.motion, ring.noise * np.sqrt(rate_hz / ring.row_rate_hz)
    other = replace(ring, noise=noise, row_rate_hz=rate_hz)
    rows = [
        other.compared(kind, motion[c].samples) for kind, c in zip(ring.kinds, ring.channels, strict=True)
    ]
    return replace(other, measured=np.stack(rows))


def _realised(records: Sequence[FloatArray], rows: int, order: int) -> tuple[ComplexArray, ComplexArray]:
    """Eigenvalues of the step from row to row, none of them zero, and what the channels show of each."""
    n = len(records[0])
    gram = np.zeros((rows * n, rows * n))
    stride = 1 + sum(record.shape[1] for record in records) // _WINDOWS
    for record in records:
        windows = np.lib.stride_tricks.sliding_window_view(record, rows, axis=1)[:, ::stride]
        hankel = windows.transpose(2, 0, 1).reshape(rows * n, -1)
        gram += hankel @ hankel.T
    seen = np.linalg.eigh(gram)[1][:, -order:]
    step = np.linalg.lstsq(seen[:-n], seen[n:], rcond=None)[0]
    values, vectors = np.linalg.eig(step.astype(np.complex128))
    alive = values != 0
    return values[alive], seen[:n] @ vectors[:, alive]


def _amplitudes(records: Sequence[FloatArray], step: ComplexArray, shapes: ComplexArray) -> FloatArray:
    """Root of the sum of squares over all records of each mode's coordinate."""
    total = np.zeros(len(step))
    for record in records:
        decays = step ** np.arange(record.shape[1])[:, None]
        modes = np.einsum("cm,tm->ctm", shapes, decays).reshape(record.size, len(step))
        table = np.concatenate([modes.real, modes.imag], axis=1)
        state = np.linalg.lstsq(table, record.ravel(), rcond=None)[0].reshape(2, -1)
        total += np.sum(np.abs(decays) ** 2, axis=0) * np.sum(state**2, axis=0)
    return np.asarray(np.sqrt(total))


def _balance(
    modes: _Modes, settings: CampaignSettings, values: Mapping[str, float], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Real rows of the modes' balance of forces over omega^2, by what is sought, and right-hand side."""
    bodies, (directions, weight) = modes.bodies, modes.directions()
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
        rows = (column @ directions * weight).ravel()
        real[path] = np.concatenate([rows.real, rows.imag])
    empty = np.zeros(2 * weight.size)
    held = [path for path in real if path in modes.given or path not in names]
    right = -sum((real[path] * modes.given.get(path, values[path]) for path in held), empty)
    block = np.stack([empty if n in held or n not in real else real[n] for n in names], axis=1)
    return block, right
