from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rom.campaign.campaign import Campaign, read_campaign
from rom.identification.reduce import reduce_records, tension_courses
from rom.signals.processing import Measurement, process
from rom.signals.tension_bins import CourseNoise, TensionBins, bins_after_hit, bins_before_hit, course_noise

RATE = 4800.0


@pytest.fixture(scope="module")
def campaign(rig_campaign: Path) -> Campaign:
    return read_campaign(rig_campaign, jobs=1)


@pytest.fixture(scope="module")
def measurement(campaign: Campaign) -> Measurement:
    return process(campaign.load(campaign.select("loosening")[3]), campaign.settings)


def with_tension(measurement: Measurement, samples: np.ndarray) -> Measurement:
    assert measurement.tension is not None
    return replace(measurement, tension=replace(measurement.tension, samples=samples))


def bins_of(edges: np.ndarray, change: np.ndarray, slope: float = 1.0) -> TensionBins:
    counts = np.round(np.diff(edges) * RATE)
    return TensionBins(edges, change, counts, 1000, 0.5 * (edges[1:] + edges[:-1]), slope, RATE)


def test_bins_widen_from_milliseconds_to_the_end_of_the_record(
    campaign: Campaign, measurement: Measurement
) -> None:
    bins = bins_after_hit(measurement, campaign.settings)
    assert bins is not None
    assert measurement.impact_s is not None
    widths = np.diff(bins.edges_s)
    assert abs(bins.edges_s[0] - measurement.impact_s) < 1.1 / RATE
    assert 0.0025 < widths[0] < 0.004
    assert np.all(np.diff(widths) > 0)
    assert bins.edges_s[-1] < 3.0
    assert len(bins.change) == len(bins.counts) == len(bins.lag_s)


def test_a_change_is_the_mean_in_the_bin_minus_the_mean_before(
    campaign: Campaign, measurement: Measurement
) -> None:
    """Of a straight line the mean over samples is its value in the middle of the edges."""
    assert measurement.tension is not None
    assert measurement.impact_s is not None
    time = np.arange(len(measurement.tension.samples)) / RATE
    bins = bins_after_hit(with_tension(measurement, 100 - 7 * time), campaign.settings)
    assert bins is not None
    low, high = campaign.settings.windows.initial_s
    before = 0.5 * (low + min(high, measurement.impact_s) - 1 / RATE)
    middle = 0.5 * (bins.edges_s[1:] + bins.edges_s[:-1])
    np.testing.assert_allclose(bins.change, -7 * (middle - before), atol=7 / RATE)


def test_before_the_hit_nothing_changes(measurement: Measurement) -> None:
    assert measurement.tension is not None
    assert measurement.impact_s is not None
    time = np.arange(len(measurement.tension.samples)) / RATE
    step = np.where(time < measurement.impact_s, 50.0, 10.0)
    bins = bins_before_hit(with_tension(measurement, step))
    assert bins is not None
    assert bins.edges_s[-1] <= measurement.impact_s
    np.testing.assert_allclose(bins.change, 0.0, atol=1e-9)


def test_without_hit_there_are_no_bins(campaign: Campaign, measurement: Measurement) -> None:
    assert bins_after_hit(replace(measurement, impact_s=None), campaign.settings) is None
    assert bins_after_hit(replace(measurement, tension=None), campaign.settings) is None
    assert bins_before_hit(replace(measurement, impact_s=None)) is None


@pytest.mark.parametrize("level", [0.0, 1e-9, 100.0, 1e9])
def test_the_covariance_of_drift_alone_can_be_taken_a_root_of(level: float) -> None:
    """A bolt without tension has no floor in newton, and drift is one direction."""
    lag = np.geomspace(0.01, 8.0, 12)
    bins = TensionBins(
        np.append(lag - 0.005, 8.1), np.zeros(12), np.full(12, 48.0), 1920, lag, 2718.7, RATE, level
    )
    root = np.linalg.cholesky(CourseNoise(0.0, 0.0, 1.0, True).covariance(bins))
    assert np.isfinite(np.linalg.solve(root, np.ones(12))).all()


def test_the_covariance_is_its_formula() -> None:
    bins = bins_of(np.array([0.0, 0.01, 0.1, 1.0]), np.zeros(3), slope=20.0)
    noise = CourseNoise(white=1e-4, walk=0.3, drift=0.02, of_tension=True)
    found = noise.covariance(bins)
    for i in range(3):
        for j in range(3):
            white = 400 * 1e-4 * ((i == j) / bins.counts[i] + 1 / 1000)
            slow = 0.3 * min(bins.lag_s[i], bins.lag_s[j]) + 0.02 * bins.lag_s[i] * bins.lag_s[j]
            assert found[i, j] == pytest.approx(white + slow, rel=1e-6)
    of_strain = replace(noise, of_tension=False).covariance(bins)
    assert of_strain[2, 2] - found[2, 2] == pytest.approx(399 * (0.3 * 0.55 + 0.02 * 0.55**2), rel=1e-6)


@pytest.mark.parametrize("of_tension", [True, False])
def test_noise_is_found_again_and_where_it_enters(of_tension: bool) -> None:
    generator = np.random.default_rng(2)
    share = 1.0 if of_tension else 1e-6
    true = CourseNoise(white=1e-7, walk=1e-3 * share, drift=2e-3 * share, of_tension=of_tension)
    edges = np.concatenate([[0.0], np.geomspace(3e-3, 7.0, 12)])
    quiet = []
    for slope in np.geomspace(200.0, 5000.0, 60):
        bins = bins_of(edges, np.zeros(12), slope)
        quiet.append(replace(bins, change=generator.multivariate_normal(np.zeros(12), true.covariance(bins))))
    found = course_noise(quiet, ())
    assert found is not None
    assert found.of_tension is of_tension
    middle = quiet[30]
    ratio = np.diag(found.covariance(middle)) / np.diag(true.covariance(middle))
    assert np.all((ratio > 0.7) & (ratio < 1.4))


def test_few_quiet_tests_are_helped_by_the_time_before_hits() -> None:
    generator = np.random.default_rng(3)
    edges = np.concatenate([[0.0], np.geomspace(3e-3, 0.3, 8)])
    bins = bins_of(edges, np.zeros(8))
    true = CourseNoise(white=0.5, walk=1e-3, drift=1e-3, of_tension=True)

    def draw(n: int) -> list[TensionBins]:
        covariance = true.covariance(bins)
        return [
            replace(bins, change=generator.multivariate_normal(np.zeros(8), covariance)) for _ in range(n)
        ]

    assert course_noise((), ()) is None
    found = course_noise(draw(2), draw(40))
    assert found is not None
    assert found.white == pytest.approx(0.5, rel=0.3)
    alone = course_noise(draw(40), [replace(bins, change=np.full(8, 1e3))] * 5)
    assert alone is not None
    assert alone.white == pytest.approx(0.5, rel=0.3)  # enough of them: the time before is not asked


def test_courses_of_a_campaign_are_ready_to_be_simulated(campaign: Campaign) -> None:
    coupled = [process(campaign.load(spec), campaign.settings) for spec in campaign.select("coupled")]
    quiet = [bins for m in coupled if (bins := bins_after_hit(m, campaign.settings)) is not None]
    noise = course_noise(quiet, ())
    assert noise is not None
    specs = campaign.select("loosening")
    courses = tension_courses(list(reduce_records(campaign, specs, 1)), noise, campaign.settings)
    assert [course.file for course in courses] == [spec.file for spec in specs]
    for course in courses:
        assert course.body == "lo"
        assert course.tension_rate_hz == RATE
        assert len(course.force) / course.rate_hz >= course.edges_s[-1] - 1 / course.rate_hz
        assert np.abs(course.force).max() > 500
        np.linalg.cholesky(course.covariance)
        assert course.initial + course.change[-1] == pytest.approx(
            course.final, abs=6 * course.final_error + 0.02 * course.initial
        )
    lost = sum(course.change[-1] < -3 * course.final_error for course in courses)
    assert lost > len(courses) / 2
