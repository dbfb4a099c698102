"""A parameter of a result file with its 95 % limits, in a line of a summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from discovery.views.digits import digits_apart

_DIGITS = 5  # of a value without limits


def parameter_line(name: str, item: Mapping[str, Any]) -> str:
    """Return ``"k = 60005 [60001, 60010] N/m"``: limits with the digits that tell them apart."""
    known = item["low"] is not None and item["high"] is not None
    digits = digits_apart(item["low"], item["high"])
    limits = f" [{item['low']:.{digits}g}, {item['high']:.{digits}g}]" if known else ""
    unit = "" if item["unit"] == "1" else f" {item['unit']}"
    return f"{name} = {item['value']:.{max(digits, _DIGITS)}g}{limits}{unit}"
