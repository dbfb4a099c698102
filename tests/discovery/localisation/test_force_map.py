"""The force that is left: brought back to newtons, told from noise, from memory, and by its sign."""

from __future__ import annotations

import json

import numpy as np
import pytest

from discovery.localisation.force_map import ForceMap, courses_at, force_map, force_maps
from discovery.views.force_plot import pair
from rom.campaign.channels import FloatArray
from tests.discovery.synthetic_lines import JOINT, PLACES, Law, campaign, record, silence


def cubic(x: FloatArray, _v: FloatArray, _rng: np.random.Generator) -> FloatArray:
    return 1e12 * x**3


def friction(_x: FloatArray, v: FloatArray, _rng: np.random.Generator) -> FloatArray:
    return 0.5 * np.tanh(v / 2e-3)


def one_sided(x: FloatArray, _v: FloatArray, _rng: np.random.Generator) -> FloatArray:
    return 1e5 * np.maximum(x - 2e-5, 0.0)


def unrelated(x: FloatArray, _v: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Of its own in every record, as long as the motion lasts."""
    return 50e3 * np.abs(x).max() * np.convolve(rng.standard_normal(len(x)), np.hanning(40) / 20, "same")


def mapped(law: Law) -> ForceMap:
    return force_map("joint", courses_at(JOINT, campaign(law)))


def test_the_force_comes_back_in_newtons() -> None:
    one = record(friction, amplitude=2e-4)
    (course,) = courses_at(JOINT, [one])
    true = 0.5 * np.tanh(course.velocity / 2e-3)
    early = (course.time > 0.02) & (course.time < 0.6)
    assert np.corrcoef(course.force[early], true[early])[0, 1] > 0.97
    assert 0.8 < np.std(course.force[early]) / np.std(true[early]) < 1.0  # lines of more noise are faded


def test_noise_is_one_and_is_no_function_of_motion() -> None:
    chances = []
    for start in range(4):
        parts = [
            record(silence, seed=20 * start + n, amplitude=a)
            for n, a in enumerate(np.geomspace(2e-5, 2e-4, 12))
        ]
        found = force_map("joint", courses_at(JOINT, parts))
        assert found.level == pytest.approx(1.0, abs=0.1)
        assert found.explained < 0.01
        assert found.level_positive == pytest.approx(found.level_negative, abs=0.2)
        assert abs(found.cosine_velocity) < 2 * found.cosine_chance
        chances.append(found.explained_p)
    assert min(chances) > 0.01
    assert max(chances) > 0.2


def test_a_cubic_spring_is_an_elastic_function_of_motion() -> None:
    found = mapped(cubic)
    assert found.level > 20
    assert found.explained > 0.85
    assert found.explained_p == pytest.approx(1e-3)
    assert found.elastic > 0.98
    assert found.cosine_displacement > 0.7
    assert abs(found.cosine_velocity) < 0.1
    left, right = (float(np.nanmean(found.force_n[:, place])) for place in (1, -2))
    low, high = found.displacement_m[-3:-1]
    assert 0.7 * 1e12 * low**3 < right < 1e12 * high**3
    assert left == pytest.approx(-right, rel=0.3)


def test_friction_loses_energy_and_is_odd_in_velocity() -> None:
    found = mapped(friction)
    assert found.explained > 0.85
    assert found.elastic < 0.02
    assert found.cosine_velocity > 0.7
    assert abs(found.cosine_displacement) < 0.1
    x = courses_at(JOINT, [record(friction, amplitude=2e-4)])[0].displacement
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x))))
    swings = np.abs(np.diff(x[turns[:7]]))
    assert found.work_per_cycle_j == pytest.approx(0.5 * swings.sum() / 3, rel=0.3)  # F_c times the path


def test_what_has_nothing_to_do_with_motion_is_told_as_the_rest() -> None:
    found = mapped(unrelated)
    assert found.level > 5
    assert found.explained < 0.05
    assert found.explained_p > 0.01
    assert found.rest == pytest.approx(1 - 1 / found.level, abs=0.06)


def test_a_force_on_one_side_is_told_by_the_sign() -> None:
    found, both = mapped(one_sided), mapped(cubic)
    assert found.level_positive > 2.5 * found.level_negative
    assert 0.67 < both.level_positive / both.level_negative < 1.5


def test_the_place_shown_is_where_the_force_is_a_function_of_motion() -> None:
    found = list(force_maps(PLACES, campaign(cubic)))
    assert [one.place for one in found] == ["joint"]  # bodies have not moved in these records
    told = [one.as_dict() for one in found]
    other = told[0] | {"place": "body so", "explained": 0.1, "level": 2 * found[0].level}
    both = pair([other, told[0]], [told[0], other])
    assert both is not None
    assert [one["place"] for one in both] == ["joint", "joint"]
    assert pair(told, []) is None


def test_the_file_holds_no_nan_and_is_small() -> None:
    found = mapped(cubic)
    assert np.isnan(found.force_n).any()
    assert len(json.dumps(found.as_dict(), allow_nan=False)) < 50_000
