"""Tables of a laboratory in text, spreadsheets and JSON: numbers, names, units and rates as written."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.experiments.datasets.lab_case import CHANNELS, HZ, Outcome, clock, imported

N = 400
FORCE, ACCELERATION = np.round(100 * np.random.default_rng(3).standard_normal((2, N)), 4)
ROWS = np.stack([clock(N), FORCE, ACCELERATION], axis=1)
FREE = {"F": '"force_m"', "A": '"acceleration_m"'}  # units from the file
Put = Callable[..., Outcome]


@pytest.fixture
def put(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import one file of bytes."""

    def work(
        content: str | bytes, rules: Mapping[str, str] = CHANNELS, name: str = "a.csv", form: str = "csv",
        encoding: str = "utf-8",
    ) -> Outcome:  # fmt: skip
        (tmp_path / "lab").mkdir()
        raw = content if isinstance(content, bytes) else content.encode(encoding)
        (tmp_path / "lab" / name).write_bytes(raw)
        return imported(capfd, tmp_path / "lab", form, rules)

    return work


def table(
    head: str, separator: str = ",", decimal: str = ".", end: str = "", rows: Any = ROWS, line: str = "\n"
) -> str:
    """Return a header and rows."""
    lines = (separator.join(f"{x:.10g}".replace(".", decimal) for x in row) + end for row in rows)
    return head + line + line.join(lines) + line


def sound(found: Outcome, rate_hz: float = HZ) -> None:
    """Require both channels as written."""
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": rate_hz, "acceleration_m": rate_hz}, rel=1e-6)
    np.testing.assert_allclose(found.samples["force_m"], FORCE, rtol=1e-9)
    np.testing.assert_allclose(found.samples["acceleration_m"], ACCELERATION, rtol=1e-9)


def refused(found: Outcome, *words: str) -> None:
    """Require one line with these words."""
    assert found.code == 2, found
    assert len(found.line.splitlines()) == 1, found.line
    assert all(word in found.line for word in words), found.line


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [
        (",", "."),
        (";", "."),
        (";", ","),
        ("\t", "."),
        ("\t", ","),
        ("|", "."),
        (" ", "."),
        ("  ", ","),
        (", ", "."),
        (" ; ", ","),
    ],
)
@pytest.mark.parametrize("line", ["\n", "\r\n"])
@pytest.mark.parametrize("end", [False, True])
def test_separators_and_decimal_marks(separator: str, decimal: str, line: str, end: bool, put: Put) -> None:
    head = separator.join(("time", "F", "A"))
    sound(put(table(head, separator, decimal, separator if end else "", line=line)))


def test_trailing_separators_in_the_header_as_well(put: Put) -> None:
    sound(put(table("time;F;A;", ";", ",", ";")))


def test_decimal_commas_in_quotes(put: Put) -> None:
    body = "\n".join(",".join(f'"{x:.10g}"'.replace(".", ",") for x in row) for row in ROWS)
    sound(put(f"time,F,A\n{body}\n"))


def test_commas_that_separate_and_are_decimal_marks_are_refused(put: Put) -> None:
    rows = [f"{i},5,{i + 1},25" for i in range(N)]
    refused(put("F,A\n" + "\n".join(rows)), "a.csv", "2 names", "4 numbers")


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252", "latin-1"]
)
def test_encodings(encoding: str, put: Put) -> None:
    rules = {"Größe": '"acceleration_m"', "Kraft": '"force_m"'}
    text = table("Zeit\tKraft\tGröße\nµs\tN\tm/s²", "\t", rows=ROWS * [1e6, 1, 1])
    sound(put(text, rules, encoding=encoding))


@pytest.mark.parametrize(
    ("page", "force", "size"),
    [
        ("cp1251", "Сила", "Ускорение"),
        ("mac_cyrillic", "Сила", "Ускорение"),
        ("koi8_r", "Сила", "Ускорение"),
        ("cp1250", "Síla", "Zrychlení ťažiska"),
        ("mac_roman", "Kraft", "Größe"),
    ],
)
def test_names_of_the_map_tell_the_code_page(page: str, force: str, size: str, put: Put) -> None:
    rules = {force: '"force_m"', size: '"acceleration_m"'}
    found = put(table(f"time\t{force}\t{size}\ns\tN\tm/s2", "\t"), rules, encoding=page)
    sound(found)
    assert f"the names of the map tell: {page}" in found.out


@pytest.mark.parametrize(
    "head",
    [
        "time,F,A\ns,N,m/s2",
        "time,F,A\nsec,Newton,m/sec^2",
        "time,F,A\n[s],[N],[m/s²]",
        "time,F,A\n(s),(N),(m/s^2)",
        "Zeit,F,A\nSekunden,N,m/s2",
        "Messung 7\nDatum: 1.2.2026\n\ntime,F,A\ns,N,m/s2",
        "# a remark\n# time,F,A\n# s,N,m/s2",
        "% rig 3\ntime,F,A\ns,N,m/s2\n",
        "//made by x\ntime,F,A\ns,N,m/s2",
        '"time","F","A"\n"s","N","m/s2"',
        "Name,rig,3\nOperator,a,b\ntime,F,A\ns,N,m/s2",
    ],
)
def test_names_and_units_above_the_numbers(head: str, put: Put) -> None:
    sound(put(table(head), FREE))


@pytest.mark.parametrize(
    "head", ["time [s],F [N],A [m/s2]", "Zeit (s),F (N),A (m/s²)", "Time_s,F [N],A [m/s^2]"]
)
def test_units_in_the_names(head: str, put: Put) -> None:
    names = head.split(",")
    sound(put(table(head), {names[1]: FREE["F"], names[2]: FREE["A"]}))


def test_a_unit_is_applied(put: Put) -> None:
    rows = ROWS / [1e-3, 1e3, 9.80665]
    sound(put(table("t;F;A\nms;kN;g", ";", ",", rows=rows), FREE))


def test_columns_without_names(put: Put) -> None:
    text = table("", " ", rows=ROWS)[1:]
    sound(put(text, {"column 2": CHANNELS["F"], "column 3": CHANNELS["A"]}, "a.txt"))


def test_comments_between_the_numbers(put: Put) -> None:
    lines = table("time,F,A").splitlines()
    lines.insert(60, "# paused")
    lines.insert(90, "")
    sound(put("\n".join(lines)))


@pytest.mark.parametrize(
    "remark",
    [
        "Sample rate: 25600 Hz",
        "Abtastrate;25600",
        "sampling frequency [Hz]: 25,600",
        "# Samplerate = 25.6 kHz",
        "# fs = 25.6 kHz",
        "# dt: 0.0390625 ms",
        "Abtastintervall;39.0625 µs",
    ],
)
def test_a_rate_in_a_remark(remark: str, put: Put) -> None:
    sound(put(table(f"{remark}\nF;A", ";", rows=ROWS[:, 1:])))


def test_a_unit_in_the_row_of_names_is_no_rate(put: Put) -> None:
    """A count of samples tells none either: that of [sampling] is taken."""
    rows = np.column_stack([np.arange(N), ROWS[:, 1:]])
    rules = {"F": CHANNELS["F"], "A [m/s2]": CHANNELS["A"]}
    sound(put(table("Sample;F;A [m/s2]", ";", rows=rows), rules), 19200)


def test_dates_and_times_of_day(put: Put) -> None:
    start = datetime(2026, 3, 1, 12)
    times = [f"{start + timedelta(milliseconds=10 * i):%d.%m.%Y %H:%M:%S,%f}" for i in range(N)]
    lines = [f"{at};" + f"{f:.10g};{a:.10g}".replace(".", ",") for at, f, a in
             zip(times, FORCE, ACCELERATION, strict=True)]  # fmt: skip
    found = put("Zeitstempel;F;A\n" + "\n".join(lines))
    sound(found, 100)


@pytest.mark.parametrize("form", ["%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f"])
def test_text_times(form: str, put: Put) -> None:
    start = datetime(2026, 3, 1, 12)
    lines = [f"{start + timedelta(microseconds=50 * i):{form}},{f:.10g},{a:.10g}" for i, (f, a) in
             enumerate(zip(FORCE, ACCELERATION, strict=True))]  # fmt: skip
    sound(put("Timestamp,F,A\n" + "\n".join(lines)), 20000)


def test_a_slower_column_has_cells_in_some_rows(put: Put) -> None:
    rows = [
        f"{t:.10g},{f:.10g},{a:.10g},{100 + i / 7 if i % 4 == 0 else ''}"
        for i, (t, f, a) in enumerate(ROWS.tolist())
    ]
    found = put("time,F,A,T\n" + "\n".join(rows), {**CHANNELS, "T": '{channel = "tension", unit = "N"}'})
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": HZ, "acceleration_m": HZ, "tension": HZ / 4})
    assert found.samples["tension"][1] == pytest.approx(100 + 4 / 7)


def test_a_column_that_ends_earlier_keeps_the_time_of_its_table(put: Put) -> None:
    rows = [f"{t:.10g},{f:.10g},{a:.10g}" for t, f, a in ROWS.tolist()]
    rows[-3:] = [row.rpartition(",")[0] + "," for row in rows[-3:]]
    found = put("time,F,A\n" + "\n".join(rows))
    assert found.code == 0, found.line
    assert found.rates == pytest.approx({"force_m": HZ, "acceleration_m": HZ})
    assert {len(samples) for samples in found.samples.values()} == {N - 3}


CATMAN = """CATMAN ASCII EXPORT
File: rig.bin
T0 = 01.03.2026 12:00:00


Time  1 - default sample rate\tF\tA\t
s\tN\tm/s²\t
0.039 ms (25600 Hz)\t0.039 ms (25600 Hz)\t0.039 ms (25600 Hz)\t
QuantumX MX840\tSlot 1\tSlot 2\t
None\tNone\tNone\t
"""


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8"])
@pytest.mark.parametrize("name", ["a.asc", "a.txt", "a.csv"])
def test_the_ascii_export_of_catman(decimal: str, encoding: str, name: str, put: Put) -> None:
    text = table(CATMAN.rstrip("\n"), "\t", decimal, "\t", line="\r\n")
    sound(put(text, FREE, name, "catman", encoding))


def test_the_other_export_of_catman(put: Put) -> None:
    text = table("Time  1 - default sample rate [s];F [N];A [m/s²]", ";", ",")
    sound(put(text, {"F [N]": FREE["F"], "A [m/s²]": FREE["A"]}, "a.csv", "catman"))


def test_an_export_of_catman_without_its_time_has_rates(put: Put) -> None:
    head = "F\tA\nN\tm/s²\n0.0390625 ms (25600 Hz)\t0.0390625 ms (25600 Hz)"
    sound(put(table(head, "\t", rows=ROWS[:, 1:]), FREE, "a.txt", "catman"))


BAD = {
    "empty": ("", ("a.csv", "no rows of numbers")),
    "words": ("no such thing\n" * 40, ("a.csv", "no rows of numbers")),
    "a word": (
        table("time,F,A").replace(f"{FORCE[200]:.10g}", "overload", 1),
        ("a.csv", "column 2", "overload", "201"),
    ),
    "a long row": (table("time,F,A") + "0.1,2,3,4\n", ("a.csv", "401", "expected 3")),
    "names for fewer": (table("time,F"), ("a.csv", "2 names", "3 numbers")),
    "a name twice": (table("time,F,F"), ("a.csv", "F", "more than once")),
    "a footer": (table("time,F,A") + "end of data\n", ("a.csv", "end of data")),
    "two readings": ("F\n" + "\n".join(f"{i},5,{i}" for i in range(40)), ("a.csv", "expected")),
    "zero bytes": ("time,F,A\n1,2\0,3\n", ("a.csv", "zero bytes")),
    "a gap": (table("time,F,A", rows=np.delete(ROWS, 77, axis=0)), ("a.csv", "time", "even steps")),
    "NaN": (table("time,F,A").replace(f",{FORCE[200]:.10g},", ",,", 1), ("force_m", "nan")),
}


@pytest.mark.parametrize("case", BAD)
def test_a_table_that_cannot_be_is_refused(case: str, put: Put) -> None:
    content, words = BAD[case]
    refused(put(content), *words)


def written_xlsx(path: Path, sheets: Mapping[str, list[list[Any]]]) -> None:
    """Write sheets of rows."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)


@pytest.fixture
def xlsx(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Put:
    """Import a spreadsheet."""

    def work(sheets: Mapping[str, list[list[Any]]], rules: Mapping[str, str] = CHANNELS) -> Outcome:
        (tmp_path / "lab").mkdir()
        written_xlsx(tmp_path / "lab" / "a.xlsx", sheets)
        return imported(capfd, tmp_path / "lab", "xlsx", rules)

    return work


@pytest.mark.parametrize(
    "head",
    [[["time", "F", "A"], ["s", "N", "m/s2"]], [["Rig 3"], [], ["Zeit", "F", "A"], ["[s]", "[N]", "[m/s²]"]]],
)
def test_a_spreadsheet(head: list[list[Any]], xlsx: Put) -> None:
    sound(xlsx({"data": [*head, *ROWS.tolist()]}, FREE))


def test_sheets_have_names(xlsx: Put) -> None:
    sheets = {
        "log": [["made by x"]],
        "run": [["time", "F", "A"], *ROWS.tolist()],
        "more": [["x"], [1.0], [2.0]],
    }
    sound(xlsx(sheets, {"run/F": CHANNELS["F"], "run/A": CHANNELS["A"]}))


def test_text_in_a_spreadsheet_is_refused(xlsx: Put) -> None:
    rows = ROWS.tolist()
    rows[40][1] = "overload"
    refused(xlsx({"data": [["time", "F", "A"], *rows]}), "a.xlsx", "column 2", "overload")


@pytest.mark.parametrize("rows", [[], [["a", "b"]], [["a"], ["x"], ["y"]]])
def test_a_spreadsheet_without_numbers_is_refused(rows: list[list[Any]], xlsx: Put) -> None:
    refused(xlsx({"data": rows}), "a.xlsx", "no rows of numbers")


LISTS = {"F": FORCE.tolist(), "A": ACCELERATION.tolist()}
TIME = clock(N).tolist()


@pytest.mark.parametrize(
    ("content", "prefix"),
    [
        ({"time": TIME, **LISTS}, ""),
        ({"run": {"time": TIME, **LISTS}}, "run."),
        ({"fs": 25600, **LISTS}, ""),
        ({"sampling_rate": "25,600 Hz", "signals": LISTS}, "signals."),
        ({"dt": 1 / HZ, **LISTS}, ""),
        ([{"time": t, "F": f, "A": a} for t, f, a in ROWS.tolist()], ""),
        ({"columns": ["time", "F", "A"], "data": ROWS.tolist()}, ""),
        ([{"name": n, "unit": "1", "rate_hz": HZ, "samples": s} for n, s in LISTS.items()], ""),
        ({n: {"unit": "x", "fs": HZ, "values": s} for n, s in LISTS.items()}, ""),
    ],
)
def test_json(content: Any, prefix: str, put: Put) -> None:
    rules = {f"{prefix}{name}": rule for name, rule in CHANNELS.items()}
    sound(put(json.dumps(content), rules, "a.json", "json"))


def test_json_with_units(put: Put) -> None:
    content = {"channels": [
        {"name": "F", "unit": "kN", "sample_rate": HZ, "data": (FORCE / 1e3).tolist()},
        {"name": "A", "unit": "g", "sample_rate": HZ, "data": (ACCELERATION / 9.80665).tolist()},
    ]}  # fmt: skip
    sound(put(json.dumps(content), FREE, "a.json", "json"))


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "{}", '{"a": 3}', '"text"', "[1]", "[" * 5000, '{"a": [1, "x"]}']
)
def test_json_without_signals_is_refused(content: str, put: Put) -> None:
    refused(put(content, name="a.json", form="json"), "a.json", "expected")


def test_signals_are_listed_as_the_file_has_them(put: Put) -> None:
    """The times of a column with a cell in every fifth row are not among them."""
    lines = [f"{t:g};{f};{a if row % 5 == 0 else ''}" for row, (t, f, a) in enumerate(ROWS)]
    found = put("\n".join(["Zeit;Kraft;Schraube", "s;N;kN", *lines]) + "\n", {"Hammer": '"force_m"'})
    refused(found, 'holds "Zeit" [s], "Kraft" [N], "Schraube" [kN]\n')
