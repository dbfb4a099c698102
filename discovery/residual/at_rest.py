"""What a model leaves over of the tension of bolts that were watched at rest, in units of the gauge's noise.

The rows are a record's slow lines: its first half-waves (`discovery.residual.rest_records`), over the noise
that the lines above these tell (`discovery.residual.gauge_noise`). A record's own level is not among them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.residual.base import Kind, Residual
from discovery.residual.gauge_noise import deviances, gauge_noise, wander_of
from discovery.residual.rest_records import RestRecord
from rom.campaign.channels import FloatArray
from rom.effects import ModelCorrection


@dataclass(frozen=True, eq=False)
class RestResidual(Residual):
    """Tensions at rest, the readings of the model so far, and the noise beside which they were fitted.

    Attributes
    ----------
    records : tuple of RestRecord
        Training and held-out ones.
    effects : tuple of ModelCorrection
        What the gauge shows beyond a tension that stays as it is.
    """

    kind: ClassVar[Kind] = "tension at rest"
    records: tuple[RestRecord, ...]
    effects: tuple[ModelCorrection, ...] = ()
    criteria: Criteria = CRITERIA

    def with_effects(self, effects: Iterable[ModelCorrection]) -> RestResidual:
        """The same records with other readings, the noise as these leave it."""
        return replace(self, effects=tuple(effects))

    @cached_property
    def remainder(self) -> tuple[FloatArray, ...]:
        """Lines that are left over of every record [N]."""
        return tuple(
            np.asarray(record.measured - sum((record.of(e) for e in self.effects), np.zeros(1)))
            for record in self.records
        )

    @cached_property
    def noise(self) -> tuple[FloatArray, ...]:
        """Noise of every record's gauge by lines [N^2]."""
        limit = self.criteria.at_rest.outlier
        return tuple(
            gauge_noise(lines, record.slow, limit, record.floor)
            for record, lines in zip(self.records, self.remainder, strict=True)
        )

    @cached_property
    def variances(self) -> tuple[FloatArray, ...]:
        """The same with a wander as large as the slow lines of the training records ask for [N^2]."""
        shapes = self.rows([r.wander / noise for r, noise in zip(self.records, self.noise, strict=True)])
        wander = wander_of((self.residual**2)[self.training], shapes[self.training])
        return tuple(noise + wander * r.wander for r, noise in zip(self.records, self.noise, strict=True))

    def rows(self, lines: Sequence[FloatArray]) -> FloatArray:
        """Slow ones of all lines of every record, (rows,)."""
        return np.concatenate([of[: r.slow] for of, r in zip(lines, self.records, strict=True)])

    @cached_property
    def sizes(self) -> FloatArray:
        """Standard deviation of the gauge's noise in every row [N], (rows,)."""
        return np.sqrt(self.rows(self.noise))

    @cached_property
    def residual(self) -> FloatArray:
        """What is left over, over the gauge's noise, (rows,)."""
        return self.rows(self.remainder) / self.sizes

    @cached_property
    def owner(self) -> npt.NDArray[np.int64]:
        """Place of each row's record, (rows,)."""
        return np.repeat(np.arange(len(self.records)), [record.slow for record in self.records])

    @property
    def held_out(self) -> list[tuple[str, bool]]:
        """File of each record, and whether no number may be fitted to it."""
        return [(record.settings.file, record.settings.hold_out) for record in self.records]

    def costs(self, rows: FloatArray) -> dict[str, float]:
        """-2 ln L of whitened rows by record, the wander allowed for, over the least noise of each."""
        return self.by_record(rows, [np.full(len(r.measured), r.floor) for r in self.records])

    def deviances(self, unit: RestResidual) -> dict[str, float]:
        """-2 ln L of the rows by record; ``unit``: whose noise makes zero of the logarithm."""
        return self.by_record(self.residual, unit.noise)

    def by_record(self, rows: FloatArray, unit: Sequence[FloatArray]) -> dict[str, float]:
        """-2 ln L of whitened rows, (rows,), by record.

        Parameters
        ----------
        rows : ndarray, shape (rows,)
            Over the gauge's noise.
        unit : sequence of ndarray, shape (lines,)
            Noise of every record that makes zero of the logarithm [N^2].
        """
        powers, zero = (rows * self.sizes) ** 2, self.rows(unit)
        return self.sums(deviances(powers / zero, self.rows(self.variances) / zero))

    def beyond(self, rows: FloatArray) -> FloatArray:
        """Training rows: a record's own level, the only free number, is in none of them."""
        return np.asarray(rows[self.training])

    def slow_errors(self) -> Mapping[str, float | None]:
        """RMS of what is left of the slow tension [N], on hold-out and on training records."""
        square = (self.residual * self.sizes) ** 2
        means = np.array([len(record.time) for record in self.records], dtype=np.float64)[self.owner]
        of = {"hold_out": ~self.training, "training": self.training}
        return {
            kind: float(np.sqrt(np.sum((square / means)[mine]) / max(len(np.unique(self.owner[mine])), 1)))
            if mine.any()
            else None
            for kind, mine in of.items()
        }
