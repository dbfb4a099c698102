"""Units of measured channels: what a symbol means in SI."""

from __future__ import annotations

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
        found = parse_unit(unit)
    except ValueError:
        return None
    expected = parse_unit(_UNITS[quantity(channel)][0])
    return found.factor if found.powers == expected.powers else None


def known_units(channel: str) -> str:
    """Return units of a channel's quantity for a message."""
    return ", ".join(_UNITS[quantity(channel)])
