"""Driven records whose input is the motion of the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rom
from discovery.loop.close_loop import close_loop
from rom.campaign.campaign import Campaign, CampaignError, CampaignSettings, write_campaign
from rom.campaign.channels import Channel
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from tests.rom.identification.test_values_of_records import identified_block
from tests.rom.lumped import LinkRow, campaign, noisy, respond

RATE_HZ, SAMPLES, FINE = 1000.0, 6000, 4
MASSES = {"a": 3.0, "b": 1.5}
LINKS: list[LinkRow] = [
    ("ga", ("a", "ground"), "linear", 9000.0, 12.0),
    ("ab", ("a", "b"), "linear", 6000.0, 5.0),
]


def shaken(
    folder: Path, kind: str, inputs: tuple[str, ...], bodies: int = 2, bolted: bool = False, **others: Any
) -> Campaign:
    """Bodies on a table that moves by a multisine of 1 to 30 Hz; the last record is held out."""
    rng, records = np.random.default_rng(6), []
    names, links = list(MASSES)[:bodies], LINKS[:bodies]
    time = np.arange(FINE * SAMPLES) / (FINE * RATE_HZ)
    omega = 2 * np.pi * np.arange(1.0, 30.0, 0.5)
    for i in range(4):
        size, phase = 0.02 / omega, rng.uniform(0, 2 * np.pi, len(omega))
        waves = np.multiply.outer(omega, time) + phase[:, None]
        ground = {
            "displacement": size @ np.sin(waves),
            "velocity": (size * omega) @ np.cos(waves),
            "acceleration": -(size * omega**2) @ np.sin(waves),
        }
        push = {name: -MASSES[name] * ground["acceleration"] for name in names}
        motion = respond({name: MASSES[name] for name in names}, links, push, FINE * RATE_HZ)
        shown = {}
        for name in names:
            absolute = motion[f"{kind}_{name}"] + ground[kind]
            shown[f"{kind}_{name}"] = noisy(rng, absolute[::FINE], 0.002)
        for quantity in inputs:
            shown[f"{quantity}_ground"] = noisy(rng, ground[quantity][::FINE], 0.001)
        if bolted:
            shown["tension"] = np.full(SAMPLES, 400.0)
        records.append(({"file": f"{i}.h5", "test": "driven", "hold_out": i == 3, **others}, shown))
    declared = [(n, ends, "bolted" if bolted and n == "ab" else law, k, c) for n, ends, law, k, c in links]
    bolt = {"bolt": {"link": "ab"}} if bolted else {}
    return campaign(folder, {name: MASSES[name] for name in names}, declared, records, RATE_HZ, **bolt)


def hold_out_error(model: rom.Model, of: Campaign) -> float:
    judged = evaluate([model], of, of.select(hold_out=True))
    error = summarise(one.comparisons[0] for one in judged)["motion_nrmse"]
    assert error is not None
    return error


@pytest.mark.parametrize(
    ("kind", "inputs"),
    [
        ("displacement", ("displacement", "acceleration")),
        ("velocity", ("displacement", "acceleration")),
        ("acceleration", ("acceleration",)),
    ],
)
@pytest.mark.parametrize("bolted", [False, True])
def test_two_bodies_on_a_table_that_moves(
    tmp_path: Path, kind: str, inputs: tuple[str, ...], bolted: bool
) -> None:
    found = shaken(tmp_path / "c", kind, inputs, bolted=bolted)
    model = rom.identify(found)
    for name, _, _, stiffness, damping in LINKS:
        assert model.parameter(f"{name}.stiffness.k").value == pytest.approx(stiffness, rel=0.01)
        assert model.parameter(f"{name}.damping.c").value == pytest.approx(damping, rel=0.03)
    assert hold_out_error(model, found) < 0.05


@pytest.mark.parametrize("inputs", [("displacement", "acceleration"), ("displacement",)])
def test_nothing_is_found_where_the_ground_explains_all(tmp_path: Path, inputs: tuple[str, ...]) -> None:
    table = shaken(tmp_path / "c", "displacement", inputs, bodies=1)
    found = close_loop(table)
    assert found.verdict == "no-effect"
    assert found.model.parameter("ga.stiffness.k").value == pytest.approx(9000.0, rel=0.01)
    error = found.steps[-1].errors["hold_out"]["motion_nrmse"]
    assert error is not None
    shown = table.load(table.settings.record[3]).channels
    x, ground = shown["displacement_a"].samples, shown["displacement_ground"].samples
    noise = np.hypot(0.002 * x.std(), 0.001 * ground.std()) / (x - ground).std()
    assert error < 1.5 * noise


def test_an_added_mass_is_pushed_by_the_ground_too(tmp_path: Path) -> None:
    """What a record gives is the mass that the ground pushes."""
    from rom.signals.measured_records import measured_record

    found = shaken(tmp_path / "c", "acceleration", ("acceleration",), bodies=1, mass_kg={"a": 4.5})
    plain = shaken(tmp_path / "plain", "acceleration", ("acceleration",), bodies=1)
    ours, theirs = (measured_record(c, c.settings.record[0]).measurement.force["a"] for c in (found, plain))
    np.testing.assert_allclose(ours, 1.5 * theirs)


def test_a_bolted_block_on_a_table_that_is_struck(tmp_path: Path) -> None:
    """A loosening test by a shock of the ground: what the block shows is its absolute acceleration."""
    hit, _, theirs = identified_block()
    settings, records = hit.settings.model_dump(exclude_none=True), []
    for record in hit.settings.record:
        channels = dict(hit.load(record).channels)
        if record.test == "loosening":
            mass = record.given.get("body.m.mass", 2.0)
            push = channels.pop("force_m").samples / -mass
            rate = hit.settings.sampling.motion_rate_hz
            shown = channels["acceleration_m"].samples + push
            channels["acceleration_ground"] = Channel("acceleration_ground", push, rate)
            channels["acceleration_m"] = Channel("acceleration_m", shown, rate)
        records.append((record.file, channels))
    write_campaign(tmp_path / "shaken", CampaignSettings.model_validate(settings), records)
    ours = rom.identify(rom.read_campaign(tmp_path / "shaken"))
    assert ours.identification is not None
    assert theirs.identification is not None
    for one, other in zip(ours.identification.gamma, theirs.identification.gamma, strict=True):
        assert one.file == other.file
        assert one.gamma == pytest.approx(other.gamma, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "inputs", "others", "words"),
    [
        (
            "displacement",
            ("acceleration",),
            {},
            ("acceleration_ground", "acceleration_a", "displacement_ground"),
        ),
        ("acceleration", (), {}, ("force_a", "found no force")),
        (
            "acceleration",
            ("acceleration",),
            {"test": "free"},
            ("acceleration_ground", "free record", "driven"),
        ),
    ],
)
def test_what_a_moving_ground_cannot_tell_is_refused(
    tmp_path: Path, kind: str, inputs: tuple[str, ...], others: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(CampaignError) as refusal:
        shaken(tmp_path / "c", kind, inputs, bodies=1, **others)
    assert all(word in refusal.value.faults[0] for word in words)
