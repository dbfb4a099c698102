"""A parameter of a result file with its 95 % limits, in a line of a summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def with_limits(name: str, item: Mapping[str, Any]) -> str:
    """Return ``"k = 60005 [60001, 60010] N/m"``: limits with the digits that tell them apart."""
    known = item["low"] is not None and item["high"] is not None
    digits, limits = 5, ""
    if known:
        digits = _digits(item["low"], item["high"])
        limits = f" [{item['low']:.{digits}g}, {item['high']:.{digits}g}]"
    unit = "" if item["unit"] == "1" else f" {item['unit']}"
    return f"{name} = {item['value']:.{max(digits, 5)}g}{limits}{unit}"


def _digits(low: float, high: float) -> int:
    """Return how many digits of two limits show two of what lies between them: 4 at least, 9 at most."""
    size, width = max(abs(low), abs(high)), (high - low) / 2
    return min(max(math.floor(math.log10(size / width)) + 2, 4), 9) if width > 0 else 4
