"""What every residual can tell, whatever kind of record it is of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from discovery.criteria.criteria import Criteria
from rom.campaign.channels import FloatArray

Kind = Literal["output error", "force balance", "simulation", "tension", "tension at rest"]


class Residual(ABC):
    """What a model leaves over of a campaign's records, in units of their noise.

        r = (measured - modelled) / sigma,   mean(r^2) = 1 where nothing is missing

    Impact tests (`discovery.residual.output_error`): lines of the motion. Driven bodies and cycled links
    (`discovery.residual.force_balance`): forces left unbalanced. Ring-downs, and driven bodies without
    measured displacements (`discovery.residual.simulation`): samples of the motion. Bolts at rest
    (`discovery.residual.at_rest`): slow lines of the tension. One closed loop runs over all of them. What a
    law leaves over of the tension after hits is beside it (`discovery.residual.tension`).
    """

    kind: ClassVar[Kind]
    """Which explainers take it (`discovery.explain.registry`)."""

    if TYPE_CHECKING:  # at run time a property here would be the default of a dataclass's field

        @property
        @abstractmethod
        def residual(self) -> FloatArray:
            """Whitened rows, (rows,)."""

        @property
        @abstractmethod
        def owner(self) -> npt.NDArray[np.int64]:
            """Place of each row's record in `held_out`, (rows,)."""

    @property
    @abstractmethod
    def held_out(self) -> Sequence[tuple[str, bool]]:
        """File of each record, and whether no number may be fitted to it."""

    @cached_property
    def training(self) -> npt.NDArray[np.bool_]:
        """Whether a row may be fitted to, (rows,)."""
        return np.asarray(~np.array([held for _, held in self.held_out], dtype=np.bool_)[self.owner])

    @property
    def stated(self) -> Residual:
        """That of which verdict and numbers are."""
        return self

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of the training rows; infinite where it is known."""
        return np.inf

    @property
    def record_count(self) -> int:
        """Records that can be simulated or balanced with the model."""
        return len(self.held_out)

    @cached_property
    def samples(self) -> Mapping[str, int]:
        """Rows of each record, by file."""
        counts = np.bincount(self.owner, minlength=len(self.held_out))
        return {file: int(n) for (file, _), n in zip(self.held_out, counts, strict=True)}

    @property
    def hold_out(self) -> frozenset[str]:
        """Files that no number is fitted to."""
        return frozenset(file for file, held in self.held_out if held)

    def costs(self, rows: FloatArray) -> dict[str, float]:
        """Squares of whitened rows, (rows,), summed by record."""
        return self.sums(rows**2)

    def sums(self, of_rows: FloatArray) -> dict[str, float]:
        """What belongs to rows, (rows,), summed by record."""
        sums = np.bincount(self.owner, weights=of_rows, minlength=len(self.held_out))
        return {file: float(one) for (file, _), one in zip(self.held_out, sums, strict=True)}

    @abstractmethod
    def beyond(self, rows: FloatArray) -> FloatArray:
        """What of rows, (rows,) or (rows, n), no free number of the model can imitate; training rows."""


class ProjectedResidual(Residual):
    """A residual of few, long records, whose model's numbers are taken off by projection."""

    if TYPE_CHECKING:

        @property
        @abstractmethod
        def basis(self) -> FloatArray:
            """Orthonormal: what the model's free numbers can imitate, (training rows, numbers)."""

        @property
        @abstractmethod
        def criteria(self) -> Criteria:
            """The numbers that decide."""

    def beyond(self, rows: FloatArray) -> FloatArray:
        """What of whitened rows, (rows,), the free numbers cannot imitate; training rows."""
        mine = rows[self.training]
        return np.asarray(mine - self.basis @ (self.basis.T @ mine))

    @cached_property
    def pieces(self) -> npt.NDArray[np.int64]:
        """Block of each training row, (training rows,): what errs to either side by itself under the null."""
        rows = self.owner[self.training]
        found, done = np.zeros(len(rows), dtype=np.int64), 0
        for place in np.unique(rows):
            mine = np.flatnonzero(rows == place)
            count = min(int(self.criteria.chance.blocks), len(mine))
            found[mine] = done + np.arange(len(mine)) * count // len(mine)
            done += count
        return found


def cost(residual: Residual) -> float:
    """Squares of the residual summed over training records."""
    return float(np.sum(residual.residual[residual.training] ** 2))


def level(residual: Residual) -> float:
    """Mean square of the residual on training records; 1 is noise."""
    return cost(residual) / float(residual.training.sum())
