"""What would be left of a difference between two effects where all free numbers are fitted to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_RCOND: Numerical[float] = 1e-12


@dataclass(frozen=True, eq=False)
class NormalSums:
    """Sums over rows: squares of slopes, slopes times difference, difference squared."""

    squares: FloatArray
    right: FloatArray
    cost: float

    def remainder(self) -> float:
        """What is left of the difference where the slopes are fitted to it."""
        size = np.sqrt(np.maximum(np.diag(self.squares), 1e-300))
        inverse = np.linalg.pinv(self.squares / np.outer(size, size), rcond=_RCOND, hermitian=True)
        right = self.right / size
        return self.cost - float(right @ inverse @ right)

    def __add__(self, other: NormalSums) -> NormalSums:
        return NormalSums(self.squares + other.squares, self.right + other.right, self.cost + other.cost)

    def repeated(self, times: int) -> NormalSums:
        """Of a record that is measured so many times."""
        return NormalSums(times * self.squares, times * self.right, times * self.cost)
