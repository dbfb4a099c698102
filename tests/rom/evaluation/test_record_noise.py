"""The errors that noise alone makes, from before the hit, against what it makes of the motion after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rom.campaign.channels import Channel
from rom.evaluation.error_measures import compare, summarise
from rom.evaluation.noise_floor import noise_floor
from rom.evaluation.record_noise import from_sample_to_sample
from rom.evaluation.replay import replay
from rom.model.rate_uncertainty import RateUncertainty
from rom.signals.motion import Motion
from rom.signals.processing import Measurement, tension_record
from tests.rom.evaluation.test_error_measures import (
    RATE_HZ,
    SAMPLES,
    WINDOWS,
    measurement,
    model,
    seen,
    tension,
)

OF_TENSION = (
    "final_tension_error_percent_mean",
    "final_tension_error_percent_median",
    "final_tension_error_percent_max",
    "tension_loss_error_percent_median",
    "tension_rmse_n",
)


def noisy(kind: str, size: float, seed: int, impact_s: float = 0.3) -> Measurement:
    """The true structure's record with white noise on every channel, as large as a share of its motion."""
    rng = np.random.default_rng(seed)
    motion = {
        body: Motion(m.kind, m.samples + size * np.std(m.samples) * rng.standard_normal(SAMPLES))
        for body, m in seen(kind).items()
    }
    return measurement("coupled", motion, preload_n=100.0, impact_s=impact_s)


@pytest.mark.parametrize(("kind", "size"), [("acceleration", 0.3), ("velocity", 0.1), ("acceleration", 3.0)])
def test_the_truth_scores_what_noise_alone_would_make(kind: str, size: float) -> None:
    found = [compare(model(), noisy(kind, size, seed), WINDOWS) for seed in range(12)]
    errors, floor = summarise(found), noise_floor(found)
    assert floor["motion_nrmse"] == pytest.approx(errors["motion_nrmse"], rel=0.2)
    assert floor["relative_motion_nrmse"] == pytest.approx(errors["relative_motion_nrmse"], rel=0.2)


def test_a_hit_at_once_leaves_the_noise_unknown() -> None:
    floor = noise_floor([compare(model(), noisy("acceleration", 0.3, 0, impact_s=0.1), WINDOWS)])
    assert floor["motion_nrmse"] is None


@pytest.mark.parametrize("share", [0.002, 0.02, 0.2])
def test_the_noise_of_displacements_without_rest_shows_from_sample_to_sample(share: float) -> None:
    found = [compare(model(), noisy("displacement", share, seed, impact_s=0.0), WINDOWS) for seed in range(6)]
    errors, floor = summarise(found), noise_floor(found)
    assert floor["motion_nrmse"] == pytest.approx(errors["motion_nrmse"], rel=0.1)
    assert floor["relative_motion_nrmse"] == pytest.approx(errors["relative_motion_nrmse"], rel=0.1)


@pytest.mark.parametrize("share", [0.002, 0.02, 0.2])
def test_the_noise_of_a_cycled_link_shows_from_sample_to_sample(share: float) -> None:
    """Whatever the model's own error is: friction that it lacks jumps at each reversal, and lasts."""
    rng, rate_hz = np.random.default_rng(3), 200.0
    time = np.arange(4000) / rate_hz
    x = 1e-3 * np.sin(2 * np.pi * 0.5 * time)
    v = np.gradient(x, 1 / rate_hz)
    white = share * 100.0 * rng.standard_normal(len(time))
    floors = []
    for friction in (0.0, 50.0):
        force = 2e5 * x + 80.0 * v + friction * np.sign(v) + white
        link = {
            "link_displacement_joint": Channel("link_displacement_joint", x, rate_hz),
            "link_force_joint": Channel("link_force_joint", force, rate_hz),
        }
        found = compare(model(), measurement("cycled", {}, force={}, impact_s=None, link=link), WINDOWS)
        noise = share * 100.0 / np.sqrt(np.mean(force**2))
        floors.append(noise_floor([found])["link_force_nrmse"])
        assert floors[-1] == pytest.approx(noise, rel=0.05)
        assert found.link_force_nrmse == pytest.approx(np.hypot(noise, friction / np.std(force)), rel=0.1)


def test_a_channel_too_coarse_to_show_noise_has_no_floor() -> None:
    assert np.isnan(from_sample_to_sample(np.repeat([0.0, 1.0], 500)))
    assert np.isnan(from_sample_to_sample(np.zeros(3)))


def test_a_floor_stands_for_all_records_or_for_none() -> None:
    late, early = (noisy("acceleration", 0.3, 0, impact_s=at) for at in (0.3, 0.1))
    floor = noise_floor([compare(model(), one, WINDOWS) for one in (late, early)])
    assert floor["motion_nrmse"] is None


def test_a_loss_is_off_by_its_noise_and_by_how_tests_differ() -> None:
    known = replace(tension(np.full(SAMPLES, 200.0)), final=150.0, initial_error=3.0, final_error=4.0)
    record = replace(noisy("acceleration", 0.1, 0), test="loosening", tension=known)
    law = replace(model(), rate_uncertainty=RateUncertainty.of((), np.zeros((0, 0)), (0.4, 0.0), 5))
    floor = noise_floor([compare(law, record, WINDOWS)])
    alone = np.hypot(3.0 * 150 / 200, 4.0)  # the loss goes with the tension that a simulation starts from
    assert floor["tension_loss_error_percent_median"] == pytest.approx(0.6745 * 100 * alone / 50, rel=1e-3)
    both = floor["tension_loss_error_percent_median_with_variability"]
    followed = np.log(200 / 150) * 150 / 50  # of a rate in proportion to the tension
    assert both == pytest.approx(0.6745 * np.hypot(100 * alone / 50, 40.0 * followed), rel=1e-3)
    assert (
        noise_floor([compare(model(), record, WINDOWS)])["tension_loss_error_percent_median_with_variability"]
        is None
    )


def loosened(rate: float, noise_n: float, seed: int) -> Measurement:
    """A loosening test of a law of this rate, from 200 N, with white noise on the tension."""
    still = replace(
        noisy("acceleration", 0.1, seed), test="loosening", tension=tension(np.full(SAMPLES, 200.0))
    )
    course = replay(model(rate), still).response.tension + noise_n * np.random.default_rng(
        seed
    ).standard_normal(SAMPLES)
    return replace(still, tension=tension_record(course, RATE_HZ, WINDOWS, impact_s=0.3, first_mode_hz=20.0))


@pytest.mark.parametrize(("noise_n", "between"), [(2.0, 0.0), (0.1, 0.3)])
def test_the_right_law_scores_what_noise_and_variability_would_make(noise_n: float, between: float) -> None:
    rate, tests = 1.6e4, 60
    of_a_test = np.random.default_rng(5).permutation(stats.norm.ppf((np.arange(tests) + 0.5) / tests))
    law = replace(
        model(rate), rate_uncertainty=RateUncertainty.of((), np.zeros((0, 0)), (between, 0.0), tests)
    )
    found = [
        compare(law, loosened(rate * np.exp(between * u), noise_n, seed), WINDOWS)
        for seed, u in enumerate(of_a_test)
    ]
    assert 100.0 < found[0].measured_final < 190.0
    errors, floor = summarise(found), noise_floor(found)
    for measure in OF_TENSION:
        assert floor[f"{measure}_with_variability"] == pytest.approx(errors[measure], rel=0.25), measure
        assert (floor[measure] < 0.5 * errors[measure]) == (between > 0)


def test_a_tension_at_rest_is_off_by_its_noise() -> None:
    noise = 0.5 * np.random.default_rng(1).standard_normal(SAMPLES)
    course = 200.0 + np.linspace(0.0, 30.0, SAMPLES) + noise
    record = replace(noisy("acceleration", 0.1, 0), test="hold", tension=tension(course))
    assert noise_floor([compare(model(), record, WINDOWS)])["tension_rmse_n"] == pytest.approx(0.5, rel=0.05)
