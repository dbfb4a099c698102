"""How far identified modes are from real ones: the modal phase collinearity of residues that may be complex.

    MPC = |psi^T psi|^2 / (psi^H psi)^2

(R. S. Pappa, K. B. Elliott, A. Schenk, J. Guid. Control Dyn. 16, 887, 1993, without their removal of the
mean): 1 where all sensors move in phase or against it, 0 for a wave that travels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rom.identification.modal_fit import ModalFit
from rom.identification.modal_responses import ComplexArray, ModalRecord


def phase_collinearities(records: Sequence[ModalRecord], fit: ModalFit) -> list[float]:
    """Return the modal phase collinearity of every mode, its shape free to be complex.

    Parameters
    ----------
    records : sequence of ModalRecord
        Training records.
    fit : ModalFit
        Modes that were fitted to them.
    """
    vectors: list[list[ComplexArray]] = [[] for _ in fit.modes.omega]
    for record in records:
        for i, found in enumerate(_complex_shapes(record, fit)):
            vectors[i] += found
    return [_collinearity(_mean(of_mode)) for of_mode in vectors]


def _complex_shapes(record: ModalRecord, fit: ModalFit) -> list[list[ComplexArray]]:
    """Residues of each mode by force and start, (sensors,), times the size of their response."""
    n, m = len(record.ring.channels), len(fit.modes.omega)
    rows = record.of_modes(fit.modes.omega, fit.modes.ratio, quadrature=True)
    size = np.linalg.norm(rows, axis=3)
    count, at_once, target = rows.shape[2], record.at_once(), record.whitened
    found = np.zeros((n, m, count))
    for s in range(n):
        table = np.concatenate([rows[s].reshape(m * count, -1), at_once[s]])
        length = np.maximum(np.linalg.norm(table, axis=1), 1e-300)
        solved = np.linalg.lstsq((table / length[:, None]).T, target[s], rcond=1e-9)[0] / length
        found[s] = solved[: m * count].reshape(m, count)
    turns = [1j] * (count // 2 - 1) + [-1j]  # a decay is given as cosine and sine: real and imaginary part
    return [
        [
            (found[:, i, k] + turn * found[:, i, k + 1]) * size[:, i, k].mean()
            for k, turn in zip(range(0, count, 2), turns, strict=True)
        ]
        for i in range(m)
    ]


def _mean(vectors: Sequence[ComplexArray]) -> ComplexArray:
    """The vector that most of some share, each of a phase and size of its own."""
    return np.asarray(np.linalg.svd(np.stack(vectors, axis=1))[0][:, 0])


def _collinearity(shape: ComplexArray) -> float:
    return float(np.abs(shape @ shape) ** 2 / np.sum(np.abs(shape) ** 2) ** 2)
