"""A small sound campaign of every kind of test, for the tests of the reader and of the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rom.campaign.campaign import CampaignSettings, write_campaign
from rom.campaign.record import Channel
from rom.parameters.he_2025 import nominal_impact, paper_model

MOTION_RATE_HZ, TENSION_RATE_HZ, DURATION_S = 400, 100, 3.0
UNCOUPLED, COUPLED, LOOSENING = "records/uncoupled.h5", "records/coupled.mat", "records/loosening.h5"
DRIVEN, FREE, CYCLED, HOLD = "records/driven.csv", "records/free.csv", "cycled.mat", "records/more/hold.h5"
FILES = (UNCOUPLED, COUPLED, LOOSENING, DRIVEN, FREE, CYCLED, HOLD)
FORCED = ("force_lo", "acceleration_lo", "acceleration_so", "strain")


def sound_settings() -> dict[str, Any]:
    """Settings of a campaign with every kind of test, as `campaign.toml` holds them."""
    return {
        "format": "boltlaw-campaign/1",
        "name": "two oscillators",
        "body": [{"name": "lo", "mass_kg": 8.625}, {"name": "so"}],
        "link": [
            {"name": "flexure_lo", "between": ["lo", "ground"], "law": "linear"},
            {"name": "flexure_so", "between": ["so", "ground"], "law": "dashpot", "damping_ns_per_m": 2},
            {"name": "joint", "between": ["lo", "so"], "law": "bolted"},
        ],
        "bolt": {"link": "joint", "calibration": [2718.7, 2363.7, -575.63]},
        "sampling": {
            "motion_rate_hz": MOTION_RATE_HZ,
            "tension_rate_hz": TENSION_RATE_HZ,
            "pretrigger_s": 0.5,
        },
        "windows": {"initial_s": [0, 0.4], "final_s": [2.0, 8.0]},
        "record": [
            {"file": UNCOUPLED, "test": "uncoupled", "bodies": ["lo"]},
            {"file": COUPLED, "test": "coupled", "preload_n": 10},
            {"file": LOOSENING, "test": "loosening", "preload_n": 152.7, "hold_out": False},
            {"file": DRIVEN, "test": "driven", "hold_out": True},
            {"file": FREE, "test": "free"},
            {"file": CYCLED, "test": "cycled"},
            {"file": HOLD, "test": "hold"},
        ],
    }


def sound_channels(file: str, factor: float = 1.0) -> dict[str, Channel]:
    """Channels of one record: the fewest that its kind of test needs, noise times a factor."""
    names = {
        UNCOUPLED: ("force_lo", "velocity_lo"),
        FREE: ("displacement_lo", "acceleration_so"),
        CYCLED: ("link_displacement_joint", "link_force_joint"),
        HOLD: ("tension",),
    }.get(file, FORCED)
    random = np.random.default_rng(len(file))
    rates = {name: TENSION_RATE_HZ if name in ("strain", "tension") else MOTION_RATE_HZ for name in names}
    noise = {name: factor * random.standard_normal(round(rate * DURATION_S)) for name, rate in rates.items()}
    if "strain" in noise:
        noise["strain"] *= 0.1  # within the range in which the calibration rises
    if file == FREE:  # in which something moves
        time = np.arange(round(MOTION_RATE_HZ * DURATION_S)) / MOTION_RATE_HZ
        noise["displacement_lo"] += 10 * factor * np.exp(-time) * np.cos(2 * np.pi * 5 * time)
    return {name: Channel(name, samples, rates[name]) for name, samples in noise.items()}


def write_sound_campaign(folder: Path, factor: float = 1.0) -> None:
    """Write the sound campaign to a new folder."""
    settings = CampaignSettings.model_validate(sound_settings())
    write_campaign(folder, settings, ((file, sound_channels(file, factor)) for file in FILES))


def write_loosening_campaign(folder: Path, rate_hz: float, noise: float = 0.0) -> None:
    """One loosening record of the paper's model, with noise of one size in all channels."""
    force = nominal_impact(1600.0, rate_hz, 3.0)
    response = paper_model().simulate({"lo": force}, rate_hz, 60.0)
    samples = {"force_lo": force, "tension": np.asarray(response.tension)}
    samples |= {f"acceleration_{body}": response.acceleration[body] for body in ("lo", "so")}
    random = np.random.default_rng(1)
    settings = sound_settings() | {
        "record": [{"file": LOOSENING, "test": "loosening", "preload_n": 60.0}],
        "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.5},
    }
    channels = {
        name: Channel(name, values + noise * random.standard_normal(len(values)), rate_hz)
        for name, values in samples.items()
    }
    write_campaign(folder, CampaignSettings.model_validate(settings), [(LOOSENING, channels)])
