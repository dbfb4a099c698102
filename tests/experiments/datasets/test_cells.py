"""Cells of tables that are no plain numbers: thousands, dates, days beside times; headers of LabVIEW."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from tests.experiments.datasets.lab_case import CHANNELS, HZ, Outcome, clock, imported, refused

N = 400
FORCE, ACCELERATION = np.round([[2e3], [1.0]] * np.random.default_rng(3).standard_normal((2, N)), 3)
Put = Callable[..., Outcome]


@pytest.fixture
def put(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import one table."""

    def work(text: str, rules: Mapping[str, str] = CHANNELS, name: str = "a.csv") -> Outcome:
        (tmp_path / "lab").mkdir()
        (tmp_path / "lab" / name).write_text(text, encoding="utf-8")
        return imported(capfd, tmp_path / "lab", "csv", rules)

    return work


def sound(found: Outcome, rate_hz: float = HZ) -> None:
    """Require both channels as written."""
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": rate_hz, "acceleration_m": rate_hz}, rel=1e-6)
    np.testing.assert_allclose(found.samples["force_m"], FORCE, rtol=1e-9)
    np.testing.assert_allclose(found.samples["acceleration_m"], ACCELERATION, rtol=1e-9)


def lines(separator: str, times: list[str], write: Callable[[float], str] = repr) -> str:
    """Return rows of a time, force and acceleration."""
    rows = zip(times, FORCE.tolist(), ACCELERATION.tolist(), strict=True)
    return "\n".join(separator.join((at, write(f), write(a))) for at, f, a in rows)


SECONDS = [f"{at:.10f}" for at in clock(N)]


@pytest.mark.parametrize(
    ("separator", "thousands", "decimal"),
    [(";", ".", ","), (";", ",", "."), ("\t", "\u00a0", ","), (";", "'", "."), ("\t", " ", ",")],
)
def test_groups_of_thousands(separator: str, thousands: str, decimal: str, put: Put) -> None:
    def written(number: float) -> str:
        return f"{number:,.3f}".replace(",", "_").replace(".", decimal).replace("_", thousands)

    times = [at.replace(".", decimal) for at in SECONDS]
    sound(put(f"time{separator}F{separator}A\n" + lines(separator, times, written)))


def test_quoted_thousands_that_may_be_decimals_are_refused(put: Put) -> None:
    text = lines(",", SECONDS, lambda x: f'"{x:,.0f}"' if abs(x) > 1e3 else repr(x))
    refused(put("time,F,A\n" + text), "a.csv: column 2", "expected a number")


def moments(form: str, start: datetime) -> list[str]:
    """Return times 50 us apart."""
    return [(start + timedelta(microseconds=50 * i)).strftime(form) for i in range(N)]


NOON, MIDNIGHT = datetime(2026, 3, 1, 12), datetime(2026, 3, 1, 23, 59, 59, 990000)


@pytest.mark.parametrize("start", [NOON, MIDNIGHT])
@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%dT%H:%M:%S.%fZ",
        "%Y/%m/%d %H:%M:%S.%f",
        "%d-%b-%Y %H:%M:%S.%f",
        "%d.%m.%y %H:%M:%S.%f",
        "%m/%d/%Y %I:%M:%S.%f %p",
        "%H:%M:%S.%f",
        "%H:%M:%S:%f",
        "%d.%m.%Y;%H:%M:%S.%f",
    ],
)
def test_dates_and_times_of_day(form: str, start: datetime, put: Put) -> None:
    head = "day;time;F;A" if ";" in form else "time;F;A"
    sound(put(f"{head}\n" + lines(";", moments(form, start))), 20000)


@pytest.mark.parametrize("form", ["%d.%m.%Y %H:%M:%S", "%H:%M:%S", "%d.%m.%Y;%H:%M:%S"])
def test_times_in_whole_seconds_are_refused(form: str, put: Put) -> None:
    head = "day;time;F;A" if ";" in form else "time;F;A"
    refused(put(f"{head}\n" + lines(";", moments(form, NOON))), "a.csv: time", "rate_hz")


def test_a_line_that_is_no_row_is_shown(put: Put) -> None:
    text = "time;F;A\n" + lines(";", SECONDS, lambda x: f"{x} N")
    refused(put(text), "a.csv", "line 201", SECONDS[199], "N")


def test_no_row_is_lost_between_remarks(put: Put) -> None:
    rows = lines(";", SECONDS).splitlines()
    first = "\n# zeroed\n".join(rows[:30])
    sound(put("time;F;A\n" + "\n".join([first, *rows[30:]])))


def test_empty_columns_behind_the_numbers(put: Put) -> None:
    rows = lines(",", SECONDS).replace("\n", ",,,\n")
    sound(put(f"time,F,A\n{rows},,,\n"))


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t{decimal}
Multi_Headings\tNo
X_Columns\t{axes}
Date\t2026/03/01
Time\t12:00:00{decimal}5
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t400\t400\t
Date\t2026/03/01\t2026/03/01\t
Time\t12:00:00{decimal}5\t12:00:00{decimal}{late}\t
Y_Unit_Label\tkN\tm/s^2\t
X_Dimension\t{dimension}\t{dimension}\t
X0\t0\t0\t
Delta_X\t{step}\t{step}\t
***End_of_Header***\t\t\t
"""
FREE = {"F": '"force_m"', "A": '"acceleration_m"'}


def labview(
    axes: str, decimal: str = ".", late: str = "5", dimension: str = "Time", step: float = 1 / HZ
) -> str:
    """Return a LabVIEW measurement file with forces in kN."""
    head = LABVIEW.format(
        axes=axes, decimal=decimal, late=late, dimension=dimension, step=repr(step).replace(".", decimal)
    )
    names = {"One": "X_Value\tF\tA", "No": "X_Value\tF\tA", "Multi": "X_Value\tF\tX_Value\tA"}[axes]
    rows = []
    for at, f, a in zip(SECONDS, (FORCE / 1e3).tolist(), ACCELERATION.tolist(), strict=True):
        cells = {"One": (at, f"{f:.9g}", a), "No": ("", f"{f:.9g}", a), "Multi": (at, f"{f:.9g}", at, a)}
        rows.append("\t".join(map(str, cells[axes])).replace(".", decimal))
    rows[7] += "\tknock"
    return f"{head}{names}\tComment\n" + "\n".join(rows)


@pytest.mark.parametrize("axes", ["One", "No", "Multi"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_file_of_labview(axes: str, decimal: str, put: Put) -> None:
    sound(put(labview(axes, decimal), FREE, "a.lvm"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (labview("No", late="75"), ("acceleration_m", "0.25 s after force_m")),
        (labview("One", dimension="Frequency"), ("a.lvm", "X_Dimension", "Frequency")),
        (labview("No", step=1.0), ("a.lvm: F", "1 Hz", "[sampling]")),
        (labview("One") + "\n" + labview("One").split("***\t\n", 1)[1], ("a.lvm", "2 segments")),
        (labview("One").split("\nX_Value")[0], ("a.lvm", "End_of_Header")),
        (labview("One").replace("Delta_X\t3", "Delta_X\tx3"), ("a.lvm: F", "Delta_X", "a number")),
    ],
)
def test_a_file_of_labview_that_cannot_be_is_refused(text: str, words: tuple[str, ...], put: Put) -> None:
    refused(put(text, FREE, "a.lvm"), *words)
