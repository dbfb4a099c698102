"""Twins of links and drives that slip, rattle, or differ for the two directions, made here with own code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rom
from rom.campaign.channels import FloatArray
from tests.discovery.driven_twins import campaign_of

RATE_HZ, LEAD_S, SECONDS = 200.0, 3.0, 3.0
STROKES = ((0.6, False), (1.0, False), (0.8, True), (1.4, False))  # of 10 mm, and whether held out
KINDS = ("nothing", "slip", "backlash", "friction", "stiffness")


def cycled(folder: Path, kind: str, noise: float = 0.01, seed: int = 1) -> rom.Campaign:
    """A link of 2e4 N/m and 40 N s/m, and beside it what ``kind`` says, over cycles of about 0.5 Hz.

    ``noise`` is that of the force sensor over its standard deviation.
    """
    rng, records = np.random.default_rng(seed), {}
    for number, (stroke, held) in enumerate(STROKES):
        time = np.arange(-int(LEAD_S * RATE_HZ), int(SECONDS * RATE_HZ)) / RATE_HZ
        phase, rate = rng.uniform(0, 6), 0.5 * rng.uniform(0.7, 1.4)
        x = 1e-2 * stroke * (0.8 + 0.2 * np.sin(0.3 * time)) * np.sin(2 * np.pi * rate * time + phase)
        v = np.gradient(x, 1 / RATE_HZ)
        force = 2e4 * x + 40.0 * v + _added(kind, x, v)
        shown = force + noise * force.std() * rng.normal(size=len(x))
        channels = {
            "link_displacement_damper": x + 1e-7 * rng.normal(size=len(x)),
            "link_force_damper": shown,
        }
        kept = {name: samples[time >= 0] for name, samples in channels.items()}  # cut from a longer run
        records[f"run_{number}.h5"] = ("cycled", held, kept, RATE_HZ)
    return campaign_of(folder, "rod", "damper", "linear", records, 1.0)


def _added(kind: str, x: FloatArray, v: FloatArray) -> FloatArray:
    if kind == "slip":
        return _slider(x, 4e5, 600.0, 0.0)
    if kind == "backlash":
        return _slider(x, 6e5, 600.0, 1.5e-3)
    if kind == "friction":
        return np.where(v > 0, 400.0, 150.0) * np.tanh(v / 2e-3)
    if kind == "stiffness":
        return 8e3 * np.abs(x)
    return np.zeros_like(x)


def _slider(x: FloatArray, stiffness: float, limit: float, gap: float) -> FloatArray:
    """A spring behind a gap of some width, on a slider: the spring's stretch follows until the limit."""
    reach, stretch, found = limit / stiffness + gap / 2, 0.0, np.empty_like(x)
    for k, step in enumerate(np.diff(x, prepend=x[0])):
        stretch = float(np.clip(stretch + step, -reach, reach))
        found[k] = stiffness * max(abs(stretch) - gap / 2, 0.0) * np.sign(stretch)
    return found


def bursts(
    folder: Path,
    *,
    gain: float = 0.0,
    dead: float = 0.0,
    friction: tuple[float, float] = (0.0, 0.0),
    noise: float = 0.01,
    seed: int = 1,
) -> rom.Campaign:
    """A cart of 0.8 kg on a spring of 700 N/m, driven by steps of random height; the last run is held out.

    The force channel shows ``1 + gain`` times what pushes and ``1 - gain`` times what pulls, and ``dead`` [N]
    beyond it; ``friction`` [N] is that of the two directions.
    """
    rng, records, substeps = np.random.default_rng(seed), {}, 10
    for number in range(3):
        count = int(6.0 * RATE_HZ)
        heights = np.repeat(rng.normal(0, 3.0, count // 20), 20)
        heights[-count // 4 :] = 0.0
        rise = np.exp(-np.arange(0, 0.1, 1 / (RATE_HZ * substeps)) / 0.01)
        fine = np.convolve(np.repeat(heights, substeps), rise / rise.sum())[: count * substeps]
        x, v, step, motion = 0.0, 0.0, 1 / (RATE_HZ * substeps), np.empty(count)
        for k, force in enumerate(fine):
            if k % substeps == 0:
                motion[k // substeps] = x
            level = friction[0] if v > 0 else friction[1]
            v += step * (force - 700.0 * x - 2.0 * v - level * np.tanh(v / 5e-3)) / 0.8
            x += step * v
        true = fine[::substeps]
        shown = true * (1 + gain * np.sign(true)) + dead * np.sign(true) * (np.abs(true) > 1e-3)
        channels = {
            "force_cart": shown + noise * true.std() * rng.normal(size=count),
            "displacement_cart": motion + noise * 2e-3 * motion.std() * rng.normal(size=count),
        }
        records[f"burst_{number}.h5"] = ("driven", number == 2, channels, RATE_HZ)
    return campaign_of(folder, "cart", "spring", "linear", records)
