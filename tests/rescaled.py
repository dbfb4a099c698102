"""Campaigns in other units of tension, mass, length and time: by powers of two, so that no digit is lost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import rom
from rom.campaign.campaign import CampaignSettings, RecordSettings, write_campaign
from rom.campaign.channels import Channel


def rescaled(
    campaign: rom.Campaign,
    folder: Path,
    *,
    tension: float = 1.0,
    mass: float = 1.0,
    length: float = 1.0,
    time: float = 1.0,
) -> rom.Campaign:
    """Write and read a campaign whose every number is so many times as large as its dimension asks for.

    Parameters
    ----------
    campaign : Campaign
        What is rescaled.
    folder : Path
        A new one.
    tension, mass, length, time : float
        Factors; that of tension is of the bolt's alone.
    """
    of = {
        "force": mass * length / time**2, "acceleration": length / time**2, "velocity": length / time,
        "displacement": length, "tension": tension, "strain": 1.0,
    }  # fmt: skip
    data = campaign.settings.model_dump(exclude_none=True, by_alias=True)
    for body in data["body"]:
        body |= {"mass_kg": body["mass_kg"] * mass} if "mass_kg" in body else {}
    if "bolt" in data:
        data["bolt"]["calibration"] = [tension * number for number in data["bolt"]["calibration"]]
    sampling = data["sampling"]
    sampling |= {key: sampling[key] / time for key in ("motion_rate_hz", "tension_rate_hz")}
    sampling["pretrigger_s"] *= time
    data["windows"] = {name: [time * end for end in ends] for name, ends in data["windows"].items()}
    for record in data["record"]:
        record |= {"preload_n": tension * record["preload_n"]} if "preload_n" in record else {}

    def channels(record: RecordSettings) -> Iterator[tuple[str, Channel]]:
        for name, channel in campaign.load(record).channels.items():
            factor = next(value for quantity, value in of.items() if name.startswith(quantity))
            yield name, Channel(name, factor * channel.samples, channel.rate_hz / time)

    written = ((record.file, dict(channels(record))) for record in campaign.settings.record)
    write_campaign(folder, CampaignSettings.model_validate(data), written, precision="float64")
    return rom.read_campaign(folder)
