"""Checks of a record against its campaign: what the file must hold for its kind of test, and how long."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rom.campaign.channels import (
    BOLT_CHANNELS,
    GROUND_CHANNELS,
    LINK_QUANTITIES,
    Channel,
    channel_names,
    motion_channels,
)
from rom.campaign.record import inspect_channels
from rom.campaign.sensors import modal_faults, sensors_of
from rom.campaign.settings import CampaignSettings, RecordSettings
from rom.campaign.settings_faults import file_fault, moving_faults
from rom.criteria.number import Numerical

MINIMUM_SAMPLES = 16  # fewer cannot be filtered (third order, both ways)
IMPACT_TESTS = ("uncoupled", "coupled", "loosening", "driven")
GROUND_TESTS = ("driven", "loosening")
RESTING_TESTS = ("cycled", "hold")
_ONE_RATE: Numerical[float] = 5e-3  # relative: clocks and printed times


@dataclass(frozen=True)
class Check:
    """What one look at a record's file found."""

    file: str
    digest: str = ""
    faults: tuple[str, ...] = ()
    needs_calibration: bool = False
    channels: frozenset[str] = frozenset()


def moving_bodies(
    record: RecordSettings, settings: CampaignSettings, channels: Collection[str]
) -> tuple[str, ...]:
    """Return the bodies that move: those named, or all; uncoupled, those whose motion is measured.

    Beside modes the sensors stand for bodies.

    Parameters
    ----------
    record : RecordSettings
        Settings of the record.
    settings : CampaignSettings
        Settings of the campaign.
    channels : collection of str
        Names of its channels.

    Returns
    -------
    tuple
        Names of bodies.
    """
    if record.test in RESTING_TESTS:
        return ()
    if settings.modes is not None:
        return sensors_of(channels)
    if record.bodies is not None:
        return record.bodies
    if record.test == "uncoupled" and len(settings.body) > 1:
        return tuple(
            body for body in settings.body_names if not set(motion_channels(body)).isdisjoint(channels)
        )
    return settings.body_names


def check_record(folder: Path, settings: CampaignSettings, index: int) -> Check:
    """Read a record once: its digest, its faults.

    Parameters
    ----------
    folder : Path
        The campaign folder.
    settings : CampaignSettings
        Settings of the campaign.
    index : int
        Place of the record among the settings' records.

    Returns
    -------
    Check
        Digest and faults.
    """
    record = settings.record[index]
    if file_fault(record.file):  # told with the settings
        return Check(record.file)
    path = folder / record.file
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):  # which survives a loop
        return Check(record.file, faults=("file: found a link to elsewhere, expected a file in the folder",))
    sampling = settings.sampling
    modal = settings.modes is not None
    known = None if modal else channel_names(settings.body_names, settings.link_names)
    found = inspect_channels(path, sampling.motion_rate_hz, sampling.tension_rate_hz, known)
    faults = list(found.faults)
    if modal and found.complete:
        faults += modal_faults(found.names, record.test)
    elif found.complete and not any(moving_faults(record, settings.body_names)):
        faults += _absent(index, settings, found.names)
    if found.channels:
        longest = max(found.channels.values(), key=lambda c: c.duration_s)
        faults += [*_tenfold(record, settings, found.channels)] or _too_short(record, settings, longest)
    needs_calibration = settings.bolt is not None and settings.bolt.calibration is None
    needs_calibration &= "strain" in found.names and "tension" not in found.names
    digest = file_digest(path) if not faults else ""
    return Check(record.file, digest, tuple(faults), needs_calibration, found.names if modal else frozenset())


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _absent(index: int, settings: CampaignSettings, names: Collection[str]) -> Iterator[str]:
    """Name the channels without which this kind of test says nothing."""
    record = settings.record[index]
    bodies = moving_bodies(record, settings, names)
    if record.test == "uncoupled" and record.bodies is None and len(bodies) != 1:
        moving = ", ".join(bodies) or "no body"
        yield f"bodies: found the motion of {moving}, expected record[{index}].bodies to name one body"
    for body in bodies:
        if set(motion_channels(body)).isdisjoint(names):
            yield (
                f"acceleration_{body}: found no motion of this body, expected {_or(motion_channels(body))} "
                f"(or record[{index}].bodies without it)"
            )
    forces = tuple(f"force_{body}" for body in bodies or settings.body_names)
    yield from _ground_faults(index, settings, bodies, names)
    by_ground = record.test in GROUND_TESTS and not set(GROUND_CHANNELS).isdisjoint(names)
    if record.test in IMPACT_TESTS and set(forces).isdisjoint(names) and not by_ground:
        yield f"{forces[0]}: found no force on a moving body, expected {_or(forces)} ({record.test} test)"
    if record.test in ("loosening", "hold") and set(BOLT_CHANNELS).isdisjoint(names):
        yield f"tension: found none, expected {_or(BOLT_CHANNELS)} ({record.test} test)"
    if record.test == "cycled":
        yield from _absent_link(settings.link_names, names)


def _ground_faults(
    index: int, settings: CampaignSettings, bodies: tuple[str, ...], names: Collection[str]
) -> Iterator[str]:
    """Say why a motion of the ground cannot be the input of a record."""
    shown, record = [name for name in GROUND_CHANNELS if name in names], settings.record[index]
    if not shown:
        return
    if record.test not in GROUND_TESTS:
        yield f'{shown[0]}: found it in a {record.test} record, expected it in "driven" or "loosening" ones'
        return
    if record.test == "loosening" and len(bodies) > 1:
        yield f"{shown[0]}: found {len(bodies)} moving bodies, expected one in a loosening record with it"
    masses = {body.name: body.mass_kg for body in settings.body}
    for body in bodies:
        if masses[body] is None and f"body.{body}.mass" not in record.given:
            yield (
                f"{shown[0]}: found no mass_kg of {body}, expected it: a ground that moves tells only "
                "ratios to the masses (1.0 where these are enough)"
            )
        if shown == ["acceleration_ground"] and f"acceleration_{body}" not in names:
            yield (
                f"acceleration_ground: found no acceleration_{body}, expected it, or displacement_ground "
                "beside: the relative motion is a difference of like quantities"
            )


def _absent_link(links: tuple[str, ...], names: Collection[str]) -> Iterator[str]:
    displacement, force, _ = LINK_QUANTITIES
    driven = [link for link in links if f"{displacement}_{link}" in names or f"{force}_{link}" in names]
    for link in driven or links[:1]:
        for name in (f"{displacement}_{link}", f"{force}_{link}"):
            if name not in names:
                yield f"{name}: found none, expected it (cycled test)"


def _or(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last


def _tenfold(
    record: RecordSettings, settings: CampaignSettings, channels: Mapping[str, Channel]
) -> Iterator[str]:
    """Say of motions and forces at a power of ten times the usual rate that their time is in another unit.

    Other than impact tests may be so slow: of these only times in ms, us or ns are told.
    """
    usual_hz, least = settings.sampling.motion_rate_hz, 3 if record.test in ("driven", "free") else 1
    for name, channel in channels.items():
        decades = math.log10(channel.rate_hz / usual_hz)
        whole = round(decades)
        near = abs(channel.rate_hz / usual_hz / 10.0**whole - 1) < _ONE_RATE
        if (
            name not in BOLT_CHANNELS
            and record.test not in RESTING_TESTS
            and near
            and whole
            and not whole % least
        ):
            yield (
                f"{name}: found {channel.rate_hz:g} Hz, expected a rate near {usual_hz:g} Hz of [sampling], "
                "not off by a power of ten: give times in s and rates in Hz, or another motion_rate_hz"
            )
            return


def _too_short(record: RecordSettings, settings: CampaignSettings, longest: Channel) -> Iterator[str]:
    least, why = MINIMUM_SAMPLES / longest.rate_hz, f"{MINIMUM_SAMPLES} samples"
    if record.test in IMPACT_TESTS and settings.sampling.pretrigger_s > 0:
        least, why = least + settings.sampling.pretrigger_s, f"sampling.pretrigger_s and {why}"
    final_s = min(settings.windows.final_s)  # told with the settings if it is not the first
    if record.test == "loosening" and final_s > least:
        least, why = final_s, "the start of windows.final_s"
    if longest.duration_s <= least:
        yield f"duration: found {longest.duration_s:.6g} s, expected more than {least:.6g} s ({why})"
