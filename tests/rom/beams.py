"""A cantilever by its bending modes, and campaigns of its accelerometers; not the model's code.

Modes above the band are there too. A cubic spring may act in one mode.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import signal

import rom
from rom.campaign.campaign import Campaign
from rom.campaign.channels import Channel
from rom.campaign.record import write_channels

RATE_HZ, SECONDS, FINER = 256.0, 2.0, 16
FREQUENCY = np.array([6.5, 40.7, 114.0])  # [Hz]
RATIO = np.array([0.006, 0.004, 0.005])
PLACES = {"root": 0.3, "middle": 0.55, "outer": 0.8, "tip": 1.0}
DRIVE = "middle"
MASS = 0.24  # of every mode, at the tip [kg]
BAND = (3.0, 62.0)
_ROOTS = np.array([1.8751, 4.6941, 7.8548])


def shapes() -> np.ndarray:
    """Shapes of the three modes at all places, 1 at the tip, (places, modes)."""
    ratio = (np.cosh(_ROOTS) + np.cos(_ROOTS)) / (np.sinh(_ROOTS) + np.sin(_ROOTS))
    x = np.outer(list(PLACES.values()), _ROOTS)
    found = np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))
    return np.asarray(found / found[-1])


def _oscillator(mode: int, force: np.ndarray, start: float, cubic: float) -> np.ndarray:
    """Acceleration of a modal coordinate from a displacement, by exact linear steps, finer than samples."""
    omega, ratio, step = 2 * np.pi * FREQUENCY[mode], RATIO[mode], 1 / (RATE_HZ * FINER)
    system = np.array([[0, 1], [-(omega**2), -2 * ratio * omega]])
    ahead, by, *_ = signal.cont2discrete((system, np.array([[0], [1]]), np.eye(2), np.zeros((2, 1))), step)
    (a, b, c, d), (e, f) = ahead.ravel().tolist(), by.ravel().tolist()
    x, v, found = start, 0.0, []
    push = (signal.resample(force, len(force) * FINER) / MASS).tolist()
    for k, now in enumerate(push):
        g = now - cubic / MASS * x**3
        if k % FINER == 0:
            found.append(g - omega**2 * x - 2 * ratio * omega * v)
        after = a * x + b * v + e * g
        g = 0.5 * (g + push[min(k + 1, len(push) - 1)] - cubic / MASS * after**3)
        x, v = a * x + b * v + e * g, c * x + d * v + f * g
    return np.array(found)


def accelerations(
    force: np.ndarray, start: np.ndarray, cubic: tuple[float, ...] = (0, 0, 0), drive: str = DRIVE
) -> np.ndarray:
    """Accelerations at all places, (places, samples), from displacements of the modes at the tip."""
    at_drive = shapes()[list(PLACES).index(drive)]
    rows = [_oscillator(m, at_drive[m] * force, float(start[m]), cubic[m]) for m in range(len(FREQUENCY))]
    return np.asarray(shapes() @ np.stack(rows))


def campaign(
    folder: Path,
    noise: float = 0.005,
    seed: int = 0,
    cubic: tuple[float, ...] = (0, 0, 0),
    count: int = 2,
    each: int = 2,
    drives: tuple[str, ...] = (DRIVE,),
    without: tuple[str, ...] = (),
    force_noise: float = 0.0,
) -> Campaign:
    """Write and read driven records, as many decays, and one of each held out.

    Parameters
    ----------
    folder : Path
        New folder.
    noise : float
        Standard deviation of the noise over the channel's RMS.
    seed : int
        Of all that is drawn.
    cubic : tuple of float
        Cubic stiffness of each mode at the tip [N/m3].
    count : int
        Modes that are declared.
    each : int
        Driven records, and decays, that are not held out.
    drives : tuple of str
        Where driven records are driven, by turns.
    without : tuple of str
        Places where no accelerometer stands.
    force_noise : float
        Standard deviation of the noise of a force's channel over its RMS.
    """
    rng, samples = np.random.default_rng(seed), int(SECONDS * RATE_HZ)
    (folder / "records").mkdir(parents=True)
    text = ['format = "boltlaw-campaign/1"', 'name = "beam"', "[modes]", f"count = {count}",
            "[band]", f"low_hz = {BAND[0]}", f"high_hz = {BAND[1]}",
            "[sampling]", f"motion_rate_hz = {RATE_HZ}", "pretrigger_s = 0"]  # fmt: skip
    sections = signal.butter(4, (2.0, 70.0), "bandpass", fs=RATE_HZ, output="sos")
    for place, kind in enumerate((*each * ["driven"], *each * ["free"], "driven", "free")):
        force, start, drive = np.zeros(samples), np.zeros(3), drives[place % len(drives)]
        if kind == "driven":
            force = signal.sosfiltfilt(sections, rng.normal(size=samples)) * signal.windows.tukey(
                samples, 0.1
            )
            force *= rng.uniform(1.5, 3.0) / force.std()
        else:
            start = rng.uniform(0.5, 1.0, 3) * np.array([8e-3, 6e-4, 1e-4]) * rng.choice([-1, 1], 3)
        rows = accelerations(force, start, cubic, drive)
        rows = rows + noise * rows.std(axis=1, keepdims=True) * rng.normal(size=rows.shape)
        channels = {f"acceleration_{p}": row for p, row in zip(PLACES, rows, strict=True) if p not in without}
        if kind == "driven":
            of_channel = force_noise * force.std() * rng.normal(size=samples) if force_noise else 0.0
            channels[f"force_{drive}"] = force + of_channel
        write_channels(
            folder / "records" / f"{place}.h5", {n: Channel(n, x, RATE_HZ) for n, x in channels.items()}
        )
        text += ["[[record]]", f'file = "records/{place}.h5"', f'test = "{kind}"',
                 f"hold_out = {str(place >= 2 * each).lower()}"]  # fmt: skip
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    return rom.read_campaign(folder)
