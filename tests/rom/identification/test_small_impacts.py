"""Small impacts that lose tension are told, and those whose gauge shows noise alone are not."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

import rom
from rom.identification.identify import Identification
from rom.identification.reduce import Tensions
from rom.identification.small_impacts import losses_of_small_impacts

PRELOADS = np.geomspace(6.0, 3000.0, 12)
SLOPES = np.sqrt(2718.7**2 + 4 * 2363.7 * PRELOADS)


def told(strain: Any, lost: Any = 0.0, test: str = "coupled") -> list[str]:
    """What is said of coupled tests whose gauge moves by so much strain and whose bolt loses so much [N]."""
    finals = PRELOADS - SLOPES * np.asarray(strain) - lost
    records: Any = [
        SimpleNamespace(
            settings=SimpleNamespace(file=f"records/{place}.h5", test=test),
            tensions=Tensions(*numbers),
        )
        for place, numbers in enumerate(
            zip(PRELOADS, finals, 0 * PRELOADS, 0 * PRELOADS, SLOPES, strict=True)
        )
    ]
    return list(losses_of_small_impacts(records))


def test_noise_of_a_gauge_is_hardly_ever_called_a_loss() -> None:
    """A share of 0.004 of campaigns is expected; 0.01 would be 6 standard errors above it."""
    rng = np.random.default_rng(0)
    warned = [bool(told(1e-5 * rng.standard_normal(12))) for _ in range(2000)]
    assert 0.0 < np.mean(warned) < 0.01


def test_a_gauge_without_noise_is_judged_without_a_division_by_zero() -> None:
    lost = np.zeros(12)
    assert told(0.0) == []
    lost[4] = 1e-10
    assert told(0.0, lost) == []
    lost[4] = 2.5
    (line,) = told(0.0, lost)
    assert line.startswith("records/4.h5: loses 2.5 N")


@pytest.mark.parametrize(("sign", "way"), [(1.0, "lose"), (-1.0, "gain")])
def test_changes_in_one_direction_are_told(sign: float, way: str) -> None:
    rng = np.random.default_rng(1)
    (line,) = told(sign * 1e-5 * (3.0 + rng.standard_normal(12)))
    assert f"coupled tests {way} tension alike" in line
    assert told(sign * 1e-5 * (3.0 + rng.standard_normal(12)), test="loosening") == []


def test_one_test_that_loosens_is_named_with_its_loss() -> None:
    rng = np.random.default_rng(2)
    lost = np.zeros(12)
    lost[4] = 2.5
    (line,) = told(1e-5 * rng.standard_normal(12), lost)
    told_n = re.match(r"records/4.h5: loses (\S+) N where other coupled tests", line)
    assert told_n is not None
    assert float(told_n[1]) == pytest.approx(2.5, abs=0.15)


def test_an_identification_says_that_small_impacts_loosen(rig_campaign: Path, tmp_path: Path) -> None:
    shutil.copytree(rig_campaign, tmp_path / "c")
    campaign = rom.read_campaign(tmp_path / "c")
    for record in campaign.select("coupled"):
        with h5py.File(tmp_path / "c" / record.file, "r+") as file:
            strain = file["strain"][:]
            after = np.arange(len(strain)) > 0.55 * campaign.settings.sampling.tension_rate_hz
            file["strain"][:] = strain - 3e-4 * after
    found = rom.identify(rom.read_campaign(tmp_path / "c")).identification
    assert isinstance(found, Identification)
    assert [line for line in found.warnings if line.startswith("coupled tests lose tension alike")]
