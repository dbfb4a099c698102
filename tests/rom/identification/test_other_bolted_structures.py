"""A block on one bolted joint and a chain of three: few levels, offsets, strains beyond their calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from rom.identification.identify import Identification, identify_campaign
from rom.signals.measured_records import screened, stored
from rom.signals.suspicions import Suspicion
from tests.rescaled import rescaled
from tests.rom.bolted import GAMMA_D, JOINT, STIFFNESS, bolted_campaign

WIDE = np.geomspace(10.0, 1500.0, 5)


def found(
    folder: Path, name: str, preloads: np.ndarray, **how: float
) -> tuple[Identification, tuple[Suspicion, ...]]:
    """Return what a campaign tells, and what of it is suspected."""
    with stored(bolted_campaign(folder, name, preloads.tolist(), **how)) as campaign:
        told = screened(campaign)
        assert told.screening is not None
        return identify_campaign(told), told.screening.suspicions


@pytest.mark.parametrize("name", ["block", "chain"])
def test_preloads_of_one_level_are_said(name: str, tmp_path: Path) -> None:
    told, suspicions = found(tmp_path / "c", name, np.linspace(600.0, 1500.0, 5))
    assert not suspicions
    (k,) = told.model.link_laws["joint"].stiffness.parameters.values()
    assert k.value == pytest.approx(STIFFNESS, rel=1e-3)
    lines = "\n".join(told.warnings)
    assert "k_C(T): from 600 to 1500 N the records tell no change: a constant stands for it" in lines
    assert "gamma(T): from 600 to 1500 N the records tell" in lines


@pytest.mark.parametrize("name", ["block", "chain"])
def test_three_preloads_leave_nothing_to_test_the_law(name: str, tmp_path: Path) -> None:
    """One of the three loosening tests is held out, and two tell two numbers."""
    told, suspicions = found(tmp_path / "c", name, np.array([20.0, 150.0, 900.0]))
    assert not suspicions
    lines = "\n".join(told.warnings)
    assert "gamma(T): 2 numbers from 2 records" in lines
    assert "no limits, and its errors on them say nothing" in lines
    numbers = told.model.parameters
    assert [numbers[f"joint.tension_rate.{name}"].high for name in ("gamma_d", "gamma_i")] == [None, None]


@pytest.mark.parametrize("name", ["block", "chain"])
def test_what_discretisation_leaves_without_noise_is_no_misfit(name: str, tmp_path: Path) -> None:
    """All that the linear model leaves over is systematic then; it is 1e-4 of the motion."""
    told, suspicions = found(tmp_path / "c", name, WIDE, noise=0.0)
    assert not suspicions
    assert not told.unsettled


@pytest.mark.parametrize("name", ["block", "chain"])
def test_sensors_that_show_gravity_tell_the_same_numbers(name: str, tmp_path: Path) -> None:
    told, suspicions = found(tmp_path / "c", name, WIDE, offset=9.80665)
    assert not suspicions
    assert not told.set_aside
    numbers = told.model.parameters
    assert numbers["joint.stiffness.k_i"].value == pytest.approx(STIFFNESS, rel=2e-3)
    assert numbers["joint.tension_rate.gamma_d"].value == pytest.approx(GAMMA_D, abs=0.05)


@pytest.mark.parametrize("name", ["block", "chain"])
def test_strains_beyond_their_calibration_are_named_and_the_others_are_judged(
    name: str, tmp_path: Path
) -> None:
    """Ten times the reading: 1500 N become a strain of 4.2, where the calibration falls."""
    told, suspicions = found(tmp_path / "c", name, WIDE, strain=10.0)
    beyond = [one for one in suspicions if one.likely == "strain beyond its calibration"]
    assert {one.record for one in beyond} == {"coupled_4.h5", "loosening_4.h5"}
    assert all(one.sets_aside for one in beyond)
    assert "slack" not in f"{told.warnings} {told.set_aside}"
    numbers = told.model.parameters
    assert all(np.isfinite(number.value) for number in numbers.values())


@pytest.mark.parametrize("name", ["block", "chain"])
def test_limits_without_noise_hold_the_truth(name: str, tmp_path: Path) -> None:
    told, suspicions = found(tmp_path / "c", name, np.geomspace(8.0, 1500.0, 7), noise=0.0, rate_hz=19200.0)
    assert not suspicions
    numbers = {path.rpartition(".")[2]: number for path, number in told.model.parameters.items()}
    for path, truth in JOINT.items():
        number = numbers[path]
        assert number.low is not None
        assert number.high is not None
        assert number.low <= truth <= number.high
        assert number.high - number.low < 2e-2 * abs(truth)


@pytest.mark.parametrize(
    ("name", "scale", "of"),
    [
        ("block", {"tension": 2.0**20}, {"alpha": -1, "beta": 1, "eta": -1, "rho": -1}),
        ("chain", {"mass": 2.0**-20}, dict.fromkeys(("mass", "k", "c", "k_i", "c_d", "c_i"), -1)),
    ],
)
def test_numbers_scale_exactly(
    name: str, scale: dict[str, float], of: dict[str, int], tmp_path: Path
) -> None:
    campaign = bolted_campaign(tmp_path / "c", name, WIDE.tolist(), strain=1.0)
    usual, other = (rom.identify(c, jobs=1) for c in (campaign, rescaled(campaign, tmp_path / "s", **scale)))
    for path, number in usual.parameters.items():
        expected = number.value * 2.0 ** (20 * of.get(path.rpartition(".")[2], 0))
        assert other.parameter(path).value == pytest.approx(expected, rel=1e-6), path
