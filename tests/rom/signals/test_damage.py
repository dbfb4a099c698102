"""Strains beyond their calibration, windows and forces of noise are named, sensors with an offset are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rom.campaign.campaign import CampaignSettings, Record
from rom.campaign.record import Channel
from rom.signals.calibration import Calibration
from rom.signals.quality import assess
from rom.signals.suspicions import evidence
from tests.rom.signals.test_suspicions import (
    BLOCK,
    CHAIN,
    HIT_S,
    RATE_HZ,
    STRUCTURES,
    UNEQUAL,
    FloatArray,
    G,
    Structure,
    campaign,
    changed,
    only,
    scaled,
    settings_of,
    told,
)

CUBIC = (2718.7, 2363.7, -575.63)  # rises from -0.4881 to 3.2256, to 14.05 kN


def overrun(y: FloatArray, _: FloatArray) -> FloatArray:
    y[[2000, 9000, 9001, 14000]] = 1e6
    return y


def overrun_a_little(y: FloatArray, _: FloatArray) -> FloatArray:
    y[[9000, 14000]] = 3 * np.abs(y).max()
    return y


def frozen(y: FloatArray, _: FloatArray) -> FloatArray:
    y[7000:7400] = y[7000]
    return y


def frozen_to_its_end(y: FloatArray, _: FloatArray) -> FloatArray:
    y[12000:] = y[12000]
    return y


def rounded(y: FloatArray, _: FloatArray) -> FloatArray:
    return y * np.hanning(len(y))


def wrapped(y: FloatArray, _: FloatArray) -> FloatArray:
    half = 0.7 * float(np.abs(y).max())
    return (y + half) % (2 * half) - half


def dropped(y: FloatArray, _: FloatArray) -> FloatArray:
    y[700:720] = y[3000:3001] = 0.0
    return y


def nearly_dropped(y: FloatArray, _: FloatArray) -> FloatArray:
    y[700:720] *= 0.02
    return y


def windowed(y: FloatArray, time: FloatArray) -> FloatArray:
    return y * np.exp(-4.0 * time)


def settling(y: FloatArray, time: FloatArray) -> FloatArray:
    return y + 0.2 * np.abs(y).max() * np.exp(-time / 0.5)


def stepped(y: FloatArray, time: FloatArray) -> FloatArray:
    return y + np.where(time > 0.45, 4 * y.std(), 0.0)


DAMAGES: dict[str, tuple[str, Callable[[FloatArray, FloatArray], FloatArray]]] = {
    "overload": ("motion", overrun),
    "overload of three peaks": ("motion", overrun_a_little),
    "channel frozen": ("motion", frozen),
    "channel frozen to its end": ("motion", frozen_to_its_end),
    "channel frozen, of the gauge": ("tension", lambda y, _: np.where(np.arange(len(y)) > 1500, y[1500], y)),
    "overload of the gauge": ("tension", lambda y, _: np.where(np.arange(len(y)) % 1700 == 900, 65535.0, y)),
    "nothing moves": ("motion", lambda y, _: 0.05 * np.random.default_rng(1).standard_normal(len(y))),
    "overload of the force": ("force", overrun),
    "wrap-around of the force": ("force", wrapped),
    "Hann window": ("motion", rounded),
    "wrap-around": ("motion", wrapped),
    "dropouts": ("tension", dropped),
    "dropouts to an open input": ("tension", nearly_dropped),
    "exponential window": ("motion", windowed),
    "sensor still settling": ("motion", settling),
    "mean moves": ("motion", stepped),
}


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_of_a_channel_is_named_in_each_record(name: str, damage: str) -> None:
    of, (kind, change) = STRUCTURES[name], DAMAGES[damage]
    names = {"motion": f"acceleration_{of.struck}", "force": f"force_{of.struck}"}
    channel = names.get(kind, kind)
    spoil = only(channel, change, 4800.0 if kind == "tension" else RATE_HZ)
    found = told(campaign(of), settings_of(of), spoil, few=(0, 3))
    named = [one for one in found if damage.startswith(one.likely or "-")]
    assert [(one.record, one.channel) for one in named] == [(f"records/{i}.h5", channel) for i in (0, 3)]
    assert {one.record for one in found} == {"records/0.h5", "records/3.h5"}


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize(("bits", "rate"), [(12, 0.0), (16, 0.0), (12, 4.0), (16, 4.0)])
def test_digits_of_an_analyser_are_no_damage_even_behind_its_window(
    name: str, bits: int, rate: float
) -> None:
    def digitised(channel: str, y: FloatArray) -> FloatArray:
        digit = np.abs(y).max() / 2 ** (bits - 1)
        window = np.exp(-rate * np.arange(len(y)) / RATE_HZ) if channel != "tension" else 1.0
        return digit * np.round(y / digit) * window

    of = STRUCTURES[name]
    found = told(campaign(of), settings_of(of), lambda record: changed(record, digitised))
    assert {one.likely for one in found} <= ({"exponential window"} if rate else set())
    if rate and bits == 16:
        assert len(found) == 6 * len(of.masses)


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        (CUBIC, (-0.48807, 3.22560)),
        ((2.0,), (-np.inf, np.inf)),
        ((2.0, 1.0), (-1.0, np.inf)),
        ((1.0, 0.0, 1.0), (-np.inf, np.inf)),
        ((1.0, -0.5, 0.0), (-np.inf, 1.0)),
        ((1e6, 0.0, -1e-6 / 3), (-1e6, 1e6)),
    ],
)
def test_where_a_calibration_rises(coefficients: tuple[float, ...], expected: tuple[float, float]) -> None:
    assert Calibration(coefficients).rising_range == pytest.approx(expected, rel=1e-4)


def with_strain(record: Record, factor: float, coefficients: tuple[float, ...]) -> Record:
    """The record with a strain in place of its tension, its reading multiplied."""
    tension = record.channels["tension"]
    readings = np.linspace(-0.4, 3.2, 20_000)
    strain = factor * np.interp(tension.samples, Calibration(coefficients).tension(readings), readings)
    channels = {name: c for name, c in record.channels.items() if name != "tension"}
    return Record(
        record.settings, channels | {"strain": Channel("strain", strain, tension.rate_hz)}, record.bodies
    )


def calibrated(of: Structure) -> CampaignSettings:
    data = settings_of(of).model_dump(exclude_none=True)
    return CampaignSettings.model_validate(data | {"bolt": {"link": "joint", "calibration": CUBIC}})


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize(("factor", "beyond"), [(1.0, ()), (40.0, (4, 5))])
def test_a_strain_beyond_where_its_calibration_rises_is_named(
    name: str, factor: float, beyond: tuple[int, ...]
) -> None:
    """Preloads from 20 N on, each twice the one before: 40 times the reading of 320 N is 4.7."""
    of = STRUCTURES[name]
    records = [with_strain(record, factor, CUBIC) for record in campaign(of)]
    found = [one for one in told(records, calibrated(of)) if one.likely == "strain beyond its calibration"]
    assert [one.record for one in found] == [f"records/{place}.h5" for place in beyond]
    assert all(one.sets_aside and "3.226" in one.finding for one in found)


def test_a_strain_in_another_unit_is_beyond_its_calibration_because_of_that() -> None:
    of = STRUCTURES["block"]
    records = [with_strain(record, 1e3, CUBIC) for record in campaign(of)]
    found = told(records, calibrated(of))
    assert [one.record for one in found] == [f"records/{place}.h5" for place in range(6)]
    assert {(one.likely, one.factor) for one in found} == {("strain in another unit", 1e-3)}


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_motion_that_falls_to_zero_is_named(name: str) -> None:
    def cut_out(y: FloatArray, _: FloatArray) -> FloatArray:
        y[6000:6020] = 0.0
        return y

    of = STRUCTURES[name]
    found = told(campaign(of), settings_of(of), only(f"acceleration_{of.struck}", cut_out), few=(0, 3))
    assert [(one.record, one.channel, one.likely) for one in found] == [
        (f"records/{i}.h5", f"acceleration_{of.struck}", "dropouts") for i in (0, 3)
    ]


@pytest.mark.parametrize("digits", [3, 30])
def test_a_motion_in_few_digits_is_at_rest_and_has_no_dropouts(digits: int) -> None:
    def quantised(y: FloatArray, _: FloatArray) -> FloatArray:
        step = float(np.abs(y).max()) / digits
        return np.round(y / step) * step

    for body in ("a", "b", "c"):
        found = told(campaign(CHAIN), settings_of(CHAIN), only(f"acceleration_{body}", quantised))
        assert "dropouts" not in {one.likely for one in found}


def test_all_readings_of_a_gauge_off_by_a_factor_without_a_name_are_said_and_kept() -> None:
    found = told(campaign(BLOCK), settings_of(BLOCK), scaled("tension", 1 / 40))
    assert len(found) == 5  # of the smallest preload a wrong zero may be the reason
    assert not any(one.sets_aside for one in found)
    assert [one.factor for one in found] == pytest.approx([40 / 1.05] * 5, rel=0.1)


def test_a_dead_accelerometer_is_named_in_each_record() -> None:
    of = STRUCTURES["chain"]
    spoilt = [
        changed(record, lambda name, y: 0 * y + 0.1 if name == "acceleration_c" else y)
        for record in campaign(of)
    ]
    found = told(spoilt, settings_of(of))
    assert {(one.channel, one.likely) for one in found} == {("acceleration_c", "nothing moves")}
    assert len(found) == len(spoilt)
    assert all(one.sets_aside and "shows nothing, not even noise" in one.finding for one in found)


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("offset", [G, -10 * G])
def test_a_sensor_that_shows_gravity_is_not_accused(name: str, offset: float) -> None:
    of = STRUCTURES[name]
    records = [
        changed(record, lambda channel, y: y + offset if channel.startswith("acceleration") else y)
        for record in campaign(of)
    ]
    assert told(records, settings_of(of)) == ()


@pytest.mark.parametrize("motion", ["velocity", "displacement"])
def test_a_force_of_noise_alone_was_not_recorded_whatever_is_measured(motion: str) -> None:
    def noise(name: str, y: FloatArray) -> FloatArray:
        return 0.05 * np.random.default_rng(1).standard_normal(y.size) if name.startswith("force") else y

    records = campaign(UNEQUAL, motion=motion)  # which swings at 10 Hz
    found = told(records, settings_of(UNEQUAL), lambda r: changed(r, noise), few=(2, 3))
    assert {(one.record, one.likely) for one in found} == {
        (f"records/{i}.h5", "force not recorded") for i in (2, 3)
    }


def test_where_nothing_moves_no_mean_does() -> None:
    (one,) = told(campaign(BLOCK), settings_of(BLOCK), scaled("acceleration", 0.0), few=(3,))
    assert one.likely == "nothing moves"


def test_a_channel_that_wraps_is_taken_for_nothing_else() -> None:
    found = told(campaign(UNEQUAL), settings_of(UNEQUAL), only("acceleration_light", wrapped), few=(0, 3))
    assert {one.likely for one in found} == {"wrap-around"}


@pytest.mark.parametrize("motion", ["acceleration", "velocity", "displacement"])
def test_a_window_is_told_with_its_rate_whatever_is_measured(motion: str) -> None:
    def window(name: str, y: FloatArray) -> FloatArray:
        return y if name == "tension" else windowed(y, np.arange(y.size) / RATE_HZ)

    found = told(campaign(BLOCK, motion=motion), settings_of(BLOCK), lambda r: changed(r, window))
    assert {one.likely for one in found} == {"exponential window"}
    rates = [float(one.finding.split("fades with ")[1].split()[0]) for one in found]
    assert rates == pytest.approx([4.0] * 6, abs=0.6)  # three deviations of half a second


def in_digits(y: FloatArray, digit: float) -> FloatArray:
    return digit * np.round(y / digit)


def windowed_from_the_hit(y: FloatArray, time: FloatArray) -> FloatArray:
    return y * np.exp(-4.0 * np.maximum(time - HIT_S, 0.0))


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize(
    ("window", "likely"), [(windowed_from_the_hit, "exponential window"), (rounded, "Hann window")]
)
def test_a_window_is_told_by_the_size_of_digits_where_they_hide_the_noise(
    name: str, window: Callable[[FloatArray, FloatArray], FloatArray], likely: str
) -> None:
    of, digit = STRUCTURES[name], 4 * 0.003  # four deviations of the noise
    channel = f"acceleration_{of.struck}"
    soft = [record for record in campaign(of) if record.test == "coupled"]
    assert told(soft, settings_of(of), only(channel, lambda y, _: in_digits(y, digit))) == ()
    found = told(soft, settings_of(of), only(channel, lambda y, time: window(in_digits(y, digit), time)))
    assert [one.channel for one in found if one.likely == likely] == [channel] * 3


@pytest.mark.parametrize(("frequency_hz", "digits"), [(2.0, 300), (2.0, 3e4), (40.0, 300), (40.0, 3e4)])
def test_a_slow_motion_that_freezes_is_named_and_one_that_turns_is_not(
    frequency_hz: float, digits: float
) -> None:
    def swings(y: FloatArray, time: FloatArray) -> FloatArray:
        later = np.maximum(time - HIT_S, 0.0)
        slow = np.sin(2 * np.pi * frequency_hz * later) + 0.5 * np.sin(3.1 * np.pi * frequency_hz * later)
        largest = float(np.abs(y).max())
        return in_digits(largest * slow, largest / digits)

    def stuck(y: FloatArray, time: FloatArray) -> FloatArray:
        moved = swings(y, time)
        moved[9000:9900] = moved[9000]
        return moved

    def of(change: Callable[[FloatArray, FloatArray], FloatArray]) -> list[str]:
        spoil = only("displacement_block", change)
        found = told(campaign(BLOCK, motion="displacement"), settings_of(BLOCK), spoil, few=(0,))
        return [one.likely for one in found if one.likely in ("channel frozen", "dropouts")]

    assert of(swings) == []
    assert of(stuck) == ["channel frozen"]


def test_a_hit_at_the_first_sample_leaves_no_noise_to_tell() -> None:
    """Two samples before it have no third difference, of which there is no mean."""
    whole, settings, start_s = campaign(BLOCK)[1], settings_of(BLOCK), HIT_S - 2 / RATE_HZ
    cut = {name: c.samples[round(start_s * c.rate_hz) :] for name, c in whole.channels.items()}
    channels = {name: Channel(name, y, whole.channels[name].rate_hz) for name, y in cut.items()}
    record = Record(whole.settings, channels, whole.bodies)
    seen = evidence(record, settings, assess(record, settings))
    assert seen.balance is not None
    assert np.array_equal(seen.balance.noise, np.zeros(2))


@pytest.mark.parametrize("noise", [0.3, 0.5, 0.7, 1.0])
def test_a_gauge_whose_noise_is_about_a_digit_is_not_frozen(noise: float) -> None:
    """Of so many samples a few in a row are equal by chance."""
    rng = np.random.default_rng(3)

    def coarse(y: FloatArray, _: FloatArray) -> FloatArray:
        return np.round(1000.0 + noise * rng.normal(size=y.size))

    found = told(campaign(BLOCK), settings_of(BLOCK), only("tension", coarse))
    assert "channel frozen" not in {one.likely for one in found}


@pytest.mark.parametrize("noise", [0.5, 3.0])
def test_a_gauge_in_digits_that_keeps_one_value_is_frozen(noise: float) -> None:
    rng = np.random.default_rng(3)

    def stuck(y: FloatArray, _: FloatArray) -> FloatArray:
        coarse = np.round(5000.0 + noise * rng.normal(size=y.size) - 0.3 * np.arange(y.size))
        coarse[1500:1900] = coarse[1500]
        return coarse

    found = told(campaign(BLOCK), settings_of(BLOCK), only("tension", stuck))
    assert "channel frozen" in {one.likely for one in found}
