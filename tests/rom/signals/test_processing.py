"""Raw records into clean force, motion and tension: each step on input whose answer is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rom.campaign.campaign import CampaignSettings, Record, RecordSettings
from rom.campaign.channels import Channel
from rom.signals.motion import Motion, dominant_frequency
from rom.signals.processing import cutoff, driven_displacement, gated_force, grows_from_rest, process
from tests.rom.lumped import pulse

RATE_HZ = 4800.0
SAMPLES = 9600
TIME = np.arange(SAMPLES) / RATE_HZ


def settings(**bolt: Any) -> CampaignSettings:
    """Return a body on a spring with a bolted link beside it."""
    return CampaignSettings.model_validate(
        {
            "format": "boltlaw-campaign/1",
            "name": "one body",
            "body": [{"name": "m", "mass_kg": 2.0}],
            "link": [{"name": "joint", "between": ["m", "ground"], "law": "bolted"}],
            "bolt": {"link": "joint", **bolt},
            "sampling": {"motion_rate_hz": RATE_HZ, "tension_rate_hz": RATE_HZ / 4, "pretrigger_s": 0.3},
            "windows": {"initial_s": [0.0, 0.4], "final_s": [1.0, 8.0]},
            "record": [{"file": "a.h5", "test": "loosening"}],
        }
    )


def record(**channels: tuple[np.ndarray, float]) -> Record:
    """Return a loosening record of one body."""
    made = {name: Channel(name, samples, rate) for name, (samples, rate) in channels.items()}
    return Record(RecordSettings(file="a.h5", test="loosening"), made, ("m",))


@pytest.mark.parametrize(("rate_hz", "length_s"), [(19200.0, 6.5e-4), (2000.0, 1e-3), (5000.0, 1.2e-2)])
def test_a_pulse_stays_whole_however_few_its_samples(rate_hz: float, length_s: float) -> None:
    samples = int(rate_hz)
    force = pulse(1000.0, samples, rate_hz, 0.4003, length_s)
    noise = np.random.default_rng(0).normal(0.0, 1.0, samples)
    gated, found = gated_force(force + noise + 5.0, rate_hz, 0.3)
    assert gated.sum() == pytest.approx(force.sum(), rel=0.01)
    assert np.count_nonzero(gated) < 0.1 * samples
    assert found == pytest.approx(1.0, rel=0.1)


def test_both_of_two_hits_are_kept() -> None:
    hits = pulse(900.0, SAMPLES, RATE_HZ, 0.4) + pulse(200.0, SAMPLES, RATE_HZ, 0.9)
    gated, _ = gated_force(hits + np.random.default_rng(1).normal(0.0, 0.5, SAMPLES), RATE_HZ, 0.3)
    assert gated.sum() == pytest.approx(hits.sum(), rel=0.01)


@pytest.mark.parametrize(
    ("test", "first_mode_hz", "expected"),
    [
        ("uncoupled", 44.0, 2.0),
        ("coupled", 15.0, 5.0),
        ("coupled", 4.0, 1.8),
        ("driven", 250.0, 25.0),
        ("free", None, 5.0),
    ],
)
def test_the_cutoff_is_the_papers_unless_the_first_mode_forbids(
    test: str, first_mode_hz: float | None, expected: float
) -> None:
    assert cutoff(test, first_mode_hz) == pytest.approx(expected)


@pytest.mark.parametrize("frequency_hz", [0.9, 17.0, 230.0])
def test_noise_on_a_displacement_hides_no_mode(frequency_hz: float) -> None:
    ringing = np.exp(-TIME) * np.cos(2 * np.pi * frequency_hz * TIME)
    samples = 3.0 + ringing + np.random.default_rng(2).normal(0.0, 0.01, SAMPLES)
    found = dominant_frequency({"m": Motion("displacement", samples)}, RATE_HZ, None)
    assert found == pytest.approx(frequency_hz, abs=0.5)


@pytest.mark.parametrize(("frequency_hz", "ratio"), [(50.0, 0.15), (70.0, 0.1), (15.0, 0.002)])
def test_a_motion_that_soon_dies_away_has_its_own_frequency(frequency_hz: float, ratio: float) -> None:
    rng, hit_s, omega = np.random.default_rng(4), 0.4, 2 * np.pi * frequency_hz
    since = np.maximum(TIME - hit_s, 0.0)
    velocity = np.where(since > 0, np.exp(-ratio * omega * since) * np.cos(omega * since), 0.0) / omega
    samples = np.gradient(velocity, 1 / RATE_HZ) + 1e-2 * rng.normal(size=SAMPLES)
    found = dominant_frequency({"m": Motion("acceleration", samples)}, RATE_HZ, hit_s)
    assert found == pytest.approx(frequency_hz, rel=0.15)


@pytest.mark.parametrize("phase", np.arange(8) * np.pi / 4)
def test_cycles_that_are_ramped_up_grow_from_rest_and_others_do_not(phase: float) -> None:
    time = np.arange(2000) / 200.0
    cycles = 3.0 + np.sin(2 * np.pi * 0.7 * time + phase)
    assert not grows_from_rest(cycles)
    assert not grows_from_rest(cycles * np.exp(-0.1 * time))
    assert grows_from_rest((cycles - cycles[0]) * np.minimum(time / 6, 1))


def test_a_driven_displacement_loses_noise_alone() -> None:
    clean = 1e-3 * np.sin(2 * np.pi * 6.0 * TIME)
    noisy = clean + np.random.default_rng(3).normal(0.0, 1e-5, SAMPLES)
    found = driven_displacement(Channel("x", noisy, RATE_HZ))
    assert np.std(found - clean) < 0.2 * np.std(noisy - clean)
    slope = np.gradient(found, 1 / RATE_HZ)
    assert np.std(slope - 1e-3 * 12 * np.pi * np.cos(2 * np.pi * 6.0 * TIME)) < 0.02 * np.std(slope)


def test_an_early_hit_ends_the_window_of_the_initial_tension() -> None:
    tension = np.where(TIME[::4] < 0.2, 300.0, 250.0)
    force = pulse(1600.0, SAMPLES, RATE_HZ, 0.2, 1e-3)
    raw = record(
        force_m=(force, RATE_HZ), acceleration_m=(np.sin(60 * TIME), RATE_HZ), tension=(tension, RATE_HZ / 4)
    )
    found = process(raw, settings()).tension
    assert found is not None
    assert found.initial == pytest.approx(300.0, abs=0.5)
    assert found.loss == pytest.approx(50.0, abs=0.5)


def test_channels_of_two_rates_meet_at_the_lower() -> None:
    acceleration = np.sin(2 * np.pi * 20 * np.arange(2 * SAMPLES) / (2 * RATE_HZ))
    force = pulse(1600.0, SAMPLES, RATE_HZ, 0.4)
    raw = record(
        force_m=(force, RATE_HZ),
        acceleration_m=(acceleration, 2 * RATE_HZ),
        tension=(np.full(SAMPLES // 4, 100.0), RATE_HZ / 4),
    )
    found = process(raw, settings())
    assert found.rate_hz == RATE_HZ
    inner = slice(100, -100)
    assert found.motion["m"].samples[inner] == pytest.approx(acceleration[::2][inner], abs=2e-3)


def test_strain_becomes_tension_and_needs_a_calibration() -> None:
    channels = {
        "force_m": (pulse(1600.0, SAMPLES, RATE_HZ, 0.4), RATE_HZ),
        "acceleration_m": (np.sin(100 * TIME), RATE_HZ),
        "strain": (np.full(SAMPLES // 4, 0.1), RATE_HZ / 4),
    }
    found = process(record(**channels), settings(calibration=[2000.0, 100.0])).tension
    assert found is not None
    assert found.initial == pytest.approx(201.0)
    assert found.slope == pytest.approx(2020.0)
    with pytest.raises(ValueError, match=r"a\.h5: strain needs bolt\.calibration"):
        process(record(**channels), settings())


def test_single_precision_halves_a_measurement_and_keeps_its_numbers() -> None:
    rng = np.random.default_rng(4)
    raw = record(
        force_m=(pulse(1600.0, SAMPLES, RATE_HZ, 0.4), RATE_HZ),
        acceleration_m=(rng.normal(size=SAMPLES), RATE_HZ),
        tension=(300.0 + rng.normal(size=SAMPLES // 4), RATE_HZ / 4),
    )
    found = process(raw, settings())
    short = found.as_type(np.float32)
    assert short.tension is not None
    assert found.tension is not None
    for one in (short.force["m"], short.motion["m"].samples, short.tension.samples):
        assert one.dtype == np.float32
    again = short.as_type(np.float64)
    assert again.motion["m"].samples.dtype == np.float64
    assert again.motion["m"].samples == pytest.approx(found.motion["m"].samples, rel=1e-7)
    assert (short.tension.initial, short.chain, short.rate_hz) == (
        found.tension.initial,
        found.chain,
        RATE_HZ,
    )
