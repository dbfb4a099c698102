"""Times, starts and rates of files of others: right, or one line that names what is not understood."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from tests.experiments.datasets.lab_case import (
    CHANNELS,
    HZ,
    N,
    Outcome,
    clock,
    force_and_acceleration,
    imported,
)
from tests.experiments.datasets.matlab_objects import with_object

FORCE, ACCELERATION = force_and_acceleration()
Put = Callable[..., Outcome]


@pytest.fixture
def matlab(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a MATLAB file of F, A and more."""

    def put(
        more: Mapping[str, Any], rules: Mapping[str, str] | None = None, motion_hz: float = 19200
    ) -> Outcome:
        (tmp_path / "lab").mkdir()
        savemat(tmp_path / "lab" / "a.mat", {"F": FORCE, "A": ACCELERATION, **more}, long_field_names=True)
        return imported(capfd, tmp_path / "lab", "matlab", {**CHANNELS, **(rules or {})}, motion_hz)

    return put


@pytest.fixture
def tdms(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a TDMS file of channels by name: samples, properties, and the group."""

    def put(
        channels: Mapping[str, Any], rules: Mapping[str, str] | None = None, motion_hz: float = 19200
    ) -> Outcome:
        import nptdms

        (tmp_path / "lab").mkdir()
        objects = [
            nptdms.ChannelObject(group, name, samples, properties)
            for name, (samples, properties, group) in channels.items()
        ]
        with nptdms.TdmsWriter(str(tmp_path / "lab" / "a.tdms")) as writer:
            writer.write_segment(objects)
        return imported(capfd, tmp_path / "lab", "tdms", {**CHANNELS, **(rules or {})}, motion_hz)

    return put


def with_time(name: str, unit: str, factor: float, start: float = 0.0) -> dict[str, Any]:
    """Return F, A and a time with its unit."""
    return {
        "F": (FORCE, {}, "run"),
        "A": (ACCELERATION, {}, "run"),
        name: (start + factor * clock(), {"unit_string": unit} if unit else {}, "run"),
    }


def refused(found: Outcome, *words: str) -> None:
    """Require one line with these words."""
    assert found.code == 2, found
    assert len(found.line.splitlines()) == 1, found.line
    assert all(word in found.line for word in words), found.line


def at_rate(found: Outcome, rate_hz: float = HZ) -> None:
    """Require both channels at a rate."""
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": rate_hz, "acceleration_m": rate_hz}, rel=1e-6)
    np.testing.assert_array_equal(found.samples["force_m"], FORCE)


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
    ("variables", "rate_hz"),
    [
        ({"fs": 25600.0}, HZ),
        ({"Fs": "25,600 Hz"}, HZ),
        ({"SampleRate": "25.6 kHz"}, HZ),
        ({"dt": 1 / HZ}, HZ),
        ({"sampling_frequency": 25600}, HZ),
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
