"""A number that a fit by simulation moves: its size and range, and the power of it that is moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.model import Model

LEAST_MASS: Numerical[float] = 1e-3  # of what it is before a fit


@dataclass(frozen=True)
class FittedNumber:
    """A number of the fit: its path, its size and range, and what power of it a fit moves.

    Far below a frequency of its own an effect is linear in the square of the period.
    """

    path: str
    size: float
    low: float
    high: float
    power: float = 1.0

    @classmethod
    def of(cls, path: str, model: Model) -> FittedNumber:
        """A parameter of a model."""
        size, low, high = _range(model, path)
        return cls(path, size, low, high, -2.0 if model.parameter(path).unit == "Hz" and low > 0 else 1.0)

    def moved(self, value: FloatArray) -> FloatArray:
        """What a fit moves of values."""
        return np.asarray((value / self.size) ** self.power)

    def value(self, moved: float) -> float:
        """The value in its range of what a fit has moved."""
        found = self.size * (moved if self.power == 1.0 else max(moved, 1e-300) ** (1 / self.power))
        return float(np.clip(found, self.low, self.high))

    def slope(self, value: float) -> float:
        """Slope of the value by what a fit moves."""
        return float(self.size / self.power * (value / self.size) ** (1 - self.power))


def _range(model: Model, path: str) -> tuple[float, float, float]:
    """Size and range of a parameter; masses, stiffnesses and dampings are not negative."""
    number = model.parameter(path)
    low, high = number.bounds
    if not np.isfinite(low) and path.rpartition(".")[2] in ("mass", "k", "c"):
        low = LEAST_MASS * number.value if path.endswith(".mass") else 0.0
    nearest = min((abs(b) for b in (low, high) if b and np.isfinite(b)), default=0.0)
    return max(abs(number.value), 0.1 * nearest, 1e-300), low, high
