"""A body on a spring that carries a small one on a stiff spring that no campaign declares: a second mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rom.campaign.campaign import Campaign
from tests.rom.lumped import LinkRow, campaign, noisy, pulse, random_force, respond

MASS, HIDDEN, STIFFNESS, DAMPING, MODE_HZ = 2.0, 0.3, 4000.0, 8.0, 130.0
RATE_HZ, SAMPLES, FINE = 2000.0, 6000, 4
BAND = {"low_hz": 1.0, "high_hz": 18.0}
LINKS: list[LinkRow] = [
    ("s", ("m", "ground"), "linear", STIFFNESS, DAMPING),
    ("hidden", ("h", "m"), "linear", HIDDEN * (2 * np.pi * MODE_HZ) ** 2, 0.5),
]


def with_hidden_mode(folder: Path, test: str, kind: str, band: bool, known: bool = True) -> Campaign:
    """Return a campaign of one declared body, of the mass of both."""
    rng, records = np.random.default_rng(9), []
    for i in range(4):
        samples, rate = FINE * SAMPLES, FINE * RATE_HZ
        force = np.zeros(samples)
        if test == "driven":
            force = 10 * random_force(rng, samples, rate, 20.0) + 60 * random_force(rng, samples, rate, 180.0)
        elif test == "coupled":
            force = pulse(100.0, samples, rate, 0.3, 8e-3)
        initial = rng.normal(0, [0.01, 0.0, 0.3, 0.0]) if test == "free" else None
        if initial is not None:  # both move alike, but for some of the hidden mode
            initial[1::2] = initial[::2] + rng.normal(0, [2e-3, 1.0])
        motion = respond({"m": MASS, "h": HIDDEN}, LINKS, {"m": force}, rate, initial)
        shown = {f"{kind}_m": noisy(rng, motion[f"{kind}_m"][::FINE], 0.01)}
        shown |= {} if test == "free" else {"force_m": force[::FINE]}
        records.append(({"file": f"{i}.h5", "test": test, "hold_out": i == 3}, shown))
    others: dict[str, Any] = {"band": BAND} if band else {}
    others |= {"sampling": {"motion_rate_hz": RATE_HZ, "pretrigger_s": 0.25}} if test == "coupled" else {}
    mass = MASS + HIDDEN if known else None
    return campaign(folder, {"m": mass}, LINKS[:1], records, RATE_HZ, **others)
