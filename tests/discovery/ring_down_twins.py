"""Ring-downs whose truth is known: one body on a spring, released or struck, no force measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

import rom
from rom.campaign.campaign import Campaign
from rom.campaign.channels import Channel
from rom.campaign.record import write_channels
from rom.effects import CATALOGUE
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure

RATE_HZ, SECONDS = 200.0, 1.5
MASS, STIFFNESS, DAMPING = 1.5, 900.0, 0.7
AMPLITUDES = (0.02, 0.028, 0.017)  # the last one is held out
EFFECTS = {
    "amplitude-stiffness": {"alpha": 0.2, "c_x": 60.0, "x_s": 0.005, "q": 1.2},
    "coulomb-friction": {"F_c": 0.15, "mu": 0.0, "v_s": 1e-3},
    "cubic-stiffness": {"k3": 2e5},
    "quadratic-damping": {"c2": 3.0},
}


def free(
    folder: Path,
    effect: str = "",
    kind: str = "displacement",
    noise: float = 0.003,
    seed: int = 0,
    seconds: float = SECONDS,
    numbers: Mapping[str, float] | None = None,
) -> Campaign:
    """Write a campaign; the noise is a share of each channel's RMS.

    Parameters
    ----------
    folder : Path
        New folder.
    effect : str
        What the declared model lacks; empty for nothing.
    kind : str
        Measured quantity.
    noise : float
        Standard deviation of the noise over the channel's RMS.
    seed : int
        Of the noise and of the initial velocities.
    seconds : float
        Length of a record [s].
    numbers : mapping of str to float, optional
        Of the effect; those above if not given.
    """
    rng, count = np.random.default_rng(seed), int(seconds * RATE_HZ)
    model = Model(
        Structure((Body("m", MASS),), (Link("s", "m", "ground", "linear"),)),
        {"s": LinkLaws(constant_stiffness(STIFFNESS), constant_damping(DAMPING))},
    )
    if effect:
        own = EFFECTS[effect] if numbers is None else numbers
        model = model.with_effect(CATALOGUE[effect].at("s", ground=True).with_values(**own))
    (folder / "records").mkdir(parents=True)
    text = [
        'format = "boltlaw-campaign/1"', 'name = "twin"', "[[body]]", 'name = "m"', f"mass_kg = {MASS}",
        "[[link]]", 'name = "s"', 'between = ["m", "ground"]', 'law = "linear"',
        "[sampling]", f"motion_rate_hz = {RATE_HZ}", "pretrigger_s = 0",
    ]  # fmt: skip
    for place, amplitude in enumerate(AMPLITUDES):
        start = {"m": amplitude}, {"m": float(rng.normal(0, amplitude * 10))}
        response = model.simulate({"m": np.zeros(count)}, RATE_HZ, None, *start)
        samples = getattr(response, kind)["m"]
        samples = samples + rng.normal(0, noise * np.sqrt(np.mean(samples**2)), count)
        name, held = f"{kind}_m", str(place + 1 == len(AMPLITUDES)).lower()
        write_channels(folder / "records" / f"{place}.h5", {name: Channel(name, samples, RATE_HZ)})
        text += ["[[record]]", f'file = "records/{place}.h5"', 'test = "free"', f"hold_out = {held}"]
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    return rom.read_campaign(folder)
