"""Units of measured channels: what a symbol means in SI."""

from __future__ import annotations

_FORCE = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "lbf": 4.4482216152605}
_LENGTH = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_VELOCITY = {f"{symbol}/s": factor for symbol, factor in _LENGTH.items()}
_ACCELERATION = {"g": 9.80665} | {f"{symbol}/s2": factor for symbol, factor in _LENGTH.items()}
UNITS = {
    "force": _FORCE,
    "link_force": _FORCE,
    "normal_force": _FORCE,
    "tension": _FORCE,
    "displacement": _LENGTH,
    "link_displacement": _LENGTH,
    "velocity": _VELOCITY,
    "acceleration": _ACCELERATION,
}
_SPELLINGS = (("µ", "u"), ("μ", "u"), ("²", "2"), ("^", ""), ("**", ""), ("·", "*"), ("/s/s", "/s2"))


def quantity(channel: str) -> str:
    """Return what a channel of a campaign measures: "force" of "force_lo"."""
    return next((name for name in UNITS if channel.startswith(f"{name}_")), channel)


def si_factor(channel: str, unit: str) -> float | None:
    """Return the factor from a unit to SI for a channel, None where the unit is none of its quantity.

    Strain stays as it is: the bolt's calibration is for the number that the file holds.
    """
    if quantity(channel) == "strain":
        return 1.0
    symbol = unit.strip().strip("[]()").replace(" ", "")
    for spelling, plain in _SPELLINGS:
        symbol = symbol.replace(spelling, plain)
    return UNITS[quantity(channel)].get(symbol)


def known_units(channel: str) -> str:
    """Return the units of a channel's quantity for a message."""
    return ", ".join(UNITS[quantity(channel)])
