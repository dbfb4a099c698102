"""A structure a million times slower or faster, lighter or smaller has the same numbers in its own units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from experiments.studies import identify as study
from rom.campaign.campaign import Campaign
from rom.identification.identify import identify_campaign
from tests.rom import lumped

RATE_HZ, SECONDS = 256.0, 6.0
MASSES = {"a": 2.0, "b": 0.7}
SECONDS_EACH = (1e-6, 1e-3, 1e3, 1e6)


def links(mass: float, second: float) -> list[lumped.LinkRow]:
    """A chain on the ground, modes at 7 and 18 Hz in units of the time scale."""
    k, c = mass / second**2, mass / second
    return [
        ("foot", ("a", "ground"), "linear", 6000.0 * k, 3.0 * c),
        ("top", ("b", "a"), "linear", 5000.0 * k, 2.0 * c),
    ]


def scaled(folder: Path, kind: str, mass: float = 1.0, length: float = 1.0, second: float = 1.0) -> Campaign:
    """Three driven records with masses given (by acceleration: of the bodies) or three ring-downs."""
    rng, rate = np.random.default_rng(3), RATE_HZ / second
    masses = {name: m * mass for name, m in MASSES.items()}
    samples, records = int(SECONDS * RATE_HZ), []
    for place in range(3):
        force = {"a": np.zeros(samples)}
        start = np.zeros(4)
        if kind == "free":
            start[:2] = length * np.array([0.004, -0.002 + 0.003 * place])
        else:
            push = lumped.random_force(rng, samples, RATE_HZ, 30.0)
            force = {"a": 20.0 * mass * length / second**2 * push}
        moved = lumped.respond(masses, links(mass, second), force, rate, start)
        quantity = "displacement" if kind == "free" else "acceleration"
        channels = {f"{quantity}_{b}": lumped.noisy(rng, moved[f"{quantity}_{b}"], 1e-3) for b in masses}
        channels |= {} if kind == "free" else {"force_a": force["a"]}
        test = {"file": f"{place}.h5", "test": "free" if kind == "free" else "driven"}
        records.append((test, channels))
    return lumped.campaign(folder, masses, links(mass, second), records, rate)


@pytest.mark.parametrize("kind", ["driven", "free"])
@pytest.mark.parametrize("second", SECONDS_EACH)
def test_any_time_scale_has_the_same_numbers(kind: str, second: float, tmp_path: Path) -> None:
    """Also light and small, whose stiffness is below 1e-9 N/m where they are slow."""
    model = rom.identify(scaled(tmp_path / "c", kind, 1e-6, 1e-4, second), jobs=1)
    for name, _, _, stiffness, damping in links(1e-6, second):
        laws = model.link_laws[name]
        assert float(laws.stiffness(0.0)) == pytest.approx(stiffness, rel=2e-3)
        assert float(laws.damping(0.0)) == pytest.approx(damping, rel=2e-2)


@pytest.mark.parametrize("second", [1e4])
def test_figures_of_a_slow_structure_are_drawn(second: float, tmp_path: Path) -> None:
    outcome = study.examine(scaled(tmp_path / "c", "free", second=second))
    assert study.draw(outcome)
    assert study.draw_records(outcome)


def test_a_hit_at_a_rate_of_a_gigahertz_is_windowed_by_its_own_length(tmp_path: Path) -> None:
    second, mass = 1e-6, 1.0
    rate, samples = 2048.0 / second, 4096
    masses, chain = {name: m * mass for name, m in MASSES.items()}, links(mass, second)
    records = []
    for place in range(2):
        force = lumped.pulse(5e12, samples, rate, 0.25 * second, 4e-3 * second)
        moved = lumped.respond(masses, chain, {"a": force}, rate)
        channels = {f"acceleration_{b}": moved[f"acceleration_{b}"] for b in masses} | {"force_a": force}
        records.append(({"file": f"{place}.h5", "test": "coupled"}, channels))
    sampling = {"motion_rate_hz": rate, "tension_rate_hz": rate, "pretrigger_s": 0.2 * second}
    campaign = lumped.campaign(tmp_path / "c", masses, chain, records, rate, sampling=sampling)
    found = identify_campaign(campaign).model
    for name, _, _, stiffness, _ in chain:
        assert float(found.link_laws[name].stiffness(0.0)) == pytest.approx(stiffness, rel=5e-3)


def test_an_uncoupled_test_of_a_record_shorter_than_ten_milliseconds(tmp_path: Path) -> None:
    rate, samples, chain = 1e6, 4096, [("foot", ("a", "ground"), "linear", 4e8, 300.0)]
    force = lumped.pulse(500.0, samples, rate, 2e-4, 2e-5)
    moved = lumped.respond({"a": 1.0}, chain, {"a": force}, rate)
    channels = {"acceleration_a": moved["acceleration_a"], "force_a": force}
    sampling = {"motion_rate_hz": rate, "tension_rate_hz": rate, "pretrigger_s": 1.5e-4}
    record = {"file": "0.h5", "test": "uncoupled"}
    campaign = lumped.campaign(
        tmp_path / "c", {"a": 1.0}, chain, [(record, channels)], rate, sampling=sampling
    )
    (test,) = identify_campaign(campaign).uncoupled
    assert np.isfinite(test.response.force_error)
