"""Rates and starts that files of others state: right, or one line that names what is not understood."""

from __future__ import annotations

from datetime import datetime, timedelta
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
from tests.experiments.datasets.matlab_objects import with_object


@pytest.mark.parametrize(
    ("variables", "rate_hz"),
    [
        ({"fs": 25600.0}, HZ),
        ({"Fs": "25,600 Hz"}, HZ),
        ({"SampleRate": "25.6 kHz"}, HZ),
        ({"dt": 1 / HZ}, HZ),
        ({"sampling_frequency": 25600}, HZ),
        ({"info": {"name": "rig 3", "fs": 25600.0}}, HZ),
        ({"rate_hz_F": "25,600 Hz", "rate_hz_A": "25.6 kHz"}, HZ),
        ({"fs": 25600.0, "time": clock(rate_hz=12800)}, 12800),
    ],
)
def test_a_rate_beside_the_signals(variables: dict[str, Any], rate_hz: float, matlab: Put) -> None:
    at_rate(matlab(variables), rate_hz)


@pytest.mark.parametrize(
    "variables", [{"fs": 25.6}, {"dt": 1e3 / HZ}, {"dt": 1e6 / HZ}, {"Fs": "25,600 kHz"}]
)
@pytest.mark.parametrize("motion_hz", [25600, 19200])
def test_a_rate_at_odds_by_a_power_of_ten_is_refused(
    variables: dict[str, Any], motion_hz: float, matlab: Put
) -> None:
    if variables == {"Fs": "25,600 kHz"}:  # the unit is told
        motion_hz = 25600
    refused(matlab(variables, motion_hz=motion_hz), "[sampling]", f"{motion_hz:g}")


@pytest.mark.parametrize("times", [1e-6, 1e-3, 0.01, 0.1, 10.0, 100.0, 1e3, 1e6])
def test_any_power_of_ten_is_refused(times: float, matlab: Put) -> None:
    refused(matlab({"fs": times * 19200.0}), "a.mat: F", "[sampling]", "19200")


@pytest.mark.parametrize(
    ("motion_hz", "tension_hz", "code"), [(25600, 6400, 0), (19200, 6400, 2), (25600, 4800, 2)]
)
def test_a_rate_beside_signals_of_two_lengths_fits_sampling_or_is_refused(
    motion_hz: float, tension_hz: float, code: int, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    tension = 100 + np.random.default_rng(2).standard_normal(N // 4)
    savemat(tmp_path / "lab" / "a.mat", {"F": FORCE, "A": ACCELERATION, "T": tension, "fs": 25600.0})
    rules = {**CHANNELS, "T": '{channel = "tension", unit = "N"}'}
    found = imported(capfd, tmp_path / "lab", "matlab", rules, motion_hz, tension_hz)
    assert found.code == code, found.line


def test_a_rate_beside_is_of_those_without_one_of_their_own(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    tension = 100 + np.random.default_rng(2).standard_normal(N // 4)
    variables = {"F": FORCE, "A": ACCELERATION, "T": tension, "fs": 25600.0, "rate_hz_T": 6400.0}
    savemat(tmp_path / "lab" / "a.mat", variables)
    rules = {**CHANNELS, "T": '{channel = "tension", unit = "N"}'}
    found = imported(capfd, tmp_path / "lab", "matlab", rules)
    assert found.code == 0, found.line
    assert found.rates == {"force_m": HZ, "acceleration_m": HZ, "tension": HZ / 4}


@pytest.mark.parametrize(("rates", "code"), [("19200 4800", 0), ("25600 6400", 2), ("25600;19200", 0)])
def test_several_rates_of_an_export(
    rates: str, code: int, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    savemat(tmp_path / "lab" / "a.mat", export(rates))
    found = imported(capfd, tmp_path / "lab", "matlab", CHANNELS)
    assert found.code == code, found.line


def test_a_time_that_only_matlab_reads_is_refused(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    with_object(tmp_path / "lab" / "a.mat", "datetime", {"F": FORCE, "A": ACCELERATION}, "Timestamp")
    found = imported(capfd, tmp_path / "lab", "matlab", CHANNELS)
    refused(found, "Timestamp", "datetime", "rate_hz")


@pytest.mark.parametrize("motion_hz", [19200, 25600])
def test_a_waveform_in_ms_that_does_not_say_so_is_refused(motion_hz: float, tdms: Put) -> None:
    refused(tdms(waveforms(None, None, wf_increment=1e3 / HZ), motion_hz=motion_hz), "25.6 Hz", "25600 Hz")


def test_a_time_as_a_channel_is_refused(tdms: Put) -> None:
    dates = np.datetime64(DAY, "us") + np.round(1e6 * clock()).astype("m8[us]")
    channels = {"F": (dates, {}, "run"), "A": (ACCELERATION, {"wf_increment": 1 / HZ}, "run")}
    refused(tdms(channels), "a.tdms: F", "dates")


def export(rate: str) -> dict[str, Any]:
    """Return what HBK's software exports."""
    return {
        "File_Header": {"SampleFrequency": rate},
        "Channel_1_Header": {"SignalName": "F", "Unit": "N"}, "Channel_1_Data": FORCE,
        "Channel_2_Header": {"SignalName": "A", "Unit": "m/s2"}, "Channel_2_Data": ACCELERATION,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "rate_hz"),
    [
        ("25,600 Hz", 25600),
        ("25.600 Hz", None),
        ("25600", 25600),
        ("25,6 kHz", 25600),
        ("25'600 Hz", 25600),
        ("25 600,0 Hz", 25600),
        ("25600,00", 25600),
        ("25,600.0", 25600),
        ("2.56e4 Hz", 25600),
        ("1/25600", None),
        ("fast", None),
        ("", 19200),
    ],
)
def test_separators_in_the_rate_of_an_export(
    text: str, rate_hz: float | None, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    savemat(tmp_path / "lab" / "a.mat", export(text))
    found = imported(capfd, tmp_path / "lab", "matlab", CHANNELS)
    if rate_hz is None:
        refused(found, "[sampling]", "rate_hz")
    else:
        at_rate(found, rate_hz)


def uff(path: Path, step: float, label: str, start: float = 0.0, factor: float = 1.0) -> None:
    """Write F and A with an abscissa in a unit."""
    import warnings

    import pyuff

    for number, (name, samples) in enumerate((("F", FORCE), ("A", ACCELERATION)), start=1):
        function = pyuff.prepare_58(
            binary=0,
            func_type=1,
            rsp_node=number,
            rsp_dir=3,
            ref_node=1,
            ref_dir=3,
            data=samples,
            x=factor * (start + np.arange(N) * step),
            id1=name,
            abscissa_spacing=1,
            abscissa_min=start,
            abscissa_inc=step,
            abscissa_spec_data_type=17,
            abscissa_axis_units_lab=label,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=0,
            num_pts=N,
            ord_data_type=4,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            pyuff.UFF(str(path)).write_sets([function], "add")


@pytest.mark.parametrize(
    ("step", "label", "rate_hz"),
    [
        (1 / HZ, "s", HZ),
        (1e3 / HZ, "ms", HZ),
        (1e6 / HZ, "us", HZ),
        (1 / HZ, "", HZ),
        (1e3 / HZ, "", None),
        (1e6 / HZ, "", None),
        (1e3 / HZ, "s", None),
        (1.0, "s", None),
        (1 / HZ, "Hz", None),
    ],
)
def test_the_abscissa_of_a_universal_file(
    step: float, label: str, rate_hz: float | None, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    uff(tmp_path / "lab" / "a.uff", step, label)
    found = imported(capfd, tmp_path / "lab", "uff", CHANNELS)
    if rate_hz is None:
        refused(found, "a.uff: F", "expected")
    else:
        assert found.code == 0, found.line
        assert found.rates["force_m"] == pytest.approx(rate_hz, rel=1e-5)


DAY = datetime(2026, 3, 1, 12, 0, 0)


def waveforms(force_at: Any, acceleration_at: Any, **more: Any) -> dict[str, Any]:
    """Return F and A with waveform properties and starts."""
    starts = {"F": force_at, "A": acceleration_at}
    return {
        name: (samples, {"wf_increment": 1 / HZ, **({} if at is None else at), **more}, name)
        for (name, at), samples in zip(starts.items(), (FORCE, ACCELERATION), strict=True)
    }


def test_channels_that_start_apart_are_refused(tdms: Put) -> None:
    late = DAY + timedelta(seconds=0.25)
    refused(
        tdms(waveforms({"wf_start_time": DAY}, {"wf_start_time": late})),
        "acceleration_m",
        "0.25 s after force_m",
    )


def test_an_offset_counts_beside_the_time_of_the_day(tdms: Put) -> None:
    late = {"wf_start_time": DAY, "wf_start_offset": 0.25}
    refused(tdms(waveforms({"wf_start_time": DAY}, late)), "0.25 s")


def test_an_offset_that_makes_up_for_a_later_start_is_none(tdms: Put) -> None:
    early = {"wf_start_time": DAY + timedelta(seconds=0.25), "wf_start_offset": -0.25}
    at_rate(tdms(waveforms({"wf_start_time": DAY}, early)))


@pytest.mark.parametrize("start", [None, {"wf_start_offset": 0.0}, {"wf_start_time": datetime(1904, 1, 1)}])
def test_only_stated_starts_are_compared(start: Any, tdms: Put) -> None:
    at_rate(tdms(waveforms({"wf_start_time": DAY}, start)))


@pytest.mark.parametrize("where", ["fast", "slow"])
def test_a_start_on_another_clock_is_told_not_compared(
    where: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    shift = {"fast": 0.0, "slow": 0.0, where: 1.77e9}
    tension = 100 + np.random.default_rng(2).standard_normal(N // 4)
    savemat(
        tmp_path / "lab" / "a.mat",
        {
            "F": FORCE,
            "A": ACCELERATION,
            "t": shift["fast"] + clock(),
            "T": tension,
            "t_slow": shift["slow"] + clock(N // 4, HZ / 4),
        },
    )
    rules = {**CHANNELS, "T": '{channel = "tension", unit = "N"}'}
    found = imported(capfd, tmp_path / "lab", "matlab", rules)
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": HZ, "acceleration_m": HZ, "tension": HZ / 4}, rel=1e-5)
    assert "different clocks" in found.out


def test_dates_are_times(tdms: Put) -> None:
    dates = np.datetime64(DAY, "us") + np.round(1e6 * clock()).astype("m8[us]")
    at_rate_within = tdms({**with_time("Timestamp", "", 1.0), "Timestamp": (dates, {}, "run")})
    assert at_rate_within.code == 0, at_rate_within.line
    assert at_rate_within.rates["force_m"] == pytest.approx(HZ, rel=1e-5)


def test_a_waveform_with_a_step_in_ms(tdms: Put) -> None:
    channels = waveforms(None, None, wf_increment=1e3 / HZ, wf_xunit_string="ms")
    at_rate(tdms(channels))


def test_an_axis_that_is_no_time_is_refused(tdms: Put) -> None:
    refused(tdms(waveforms(None, None, wf_xunit_string="Hz")), "a.tdms: A", '"Hz"', "wf_xunit_string")


def test_a_step_of_one_is_what_a_program_writes_for_none(tdms: Put) -> None:
    refused(tdms(waveforms(None, None, wf_increment=1.0)), "a.tdms: A", "1 Hz", "[sampling]")


def test_rates_other_than_in_sampling_are_told(matlab: Put) -> None:
    found = matlab({"time": clock()})
    assert "force_m 25600 Hz (not 19200)" in found.out


@pytest.mark.parametrize("with_rate", [False, True])
@pytest.mark.parametrize("how", ["date", "offset"])
def test_a_start_is_compared_whoever_tells_the_rate(how: str, with_rate: bool, tdms: Put) -> None:
    late: dict[str, Any] = {"wf_start_time": DAY + timedelta(seconds=0.25)}
    channels = waveforms({"wf_start_time": DAY}, late)
    if how == "offset":
        channels = waveforms({"wf_start_offset": 0.0}, {"wf_start_offset": 0.25})
    rules = {name: rule.replace("}", ", rate_hz = 25600}") for name, rule in CHANNELS.items()}
    refused(tdms(channels, rules if with_rate else None), "acceleration_m", "0.25 s after force_m")


@pytest.mark.parametrize("unit", ["", "_s", "_ms"])
def test_a_time_that_starts_later_is_told_beside_a_rate_of_the_map(
    unit: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "lab").mkdir()
    factor = 1e3 if unit == "_ms" else 1.0
    tension = 100 + np.random.default_rng(2).standard_normal(N // 4)
    slow = factor * (0.25 + clock(N // 4, HZ / 4))
    variables = {"F": FORCE, "A": ACCELERATION, "t": clock(), "T": tension, f"time_slow{unit}": slow}
    savemat(tmp_path / "lab" / "a.mat", variables)
    rules = {**CHANNELS, "T": '{channel = "tension", unit = "N", rate_hz = 6400}'}
    refused(imported(capfd, tmp_path / "lab", "matlab", rules), "tension", "0.25 s after")
