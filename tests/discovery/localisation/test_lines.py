"""Where a residual lives that a force of known time, frequency and place makes."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.localisation.lines import by_harmonic, by_place, by_time, line_correlation, repeatability
from rom.campaign.channels import FloatArray
from tests.discovery.synthetic_lines import (
    DOMINANT_HZ,
    IMPACT_S,
    JOINT,
    PLACES,
    RATE_HZ,
    SAMPLES,
    campaign,
    record,
    silence,
)

TIME = np.arange(SAMPLES) / RATE_HZ - IMPACT_S


def tone(order: float, first_s: float = 0.0, last_s: float = 2.0, size: float = 0.3) -> FloatArray:
    window = np.where(
        (first_s <= TIME) & (last_s > TIME), np.sin(np.pi * (TIME - first_s) / (last_s - first_s)), 0
    )
    return size * window**2 * np.sin(2 * np.pi * order * DOMINANT_HZ * TIME)


def test_noise_is_one_in_every_class_even_where_end_states_take_much_of_it() -> None:
    parts = campaign(silence, amplitudes=[1e-4] * 40)
    for profile in (by_time(parts), by_harmonic(parts), by_place(parts, PLACES)):
        assert len(profile) >= 3
        for label, square in profile:
            assert square == pytest.approx(1.0, abs=0.12), label
    taken = [one.projected_variance(np.fft.ifft(one.projected, axis=0, norm="ortho")) for one in parts]
    assert np.max(taken) > 0.5  # of 2, just where a record ends: one would read far less there


@pytest.mark.parametrize(
    ("start", "label"), [(0.0, "0 to 0.1 s"), (0.15, "0.1 to 0.35 s"), (0.5, "0.35 to 1 s")]
)
def test_a_force_that_acts_for_a_while_is_told_when_it_acts(start: float, label: str) -> None:
    burst = tone(5.0, start, start + 0.08)
    found = dict(by_time([record(lambda *_: burst, seed=seed) for seed in range(5)]))
    assert max(found, key=lambda name: found[name]) == label
    assert found[label] > 8
    assert found["1 to 3 s"] < 0.1 * found[label]


def test_what_comes_round_from_before_the_hit_is_put_aside_as_the_criteria_say() -> None:
    late = tone(5.0, 1.5, 1.9)
    parts = [record(lambda *_: late, seed=seed) for seed in range(5)]
    more = CRITERIA.changed(localisation={"wrapped": 0.5})
    assert dict(by_time(parts))["1 to 3 s"] > 2 * dict(by_time(parts, more)).get("1 to 3 s", 1.0)


@pytest.mark.parametrize(("order", "label"), [(1, "1st harmonic"), (3, "3rd harmonic"), (2.5, "other lines")])
def test_lines_are_told_by_the_dominant_frequency(order: float, label: str) -> None:
    found = dict(by_harmonic([record(lambda *_: tone(order))]))
    assert max(found, key=lambda name: found[name]) == label
    assert max(value for name, value in found.items() if name != label) < 0.1 * found[label]


@pytest.mark.parametrize("place", PLACES, ids=lambda place: str(place.name))
def test_a_force_is_largest_at_its_own_place(place: object) -> None:
    where = next(one for one in PLACES if one is place)
    found = dict(by_place([record(lambda *_: tone(4.0), where)], PLACES))
    assert max(found, key=lambda name: found[name]) == where.name


def test_records_without_an_impact_or_a_dominant_frequency_have_no_such_views() -> None:
    one = record(silence)
    one.trace.measurement.impact_s = one.trace.measurement.strongest_hz = None  # type: ignore[misc]
    assert by_time([one]) == by_harmonic([one]) == ()


def test_residuals_of_tests_that_repeat_are_alike_whenever_their_records_begin() -> None:
    missing = tone(3.0)
    pair = [record(lambda *_: missing, seed=seed, delay_s=delay) for seed, delay in ((0, 0.0), (1, 2.3e-4))]
    found = dict(repeatability(pair))
    assert found["repeatability_pairs"] == 1.0
    assert found["repeatability"] > 0.95
    assert found["repeatability_noise"] == pytest.approx(1.0, abs=0.15)  # what comes again is none
    clean = dict(repeatability([record(silence, seed=seed) for seed in range(6)]))
    assert abs(clean["repeatability"]) < 2 * clean["repeatability_chance"]
    assert clean["repeatability_noise"] == pytest.approx(1.0, abs=0.1)
    assert clean["repeatability_pairs"] == 15.0
    by_sensor = [clean[f"repeatability_noise_{body}"] for body in ("lo", "so")]
    assert by_sensor == pytest.approx([1.0, 1.0], abs=0.15)
    assert np.mean(by_sensor) == pytest.approx(clean["repeatability_noise"])


def test_other_preloads_do_not_repeat() -> None:
    assert repeatability([record(silence, seed=1), record(silence, seed=2, preload_n=130.0)]) == ()
    assert len(repeatability([record(silence, seed=1), record(silence, seed=2, preload_n=105.0)])) == 6


def test_the_link_shows_nothing_of_bodies_alone() -> None:
    one = record(silence)
    one.trace.measurement.test = "uncoupled"  # type: ignore[misc]
    assert JOINT.direction(one.trace) is None
    assert [label for label, _ in by_place([one], PLACES)] == ["body lo", "body so"]


def test_lines_of_noise_are_white_and_those_of_a_burst_are_not() -> None:
    def told(force: FloatArray | None, first: int) -> tuple[float, float]:
        own = silence if force is None else lambda *_: force
        pairs = line_correlation([record(own, seed=seed) for seed in range(first, first + 4)])
        (name, value), (bound, chance) = pairs
        assert bound == f"{name}_chance"
        return value, chance

    clean = [told(None, 10 * k) for k in range(30)]
    assert np.mean([value > chance for value, chance in clean]) < 0.2
    assert np.median([value / chance for value, chance in clean]) > 0.5  # a bound that is near
    value, chance = told(tone(5.0, 0.15, 0.23), 1)
    assert value > 3 * chance
