"""The one grammar of units: a text such as ``"N s2/m2"`` as powers of N, m and s and a factor to SI.

Symbols stand side by side or with ``*`` or ``·`` between them; a power follows its symbol (``m2``, ``m^2``,
``m**2``, ``m²``, ``m^-0.5``); all behind a ``/`` divides. Brackets round the whole are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

Powers = tuple[float, float, float]
_SYMBOLS: Mapping[str, tuple[float, Powers]] = {  # factor to SI; powers of N, m and s
    "1": (1.0, (0, 0, 0)),
    "N": (1.0, (1, 0, 0)),
    "kN": (1e3, (1, 0, 0)),
    "mN": (1e-3, (1, 0, 0)),
    "uN": (1e-6, (1, 0, 0)),
    "lbf": (4.4482216152605, (1, 0, 0)),
    "m": (1.0, (0, 1, 0)),
    "mm": (1e-3, (0, 1, 0)),
    "um": (1e-6, (0, 1, 0)),
    "in": (0.0254, (0, 1, 0)),
    "s": (1.0, (0, 0, 1)),
    "Hz": (1.0, (0, 0, -1)),
    "kg": (1.0, (1, -1, 2)),
    "J": (1.0, (1, 1, 0)),
    "W": (1.0, (1, 1, -1)),
    "g": (9.80665, (0, 1, -2)),
}
_SPELLINGS = (("µ", "u"), ("μ", "u"), ("²", "2"), ("³", "3"), ("**", "^"), ("·", " "), ("*", " "))
_TOKEN = re.compile(r"1|([A-Za-z]+)(?:\^?(-?\d+(?:\.\d+)?))?")


class Unit(NamedTuple):
    """A unit: its factor to SI, and its powers of N, m and s."""

    factor: float
    powers: Powers


def parse_unit(text: str) -> Unit:
    """Read a unit.

    Raises
    ------
    ValueError
        If it holds a symbol that is not known.

    Examples
    --------
    >>> parse_unit("N s2/m2")
    Unit(factor=1.0, powers=(1.0, -2.0, 2.0))
    >>> parse_unit("[mm / s²]")
    Unit(factor=0.001, powers=(0.0, 1.0, -2.0))
    """
    plain = text.strip().strip("[]()")
    for spelling, meant in _SPELLINGS:
        plain = plain.replace(spelling, meant)
    factor, total = 1.0, [0.0, 0.0, 0.0]
    for place, part in enumerate(plain.split("/")):
        for token in part.split() or [""]:
            match = _TOKEN.fullmatch(token)
            symbol = "" if match is None else match[1] or "1"
            if match is None or symbol not in _SYMBOLS:
                raise ValueError(f"a unit must be made of {', '.join(_SYMBOLS)}, got {text!r}")
            power = (-1.0 if place else 1.0) * float(match[2] or 1)
            size, powers = _SYMBOLS[symbol]
            factor *= size**power
            total = [whole + power * own for whole, own in zip(total, powers, strict=True)]
    return Unit(factor, (total[0], total[1], total[2]))


def unit_text(powers: Mapping[str, float]) -> str:
    """Write a unit of symbols with powers: ``"N s^-1"``, ``"1"`` for none."""
    parts = [
        symbol if power == 1.0 else f"{symbol}^{power:.4g}"
        for symbol, power in powers.items()
        if abs(power) > 1e-9
    ]
    return " ".join(parts) or "1"
