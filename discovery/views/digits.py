"""How many digits a number is shown with."""

from __future__ import annotations

import math

from rom.criteria.number import Numerical

_LEAST: Numerical[int] = 4
_MOST: Numerical[int] = 9


def digits_apart(low: float | None, high: float | None) -> int:
    """Return how many digits show two of what lies between two limits: 4 at least, 9 at most."""
    if low is None or high is None or low == high:
        return _LEAST
    size = max(abs(low), abs(high)) / abs(high - low)
    return min(max(math.ceil(math.log10(size)) + 2, _LEAST), _MOST)
