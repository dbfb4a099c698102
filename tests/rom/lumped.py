"""Linear lumped structures by exact discretisation, and campaigns of their records; not the model's code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from rom.campaign.campaign import Campaign, CampaignSettings, read_campaign, write_campaign
from rom.campaign.record import Channel

Channels = Mapping[str, Channel]
LinkRow = tuple[str, tuple[str, str], str, float, float]  # name, ends, law, stiffness, damping


def respond(
    masses: Mapping[str, float],
    links: Sequence[LinkRow],
    force: Mapping[str, np.ndarray],
    rate_hz: float,
    initial: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Return "displacement_<body>", "velocity_<body>" and "acceleration_<body>", exact for straight lines.

    `initial` holds displacements, then velocities; forces run linearly between their samples.
    """
    bodies = list(masses)
    n = len(bodies)
    mass = np.diag(list(masses.values()))
    stiffness, damping = np.zeros((n, n)), np.zeros((n, n))
    for _, ends, law, k, c in links:
        row = np.array([float(body == ends[0]) - float(body == ends[1]) for body in bodies])
        stiffness += (0.0 if law == "dashpot" else k) * np.outer(row, row)
        damping += c * np.outer(row, row)
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    entry = np.vstack([np.zeros((n, n)), inverse])
    samples = len(next(iter(force.values())))
    loads = np.stack([force.get(body, np.zeros(samples)) for body in bodies], axis=1)
    whole = (system, entry, np.eye(2 * n), np.zeros((2 * n, n)))
    time = np.arange(samples) / rate_hz
    _, state, _ = signal.lsim(whole, loads, time, X0=initial)
    acceleration = state @ system[n:].T + loads @ inverse.T
    out = {}
    for i, body in enumerate(bodies):
        out[f"displacement_{body}"] = state[:, i]
        out[f"velocity_{body}"] = state[:, n + i]
        out[f"acceleration_{body}"] = acceleration[:, i]
    return out


def pulse(peak: float, samples: int, rate_hz: float, at_s: float, length_s: float = 4e-3) -> np.ndarray:
    """Return a half-sine pulse."""
    phase = (np.arange(samples) / rate_hz - at_s) / length_s
    return np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)


def random_force(rng: np.random.Generator, samples: int, rate_hz: float, highest_hz: float) -> np.ndarray:
    """Return band-limited noise of unit size that begins and ends with nothing."""
    sections = signal.butter(6, highest_hz, fs=rate_hz, output="sos")
    force = signal.sosfiltfilt(sections, rng.normal(size=samples))
    return np.asarray(force / force.std() * signal.windows.tukey(samples, 0.1))


def noisy(rng: np.random.Generator, samples: np.ndarray, share: float) -> np.ndarray:
    """Return samples with white noise of a share of their own size."""
    return np.asarray(samples + rng.normal(0.0, share * samples.std(), samples.size))


def campaign(
    folder: Path,
    masses: Mapping[str, float | None],
    links: Sequence[LinkRow],
    records: Sequence[tuple[dict[str, Any], Mapping[str, np.ndarray]]],
    rate_hz: float,
    **others: Any,
) -> Campaign:
    """Write and read a campaign; `records` pairs a record's settings with its channels, all at one rate."""
    data: dict[str, Any] = {
        "format": "boltlaw-campaign/1",
        "name": "lumped",
        "body": [{"name": name} | ({} if m is None else {"mass_kg": m}) for name, m in masses.items()],
        "link": [{"name": name, "between": ends, "law": law} for name, ends, law, _, _ in links],
        "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": 0.0},
        "windows": {"initial_s": [0.0, 0.1], "final_s": [0.5, 8.0]},
        "record": [settings for settings, _ in records],
    } | others
    write_campaign(
        folder,
        CampaignSettings.model_validate(data),
        (
            (settings["file"], {name: Channel(name, np.asarray(x), rate_hz) for name, x in channels.items()})
            for settings, channels in records
        ),
    )
    return read_campaign(folder)
