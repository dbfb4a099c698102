"""Raw records of the paper's model as sensors with faults show them, processed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rom import Model
from rom.campaign.campaign import CampaignSettings, Record, RecordSettings
from rom.campaign.channels import Channel
from rom.effects import SensorFault
from rom.effects.observation import tension_reading
from rom.signals.processing import Measurement, process
from tests.rom.lumped import pulse

RATE_HZ, TENSION_RATE_HZ, SECONDS, IMPACT_S = 4800.0, 1200.0, 3.0, 0.5
SETTINGS = CampaignSettings.model_validate(
    {
        "format": "boltlaw-campaign/1",
        "name": "two oscillators",
        "body": [{"name": "lo", "mass_kg": 8.625}, {"name": "so", "mass_kg": 0.9888}],
        "link": [
            {"name": "flexure_lo", "between": ["lo", "ground"], "law": "linear"},
            {"name": "flexure_so", "between": ["so", "ground"], "law": "linear"},
            {"name": "joint", "between": ["lo", "so"], "law": "bolted"},
        ],
        "bolt": {"link": "joint"},
        "sampling": {
            "motion_rate_hz": RATE_HZ,
            "tension_rate_hz": TENSION_RATE_HZ,
            "pretrigger_s": IMPACT_S,
        },
        "windows": {"initial_s": [0.0, 0.4], "final_s": [1.5, 3.0]},
        "record": [{"file": "a.h5", "test": "loosening"}],
    }
)


def channels(
    model: Model,
    faults: Sequence[SensorFault] = (),
    *,
    peak_n: float = 400.0,
    tension_n: float = 200.0,
    noise: float = 0.0,
    seed: int = 0,
) -> dict[str, Channel]:
    """Return what sensors with faults show of a simulated hit; noise in 0.02 N, 0.02 m/s2 and 0.5 N."""
    rng = np.random.default_rng(seed)
    samples = int(SECONDS * RATE_HZ)
    force = pulse(peak_n, samples, RATE_HZ, IMPACT_S)
    response = model.simulate({"lo": force}, RATE_HZ, tension_n)
    every = int(RATE_HZ / TENSION_RATE_HZ)
    shown = {
        "force_lo": Channel("force_lo", force, RATE_HZ),
        "acceleration_lo": Channel("acceleration_lo", response.acceleration["lo"], RATE_HZ),
        "acceleration_so": Channel("acceleration_so", response.acceleration["so"], RATE_HZ),
        "tension": Channel("tension", tension_reading(model, response, IMPACT_S)[::every], TENSION_RATE_HZ),
    }
    for fault in faults:
        channel = shown[fault.channel]
        other = response.acceleration["lo" if fault.channel.endswith("so") else "so"]
        shown[fault.channel] = replace(
            channel, samples=fault.apply(channel.samples, channel.rate_hz, other if fault.other else None)
        )
    level = {"force_lo": 0.02, "tension": 0.5}
    return {
        name: replace(
            c, samples=c.samples + noise * level.get(name, 0.02) * rng.standard_normal(c.samples.size)
        )
        for name, c in shown.items()
    }


def record(model: Model, faults: Sequence[SensorFault] = (), **how: float) -> Measurement:
    """Return the record of ``channels``, processed."""
    settings = RecordSettings(file="a.h5", test="loosening")
    return process(Record(settings, channels(model, faults, **how), ("lo", "so")), SETTINGS)  # type: ignore[arg-type]
