"""What other tests say of a fit's coefficients, and how much that counts where the model does not fit.

    sum_i a_i ln(theta_i) = b,   within a standard error

A fit weighs its lines as if the residual were noise. Where it is misfit instead, it is the same in every
record and does not average out: limits come out far too narrow, and coefficients that the records hardly tell
apart (two flexures of a coupled structure, of which the first mode knows the sum) wander to wherever the
misfit is smallest. So priors weigh nothing beside noise, and the more the larger the systematic part is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rom.criteria.identification import RULES
from rom.identification.spectral_model import Linearised, SpectralRecord


@dataclass(frozen=True)
class PriorConstraint:
    """A product of powers of coefficients, its logarithm `target` known within `error`.

    `leaning` are those of them that misfit may lead astray; `statement` says for people what is tied to what.
    """

    factors: Mapping[str, float]
    target: float
    error: float
    leaning: tuple[str, ...]
    statement: str

    def offset(self, values: Mapping[str, float]) -> float:
        """Return what is missing to the target, in standard errors."""
        found = sum(a * float(np.log(max(values[name], 1e-300))) for name, a in self.factors.items())
        return (self.target - found) / self.error


@dataclass(frozen=True)
class Misfit:
    """What a fit leaves over in records of a kind.

    `share` of the whitened residual's square is systematic: a short answer to the hit that is alike in
    neighbouring lines, which noise is not. `systematic` is the cost of what goes beyond chance. `of_motion`
    is the systematic part as a share of the motion, both weighted alike.
    """

    group: str
    share: float
    systematic: float
    of_motion: float


def misfits(records: Sequence[SpectralRecord], parts: Sequence[Linearised]) -> tuple[Misfit, ...]:
    """Return the misfit of every group: |sum_k conj(z_k) z_k+1| / sum_k |z_k|^2 over its lines z_k."""
    sums: dict[str, tuple[complex, float, float, int]] = {}
    for record, part in zip(records, parts, strict=True):
        shape = record.motion.shape
        count = record.motion.size
        lines = (part.residual[:count] + 1j * part.residual[count : 2 * count]).reshape(shape)
        product, square, motion, n = sums.get(record.group, (0j, 0.0, 0.0, 0))
        product += complex(np.sum(lines[:-1].conj() * lines[1:]))
        square += float(np.sum(np.abs(lines) ** 2))
        motion += float(np.sum(part.projected(record.motion) ** 2))
        sums[record.group] = product, square, motion, n + count
    found = []
    for group, (product, square, motion, n) in sums.items():
        share = abs(product) / max(square, 1e-300)
        beyond = max(share - max(RULES.misfit_share, RULES.misfit_chance / np.sqrt(n)), 0.0)
        of_motion = float(np.sqrt(abs(product) / max(motion, 1e-300)))
        found.append(Misfit(group, share, beyond * square, of_motion))
    return tuple(found)


def pull(
    ties: Sequence[PriorConstraint], records: Sequence[SpectralRecord], found: Sequence[Misfit]
) -> tuple[float, ...]:
    """Return every tie's weight: a share of the systematic cost of the records that its `leaning` are in.

    Parameters
    ----------
    ties : sequence of PriorConstraint
        Prior constraints on the terms.
    records : sequence of SpectralRecord
        Spectra of the records.
    found : sequence of Misfit
        Misfit of each record.

    Returns
    -------
    tuple
        A weight for each constraint.
    """
    cost = {one.group: one.systematic for one in found}
    terms: dict[str, set[str]] = {}
    for record in records:
        terms.setdefault(record.group, set()).update(term.name for term in record.terms if term.free)
    return tuple(
        RULES.aligned
        * sum(cost[group] for group, names in terms.items() if not names.isdisjoint(tie.leaning))
        for tie in ties
    )
