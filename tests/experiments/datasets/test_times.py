"""Times of files of others: understood, or one line that names what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from tests.experiments.datasets.lab_case import (
    ACCELERATION,
    CHANNELS,
    FORCE,
    HZ,
    N,
    Put,
    at_rate,
    clock,
    imported,
    refused,
    with_time,
)


@pytest.mark.parametrize(
    "name",
    [
        "Timestamp",
        "TimeStamp",
        "X_Value",
        "X-Wert",
        "Zeit",
        "Zeitstempel",
        "Messzeit",
        "Abs. Zeit",
        "Temps",
        "tiempo",
        "Tempo",
        "Tijd",
        "Czas",
        "Aika",
        "Idő",
        "Время",
        "时间",
        "Elapsed Time",
        "SampleTime",
        "t",
        "t1",
        "Time  1 - default sample rate",
        "TIME",
        "rel_time",
    ],
)
@pytest.mark.parametrize("unit", ["", "s"])
def test_a_time_by_any_name_gives_the_rate(name: str, unit: str, tdms: Put) -> None:
    at_rate(tdms(with_time(name, unit, 1.0)))


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("Seconds", 1.0),
        ("Sekunden", 1.0),
        ("sec", 1.0),
        ("[s]", 1.0),
        ("ms", 1e3),
        ("Millisekunden", 1e3),
        ("msec", 1e3),
        ("us", 1e6),
        ("µs", 1e6),
        ("μs", 1e6),
        ("microseconds", 1e6),
        ("ns", 1e9),
        ("min", 1 / 60),
        ("Minuten", 1 / 60),
        ("h", 1 / 3600),
        ("Stunden", 1 / 3600),
        ("hours", 1 / 3600),
        ("days", 1 / 86400),
    ],
)
def test_a_time_in_any_unit_gives_the_rate(unit: str, factor: float, tdms: Put) -> None:
    at_rate(tdms(with_time("Zeit", unit, factor)))


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("time_ms", 1e3),
        ("t_us", 1e6),
        ("Time_s", 1.0),
        ("Zeit_ms", 1e3),
        ("timestamp_ns", 1e9),
        ("t_h", 1 / 3600),
        ("tMs", 1e3),
    ],
)
def test_the_name_of_a_variable_tells_the_unit(name: str, factor: float, matlab: Put) -> None:
    at_rate(matlab({name: factor * clock()}))


@pytest.mark.parametrize(
    ("label", "factor"),
    [
        ("Time [ms]", 1e3),
        ("Zeit in ms", 1e3),
        ("Zeit / µs", 1e6),
        ("t (us)", 1e6),
        ("Temps, ms", 1e3),
        ("Seconds", 1.0),
        ("Millisekunden", 1e3),
    ],
)
def test_a_label_tells_the_unit(label: str, factor: float, tdms: Put) -> None:
    at_rate(tdms(with_time(label, "", factor)))


@pytest.mark.parametrize(("place", "motion_hz"), [(0, 19200), (0, 25600), (1, 25600)])
@pytest.mark.parametrize("wide", [False, True])
def test_the_time_in_a_matrix(
    place: int, motion_hz: float, wide: bool, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    columns = [FORCE, ACCELERATION]
    columns.insert(place, clock())
    names = [f"data({i},:)" if wide else f"data(:,{i})" for i in (1, 2, 3)]
    del names[place]
    table = np.stack(columns, axis=0 if wide else 1)
    savemat(tmp_path / "lab" / "a.mat", {"data": table})
    at_rate(
        imported(
            capfd, tmp_path / "lab", "matlab", dict(zip(names, CHANNELS.values(), strict=True)), motion_hz
        )
    )


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_the_first_column_in_other_units_is_refused(
    factor: float, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    savemat(tmp_path / "lab" / "a.mat", {"data": np.stack([factor * clock(), FORCE, ACCELERATION], axis=1)})
    rules = dict(zip(("data(:,2)", "data(:,3)"), CHANNELS.values(), strict=True))
    refused(imported(capfd, tmp_path / "lab", "matlab", rules), "data(:,1)", "[sampling]", "unit")


@pytest.mark.parametrize(
    ("name", "factor"),
    [("time", 1e3), ("t", 1e6), ("Zeit", 1e9), ("Timestamp", HZ), ("time", 1 / 3600), ("X_Value", 1e3)],
)
@pytest.mark.parametrize("motion_hz", [19200, 25600, 5000])
def test_a_time_without_unit_that_is_in_no_seconds_is_refused(
    name: str, factor: float, motion_hz: float, matlab: Put
) -> None:
    refused(matlab({name: factor * clock()}, motion_hz=motion_hz), f'"{name}"', "[sampling]", "unit")


@pytest.mark.parametrize(
    ("rule", "factor"),
    [
        ('{channel = "time", unit = "ms"}', 1e3),
        ('{channel = "time", unit = "Mikrosekunden"}', 1e6),
        (f'{{channel = "time", scale = {1 / HZ!r}}}', HZ),
        ('"time"', 1.0),
        ('{channel = "time", unit = "h"}', 1 / 3600),
    ],
)
@pytest.mark.parametrize("name", ["time", "clicks", "A_axis"])
def test_the_map_names_time_and_unit(rule: str, factor: float, name: str, matlab: Put) -> None:
    at_rate(matlab({name: factor * clock()}, {name: rule}))


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ('{channel = "time", unit = "kN"}', ("unit", "kN", "ms")),
        ('{channel = "time", rate_hz = 5.0}', ("rate_hz", "time")),
        ('{channel = "time", scale = 0}', ("scale", "0")),
    ],
)
def test_a_rule_of_a_time_that_cannot_be_is_refused(rule: str, words: tuple[str, ...], matlab: Put) -> None:
    refused(matlab({"time": clock()}, {"time": rule}), "import.toml", *words)


def test_a_time_of_the_map_that_no_file_holds_is_refused(matlab: Put) -> None:
    refused(matlab({}, {"Uhr": '"time"'}), 'channels."Uhr"', "no file")


@pytest.mark.parametrize("unit", ["ticks", "samples", "V"])
def test_a_time_in_no_unit_of_time_is_refused(unit: str, tdms: Put) -> None:
    refused(tdms(with_time("Time", unit, HZ)), "Time", unit, "ms", "rate_hz")


def test_units_at_odds_are_refused(tdms: Put) -> None:
    refused(tdms(with_time("Time [ms]", "s", 1e3)), "Time [ms]", '"s"', '"ms"')


def uneven() -> Any:
    """Return times with a gap."""
    return clock() + 0.01 * (clock() > 0.05)


@pytest.mark.parametrize("times", [uneven(), clock()[::-1], np.zeros(N), np.full(N, np.nan), clock()[:-7]])
def test_a_time_that_cannot_be_used_is_named(times: Any, matlab: Put) -> None:
    refused(matlab({"Timestamp": times}), "Timestamp", "expected", "rate_hz")


@pytest.mark.parametrize("times", [uneven(), np.zeros(N), clock()[:-7], 1e3 * clock()])
def test_the_rate_of_the_map_goes_before_a_time(times: Any, matlab: Put) -> None:
    with_rate = {name: rule.replace("}", ", rate_hz = 12800}") for name, rule in CHANNELS.items()}
    at_rate(matlab({"time": times}, with_rate), 12800)


def test_a_time_in_an_unknown_unit_gives_way_to_the_rate_of_the_map(tdms: Put) -> None:
    with_rate = {name: rule.replace("}", ", rate_hz = 12800}") for name, rule in CHANNELS.items()}
    at_rate(tdms(with_time("Time", "ticks", 1.0), with_rate), 12800)


def test_times_at_odds_are_named(matlab: Put) -> None:
    refused(
        matlab({"time": clock(), "Timestamp": clock(rate_hz=12800)}),
        '"time"',
        '"Timestamp"',
        "25600",
        "12800",
    )


def test_times_that_only_start_apart_give_one_rate(matlab: Put) -> None:
    at_rate(matlab({"time": clock(), "Timestamp": 5.0 + clock()}))


def test_a_count_of_samples_tells_nothing(matlab: Put) -> None:
    at_rate(matlab({"n": np.arange(N), "Index": np.arange(1, N + 1)}), 19200)


def test_even_steps_that_may_be_a_time_are_not_passed_over(matlab: Put) -> None:
    refused(matlab({"u": clock()}), '"u"', "25600", 'channel = "time"')


def test_a_time_of_the_own_group_goes_before_others(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    strain = np.random.default_rng(1).standard_normal(N)
    fast = {"F": FORCE, "A": ACCELERATION, "time": clock()}
    savemat(tmp_path / "lab" / "a.mat", {"fast": fast, "slow": {"T": strain, "time": clock(rate_hz=5120)}})
    rules = {"fast.F": CHANNELS["F"], "fast.A": CHANNELS["A"]}
    found = imported(capfd, tmp_path / "lab", "matlab", rules)
    at_rate(found)


@pytest.mark.parametrize(
    ("name", "factor", "fits"),
    [
        ("Heure", 1.0, False),
        ("hora", 1 / 3600, True),
        ("Stunde", 1.0, False),
        ("h", 1 / 3600, True),
        ("Sekunde", 1.0, True),
    ],
)
def test_a_name_that_is_a_unit_may_be_a_mere_name(name: str, factor: float, fits: bool, matlab: Put) -> None:
    found = matlab({name: factor * clock()})
    if fits:
        at_rate(found)
    else:
        refused(found, f'"{name}"', "25600 Hz in another unit")


@pytest.mark.parametrize("name", ["timestamps_us", "TimeMs"])
def test_a_label_that_cannot_be_right_is_refused(name: str, matlab: Put) -> None:
    refused(matlab({name: clock()}), f'"{name}"', "[sampling]")
