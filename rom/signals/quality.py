"""Doubts about a record, found without any model: clipped channels, hits the force misses, flipped signs.

Each test is made to keep silent unless the evidence is strong: a good record set aside is a loss as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import BOLT_CHANNELS
from rom.criteria.criteria import RECORD_CRITERIA
from rom.criteria.records import Records
from rom.criteria.suspicions import Suspicions
from rom.signals.clipping import flat_top, resolution
from rom.signals.hits import Hit, first_hit, second_hit, signs
from rom.signals.motion import stands_out

Kind: TypeAlias = Literal["still", "clipped", "second-hit", "polarity", "suspicion"]

HIT_TESTS = ("uncoupled", "coupled", "loosening")


@dataclass(frozen=True)
class Doubt:
    """Why a record is set aside: its file, the channel, the kind of doubt, and a line for people."""

    file: str
    channel: str
    kind: Kind
    message: str


def assess(
    record: Record, settings: CampaignSettings, rules: Records = RECORD_CRITERIA.records
) -> tuple[Doubt, ...]:
    """Name every reason to doubt a record; none for a good one.

    Still: a channel of the motion never changes. Clipped: the channel's extreme is a flat top whose flanks
    point well above it. Polarity: the struck body accelerates against the force during the contact, or two
    bodies move against each other across a bolted link in their lowest mode. Second hit: ``F - sum m_i a_i``,
    in which all forces within the structure cancel, shows one more pulse like the first where the force shows
    nothing.

    Parameters
    ----------
    record
        The record; of `cycled` and `hold` records none is doubted, of `driven` and `free` ones only that
        nothing moves, and clipping.
    settings
        The campaign's, for its links.
    rules
        The numbers that decide.
    """
    if still := tuple(_still(record)):
        return still
    clipped = tuple(_clipped(record, rules))
    hit = first_hit(record, rules) if record.test in HIT_TESTS and not clipped else None
    if hit is None:
        return clipped
    if unmoved := tuple(_unmoved(record, hit, RECORD_CRITERIA.suspicions)):
        return unmoved
    flipped = tuple(_flipped(record, settings, hit))
    return flipped or tuple(_second_hit(record, hit))


def _still(record: Record) -> Iterator[Doubt]:
    """Yield a doubt where bodies are to move and a channel of theirs shows nothing, not even noise.

    Where no force acts either noise is nothing: no line of a spectrum stands above it.
    """
    motions = [record.motion(body)[1] for body in record.bodies]
    if not motions:
        return
    names, first = ", ".join(channel.name for channel in motions), motions[0].name
    forces = [channel for name, channel in record.channels.items() if name.startswith("force_")]
    unforced = record.test in ("free", "driven") and not record.relative
    dead = [channel.name for channel in motions if not np.ptp(channel.samples)]
    if len(dead) == len(motions):
        yield Doubt(record.file, first, "still", f"nothing moves in the record: constant {names}")
    elif dead:
        message = f"{', '.join(dead)} shows nothing, not even noise, while other bodies move"
        yield Doubt(record.file, dead[0], "still", message)
    elif (
        unforced
        and not any(np.any(force.samples) for force in forces)
        and not any(stands_out(channel.samples) for channel in motions)
    ):
        yield Doubt(record.file, first, "still", f"nothing moves in the record: noise alone in {names}")


def _unmoved(record: Record, hit: Hit, rules: Suspicions) -> Iterator[Doubt]:
    """Yield a doubt for a channel of the motion that shows noise alone, before a hit and after."""
    for body in record.bodies:
        channel = record.motion(body)[1]
        start = round(hit.start / hit.force.rate_hz * channel.rate_hz)
        before, after = channel.samples[:start], channel.samples[start:]
        if len(before) < rules.shortest or len(after) < rules.shortest:
            continue
        span = after[: len(before)]
        if span.std() < rules.unlike_noise * before.std() and not stands_out(channel.samples):
            message = f"{channel.name} shows noise alone while {hit.force.name} shows a hit"
            yield Doubt(record.file, channel.name, "still", message)


def _clipped(record: Record, rules: Records) -> Iterator[Doubt]:
    if record.test in ("cycled", "hold"):
        return  # a prescribed motion may rest, friction has flat tops
    for name, channel in record.channels.items():
        if record.test == "driven" and name.startswith("force_"):
            continue  # a command may be a square wave
        sides = (1.0,) if name in BOLT_CHANNELS else (1.0, -1.0)  # a loose bolt rests at zero tension
        fine = resolution(channel.samples)
        for side in sides:
            if cut := flat_top(side * channel.samples, rules, fine):
                count, level = cut
                message = f"{name} is clipped: flat for {count} samples at its extreme of {side * level:.6g}"
                yield Doubt(record.file, name, "clipped", message)
                break


def _flipped(record: Record, settings: CampaignSettings, hit: Hit) -> Iterator[Doubt]:
    found = signs(record, settings.link, hit)
    if len(found) > 1 and max(found.values()) < 0:
        message = f"{hit.force.name} opposes the motion of every body: its sign seems flipped"
        yield Doubt(record.file, hit.force.name, "polarity", message)
        return
    for body, sign in found.items():
        name = record.motion(body)[1].name
        if sign < 0:
            against = hit.force.name if body == hit.body else "the bodies beside it in their lowest mode"
            yield Doubt(record.file, name, "polarity", f"{name} opposes {against}: its sign seems flipped")


def _second_hit(record: Record, hit: Hit) -> Iterator[Doubt]:
    if (found := second_hit(record, hit)) is not None:
        time_s, share = found
        message = (
            f"{hit.force.name} shows nothing at {time_s:.4f} s, "
            f"where the bodies move as after a second hit of {100 * share:.0f} % of the first"
        )
        yield Doubt(record.file, hit.force.name, "second-hit", message)
