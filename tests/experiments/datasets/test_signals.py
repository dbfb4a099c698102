"""Names, times, units and patterns of a laboratory's signals."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.datasets.channel_map import pattern_of
from experiments.datasets.signals import Signal, timed
from experiments.datasets.units import si_factor


@pytest.mark.parametrize(
    "name", ["t", "time", "Time  1 - default", "run.time", "Zeit", "t_s", "group/Time", "time_4800"]
)
def test_a_time_gives_rate_and_start(name: str) -> None:
    time = Signal(name, 3.0 + np.arange(50) / 200, "s")
    (found,) = timed(
        "file",
        [
            time,
            Signal("x", np.zeros(50)),
        ],
    )
    assert found.rate_hz == pytest.approx(200)
    assert found.start_s == 3.0


@pytest.mark.parametrize("name", ["T", "tension", "timer", "Temperature", "thrust", "x.times"])
def test_a_signal_is_no_time(name: str) -> None:
    assert [signal.name for signal in timed("file", [Signal(name, np.arange(50.0))])] == [name]


def test_times_in_milliseconds() -> None:
    time = Signal("Time", np.arange(50.0), "ms")
    assert timed("file", [time, Signal("x", np.zeros(50))])[0].rate_hz == pytest.approx(1000)


def test_two_times_of_one_length_that_are_at_odds_tell_nothing() -> None:
    times = [Signal(f"Time {n}", np.arange(50) * n, "s") for n in (1, 2)]
    assert timed("file", [*times, Signal("x", np.zeros(50), rate_hz=7.0)])[0].rate_hz == 7.0


@pytest.mark.parametrize(
    ("channel", "unit", "factor"),
    [
        ("force_lo", "kN", 1e3), ("force_lo", "[mN]", 1e-3), ("acceleration_lo", "m/s²", 1.0),
        ("acceleration_lo", "m/s^2", 1.0), ("acceleration_lo", "mm/s**2", 1e-3),
        ("acceleration_lo", "g", 9.80665), ("displacement_a_b", "µm", 1e-6),
        ("displacement_lo", "μm", 1e-6), ("velocity_lo", "mm / s", 1e-3),
        ("link_force_x", "N", 1.0), ("normal_force_x", "uN", 1e-6),
        ("link_displacement_x", "mm", 1e-3), ("tension", "kN", 1e3), ("strain", "whatever", 1.0),
        ("force_lo", "m/s2", None), ("acceleration_lo", "N", None), ("tension", "mm/m", None),
        ("force_lo", "", None), ("force_lo", "MN", None),
    ],
)  # fmt: skip
def test_units(channel: str, unit: str, factor: float | None) -> None:
    assert si_factor(channel, unit) == factor


@pytest.mark.parametrize(
    ("pattern", "name", "preload"),
    [
        ("*.mat", "a.mat", None), ("*.mat", "b/a.mat", False), ("a?.mat", "a1.mat", None),
        ("[!a]*.mat", "a1.mat", False), ("run_{preload_n}N.mat", "run_3.5N.mat", "3.5"),
        ("*{preload_n}N.mat", "x152N.mat", "152"), ("a.mat", "axmat", False),
        ("a+b*.mat", "a+b1.mat", None),
    ],
)  # fmt: skip
def test_patterns(pattern: str, name: str, preload: str | bool | None) -> None:
    match = pattern_of(pattern).fullmatch(name)
    found = match.groupdict().get("preload_n") if match else False
    assert found == preload
