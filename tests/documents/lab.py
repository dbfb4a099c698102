"""A folder as a lab leaves it: `.mat` files with names and units of its own, and a logbook."""

from __future__ import annotations

import csv
from pathlib import Path

from scipy.io import savemat

from rom.campaign.campaign import Campaign, RecordSettings

_GRAVITY = 9.80665
_EVERY = 2  # of so many coupled and loosening tests one is kept, over all preloads


def write_lab(campaign: Campaign, folder: Path) -> None:
    """Write some records of a rig campaign as the page on one's own records takes them for granted."""
    folder.mkdir()
    chosen = [*campaign.select("uncoupled")]
    for test in ("coupled", "loosening"):
        chosen += campaign.select(test)[::_EVERY]
    with (folder / "logbook.csv").open("w", newline="", encoding="utf-8") as file:
        book = csv.writer(file)
        book.writerow(("file", "test", "body", "preload_n", "hold_out"))
        for number, record in enumerate(chosen, 1):
            name = f"run_{number:03}.mat"
            savemat(folder / name, _as_in_the_lab(campaign, record))
            body = record.bodies[0] if record.test == "uncoupled" and record.bodies else ""
            book.writerow((name, record.test, body, record.preload_n, str(record.hold_out).lower()))


def _as_in_the_lab(campaign: Campaign, record: RecordSettings) -> dict[str, object]:
    channels = campaign.load(record).channels
    found: dict[str, object] = {}
    for name, channel in channels.items():
        quantity, _, body = name.partition("_")
        if quantity == "acceleration":
            found[f"acc_{body}"] = channel.samples / _GRAVITY
        else:
            found["hammer" if quantity == "force" else "gauge"] = channel.samples
    return found
