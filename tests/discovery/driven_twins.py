"""Twins of driven and cycled campaigns, integrated here with own code, and measured sets as campaigns."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io

import rom
from rom.campaign.campaign import CampaignSettings, write_campaign
from rom.campaign.channels import Channel, FloatArray

RATE_HZ, RECORDS, SUBSTEPS = 500.0, 4, 4
CYCLED_HZ = 200.0
Extra = Callable[[FloatArray, FloatArray], FloatArray]
Records = Mapping[str, tuple[str, bool, Mapping[str, FloatArray], float]]


def nothing(_x: FloatArray, v: FloatArray) -> FloatArray:
    """No force beyond the declared ones."""
    return np.zeros_like(v)


def campaign_of(
    folder: Path, body: str, link: str, law: str, records: Records, mass_kg: float | None = None
) -> rom.Campaign:
    """Write and read a campaign of one body on one link to ground; its mass is unknown by default."""
    rates = {rate for *_, rate in records.values()}
    settings: dict[str, Any] = {
        "format": "boltlaw-campaign/1",
        "name": folder.name,
        "body": [{"name": body} if mass_kg is None else {"name": body, "mass_kg": mass_kg}],
        "link": [{"name": link, "between": [body, "ground"], "law": law}],
        "sampling": {"motion_rate_hz": max(rates), "tension_rate_hz": max(rates), "pretrigger_s": 0.0},
        "record": [
            {"file": file, "test": test, "hold_out": held} for file, (test, held, _, _) in records.items()
        ],
    }
    channels = (
        (file, {name: Channel(name, samples, rate) for name, samples in shown.items()})
        for file, (_, _, shown, rate) in records.items()
    )
    write_campaign(folder, CampaignSettings.model_validate(settings), channels)
    return rom.read_campaign(folder)


def driven(
    folder: Path,
    *,
    stiffness: float = 8000.0,
    offset: float = 0.0,
    extra: Extra = nothing,
    seed: int = 1,
    sizes: Sequence[float] = (1.0,) * RECORDS,
    given_kg: float | None = None,
    gain: float = 0.0,
    noise_m: float = 2e-6,
    kind: str = "displacement",
    force_noise_n: float = 0.02,
    seconds: float = 5.0,
) -> rom.Campaign:
    """A body of 2 kg, 6 N s/m and some stiffness under multisines of 1 to 40 Hz.

    Sensors have noise of ``force_noise_n`` and ``noise_m``, of other motions what that is at 10 Hz.
    The last record is held out. Forces are ``sizes`` times the usual one, record by record; the force sensor
    shows ``gain`` too much, and the campaign tells the mass where one is given.
    """
    count = len(sizes)
    rng, fine_s = np.random.default_rng(seed), 1 / (RATE_HZ * SUBSTEPS)
    steps = int(seconds * RATE_HZ) * SUBSTEPS
    time = np.arange(2 * steps + 1) * fine_s / 2
    lines = np.arange(1.0, 40.0, 0.5)
    phases = rng.uniform(0, 2 * np.pi, (count, len(lines)))
    force = (
        np.stack([np.cos(2 * np.pi * np.outer(time, lines) + p).sum(axis=1) for p in phases], axis=1)
        * 3.0
        * np.asarray(sizes)
    )

    def rates(x: FloatArray, v: FloatArray, at: int) -> tuple[FloatArray, FloatArray]:
        return v, (force[at] + offset - 6.0 * v - stiffness * x - extra(x, v)) / 2.0

    x, v = np.zeros(count), np.zeros(count)
    order = ("displacement", "velocity", "acceleration").index(kind)
    shown = np.empty((steps // SUBSTEPS, count))
    for step in range(steps):
        a = rates(x, v, 2 * step)
        if step % SUBSTEPS == 0:
            shown[step // SUBSTEPS] = (x, *a)[order]
        b = rates(x + fine_s / 2 * a[0], v + fine_s / 2 * a[1], 2 * step + 1)
        c = rates(x + fine_s / 2 * b[0], v + fine_s / 2 * b[1], 2 * step + 1)
        d = rates(x + fine_s * c[0], v + fine_s * c[1], 2 * step + 2)
        x, v = (
            y + fine_s / 6 * (p + 2 * q + 2 * r + s) for y, p, q, r, s in zip((x, v), a, b, c, d, strict=True)
        )
    shown += noise_m * (20 * np.pi) ** order * rng.normal(size=shown.shape)
    forces = (1 + gain) * force[: 2 * steps : 2 * SUBSTEPS] + force_noise_n * rng.normal(size=shown.shape)
    records = {
        f"run_{k}.h5": (
            "driven", k == count - 1,
            {"force_mass": forces[:, k], f"{kind}_mass": shown[:, k]}, RATE_HZ,
        )
        for k in range(count)
    }  # fmt: skip
    law = "linear" if stiffness else "dashpot"
    return campaign_of(folder, "mass", "guide", law, records, given_kg)


def cycled(folder: Path, friction: float, seed: int = 1, seconds: float = 30.0) -> rom.Campaign:
    """A contact of 2e4 N/m and 50 N s/m over slow cycles of growing stroke; beside it a slider of 1e4 N/m and
    ``friction`` times the normal force, in steps of its own law: it sticks or slips.
    """
    rng, records = np.random.default_rng(seed), {}
    for file, held in (("first.h5", False), ("second.h5", True)):
        time = np.arange(-int(8 * CYCLED_HZ), int(seconds * CYCLED_HZ)) / CYCLED_HZ
        x = 1e-4 * (0.4 + 0.6 * time / seconds) * np.sin(2 * np.pi * 0.5 * time + rng.uniform(0, 6))
        normal = 5.0 + np.sin(2 * np.pi * 0.07 * time + rng.uniform(0, 6))
        slider, forces = 0.0, np.empty_like(x)
        for k, step in enumerate(np.diff(x, prepend=x[0])):
            slider = float(np.clip(slider + 1e4 * step, -friction * normal[k], friction * normal[k]))
            forces[k] = slider
        forces += 2e4 * x + 50.0 * np.gradient(x, 1 / CYCLED_HZ) + 2e-3 * rng.normal(size=len(x))
        channels = {
            "link_displacement_contact": x + 1e-9 * rng.normal(size=len(x)),
            "link_force_contact": forces,
            "normal_force_contact": normal,
        }
        shown = {name: samples[time >= 0] for name, samples in channels.items()}  # cut from a longer run
        records[file] = ("cycled", held, shown, CYCLED_HZ)
    return campaign_of(folder, "slider", "contact", "linear", records)


def emps(source: Path, folder: Path) -> rom.Campaign:
    """The electro-mechanical positioning system: one run to fit, one with pulses held out."""
    records = {}
    for name, held in (("DATA_EMPS", False), ("DATA_EMPS_PULSES", True)):
        data = io.loadmat(source / f"{name}.mat")
        shown = {
            "force_carriage": data["gtau"].item() * data["vir"].ravel(),
            "displacement_carriage": data["qm"].ravel(),
        }
        records[f"{name}.h5"] = ("driven", held, shown, 1000.0)
    return campaign_of(folder, "carriage", "guide", "dashpot", records)


def silverbox(source: Path, folder: Path, parts: Sequence[int] = range(11)) -> rom.Campaign:
    """The electronic Duffing oscillator: the first 40000 samples and the last of ten parts are held out."""
    data, rate = io.loadmat(source / "SNLS80mV.mat"), 1e7 / 2**14
    force, motion = data["V1"].ravel(), data["V2"].ravel()
    edges = [0, *np.linspace(40_000, len(force), 11).astype(int).tolist()]
    records = {
        f"part_{k:02d}.h5": (
            "driven", k in (0, 10),
            {"force_oscillator": force[a:b], "displacement_oscillator": motion[a:b]}, rate,
        )
        for k, (a, b) in enumerate(itertools.pairwise(edges)) if k in parts
    }  # fmt: skip
    return campaign_of(folder, "oscillator", "spring", "linear", records)


def tribometer(source: Path, folder: Path, share: float = 1.0) -> rom.Campaign:
    """A reciprocating contact; of a share of its evenly sampled rows the last two fifths are held out."""
    rows = np.genfromtxt(source / "test_data_2.txt", skip_header=1)
    jumps = np.flatnonzero(np.abs(np.diff(rows[:, 0]) - 0.005) > 1e-6)
    rows = rows[int(jumps[-1]) + 1 if len(jumps) and jumps[-1] < len(rows) / 10 else 0 :]
    rows = rows[: int(share * len(rows))]
    cut = int(0.6 * len(rows))
    middle = (rows[:cut, 2].min() + rows[:cut, 2].max()) / 2
    records = {
        file: (
            "cycled", held,
            {
                "link_displacement_contact": 1e-3 * (part[:, 2] - middle),
                "link_force_contact": -1e-6 * part[:, 3],
                "normal_force_contact": 1e-6 * part[:, 1],
            },
            200.0,
        )
        for file, held, part in (("training.h5", False, rows[:cut]), ("hold_out.h5", True, rows[cut:]))
    }  # fmt: skip
    return campaign_of(folder, "slider", "contact", "linear", records)
