"""A record as a model would have it measured: its hit, what the sensors show, the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.record import Channel
from rom.effects import CATALOGUE
from rom.evaluation.replay import replay
from rom.evaluation.simulated_record import cannot_be_simulated, quiet_part, simulated_record
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty
from rom.parameters.he_2025 import nominal_impact, paper_model
from rom.signals.calibration import Calibration
from rom.signals.processing import process
from tests.rom.sound_campaign import LOOSENING, sound_settings

RATE_HZ, QUIET = 4800.0, int(0.45 * 4800)
BODIES = ("lo", "so")
Noise = dict[str, float]
NOISE: Noise = {"force_lo": 0.1, "acceleration_lo": 0.02, "acceleration_so": 0.05, "strain": 2e-6}


def measured(noise: Noise = NOISE) -> tuple[Record, CampaignSettings]:
    """A loosening record of the paper's model, its noise shared by both accelerometers for the most part."""
    generator = np.random.default_rng(5)
    force = nominal_impact(1600.0, RATE_HZ, 3.0)
    response = paper_model().simulate({"lo": force}, RATE_HZ, 60.0)
    strain = np.linspace(0.0, 0.1, 2001)
    calibrated = Calibration((2718.7, 2363.7, -575.63)).tension(strain)
    shared = generator.standard_normal(len(force))
    samples = {"force_lo": force, "strain": np.interp(np.asarray(response.tension), calibrated, strain)}
    samples |= {f"acceleration_{body}": response.acceleration[body] for body in BODIES}
    for name, size in noise.items():
        own = generator.standard_normal(len(force))
        samples[name] = samples[name] + size * (shared if name.startswith("acceleration") else own)
    settings = CampaignSettings.model_validate(
        sound_settings()
        | {
            "record": [{"file": LOOSENING, "test": "loosening", "preload_n": 60.0}],
            "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": RATE_HZ, "pretrigger_s": 0.5},
        }
    )
    channels = {name: Channel(name, values, RATE_HZ) for name, values in samples.items()}
    return Record(settings.record[0], channels, BODIES), settings


@pytest.fixture(scope="module")
def record() -> tuple[Record, CampaignSettings]:
    return measured()


def simulated(record: tuple[Record, CampaignSettings], model: Model, seed: int = 1) -> dict[str, Channel]:
    raw, settings = record
    measurement = process(raw, settings)
    quiet = [quiet_part(raw, measurement)]
    return simulated_record(model, raw, measurement, settings, quiet, np.random.default_rng(seed))


def test_processed_again_it_shows_the_models_motion_and_tension(
    record: tuple[Record, CampaignSettings],
) -> None:
    raw, settings = record
    shown = simulated(record, paper_model())
    added = shown["force_lo"].samples - nominal_impact(1600.0, RATE_HZ, 3.0)
    assert float(added.std()) == pytest.approx(NOISE["force_lo"], rel=0.1)  # to the contacts alone
    again = process(replace(raw, channels=shown), settings)
    run = replay(paper_model(), again)
    assert again.tension is not None
    assert again.tension.final == pytest.approx(
        np.asarray(run.response.tension)[int(2 * RATE_HZ) :].mean(), abs=0.02
    )
    moved = again.displacement("lo")
    size = float(np.std(moved))
    first = process(raw, settings).displacement("lo")
    assert float(np.std(moved - first)) < 0.05 * size


def test_noise_is_as_strong_as_before_the_hit_and_shared_as_there(
    record: tuple[Record, CampaignSettings],
) -> None:
    shown, other = simulated(record, paper_model()), simulated(record, paper_model(), seed=2)
    for name, size in NOISE.items():
        before = shown[name].samples[:QUIET]
        assert float(before.std()) == pytest.approx(size, rel=0.15)
        assert abs(np.corrcoef(before, other[name].samples[:QUIET])[0, 1]) < 0.1
    pair = [shown[f"acceleration_{body}"].samples[:QUIET] for body in BODIES]
    assert np.corrcoef(*pair)[0, 1] > 0.95


def test_a_test_has_a_rate_of_loosening_of_its_own(record: tuple[Record, CampaignSettings]) -> None:
    model = paper_model()
    spread = replace(model, rate_uncertainty=RateUncertainty.of((), np.zeros((0, 0)), (0.5, 0.0), 9))
    losses = []
    for which, seed in ((model, 1), (model, 2), (spread, 1), (spread, 2)):
        strain = simulated(record, which, seed)["strain"].samples
        losses.append(float(strain[:QUIET].mean() - strain[-QUIET:].mean()))
    assert losses[0] == pytest.approx(losses[1], rel=0.02)
    assert abs(losses[3] / losses[2] - 1) > 0.05


def test_faults_of_sensors_are_in_it(record: tuple[Record, CampaignSettings]) -> None:
    gain = CATALOGUE["acceleration-gain"].at("sensor:acceleration_so")
    plain = simulated(record, paper_model())["acceleration_so"].samples
    shown = simulated(record, paper_model().with_effect(gain))["acceleration_so"].samples
    assert shown @ plain / (plain @ plain) == pytest.approx(1 + gain.parameters["g"].value, rel=1e-3)


def test_what_cannot_be_simulated_is_told(record: tuple[Record, CampaignSettings]) -> None:
    raw, _ = record
    assert not cannot_be_simulated(raw)
    driven = replace(raw, settings=raw.settings.model_copy(update={"test": "driven"}))
    assert "driven" in cannot_be_simulated(driven)
    ground = Channel("acceleration_ground", raw.channels["force_lo"].samples, RATE_HZ)
    assert "ground" in cannot_be_simulated(replace(raw, channels={**raw.channels, ground.name: ground}))
