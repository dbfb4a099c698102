"""A record in which nothing moves is set aside by name; where no other is left the command says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from rom.campaign.campaign import Campaign
from rom.identification.identify import identify_campaign
from rom.signals.measured_records import NothingLeftError
from tests.rom import lumped

RATE_HZ = 256.0
LINK: lumped.LinkRow = ("foot", ("a", "ground"), "linear", 6000.0, 3.0)


def driven(folder: Path, *sizes: float, noise_m: float = 0.0) -> Campaign:
    """Records of one body of unknown mass under forces of some sizes; of size 0 nothing moves."""
    rng, records = np.random.default_rng(1), []
    for place, size in enumerate(sizes):
        force = size * lumped.random_force(rng, 1024, RATE_HZ, 15.0)
        moved = lumped.respond({"a": 2.0}, [LINK], {"a": force}, RATE_HZ)
        shown = moved["displacement_a"] + noise_m * rng.normal(size=len(force))
        channels = {"displacement_a": shown, "force_a": force}
        records.append(({"file": f"{place}.h5", "test": "driven"}, channels))
    return lumped.campaign(folder, {"a": None}, [LINK], records, RATE_HZ)


@pytest.mark.parametrize("noise_m", [0.0, 1e-6])
def test_a_still_record_is_set_aside_and_changes_no_number(noise_m: float, tmp_path: Path) -> None:
    """Also where its sensor has noise."""
    found = identify_campaign(driven(tmp_path / "with", 1.0, 0.0, noise_m=noise_m))
    assert [doubt.file for doubt in found.set_aside] == ["1.h5"]
    assert float(found.model.link_laws["foot"].stiffness(0.0)) == pytest.approx(6000.0, rel=2e-2)


def test_nothing_but_still_records_is_said(tmp_path: Path) -> None:
    with pytest.raises(NothingLeftError, match="nothing moves"):
        rom.identify(driven(tmp_path / "still", 0.0), jobs=1)


@pytest.mark.parametrize("noise_share", [0.0, 0.3])
def test_a_decay_without_force_moves(noise_share: float, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    moved = lumped.respond({"a": 2.0}, [LINK], {"a": np.zeros(1024)}, RATE_HZ, np.array([0.01, 0.0]))
    shown = lumped.noisy(rng, moved["displacement_a"], noise_share)
    channels = {"displacement_a": shown, "force_a": np.zeros(1024)}
    campaign = lumped.campaign(
        tmp_path / "c", {"a": 2.0}, [LINK], [({"file": "0.h5", "test": "driven"}, channels)], RATE_HZ
    )
    assert not identify_campaign(campaign).set_aside
