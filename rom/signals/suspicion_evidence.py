"""What one record tells of itself, kept small, so that all records of a campaign can be judged together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.channels import BOLT_CHANNELS, FloatArray
from rom.criteria.criteria import RECORD_CRITERIA, RecordCriteria
from rom.criteria.number import Numerical
from rom.criteria.suspicions import Suspicions
from rom.signals.damage import Damage, beyond_calibration, damages
from rom.signals.filters import find_impact
from rom.signals.hits import Hit, first_hit
from rom.signals.momentum import Balance, driven_balance, hit_balance
from rom.signals.motion import stands_out
from rom.signals.quality import HIT_TESTS, Doubt

OF_DOUBTS: Numerical[float] = 0.95  # confidence of what one record tells by itself
_KEPT = ("sampling rate",)  # of what is likely: the record is used


@dataclass(frozen=True)
class Suspicion:
    """One thing that does not fit what is declared.

    Attributes
    ----------
    record, channel : str
        File and channel.
    finding : str
        What was found, a line for people.
    factor : float or None
        What the channel would have to be multiplied by.
    likely : str
        The likeliest cause, such as "acceleration in g"; empty where none is known.
    confidence : float
        From 0 to 1: the share of what does not fit that this cause explains.
    """

    record: str
    channel: str
    finding: str
    factor: float | None
    likely: str
    confidence: float

    @property
    def sets_aside(self) -> bool:
        """Whether the record cannot be right."""
        return bool(self.likely) and self.likely not in _KEPT

    @property
    def cause(self) -> str:
        """What is likely, where, and what would mend it."""
        scaled = "" if self.factor is None else f", scale = {self.factor:.6g}"
        return f"{self.likely} ({self.channel}{scaled})"


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is kept of one record to judge all together.

    Attributes
    ----------
    unhit : str
        The force channel, where it shows no hit and there should be one.
    gauge : tuple
        The bolt's channel and its median before the hit, in its own unit; None without one.
    rates : mapping of str to float
        Sampling rates [Hz] by channel.
    hit_s : float, optional
        Time of the hit by its channel's rate [s]; None without one.
    given : mapping of str to float
        Masses and stiffnesses of this record alone, by path.
    """

    file: str
    test: str
    preload_n: float | None
    doubts: tuple[Doubt, ...]
    pushed: bool
    balance: Balance | None
    unhit: str
    gauge: tuple[str, float] | None
    damages: tuple[Damage, ...]
    rates: Mapping[str, float]
    hit_s: float | None = None
    given: Mapping[str, float] = field(default_factory=dict)


def evidence(
    record: Record,
    settings: CampaignSettings,
    doubts: tuple[Doubt, ...],
    criteria: RecordCriteria = RECORD_CRITERIA,
) -> Evidence:
    """Return what is kept of a record.

    Parameters
    ----------
    record : Record
        The record.
    settings : CampaignSettings
        The campaign's.
    doubts : tuple of Doubt
        What the record tells by itself.
    criteria : RecordCriteria
        The numbers that decide.
    """
    is_hit = record.test in HIT_TESTS
    hit = first_hit(record, criteria.records) if is_hit else None
    forces = [channel for body in settings.body_names if (channel := record.force(body)) is not None]
    still = [channel for channel in forces if not np.ptp(channel.samples)]
    missed = (
        is_hit
        and forces
        and hit is None
        and (len(still) == len(forces) or _moves(record, criteria.suspicions))
    )
    damaged = (
        *damages(record, hit, criteria.suspicions),
        *beyond_calibration(record, settings, criteria.suspicions),
    )
    hit_s = None if hit is None else hit.start / hit.force.rate_hz
    spoilt = any(doubt.kind not in ("polarity", "second-hit") for doubt in doubts) or any(
        one.at_hit for one in damaged
    )
    return Evidence(
        file=record.file,
        test=record.test,
        preload_n=record.preload_n,
        doubts=doubts,
        pushed=record.test != "driven" and (hit is None or float(hit.pulse.sum()) > 0),
        balance=None if spoilt else _balance(record, settings, hit, criteria.suspicions),
        unhit=forces[0].name if missed else "",
        gauge=_gauge(record, settings, hit_s),
        damages=damaged,
        rates={name: channel.rate_hz for name, channel in record.channels.items()},
        hit_s=hit_s,
        given=record.settings.given,
    )


def _balance(
    record: Record, settings: CampaignSettings, hit: Hit | None, rules: Suspicions
) -> Balance | None:
    if record.test == "driven":
        return driven_balance(record, settings, rules)
    return None if hit is None else hit_balance(record, settings, hit, rules)


def _moves(record: Record, rules: Suspicions) -> bool:
    """Whether something was hit: a motion begins like a blow, or has lines beside a force of noise alone."""
    channels = [record.motion(body)[1] for body in record.bodies]
    forces = [force for body in record.bodies if (force := record.force(body)) is not None]
    return any(find_impact(channel.samples, channel.rate_hz) is not None for channel in channels) or (
        not any(_exceeds_noise(force.samples, rules.force_noise) for force in forces)
        and any(stands_out(channel.samples) for channel in channels)
    )


def _exceeds_noise(samples: FloatArray, most: float) -> bool:
    """Whether anything but noise is there: a line, or a sample of more than so many deviations."""
    deviation = np.abs(samples - np.median(samples))
    return stands_out(samples) or bool(deviation.max() > most * 1.4826 * np.median(deviation))


def _gauge(record: Record, settings: CampaignSettings, hit_s: float | None) -> tuple[str, float] | None:
    name = next((name for name in BOLT_CHANNELS if name in record.channels), None)
    if name is None:
        return None
    channel = record.channels[name]
    start, end = settings.windows.initial_s
    end = end if hit_s is None else min(end, 0.98 * hit_s)
    span = channel.samples[round(start * channel.rate_hz) : round(end * channel.rate_hz)]
    return (name, float(np.median(span))) if span.size else None  # lone samples may be wrong
