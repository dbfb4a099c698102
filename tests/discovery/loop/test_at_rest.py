"""The closed loop on bolts that were watched at rest: nothing moves, and no rate of a motion is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from discovery.loop.close_loop import close_loop
from rom.campaign.campaign import Campaign, CampaignSettings, write_campaign
from rom.campaign.channels import Channel, FloatArray
from tests.shared import measured

RATE_HZ, LENGTH_S, TENSION_N = 20.0, 60.0, 5e4
CURVES = {
    "clean": lambda t: 0.0 * t,
    "relaxation-log": lambda t: -500.0 * np.log1p(t / 1.2),
    "relaxation-stretched": lambda t: 2500.0 * np.expm1(-t / 15.0),
    "tension-drift": lambda t: -15.0 * t,
    "outside": lambda t: 1000.0 * np.sin(2 * np.pi * 1.7 * t / LENGTH_S + 1.0),
}


def held(folder: Path, curve: str, noise: float = 50.0, seed: int = 0, step: float = 0.0) -> Campaign:
    """Two training records and one held out, which is longer; quantised where a step [N] is given."""
    random, records, channels = np.random.default_rng(seed), [], []
    for place in range(3):
        held_out = place == 2
        time: FloatArray = np.arange(int(LENGTH_S * (1.5 if held_out else 1.0) * RATE_HZ)) / RATE_HZ
        samples = TENSION_N * (1 + 0.1 * random.standard_normal()) + CURVES[curve](time)
        samples = samples + noise * random.standard_normal(len(time))
        samples = np.round(samples / step) * step if step else samples
        records.append({"file": f"{place}.h5", "test": "hold", "hold_out": held_out})
        channels.append((f"{place}.h5", {"tension": Channel("tension", samples, RATE_HZ)}))
    settings = {
        "format": "boltlaw-campaign/1", "name": "at rest", "sampling": {"tension_rate_hz": RATE_HZ},
        "record": records,
    }  # fmt: skip
    write_campaign(folder, CampaignSettings.model_validate(settings), channels)
    return rom.read_campaign(folder)


@pytest.mark.parametrize("curve", ["relaxation-log", "relaxation-stretched", "tension-drift"])
def test_a_slow_change_is_named_and_lowers_the_error(curve: str, tmp_path: Path) -> None:
    found = close_loop(held(tmp_path / "campaign", curve))
    assert found.verdict == "closed"
    (effect,) = found.effects
    assert curve in [effect.effect.name, *(like.name for like in effect.look_alikes)]
    before, after = (errors["hold_out"]["tension_rmse_n"] for errors in (found.before, found.after))
    assert before is not None
    assert after is not None
    assert after < 0.2 * before
    assert effect.effect.name in found.summary()


@pytest.mark.parametrize("step", [0.0, 500.0])
def test_nothing_is_missing_where_the_tension_stays(step: float, tmp_path: Path) -> None:
    found = close_loop(held(tmp_path / "campaign", "clean", step=step))
    assert (found.verdict, found.effects) == ("no-effect", ())


def test_what_the_catalogue_does_not_hold_gets_no_name(tmp_path: Path) -> None:
    found = close_loop(held(tmp_path / "campaign", "outside"))
    assert (found.verdict, found.effects) == ("unexplained", ())


def test_a_model_of_bolts_at_rest_survives_its_file(tmp_path: Path) -> None:
    model = close_loop(held(tmp_path / "campaign", "relaxation-log")).model
    model.save(tmp_path / "model.json")
    assert rom.load_model(tmp_path / "model.json").effects == model.effects


def test_a_real_clamp_creeps_by_the_logarithm_of_time() -> None:
    found = close_loop(rom.read_campaign(measured("others/clamp-at-rest")))
    assert found.verdict == "closed"
    assert [effect.effect.name for effect in found.effects] == ["relaxation-log"]
    assert (found.after["hold_out"]["tension_rmse_n"] or np.inf) < 200.0


@pytest.mark.slow
def test_a_clean_campaign_is_called_so_nineteen_times_of_twenty(tmp_path: Path) -> None:
    found = [close_loop(held(tmp_path / str(seed), "clean", seed=seed)).verdict for seed in range(20)]
    assert found.count("no-effect") >= 19
