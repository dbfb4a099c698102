"""What was read of a campaign: every channel with rate, length and size, doubts, suspicions, and figures."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.results import plain, results_folder, write_result
from experiments.run.publication import results_into
from experiments.studies.figure_files import save_figures
from experiments.text.records import checked
from rom.campaign.campaign import Campaign, CampaignSettings, Record, read_campaign
from rom.signals.calibration import Calibration
from rom.signals.quality import Doubt, assess
from rom.signals.suspicions import Evidence, evidence, suspicions

MOST_DRAWN = 12  # records in one figure


def run(
    campaign_path: Path,
    out: Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> Path:
    """Write ``check.json`` and the figures, and return the path of the former.

    Parameters
    ----------
    campaign_path : Path
        Folder of the campaign.
    out : Path, optional
        Folder of the results; beside the campaign if not given.
    seed : int
        Kept in the result file; nothing is drawn.
    jobs : int
        Processes.
    progress : callable, optional
        Takes records done and records in all.
    command : str
        The command line, kept in the result file.

    Returns
    -------
    Path
        Of ``check.json``.

    Raises
    ------
    ValueError
        If the campaign is refused.
    """
    from experiments.figures.records import figures_by_test

    started = time.perf_counter()
    campaign = read_campaign(campaign_path, jobs, progress)
    folder = results_folder(campaign_path, out)
    rows, drawn, looked_at = _read(campaign)
    told = plain([asdict(one) for one in suspicions(looked_at, campaign.settings)])
    with results_into(folder) as new:
        save_figures(figures_by_test(drawn), new)
        write_result(
            new / "check.json", "check", {"command": command, "records": rows, "suspicions": told},
            campaign=campaign.settings.name, seed=seed, elapsed_s=time.perf_counter() - started,
        )  # fmt: skip
    return folder / "check.json"


def _read(campaign: Campaign) -> tuple[list[dict[str, Any]], dict[str, list[Record]], list[Evidence]]:
    """Return what each record holds, the first records of each kind of test, and what raises suspicions."""
    rows: list[dict[str, Any]] = []
    drawn: dict[str, list[Record]] = {}
    looked_at: list[Evidence] = []
    for settings in campaign.settings.record:
        record = campaign.load(settings)
        doubts = assess(record, campaign.settings)
        rows.append(_row(record, doubts) | _calibrated(record, campaign.settings))
        looked_at.append(evidence(record, campaign.settings, doubts))
        same = drawn.setdefault(record.test, [])
        if len(same) < MOST_DRAWN:
            same.append(record)
    return rows, drawn, looked_at


def _row(record: Record, doubts: tuple[Doubt, ...]) -> dict[str, Any]:
    return {
        "file": record.file,
        "test": record.test,
        "bodies": list(record.bodies),
        "hold_out": record.hold_out,
        "preload_n": record.preload_n,
        "duration_s": record.duration_s,
        "channels": {
            name: {
                "rate_hz": channel.rate_hz,
                "samples": len(channel.samples),
                "minimum": float(channel.samples.min()),
                "maximum": float(channel.samples.max()),
                "rms": float(np.sqrt(np.mean(channel.samples**2))),
            }
            for name, channel in record.channels.items()
        },
        "doubts": [doubt.message for doubt in doubts],
    }


def _calibrated(record: Record, settings: CampaignSettings) -> dict[str, Any]:
    """Return the range of the tension [N] that the calibration makes of a strain: it shows a wrong one."""
    strain, bolt = record.channels.get("strain"), settings.bolt
    if strain is None or bolt is None or not bolt.calibration:
        return {}
    tension = Calibration(tuple(bolt.calibration)).tension(strain.samples)
    return {"calibrated_n": [float(tension.min()), float(tension.max())]}


def summary(path: Path) -> str:
    """Return how many records there are, and a line for each with its channels and doubts."""
    return "\n".join(checked(json.loads(path.read_text(encoding="utf-8"))))
