"""The balance of forces: one filter for all terms, the declared model, its noise, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from rom.campaign.channels import Channel
from rom.effects import Effect, free_form
from rom.identification.equation_error import Smoothing, noise_of
from rom.identification.force_balance import balances_of, is_driven
from rom.identification.identify import identify_campaign
from rom.model.laws import Parameter
from tests.discovery import driven_twins as twins
from tests.discovery import slip_twins


def test_the_filter_and_its_derivatives_are_exact_for_a_harmonic() -> None:
    rate, width, omega = 500.0, 4e-3, 2 * np.pi * 20.0
    time = np.arange(2000) / rate
    smoothing = Smoothing(width)
    passed = np.exp(-0.5 * (omega * width) ** 2)
    at = smoothing.rows(time, rate)
    for order, expected in enumerate(
        (np.sin, lambda a: omega * np.cos(a), lambda a: -(omega**2) * np.sin(a))
    ):
        rows = smoothing.rows(np.sin(omega * time), rate, order)
        np.testing.assert_allclose(rows, passed * expected(omega * at), atol=1e-5 * omega**order)


def test_rows_of_white_noise_have_the_size_that_the_filter_says() -> None:
    smoothing, rng = Smoothing(6e-3), np.random.default_rng(3)
    noise = 0.1 * rng.normal(size=200_000)
    assert noise_of(Channel("force_a", noise, 500.0)) == pytest.approx(0.1, rel=0.02)
    for terms in ((1.0,), (8000.0, 6.0, 2.0)):
        rows = sum(term * smoothing.rows(noise, 500.0, n) for n, term in enumerate(terms))
        assert np.std(rows) == pytest.approx(0.1 * smoothing.gain(terms, 500.0), rel=0.03)


def test_the_motion_along_which_effects_act_keeps_its_size(tmp_path: Path) -> None:
    """Of one frequency: smoothed once, a hundredth was gone, half of the velocity at the ends."""
    campaign = slip_twins.cycled(tmp_path / "cycled", "nothing")
    for record in balances_of(campaign)[0].records:
        shown = campaign.load(record.settings).channels["link_displacement_damper"]
        x, v, _ = record.motion["damper"]
        speed = np.gradient(shown.samples, edge_order=2) * shown.rate_hz
        for found, true in ((x, shown.samples), (v, speed)):
            assert float(found @ true / (true @ true)) == pytest.approx(1.0, abs=1e-3)
            assert np.abs(found - true).max() < 0.1 * np.abs(true).max()


def test_the_declared_model_of_a_driven_oscillator(tmp_path: Path) -> None:
    campaign = twins.driven(tmp_path / "clean", offset=0.4)
    assert is_driven(campaign)
    found = identify_campaign(campaign)
    model = found.model
    assert model.structure.bodies[0].mass == pytest.approx(2.0, rel=2e-3)
    numbers = model.parameters
    for path, truth in {
        "guide.stiffness.k": 8000.0,
        "guide.damping.c": 6.0,
        "body:mass.constant-force.F_0": 0.4,
    }.items():
        number = numbers[path]
        assert number.low is not None
        assert number.high is not None
        assert abs(number.value - truth) < 1.5 * (number.high - number.low)
        assert number.value == pytest.approx(truth, rel=0.05)
    assert found.records == ("run_0.h5", "run_1.h5", "run_2.h5")
    assert any("only the ratios" in line for line in found.warnings)


def test_a_given_mass_is_kept(tmp_path: Path) -> None:
    campaign = twins.driven(tmp_path / "clean")
    text = (tmp_path / "clean" / "campaign.toml").read_text()
    changed = text.replace('{ name = "mass" }', '{ name = "mass", mass_kg = 2.0 }')
    assert changed != text
    (tmp_path / "clean" / "campaign.toml").write_text(changed)
    campaign = rom.read_campaign(tmp_path / "clean")
    model = rom.identify(campaign)
    assert model.structure.bodies[0].mass == 2.0
    assert model.parameters["guide.stiffness.k"].value == pytest.approx(8000.0, rel=2e-3)


def test_what_is_left_of_a_sound_model_is_the_sensors_noise(tmp_path: Path) -> None:
    balances, doubts = balances_of(twins.driven(tmp_path / "clean", stiffness=0.0))
    assert not doubts
    values, _ = balances.fitted(balances.force)
    left = (balances.force - balances.columns @ values) / balances.noise
    assert np.mean(left[balances.training] ** 2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(left[~balances.training] ** 2) == pytest.approx(1.0, abs=0.25)
    bounded = [not name.endswith("F_0") for name in balances.names]
    against, _ = balances.fitted(-balances.columns @ np.abs(values))
    assert not against[bounded].any()  # at the bound, not beside it


def test_a_force_without_noise_is_known_no_better_than_the_motion_between_samples(tmp_path: Path) -> None:
    """Rows err by what lies between samples: a sound model leaves no more than the noise that is allowed."""
    campaign = twins.driven(tmp_path / "clean", noise_m=0.0, force_noise_n=0.0, sizes=(1.0, 0.3, 1.0))
    balances, _ = balances_of(campaign)
    values, _ = balances.fitted(balances.force)
    left = (balances.force - balances.columns @ values) / balances.noise
    for record in range(3):
        rows = balances.owner == record
        assert balances.noise[rows][0] > 1e-4 * np.std(balances.force[rows])
        assert np.mean(left[rows] ** 2) < 1.0


def test_records_without_any_force_are_refused(tmp_path: Path) -> None:
    time = np.arange(2000) / 500.0
    shown = {"displacement_mass": np.exp(-time) * np.cos(2 * np.pi * 10 * time)}
    records = {"decay.h5": ("free", False, shown, 500.0)}
    campaign = twins.campaign_of(tmp_path / "free", "mass", "guide", "linear", records)
    with pytest.raises(ValueError, match="found no training record with a force"):
        balances_of(campaign)


def test_a_record_shorter_than_the_filter_is_refused(tmp_path: Path) -> None:
    time = np.arange(100) / 500.0
    force = np.cos(2 * np.pi * 5.0 * time)
    records = {"short.h5": ("driven", False, {"force_mass": force, "displacement_mass": force}, 500.0)}
    campaign = twins.campaign_of(tmp_path / "short", "mass", "guide", "linear", records)
    with pytest.raises(ValueError, match=r"short.h5: found 0.2 s, expected .* s at least"):
        balances_of(campaign)


def test_a_free_form_along_the_measured_motion_is_not_compiled_and_has_the_compiled_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    balances, _ = balances_of(twins.driven(tmp_path / "driven", sizes=(1.0, 1.0), seconds=2.0))
    numbers = {"g": Parameter(3.0, "N"), "h": Parameter(2e5, "N/m2")}
    form = free_form("g * tanh(v / 0.01) + h * max(x, 0) * abs(x) * sign(v)", "guide", numbers)
    assert isinstance(form, Effect)
    compiled = Effect(form.name, form.enters, form.equation, form.parameters, form.function, on_disk=False)
    expected = balances.of(compiled, 8000.0, 6.0)
    assert np.ptp(expected) > 1.0
    monkeypatch.setattr(type(form), "address", None)
    np.testing.assert_allclose(balances.of(form, 8000.0, 6.0), expected, rtol=0, atol=1e-9)
