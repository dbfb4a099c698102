"""Resonances without a mode of the declared structure are told, and starts far off do not mislead a fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rom.campaign.campaign import Campaign
from rom.identification.identify import identify_campaign
from tests.rom.lumped import LinkRow, campaign, noisy, pulse, respond
from tests.rom.lumped_hidden import with_hidden_mode

RATE_HZ, SAMPLES = 2000.0, 6000
MASSES = {"a": 3.0, "b": 0.8}
LINKS: list[LinkRow] = [
    ("wall", ("a", "ground"), "linear", 9e3, 6.0), ("tie", ("a", "b"), "linear", 6e4, 4.0),
]  # fmt: skip


def hits(folder: Path, noise: float, **starts: float) -> Campaign:
    """Two bodies, struck in turn, with declared starting stiffnesses."""
    random, records = np.random.default_rng(4), []
    for place in range(4):
        struck = "ab"[place % 2]
        force = pulse(80.0, SAMPLES, RATE_HZ, 0.3, 5e-3)
        moved = respond(MASSES, LINKS, {struck: force}, RATE_HZ)
        shown = {f"acceleration_{b}": noisy(random, moved[f"acceleration_{b}"], noise) for b in MASSES}
        records.append(({"file": f"{place}.h5", "test": "coupled"}, {f"force_{struck}": force, **shown}))
    sampling: dict[str, Any] = {"motion_rate_hz": RATE_HZ, "pretrigger_s": 0.25}
    found = campaign(folder / "hits", MASSES, LINKS, records, RATE_HZ, sampling=sampling)
    links = [
        link.model_copy(update={"stiffness_n_per_m": starts.get(link.name)}) for link in found.settings.link
    ]
    return replace(found, settings=found.settings.model_copy(update={"link": tuple(links)}))


def test_a_mode_that_no_body_stands_for_is_told(tmp_path: Path) -> None:
    found = identify_campaign(with_hidden_mode(tmp_path / "all", "coupled", "acceleration", band=False))
    assert found.linear is not None
    (one,) = found.linear.unexplained
    assert one.frequency_hz == pytest.approx(130 * np.sqrt(1 + 0.3 / 2), rel=0.05)
    assert any(
        "m in coupled tests" in line and "declared structure has no mode" in line for line in found.warnings
    )
    within = identify_campaign(with_hidden_mode(tmp_path / "band", "coupled", "acceleration", band=True))
    assert within.linear is not None
    assert within.linear.unexplained == ()


@pytest.mark.parametrize("noise", [0.003, 0.1, 1.0])
def test_modes_that_are_declared_are_not(tmp_path: Path, noise: float) -> None:
    linear = identify_campaign(hits(tmp_path, noise)).linear
    assert linear is not None
    assert linear.unexplained == ()


@pytest.mark.parametrize("factor", [1e-4, 1e5])
def test_a_start_far_off_is_told_and_not_followed(tmp_path: Path, factor: float) -> None:
    found = identify_campaign(hits(tmp_path, 0.01, tie=factor * 6e4, wall=2 * 9e3))
    assert found.linear is not None
    assert found.linear.value("tie.stiffness") == pytest.approx(6e4, rel=0.01)
    assert found.linear.value("wall.stiffness") == pytest.approx(9e3, rel=0.01)
    assert [line.partition(":")[0] for line in found.warnings if "stiffness_n_per_m" in line] == ["link tie"]
