"""Simulated campaigns of other bolted structures than the paper's: a block on one joint, a chain of three."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rom.campaign.campaign import Campaign, CampaignSettings, read_campaign, write_campaign
from rom.campaign.channels import Channel, FloatArray
from rom.model.description import LinkLaws
from rom.model.laws import (
    constant_damping,
    constant_stiffness,
    logistic_damping,
    logistic_loosening,
    logistic_stiffness,
)
from rom.model.model import Model
from rom.model.structure import Body, Link, Structure
from rom.signals.calibration import Calibration

RATE_HZ, SAMPLES, HIT_S = 9600.0, 9600, 0.2
STIFFNESS, ALPHA, GAMMA_D = 9e5, -0.03, 11.0
CUBIC = (2718.7, 2363.7, -575.63)  # rises up to a strain of 3.226, to 14 kN
JOINT = {
    "k_i": STIFFNESS, "alpha": ALPHA, "beta": 8.0, "c_d": 900.0, "c_i": 800.0, "eta": -0.008,
    "gamma_d": GAMMA_D, "gamma_i": 7.5, "rho": -0.004,
}  # fmt: skip
_JOINT = LinkLaws(
    logistic_stiffness(*(JOINT[name] for name in ("k_i", "alpha", "beta"))),
    logistic_damping(*(JOINT[name] for name in ("c_d", "c_i", "eta"))),
    logistic_loosening(*(JOINT[name] for name in ("gamma_d", "gamma_i", "rho"))),
)
_MODELS = {
    "block": (
        Structure((Body("block", 8.0),), (Link("joint", "block", "ground", "bolted"),)),
        {"joint": _JOINT},
    ),
    "chain": (
        Structure(
            (Body("a", 6.0), Body("b", 1.5), Body("c", 0.9)),
            (Link("wall", "a", "ground"), Link("joint", "a", "b", "bolted"), Link("end", "b", "c")),
        ),
        {
            "wall": LinkLaws(constant_stiffness(9e3), constant_damping(8.0)),
            "joint": _JOINT,
            "end": LinkLaws(constant_stiffness(2e5), constant_damping(15.0)),
        },
    ),
}


def bolted_campaign(
    folder: Path,
    name: str,
    preloads: Sequence[float],
    offset: float = 0.0,
    strain: float | None = None,
    noise: float = 1.0,
    rate_hz: float = RATE_HZ,
) -> Campaign:
    """Write a small and a loosening hit for each preload, every third of the latter held out, and read them.

    Parameters
    ----------
    folder : Path
        Where to write.
    name : str
        "block" or "chain"; the first body is struck.
    preloads : sequence of float
        Tensions before the hits [N].
    offset : float
        What the accelerometers show at rest [m/s2].
    strain : float, optional
        With it the gauge shows a strain, this many times what the cubic calibration takes for the tension.
    noise : float
        Multiplies the noise of all channels.
    rate_hz : float
        Of all channels [Hz].

    Returns
    -------
    Campaign
        The campaign.
    """
    structure, laws = _MODELS[name]
    model, rng = Model(structure=structure, link_laws=laws), np.random.default_rng(1)
    count = round(SAMPLES / RATE_HZ * rate_hz)

    def white(deviation: float) -> FloatArray:
        return noise * deviation * rng.standard_normal(count)

    time, struck = np.arange(count) / rate_hz, structure.bodies[0].name
    grid = np.linspace(-0.4, 3.2, 100_000)
    rows, files = [], []
    for place, preload in enumerate(preloads):
        for test, peak, length in (("coupled", 25.0, 2e-3), ("loosening", 700.0, 1.3e-3)):
            inside = (time > HIT_S) & (time < HIT_S + length)
            force = np.where(inside, peak * np.sin(np.pi * (time - HIT_S) / length), 0.0)
            moved = model.simulate({struck: force}, rate_hz=rate_hz, initial_tension=float(preload))
            channels = {f"force_{struck}": force + white(0.02)}
            for body in structure.bodies:
                channels[f"acceleration_{body.name}"] = (
                    moved.acceleration[body.name] + offset + white(2e-5 * peak)
                )
            tension = np.asarray(moved.tension) + white(0.01)
            if strain is None:
                channels["tension"] = tension
            else:
                channels["strain"] = strain * np.interp(tension, Calibration(CUBIC).tension(grid), grid)
            held = test == "loosening" and place % 3 == 2
            row = {"file": f"{test}_{place}.h5", "test": test, "preload_n": float(preload), "hold_out": held}
            rows.append(row)
            files.append({key: Channel(key, values, rate_hz) for key, values in channels.items()})
    data = {
        "format": "boltlaw-campaign/1",
        "name": name,
        "body": [{"name": body.name, "mass_kg": body.mass} for body in structure.bodies],
        "link": [{"name": x.name, "between": [x.first, x.second], "law": x.law} for x in structure.links],
        "bolt": {"link": "joint"} | ({} if strain is None else {"calibration": CUBIC}),
        "sampling": {"motion_rate_hz": rate_hz, "tension_rate_hz": rate_hz, "pretrigger_s": HIT_S},
        "windows": {"initial_s": [0.0, 0.15], "final_s": [0.6, 1.0]},
        "record": rows,
    }
    settings = CampaignSettings.model_validate(data)
    write_campaign(folder, settings, ((row["file"], file) for row, file in zip(rows, files, strict=True)))  # type: ignore[misc]
    return read_campaign(folder)
