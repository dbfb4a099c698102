"""What every residual can tell, whatever kind of record it is of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal, Protocol

import numpy as np
import numpy.typing as npt

from rom.campaign.channels import FloatArray

Kind = Literal["output error", "force balance", "simulation", "tension", "tension at rest"]


class Residual(Protocol):
    """What a model leaves over of a campaign's records, in units of their noise.

        r = (measured - modelled) / sigma,   mean(r^2) = 1 where nothing is missing

    Impact tests (`discovery.residual.output_error`): lines of the motion. Driven bodies and cycled links
    (`discovery.residual.force_balance`): forces left unbalanced. Ring-downs
    (`discovery.residual.simulation`): samples of the motion. Bolts at rest (`discovery.residual.at_rest`):
    slow lines of the tension. One closed loop runs over all of them. What a law
    leaves over of the tension after hits is beside it (`discovery.residual.tension`).
    """

    kind: ClassVar[Kind]
    """Which explainers take it (`discovery.explain.registry`)."""

    @property
    def residual(self) -> FloatArray:
        """Whitened rows, (rows,)."""
        ...

    @property
    def training(self) -> npt.NDArray[np.bool_]:
        """Whether a row may be fitted to, (rows,)."""
        ...

    @property
    def owner(self) -> npt.NDArray[np.int64]:
        """Place of each row's record, (rows,)."""
        ...

    @property
    def record_count(self) -> int:
        """Records that can be simulated or balanced with the model."""
        ...

    @property
    def samples(self) -> Mapping[str, int]:
        """Rows of each record, by file."""
        ...

    @property
    def hold_out(self) -> frozenset[str]:
        """Files that no number is fitted to."""
        ...

    def costs(self, rows: FloatArray) -> dict[str, float]:
        """Squares of whitened rows, (rows,), summed by record."""
        ...

    def beyond(self, rows: FloatArray) -> FloatArray:
        """What of rows, (rows,) or (rows, n), no free number of the model can imitate; training rows."""
        ...


def cost(residual: Residual) -> float:
    """Squares of the residual summed over training records."""
    return float(np.sum(residual.residual[residual.training] ** 2))


def level(residual: Residual) -> float:
    """Mean square of the residual on training records; 1 is noise."""
    return cost(residual) / float(residual.training.sum())
