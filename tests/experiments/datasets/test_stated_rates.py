"""Rates stated by names of values, in remarks and properties: right, or refused where they are at odds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.experiments.datasets.lab_case import (
    ACCELERATION,
    CHANNELS,
    FORCE,
    HZ,
    Outcome,
    Put,
    at_rate,
    clock,
    imported,
    refused,
)

NAMED: list[tuple[str, Any, float | None]] = [
    ("fs_kHz", 25.6, HZ),
    ("sample_rate_khz", 25.6, HZ),
    ("Ts", 1 / HZ, HZ),
    ("T_s", 1 / HZ, HZ),
    ("Tsample", 1 / HZ, HZ),
    ("dt_ms", 1e3 / HZ, HZ),
    ("delta_t_us", 1e6 / HZ, HZ),
    ("Xincr", 1 / HZ, HZ),
    ("increment", 1 / HZ, HZ),
    ("dt", "39.0625 us", HZ),
    ("dt", "0.0390625 ms", HZ),
    ("sampleRate", "25.6 kHz", HZ),
    ("Ts", 1e3 / HZ, None),
    ("fs", [25600.0, 12800.0], None),
    ("fs", "as usual", None),
]


@pytest.fixture
def json_file(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a JSON file."""

    def work(content: Any, rules: Mapping[str, str] = CHANNELS) -> Outcome:
        (tmp_path / "lab").mkdir()
        (tmp_path / "lab" / "a.json").write_text(json.dumps(content))
        return imported(capfd, tmp_path / "lab", "json", rules)

    return work


LISTS: dict[str, Any] = {"F": FORCE.tolist(), "A": ACCELERATION.tolist()}


def right_or_refused(found: Outcome, rate_hz: float | None) -> None:
    """Require a rate, or a refusal that names [sampling]."""
    if rate_hz is None:
        refused(found, "F: found", "[sampling]", "rate_hz")
    else:
        at_rate(found, rate_hz)


@pytest.mark.parametrize(("name", "value", "rate_hz"), NAMED)
def test_a_value_beside_the_signals_of_matlab(
    name: str, value: Any, rate_hz: float | None, matlab: Put
) -> None:
    right_or_refused(matlab({name: value}), rate_hz)


@pytest.mark.parametrize(("name", "value", "rate_hz"), NAMED)
@pytest.mark.parametrize("inner", [False, True])
def test_a_value_in_json(name: str, value: Any, rate_hz: float | None, inner: bool, json_file: Put) -> None:
    right_or_refused(json_file({**LISTS, **({"info": {name: value}} if inner else {name: value})}), rate_hz)


@pytest.mark.parametrize(
    "content",
    [
        {"metadata": {"fs": HZ}, **LISTS},
        {"sampling": {"rate": 25.6, "unit": "kHz"}, **LISTS},
        {"rate": "25.6 kHz", **LISTS},
        {"interval": "39.0625 us", **LISTS},
        {"time_ms": (1e3 * clock()).tolist(), **LISTS},
    ],
)
def test_rates_that_json_has_elsewhere(content: Any, json_file: Put) -> None:
    at_rate(json_file(content))


@pytest.mark.parametrize("content", [{"rate": 25.6, **LISTS}, {"interval": 1e3 / HZ, **LISTS}])
def test_a_rate_in_json_without_its_unit_is_refused(content: Any, json_file: Put) -> None:
    refused(json_file(content), "a.json: F: found 25.6 Hz", "25600 Hz in another unit")


def test_a_letter_is_no_rate(json_file: Put) -> None:
    at_rate(json_file(LISTS), 19200)


@pytest.mark.parametrize(
    ("content", "rules"),
    [
        ({"units": {"F": "kN", "A": "m/s2"}, "fs": HZ, "F": (FORCE / 1e3).tolist(), "A": LISTS["A"]}, "free"),
        (
            {"columns": ["time", "F", "A"], "units": ["us", "kN", "m/s2"],
             "data": np.column_stack([1e6 * clock(), FORCE / 1e3, ACCELERATION]).tolist()},
            "free",
        ),
        ({"fs": HZ, "F": [str(x) for x in LISTS["F"]], "A": LISTS["A"]}, "given"),
    ],
)  # fmt: skip
def test_units_and_numbers_as_json_may_write_them(content: Any, rules: str, json_file: Put) -> None:
    free = {"F": '"force_m"', "A": '"acceleration_m"'}
    found = json_file(content, free if rules == "free" else CHANNELS)
    assert found.code == 0, found.line
    assert found.rates["force_m"] == pytest.approx(HZ)
    np.testing.assert_allclose(found.samples["force_m"], FORCE, rtol=1e-12)


def test_channels_of_json_that_start_apart_are_refused(json_file: Put) -> None:
    content = [
        {"name": "F", "x0": 0.0, "dt": 1 / HZ, "y": LISTS["F"]},
        {"name": "A", "x0": 0.25, "dt": 1 / HZ, "y": LISTS["A"]},
    ]
    refused(json_file(content), "acceleration_m to start 0.25 s after force_m")


def test_texts_that_are_times_in_json(json_file: Put) -> None:
    day = np.datetime64("2026-03-01T12:00:00") + (1e9 * clock(rate_hz=10000)).astype("m8[ns]")
    found = json_file({"time": [str(moment) for moment in day], **LISTS})
    at_rate(found, 10000)


def test_times_of_text_in_cells_of_matlab_are_refused(matlab: Put) -> None:
    times = np.array([f"2026-03-01T12:00:{at:09.6f}" for at in clock()], dtype=object)
    refused(matlab({"time": times}), "a.mat: time: found cells of text", "rate_hz")


@pytest.mark.parametrize(
    ("remarks", "rate_hz"),
    [
        ("Sample rate: 25600 Hz\nLow pass filter frequency: 5000 Hz", HZ),
        ("Number of samples: 2560\nSample rate: 25600", HZ),
        ("Samples: 2560\nfs: 25600", HZ),
        ("X-Increment;3.90625E-5", HZ),
        ("Cut-off frequency;5000 Hz", 19200),
        ("Sample rate A: 25600 Hz\nSample rate B: 12800 Hz", None),
        ("Sample rate A: 19200 Hz\nSample rate B: 4800 Hz", 19200),
    ],
)
def test_remarks_above_a_table(
    remarks: str, rate_hz: float | None, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    rows = "\n".join(f"{f!r};{a!r}" for f, a in zip(LISTS["F"], LISTS["A"], strict=True))
    (tmp_path / "lab" / "a.csv").write_text(f"{remarks}\nF;A\n{rows}\n")
    right_or_refused(imported(capfd, tmp_path / "lab", "csv", CHANNELS), rate_hz)


@pytest.mark.parametrize("where", ["above", "other sheet"])
@pytest.mark.parametrize(
    ("label", "value"), [("Sample rate [Hz]", 25600), ("fs", "25.6 kHz"), ("dt", "39.0625 us")]
)
def test_remarks_in_a_spreadsheet(
    where: str, label: str, value: Any, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    import openpyxl

    (tmp_path / "lab").mkdir()
    book = openpyxl.Workbook()
    sheet = book.active
    (sheet if where == "above" else book.create_sheet("info")).append([label, value])
    for row in (["F", "A"], *np.column_stack([FORCE, ACCELERATION]).tolist()):
        sheet.append(row)
    book.save(tmp_path / "lab" / "a.xlsx")
    found = imported(capfd, tmp_path / "lab", "xlsx", CHANNELS)
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": HZ, "acceleration_m": HZ})


@pytest.mark.parametrize("where", ["root", "group", "channel"])
@pytest.mark.parametrize(("name", "value"), [("SampleRate", 25600.0), ("wf_increment", 1 / HZ)])
def test_properties_of_tdms(
    where: str, name: str, value: float, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    import nptdms

    (tmp_path / "lab").mkdir()
    own = {level: {name: value} if level == where else {} for level in ("root", "group", "channel")}
    with nptdms.TdmsWriter(str(tmp_path / "lab" / "a.tdms")) as writer:
        writer.write_segment([
            nptdms.RootObject(own["root"]),
            nptdms.GroupObject("run", own["group"]),
            nptdms.ChannelObject("run", "F", FORCE, own["channel"]),
            nptdms.ChannelObject("run", "A", ACCELERATION, own["channel"]),
        ])  # fmt: skip
    at_rate(imported(capfd, tmp_path / "lab", "tdms", CHANNELS))


def test_a_step_below_zero_is_refused(tdms: Put) -> None:
    channels = {"F": (FORCE, {"wf_increment": -1 / HZ}, "run"), "A": (ACCELERATION, {}, "run")}
    refused(tdms(channels), "a.tdms: F", "wf_increment", "above 0")


def test_times_that_start_apart_are_told(matlab: Put) -> None:
    found = matlab({"time": clock(), "Timestamp": 5.0 + clock()})
    at_rate(found)
    assert "times that start apart" in found.out
    assert 'a.mat ("time" and "Timestamp")' in found.out


def test_a_time_in_few_digits_tells_the_rate_of_its_middle(matlab: Put) -> None:
    """The ends alone are off by 260 ppm here."""
    found = matlab({"time": np.round(clock(), 5)})
    assert found.code == 0, found.line
    assert found.rates["force_m"] == pytest.approx(HZ, rel=1e-5)
