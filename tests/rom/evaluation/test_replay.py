"""Records run again by models with readings, driven links and memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.campaign.channels import Channel
from rom.effects import CATALOGUE
from rom.evaluation.error_measures import compare
from rom.evaluation.evaluate import without_loosening
from rom.evaluation.replay import driven_forces, replay, shown_tension
from rom.parameters.he_2025 import paper_model
from rom.signals.processing import Measurement, TensionRecord
from tests.rom.shown_records import SETTINGS, TENSION_RATE_HZ, record

MODEL, WINDOWS = paper_model(), SETTINGS.windows
READINGS = [
    (name, member.at("tension")) for name, member in CATALOGUE.items() if member.kind == "measured tension"
]


def tension_of(measurement: Measurement) -> TensionRecord:
    assert measurement.tension is not None
    return measurement.tension


@pytest.mark.parametrize(("name", "reading"), READINGS, ids=[name for name, _ in READINGS])
def test_a_gauge_is_compared_with_what_the_model_says_it_shows(name: str, reading: object) -> None:
    model = reading.added_to(MODEL)  # type: ignore[attr-defined]
    shown = record(model)
    with_it, without = (compare(m, shown, WINDOWS) for m in (model, MODEL))
    assert with_it.simulated_final == pytest.approx(with_it.measured_final, abs=0.06)
    assert with_it.tension_rmse < 0.06
    if name.startswith(("relaxation", "tension-drift")):
        assert with_it.tension_rmse < 0.5 * without.tension_rmse
        assert with_it.loss_error_percent < 0.5 * without.loss_error_percent


def test_what_oscillates_in_a_reading_passes_the_split_of_the_measured_tension() -> None:
    model = CATALOGUE["tension-follows-displacement"].at("tension").with_values(a=2e5).added_to(MODEL)
    shown = record(model)
    run = replay(model, shown)
    whole, steady = shown_tension(run, tension_of(shown))
    late = slice(int(0.8 * TENSION_RATE_HZ), int(1.5 * TENSION_RATE_HZ))
    assert np.ptp(whole[late]) > 5 * np.ptp(steady[late])


def test_the_steps_in_which_a_tension_falls_pass_the_split_of_the_measured_tension() -> None:
    measured = tension_of(record(MODEL))
    whole, steady = shown_tension(replay(MODEL, record(MODEL)), measured)
    differs = np.abs(whole - measured.non_oscillatory).max()
    assert np.abs(steady - measured.non_oscillatory).max() < 0.2 * differs


def test_a_knee_that_a_mode_crosses_for_long_asks_for_a_finer_tolerance() -> None:
    model = CATALOGUE["two-sided-gap"].at("joint").with_values(k_g=3.5e5, delta=2.2e-5).added_to(MODEL)
    shown = record(MODEL)

    def motion(*tolerance: float) -> np.ndarray:
        return np.asarray(replay(model, shown, *tolerance).response.displacement["lo"])

    finest = motion(1e-10)
    default, fine = (np.abs(motion(*one) - finest).max() for one in ((), (1e-8,)))
    assert 0.0 < fine < 0.1 * default


def test_no_strength_is_no_reading() -> None:
    silent = CATALOGUE["relaxation-log"].at("tension").with_values(A=0.0).added_to(MODEL)
    shown = record(MODEL)
    assert compare(silent, shown, WINDOWS) == compare(MODEL, shown, WINDOWS)


def test_no_loosening_is_no_change_of_loosening_either() -> None:
    model = CATALOGUE["tightening"].at("tension").added_to(MODEL)
    still = without_loosening(CATALOGUE["relaxation-log"].at("tension").added_to(model))
    assert [effect.name for effect in still.effects] == ["relaxation-log"]
    tension = replay(without_loosening(model), record(MODEL)).response.tension
    assert np.ptp(np.asarray(tension)) == 0.0


def cycled(mu: float, rate_hz: float = 400.0, *, from_rest: bool = False) -> Measurement:
    """Return a link driven to and fro, its slider held by a normal force that changes."""
    time = np.arange(int(6 * rate_hz)) / rate_hz
    x, normal = 2e-3 * np.sin(2 * np.pi * 0.5 * time + 1.0), 300.0 + 100.0 * np.sin(2 * np.pi * 0.11 * time)
    x = (x - x[0]) * np.minimum(time / 4, 1) ** 2 + x[0] if from_rest else x
    true = CATALOGUE["jenkins-slip"].at("joint").with_values(mu=mu).added_to(MODEL)
    force = true.link_force("joint", x, rate_hz, normal, settled=not from_rest)
    link = {
        "link_displacement_joint": Channel("link_displacement_joint", x, rate_hz),
        "link_force_joint": Channel("link_force_joint", force[::2], rate_hz / 2),
        "normal_force_joint": Channel("normal_force_joint", normal[::4], rate_hz / 4),
    }
    return replace(
        record(MODEL), test="cycled", force={}, motion={}, impact_s=None, tension=None, link=link, samples=0
    )


@pytest.mark.parametrize("from_rest", [False, True])
def test_a_driven_link_sees_its_normal_force_and_remembers(from_rest: bool) -> None:
    slip, record_of = CATALOGUE["jenkins-slip"].at("joint"), cycled(0.12, from_rest=from_rest)
    right, wrong, none = (
        compare(model, record_of, WINDOWS).link_force_nrmse
        for model in (
            slip.with_values(mu=0.12).added_to(MODEL),
            slip.with_values(mu=0.2).added_to(MODEL),
            MODEL,
        )
    )
    assert right < 3e-3  # the drive is measured, and differentiated
    assert right < 0.1 * wrong < 0.1 * none
    simulated, measured = driven_forces(MODEL, cycled(0.12))["joint"]
    assert simulated.shape == measured.shape
