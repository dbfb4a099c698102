"""Random linear campaigns of random kinds, structures and scales; not the model's code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from rom.campaign.campaign import Campaign
from tests.rom import lumped

QUANTITIES = ("displacement", "velocity", "acceleration")
FINER = 8  # samples of the true force for one of the record


@dataclass(frozen=True)
class RandomCampaign:
    """A campaign and its truth: stiffness of every link [N/m]."""

    campaign: Campaign
    kind: str
    stiffness: dict[str, float]


def random_campaign(folder: Path, seed: int) -> RandomCampaign:
    """Draw a chain of one to three masses, all given, with free or driven records or both."""
    rng = np.random.default_rng(seed)
    kind, quantity = str(rng.choice(["free", "driven", "mixed"])), str(rng.choice(QUANTITIES))
    mass, length, second = (10 ** rng.uniform(-6, 6, 3)).tolist()
    rate, samples = 256.0 / second, int(rng.integers(800, 1600))
    masses = {f"m{i}": float(mass * rng.uniform(0.5, 3.0)) for i in range(int(rng.integers(1, 4)))}
    links: list[lumped.LinkRow] = []
    for i, (name, own) in enumerate(masses.items()):
        k = own * (2 * np.pi * rng.uniform(6, 14) / second) ** 2
        c = 2 * 10 ** rng.uniform(-2.0, -1.3) * np.sqrt(k * own)
        links.append((f"link{i}", (name, f"m{i - 1}" if i else "ground"), "linear", float(k), float(c)))
    records = []
    for place in range(int(rng.integers(2, 4))):
        test = ["free", "driven"][(kind == "driven") or (kind == "mixed" and place % 2 == 1)]
        force, start = np.zeros(samples * FINER), np.zeros(2 * len(masses))
        if test == "driven":
            force = _smooth(rng, samples) * mass * length / second**2
        else:
            start[: len(masses)] = length * rng.normal(0.0, 0.01, len(masses))
        moved = lumped.respond(masses, links, {"m0": force}, rate * FINER, start)
        noise = 10 ** rng.uniform(-4, -2)
        channels = {
            f"{quantity}_{b}": lumped.noisy(rng, moved[f"{quantity}_{b}"][::FINER], noise) for b in masses
        }
        channels |= {"force_m0": force[::FINER]} if test == "driven" else {}
        records.append(({"file": f"{place}.h5", "test": test}, channels))
    stiffness = {name: k for name, _, _, k, _ in links}
    return RandomCampaign(lumped.campaign(folder, masses, links, records, rate), kind, stiffness)


def _smooth(rng: np.random.Generator, samples: int) -> np.ndarray:
    """A force of up to 0.08 of the rate that begins and ends with nothing."""
    sections = signal.butter(6, 0.08, fs=FINER, output="sos")
    force = signal.sosfiltfilt(sections, rng.normal(size=samples * FINER))
    return np.asarray(20 * force / force.std() * signal.windows.tukey(samples * FINER, 0.1))
