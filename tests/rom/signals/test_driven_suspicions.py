"""Slips of units, signs and channels of driven records, told on several structures."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from rom.campaign.campaign import CampaignSettings, Record, RecordSettings, read_campaign
from rom.campaign.record import Channel
from tests.rom.lumped import respond
from tests.rom.signals.test_suspicions import (
    BLOCK,
    CHAIN,
    PAPER,
    STRUCTURES,
    Slip,
    Structure,
    exchanged,
    scaled,
    settings_of,
    told,
)
from tests.shared import measured

RATE_HZ, SAMPLES, G = 4096.0, 8192, 9.80665
RECORDS = 2


@cache
def campaign(of: Structure, motion: str = "acceleration", noise: float = 1.0) -> list[Record]:
    """Bodies driven by multisines of 5 to 400 Hz, of noise of 0.1 % and more of each channel."""
    rng, time = np.random.default_rng(5), np.arange(SAMPLES) / RATE_HZ
    return [_driven(of, motion, noise, rng, time, place) for place in range(RECORDS)]


def _driven(
    of: Structure, motion: str, noise: float, rng: np.random.Generator, time: np.ndarray, place: int
) -> Record:
    lines = np.arange(5.0, 400.0, 2.5)
    force = np.cos(2 * np.pi * np.outer(time, lines) + rng.uniform(0, 2 * np.pi, len(lines))).sum(axis=1)
    moved = respond(dict(of.masses), of.links, {of.struck: force}, RATE_HZ)
    rows = {f"force_{of.struck}": force} | {f"{motion}_{b}": moved[f"{motion}_{b}"] for b, _ in of.masses}
    channels = {
        name: Channel(name, y + 1e-3 * noise * y.std() * rng.standard_normal(SAMPLES), RATE_HZ)
        for name, y in rows.items()
    }
    kind = RecordSettings.model_validate({"file": f"records/{place}.h5", "test": "driven"})
    return Record(kind, channels, tuple(body for body, _ in of.masses))


def driven_settings(of: Structure, masses: bool = True) -> CampaignSettings:
    data = settings_of(of, masses).model_dump(exclude_none=True)
    del data["bolt"]
    data["link"] = [link | {"law": "linear"} for link in data["link"]]
    data["record"] = [{"file": "records/0.h5", "test": "driven"}]
    return CampaignSettings.model_validate(data)


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("noise", [0.3, 30.0])
@pytest.mark.parametrize("motion", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("masses", [True, False])
def test_a_sound_driven_campaign_is_not_accused(name: str, noise: float, motion: str, masses: bool) -> None:
    of = STRUCTURES[name]
    assert told(campaign(of, motion, noise), driven_settings(of, masses)) == ()


SLIPS: dict[str, tuple[Slip, float | None]] = {
    "acceleration in g": (scaled("acceleration", 1 / G), G),
    "acceleration in mg": (scaled("acceleration", 1e3 / G), G / 1e3),
    "force in kgf": (scaled("force", 1 / G), G),
    "force sign": (scaled("force", -1.0), -1.0),
    "channels exchanged": (exchanged, None),
}


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("likely", SLIPS)
@pytest.mark.parametrize("few", [(), (1,)])
def test_a_slip_of_driven_records_is_named_with_its_factor(
    name: str, likely: str, few: tuple[int, ...]
) -> None:
    of, (spoil, factor) = STRUCTURES[name], SLIPS[likely]
    if likely == "channels exchanged" and len(of.masses) == 1:
        pytest.skip("one body has one channel")
    found = told(campaign(of), driven_settings(of), spoil, few)
    assert {one.likely for one in found} == {likely}
    assert {one.record for one in found} == {f"records/{place}.h5" for place in few or range(RECORDS)}
    if factor is not None:
        assert [one.factor for one in found] == pytest.approx([factor] * len(found), rel=0.03)


@pytest.mark.parametrize(("of", "body"), [(PAPER, "lo"), *((CHAIN, body) for body in "abc")])
def test_one_channel_of_the_wrong_sign_is_told(of: Structure, body: str) -> None:
    """Not of a body so light that its sign would pass for a sensor's share of another's motion."""
    found = told(campaign(of), driven_settings(of), scaled(f"acceleration_{body}", -1.0))
    assert {(one.channel, one.likely) for one in found} == {(f"acceleration_{body}", "acceleration sign")}


@pytest.mark.parametrize("motion", ["acceleration", "velocity", "displacement"])
def test_the_sign_of_a_force_is_told_without_a_declared_mass(motion: str) -> None:
    records = campaign(BLOCK, motion)[:1]
    found = told(records, driven_settings(BLOCK, masses=False), scaled("force", -1.0))
    assert {(one.channel, one.likely) for one in found} == {("force_block", "force sign")}


MEASURED = ("bolted-double-beam", "cart-driven", "cart-free-decay", "clamp-at-rest", "friction-damper",
            "wing-driven-acceleration")  # fmt: skip


@pytest.mark.parametrize("name", MEASURED)
def test_campaigns_that_others_measured_are_not_accused(name: str) -> None:
    found = read_campaign(measured(f"others/{name}"), 1)
    assert told([found.load(record) for record in found.settings.record], found.settings) == ()


def test_a_measured_cart_with_its_force_reversed_is_told_without_its_mass() -> None:
    found = read_campaign(measured("others/cart-driven"), 1)
    records = [found.load(record) for record in found.settings.record]
    one = told(records, found.settings, scaled("force", -1.0))
    assert {(s.channel, s.likely) for s in one} == {("force_cart1", "force sign")}
    assert len(one) == len(records)


def test_points_that_add_up_to_no_sum_of_masses_are_not_accused_where_nobody_declares_masses() -> None:
    turned = scaled("acceleration_c", -1.0)  # as the tip of a beam moves in its second mode
    assert told(campaign(CHAIN), driven_settings(CHAIN, masses=False), turned) == ()
