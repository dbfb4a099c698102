"""Sensors and drive points of a campaign of modes: named by its channels, since no body names them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from rom.campaign.channels import BODY_QUANTITIES, GROUND_CHANNELS, MOTIONS
from rom.campaign.settings import CampaignSettings


def places_of(quantities: Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """Places at which one of some quantities was measured, in alphabetical order.

    Parameters
    ----------
    quantities : iterable of str
        Such as ``"force"``.
    names : iterable of str
        Names of channels, such as ``"force_tip"``.
    """
    starts = tuple(f"{quantity}_" for quantity in quantities)
    found = {name.partition("_")[2] for name in names if name.startswith(starts)}
    return tuple(sorted(found))


def sensors_of(names: Iterable[str]) -> tuple[str, ...]:
    """Places whose motion was measured, in alphabetical order."""
    return places_of(MOTIONS, names)


def modal_faults(names: Collection[str], test: str) -> Iterator[str]:
    """Say why channels cannot be those of a record of modes."""
    known = tuple(f"{quantity}_" for quantity in BODY_QUANTITIES)
    for name in sorted(names):
        if name in GROUND_CHANNELS:
            yield f"{name}: found it beside [modes], expected none: modal bodies stand on a ground at rest"
        elif not name.startswith(known) or not name.partition("_")[2]:
            wanted = ", ".join(f"{start}PLACE" for start in known)
            yield f"{name}: found an unknown channel, expected one of {wanted}"
    if not sensors_of(names):
        wanted = "expected the acceleration, velocity or displacement of a place"
        yield f"acceleration_PLACE: found no motion, {wanted}"
    if test == "driven" and not places_of(("force",), names):
        yield 'force_PLACE: found no force, expected one (driven test; "free" without a force)'


def sensor_faults(settings: CampaignSettings, channels: Mapping[str, Collection[str]]) -> Iterator[str]:
    """Say why the sensors of all records, by file their channels, cannot tell the declared modes."""
    if settings.modes is None or not channels:
        return
    first = next(iter(channels))
    sensors = sensors_of(channels[first])
    for file, names in channels.items():
        if sensors_of(names) != sensors:
            yield (
                f"{file}: found the sensors {', '.join(sensors_of(names))}, expected those of {first}: "
                f"{', '.join(sensors)}"
            )
            return
    if len(sensors) < settings.modes.count:
        yield (
            f"campaign.toml: modes.count: found {settings.modes.count} modes and {len(sensors)} sensors "
            f"({', '.join(sensors)}), expected no more modes than sensors"
        )
