from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import rom
from discovery.courses.frozen_motion import freeze
from discovery.laws.factors import displacement_power, velocity_power
from tests.discovery.synthetic import frozen, measured, model_with, with_power

BINS = 9


def test_the_frozen_motion_is_that_of_a_full_simulation() -> None:
    whole = frozen(scatter=0.0, noise=0.0)
    course = whole.courses[4]
    response = model_with(with_power(4.0)).simulate(
        {course.body: course.force}, course.rate_hz, course.initial
    )
    time, x, v, force, damping, tension = whole.of_case(4)
    index = np.round((time + course.impact_s) * course.rate_hz).astype(int)
    expected_x = (response.displacement["lo"] - response.displacement["so"])[index]
    expected_v = (response.velocity["lo"] - response.velocity["so"])[index]
    np.testing.assert_allclose(x, expected_x, atol=2e-3 * np.abs(expected_x).max())
    np.testing.assert_allclose(v, expected_v, atol=2e-3 * np.abs(expected_v).max())
    loss = tension[0] - tension[-1]
    np.testing.assert_allclose(tension, np.asarray(response.tension)[index], atol=0.03 * loss)
    laws = whole.model.link_laws["joint"]
    assert loss > 5.0
    np.testing.assert_allclose(force, laws.stiffness(tension) * x + laws.damping(tension) * v, rtol=1e-9)
    np.testing.assert_allclose(damping, laws.damping(tension) * v, rtol=1e-9)


def test_an_exposure_is_the_integral_of_its_factor_over_every_sample() -> None:
    whole = frozen(scatter=0.0, noise=0.0)
    course = whole.courses[2]
    response = model_with(with_power(4.0)).simulate(
        {course.body: course.force}, course.rate_hz, course.initial
    )
    v = response.velocity["lo"] - response.velocity["so"]
    for n in (2.0, 4.0):
        found = whole.exposure(velocity_power(n))[2]
        values = np.abs(v) ** n
        total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) / course.rate_hz
        expected = np.interp(whole.knots_s + course.impact_s, response.time, total)
        np.testing.assert_allclose(found, expected, atol=3e-3 * expected[-1])
        assert np.all(np.diff(found) >= 0)


def test_averages_are_means_over_the_bins() -> None:
    whole = frozen()
    np.testing.assert_allclose(whole.averages.sum(axis=1), 1.0, rtol=1e-12)
    edges = np.array(whole.courses[0].edges_s) - whole.courses[0].impact_s
    np.testing.assert_allclose(
        whole.averages @ whole.knots_s, 0.5 * (edges[1:] + edges[:-1]), atol=1e-9
    )  # of a straight line exact


def test_what_oscillates_with_the_motion_weighs_nothing() -> None:
    whole = frozen()
    time, x = whole.of_case(6)[:2]
    edges = whole.courses[6].edges_s - whole.courses[6].impact_s
    total = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(time))])
    mean = np.diff(np.interp(edges, time, total)) / np.diff(edges)
    shift = mean / np.abs(mean).max() * np.sqrt(np.diag(whole.courses[6].covariance).max())
    plain = shift @ np.linalg.solve(whole.courses[6].covariance, shift)
    assert plain > 0.5
    assert shift @ np.linalg.solve(whole.covariance[6], shift) < 0.01 * plain
    loss = np.full(BINS, shift.max())  # what stays is no oscillation
    kept = loss @ np.linalg.solve(whole.covariance[6], loss)
    assert kept > 0.3 * loss @ np.linalg.solve(whole.courses[6].covariance, loss)


def test_a_subset_is_what_freezing_it_would_give() -> None:
    whole = frozen()
    before = whole.exposure(velocity_power())
    some = whole.subset([5, 5, 1])
    assert [course.file for course in some.courses] == [whole.courses[i].file for i in (5, 5, 1)]
    np.testing.assert_array_equal(some.exposure(velocity_power()), before[[5, 5, 1]])
    fresh = some.without_cache()
    np.testing.assert_array_equal(fresh.exposure(velocity_power()), before[[5, 5, 1]])
    np.testing.assert_array_equal(
        some.exposure(displacement_power()), whole.exposure(displacement_power())[[5, 5, 1]]
    )
    np.testing.assert_array_equal(some.change, whole.change[[5, 5, 1]])


def test_frozen_motion_travels_between_processes() -> None:
    again = pickle.loads(pickle.dumps(frozen().without_cache()))
    np.testing.assert_array_equal(again.exposure(velocity_power()), frozen().exposure(velocity_power()))


def test_courses_of_different_lengths_are_cut_to_the_shortest() -> None:
    courses = measured(preloads=(20.0, 150.0), strengths=(1.0,))
    short = replace(
        courses[1],
        edges_s=courses[1].edges_s[:-2],
        change=courses[1].change[:-2],
        covariance=courses[1].covariance[:-2, :-2],
    )
    assert freeze(rom.paper_model(), (courses[0], short)).change.shape == (2, BINS - 2)


def test_a_net_tightening_case_is_frozen_too() -> None:
    courses = measured(preloads=(20.0, 150.0), strengths=(1.0,))
    tighter = replace(courses[0], final=courses[0].initial + 2.0, change=np.abs(courses[0].change))
    whole = freeze(rom.paper_model(), (tighter, courses[1]))
    assert np.isfinite(whole.nodes).all()
    np.testing.assert_allclose(whole.of_case(0)[5], courses[0].initial)


def test_no_courses_are_refused() -> None:
    with pytest.raises(ValueError, match="found no loosening record"):
        freeze(rom.paper_model(), ())


def test_a_model_without_bolt_is_refused() -> None:
    with pytest.raises(ValueError, match="one bolted link, this one has 0"):
        freeze(rom.paper_model().without_bolt(), measured(preloads=(20.0,), strengths=(1.0,)))
