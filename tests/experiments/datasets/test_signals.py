"""Names, times, units and patterns of a laboratory's signals."""

from __future__ import annotations

from unittest.mock import ANY

import numpy as np
import pytest

from experiments.datasets.channel_map import pattern_of
from experiments.datasets.rates import readings_of
from experiments.datasets.signals import Clocks, Signal
from experiments.datasets.times import Clock, label
from experiments.datasets.units import si_factor


def clock_of_x(*others: Signal, samples: int = 50, rate_hz: float | None = None) -> Clock | None:
    """Return the clock of a signal x beside others."""
    x = Signal("x", np.random.default_rng(0).standard_normal(samples), rate_hz=rate_hz)
    return Clocks("file", [*others, x], {}, ["x"]).of(x, 200.0)


@pytest.mark.parametrize(
    "name", ["t", "time", "Time  1 - default", "run.time", "Zeit", "t_s", "group/Time", "time_4800"]
)
def test_a_time_gives_rate_and_start(name: str) -> None:
    found = clock_of_x(Signal(name, 3.0 + np.arange(50) / 200, "s"))
    assert found is not None
    assert found.rate_hz == pytest.approx(200)
    assert found.start_s == 3.0


@pytest.mark.parametrize(
    "name", ["T", "tension", "timer", "Temperature", "thrust", "x.times", "t_bolt", "Second gauge"]
)
def test_a_signal_is_no_time(name: str) -> None:
    signal = Signal(name, np.random.default_rng(1).standard_normal(50))
    assert Clocks("file", [signal], {}, []).signals == [signal]


@pytest.mark.parametrize("unit", ["N", "kN", "m/s2", "mm"])
def test_a_time_in_a_unit_of_something_else_is_none(unit: str) -> None:
    assert clock_of_x(Signal("t", np.arange(50.0) / 200, unit), rate_hz=7.0) == (7.0, None, ANY, ())


def test_times_in_milliseconds() -> None:
    found = clock_of_x(Signal("Time", np.arange(50.0), "ms"))
    assert found is not None
    assert found.rate_hz == pytest.approx(1000)


def test_two_times_of_one_length_that_are_at_odds_give_way_to_the_rate_that_the_file_states() -> None:
    times = [Signal(f"Time {n}", np.arange(50) * n, "s") for n in (1, 2)]
    found = clock_of_x(*times, rate_hz=7.0)
    assert found is not None
    assert found.rate_hz == 7.0


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("Force [kN]", "Force", "kN"), ("Acc (m/s²)", "Acc", "m/s²"), ("Time [ms]", "Time", "ms"),
        ("Force (left)", "Force (left)", ""), ("acc(:,2)", "acc(:,2)", ""), ("x.force", "x.force", ""),
        ("Weg in mm", "Weg in mm", ""), ("t_us", "t", "us"), ("s", "s", ""),
        ("Strain [ticks]", "Strain", "ticks"),
    ],
)  # fmt: skip
def test_labels(name: str, base: str, unit: str) -> None:
    assert label(name) == (base, unit)


@pytest.mark.parametrize(
    ("text", "readings"),
    [
        ("25600", (25600,)), ("25,600", (25600, 25.6)), ("25.600", (25.6, 25600)), ("25,6", (25.6,)),
        ("0,600", (0.6,)),
        ("1,234.5", (1234.5,)), ("1.234,5", (1234.5,)), ("1.234.567", (1234567,)), ("25 600", (25600,)),
        ("25'600", (25600,)), ("1e3", (1000,)),
    ],
)  # fmt: skip
def test_printed_numbers(text: str, readings: tuple[float, ...]) -> None:
    assert readings_of(text) == readings


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
        ("force_lo", "Newton", 1.0), ("force_lo", "[kilonewtons]", 1e3), ("acceleration_lo", "m/sec^2", 1.0),
        ("acceleration_lo", "G", 9.80665), ("displacement_lo", "millimeter", 1e-3), ("force_lo", "G", None),
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
