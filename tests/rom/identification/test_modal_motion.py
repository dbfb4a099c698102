"""Modes of structures that a seed draws: what sensors show of them, and where they lie in a wide band."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from benchmarks import drawn_beams
from discovery.loop.free_refits import FreeRefits
from discovery.options import Options
from rom.effects import CATALOGUE, Effect
from rom.identification.modal_model import ModalIdentification, identify_modes
from rom.identification.modal_sensors import as_sensors_show
from rom.identification.ring_down_states import fitted_state
from tests.rom import beams

FEW_SAMPLES = 133  # seed: three modes, accelerations, 10 samples in a period of the highest
SIX_SAMPLES = 132  # seed: 6 samples in a period of the highest mode, whose mass was 0.1 % off
WIDE = 107  # seed: six modes from 86 to 4246 Hz, records of 7 periods of the lowest


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> ModalIdentification:
    return identify_modes(beams.campaign(tmp_path_factory.mktemp("beam") / "folder"))


@pytest.mark.parametrize("test", ["driven", "free"])
def test_modes_move_alone_as_they_move_together(beam: ModalIdentification, test: str) -> None:
    """Within a simulation's tolerance; with a spring that stiffens in one mode, half of it, none."""
    ring = next(ring for ring in beam.rings if ring.measurement.test == test)
    state = fitted_state(ring, beam.model)
    spring = CATALOGUE["cubic-stiffness"].at("mode_1", ground=True)
    assert isinstance(spring, Effect)
    stiffened, half = (beam.model.with_effect(spring.with_values(k3=k3)) for k3 in (3e5, 1.5e5))
    for model in (stiffened, half, beam.model):
        response = ring.response(model, state, tolerance=ring.tolerance)
        together = ring.shown(as_sensors_show(model, response, ring.measurement))
        alone = ring.simulated(model, state)
        assert alone is not None
        assert np.sqrt(np.mean((alone - together) ** 2)) < 1e-5 * np.sqrt(np.mean(together**2))
    moved, still = ring.simulated(stiffened, state), ring.simulated(beam.model, state)
    assert moved is not None
    assert still is not None
    assert np.sqrt(np.mean((moved - still) ** 2)) > 1.0  # times noise


def test_an_accelerometer_shows_the_force_as_it_was_sampled(tmp_path: Path) -> None:
    """By the sharper force of a simulation (1 / 12 of its second difference) compliances would come out."""
    drawn_beams.drawn(FEW_SAMPLES, tmp_path / "campaign", undeclared=())
    campaign = rom.read_campaign(tmp_path / "campaign")
    model, rate_hz = identify_modes(campaign).model, campaign.settings.sampling.motion_rate_hz
    assert model.shapes is not None
    sensors, masses = model.shapes.sensors, np.array(model.structure.masses)
    shown = model.shapes.at(sensors) @ (model.shapes.at(("p0",))[0] / masses)
    compliance = np.array([model.shapes.compliance(sensor, "p0") for sensor in sensors])
    assert np.abs(compliance / (shown / (12 * rate_hz**2))).max() < 0.05  # none is there in truth


def test_noise_of_a_force_that_rings_in_all_modes_is_allowed_for(tmp_path: Path) -> None:
    levels = []
    for noise in (0.0, 0.05):
        campaign = beams.campaign(tmp_path / f"{noise}", force_noise=noise)
        levels.append(FreeRefits.of_modes(campaign, Options(jobs=1)).start().level)
    assert levels[1] == pytest.approx(levels[0], rel=0.1)


def test_slow_modes_are_found_in_a_wide_band(tmp_path: Path) -> None:
    """Once two poles stood at the third mode, and none at the second, at 188 Hz."""
    drawn_beams.drawn(WIDE, tmp_path / "campaign", undeclared=())
    found = identify_modes(rom.read_campaign(tmp_path / "campaign"))
    truth = [85.79, 188.08, 434.21, 1193.81, 3104.51, 4246.31]
    assert [mode.frequency_hz.value for mode in found.modes] == pytest.approx(truth, rel=1e-3)


def test_forces_between_few_samples_do_not_shift_a_modal_mass(tmp_path: Path) -> None:
    drawn_beams.drawn(SIX_SAMPLES, tmp_path / "campaign", undeclared=())
    found, truth = (
        identify_modes(rom.read_campaign(tmp_path / "campaign")),
        drawn_beams.drawn_beam(SIX_SAMPLES),
    )
    masses = truth.model.structure.masses
    assert found.model.structure.masses[-1] == pytest.approx(masses[-1], rel=6e-4)
