"""Units of measured channels: what a symbol means in SI."""

from __future__ import annotations

import re

from rom.model.units import parse_unit

_FORCE = ("N", "kN", "mN", "uN", "lbf")
_LENGTH = ("m", "mm", "um", "in")
_UNITS = {  # in SI first
    "force": _FORCE,
    "link_force": _FORCE,
    "normal_force": _FORCE,
    "tension": _FORCE,
    "displacement": _LENGTH,
    "link_displacement": _LENGTH,
    "velocity": tuple(f"{symbol}/s" for symbol in _LENGTH),
    "acceleration": (*(f"{symbol}/s2" for symbol in _LENGTH), "g"),
}
_SYMBOLS = {
    **{f"{prefix}newton{plural}": f"{symbol}N" for prefix, symbol in (("", ""), ("kilo", "k"), ("milli", "m"))
       for plural in ("", "s")},
    **{f"{prefix}met{ending}": f"{symbol}m" for prefix, symbol in (("", ""), ("milli", "m"), ("micro", "u"))
       for ending in ("er", "re", "ers", "res")},
    "sec": "s", "sek": "s", "second": "s", "seconds": "s", "inch": "in", "inches": "in",
    "lbs": "lbf", "lb": "lbf",
}  # fmt: skip
_WORDS = re.compile(rf"\b({'|'.join(sorted(_SYMBOLS, key=len, reverse=True))})(?![a-z])", re.IGNORECASE)


def quantity(channel: str) -> str:
    """Return what a channel of a campaign measures: "force" of "force_lo"."""
    return next((name for name in _UNITS if channel.startswith(f"{name}_")), channel)


def si_factor(channel: str, unit: str) -> float | None:
    """Return the factor from a unit to SI for a channel, None where the unit is none of its quantity.

    Strain stays as it is: the bolt's calibration is for the number that the file holds.
    """
    if quantity(channel) == "strain":
        return 1.0
    try:
        found = parse_unit(symbols(unit))
    except ValueError:
        return None
    expected = parse_unit(_UNITS[quantity(channel)][0])
    return found.factor if found.powers == expected.powers else None


def symbols(unit: str) -> str:
    """Return a unit with symbols in place of words: "Newton", "m/sec^2", "millimeter"; "G" alone is g."""
    text = unit.strip(" []()")
    if text in ("G", "gn", "g_n", "g0"):
        return "g"
    return _WORDS.sub(lambda word: _SYMBOLS[word[0].lower()], text)


def known_units(channel: str) -> str:
    """Return units of a channel's quantity for a message."""
    return ", ".join(_UNITS[quantity(channel)])
