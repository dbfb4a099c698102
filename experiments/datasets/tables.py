"""Tables of numbers in text: CSV, plain columns, catman's ASCII export.

Encoding, separator, decimal mark, comments, names and units are found in the file, which is refused where two
readings are left. The numbers are read by pandas.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from experiments.datasets import labview
from experiments.datasets.cells import EMPTY, is_number, numbers, with_days
from experiments.datasets.collected import SourceError
from experiments.datasets.rates import Told, rate_above, stated_rate
from experiments.datasets.signals import Signal
from experiments.datasets.times import factor_of, is_time
from experiments.datasets.units import symbols
from rom.model.units import parse_unit

ENDINGS = (".csv", ".txt", ".tsv", ".asc", ".dat", ".prn", ".lvm")
_HEAD = 400  # lines in which a header ends
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_COMMENT = re.compile(r"^\s*(#+|%+|//+|!|\*)\s?")


@dataclass(frozen=True)
class Dialect:
    """How a table is written; an empty separator is white space."""

    separator: str
    decimal: str

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line."""
        if not self.separator:
            return line.split()
        return [
            cell.strip()
            for cell in next(csv.reader([line], delimiter=self.separator, skipinitialspace=True), [])
        ]


_DIALECTS = tuple(
    Dialect(separator, decimal) for separator in ("\t", ";", "|", ",", "") for decimal in (".", ",")
)


def read(path: Path) -> list[Signal]:
    """Return the columns of a table in text.

    Raises
    ------
    SourceError
        If there is no table of numbers in it, or rows are of unequal length.
    """
    lines = decoded(path).replace("\u2212", "-").splitlines()
    if labview.is_labview(lines):
        return _of_labview(path.name, lines)
    dialect, start, width = _layout(path.name, lines)
    above = [_COMMENT.sub("", line) for line in lines[:start]]
    columns = _columns(path.name, lines[start:], dialect, width)
    return named(path.name, [dialect.cells(line) for line in above], columns, rate_above(above))


def _of_labview(file: str, lines: Sequence[str]) -> list[Signal]:
    told = labview.header(file, lines)
    columns = _columns(file, told.body, Dialect(told.separator, told.decimal), len(told.columns))
    signals = []
    for (name, unit, rate, start_s), column in zip(told.columns, columns, strict=True):
        rate_hz, readings = rate or (None, ())
        if len(filled := np.flatnonzero(~_missing(column))):
            signals.append(Signal(name, column[: filled[-1] + 1], unit, rate_hz, start_s, readings))
    return [*_slower(_with_shorter_times(signals))]


def decoded(path: Path) -> str:
    """Return the text of a file in UTF-8, UTF-16 or the Latin code page of Windows.

    Raises
    ------
    SourceError
        If it is none.
    """
    raw = path.read_bytes()
    for mark, encoding in _MARKS:
        if raw.startswith(mark):
            return _strict(path, raw, encoding)
    for offset, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        sample = raw[:2000]
        if len(sample) > 7 and sample[offset::2].count(0) > 0.8 * len(sample[offset::2]):
            return _strict(path, raw, encoding)
    if b"\0" in raw:
        raise SourceError(f"{path.name}: found zero bytes, expected a table in text")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _strict(path: Path, raw: bytes, encoding: str) -> str:
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as cause:
        raise SourceError(f"{path.name}: found {cause.reason}, expected text in {encoding}") from None


def _layout(name: str, lines: Sequence[str]) -> tuple[Dialect, int, int]:
    """Return the dialect in which most lines are numbers, where these start, and cells in a row."""
    found = []
    told = [i for i, line in enumerate(lines[:_HEAD]) if not _COMMENT.match(line)]
    for dialect in _DIALECTS:
        widths = [_width(dialect, lines[i]) for i in told]
        if any(widths):
            width, rows = Counter(filter(None, widths)).most_common(1)[0]
            pairs = pairwise([*widths, 0])
            start = next((i for i, pair in enumerate(pairs) if pair == (width, width)), widths.index(width))
            found.append((rows, dialect, told[start], width))
    most = max((rows for rows, *_ in found), default=0)
    best = [one[1:] for one in found if one[0] == most]
    # "1,5,2,5" is four numbers, or two with decimal commas: the names above know
    best = [one for one in best if _names_above(lines[: one[1]], one[0]) == one[2]] or best
    if not most or len({_values(lines[start], dialect) for dialect, start, _ in best}) > 1:
        what = "rows that may be read in two ways" if most else "no rows of numbers"
        filled = [i for i in told if lines[i].strip()]
        row = best[0][1] if best else filled[len(filled) // 2] if filled else None
        shown = "" if row is None else f' (line {row + 1}: "{lines[row].strip()[:60]}")'
        raise SourceError(
            f"{name}: found {what}{shown}, expected a table: names, then a row of numbers for each time"
        )
    return best[0]


def _width(dialect: Dialect, line: str) -> int:
    """Return the number of cells of a row of numbers, 0 for any other line."""
    cells = dialect.cells(line) if line.strip() else []
    sound = all(is_number(cell, dialect.decimal) or cell.lower() in EMPTY for cell in cells)
    return len(cells) if sound and any(is_number(cell, dialect.decimal) for cell in cells) else 0


def _names_above(above: Sequence[str], dialect: Dialect) -> int:
    last = next((line for line in reversed(above) if line.strip()), "")
    return len(dialect.cells(_COMMENT.sub("", last)))


def _values(line: str, dialect: Dialect) -> tuple[str, ...]:
    return tuple(cell.replace(dialect.decimal, ".") for cell in dialect.cells(line) if cell)


def _columns(name: str, lines: Sequence[str], dialect: Dialect, width: int) -> list[npt.NDArray[np.generic]]:
    import pandas as pd  # slow to load, and only tables need it

    body = "\n".join(line for line in lines if line.strip() and not _COMMENT.match(line))
    try:
        table = pd.read_csv(
            io.StringIO(body), header=None, sep=dialect.separator or r"\s+", decimal=dialect.decimal,
            skipinitialspace=True, low_memory=False, index_col=False, names=range(width + 2),
        )  # fmt: skip
    except ValueError as cause:
        raise SourceError(f"{name}: found rows of unequal length, expected {width} cells ({cause})") from None
    beyond = (table[width].notna() | table[width + 1].notna()).to_numpy()
    if beyond.any():
        row = int(beyond.argmax()) + 1
        raise SourceError(f"{name}: found more than {width} cells in data row {row}, expected {width}")
    return [numbers(f"{name}: column {i + 1}", table[i], dialect.decimal) for i in range(width)]


def named(
    file: str,
    above: Sequence[Sequence[str]],
    columns: Sequence[npt.NDArray[np.generic]],
    common: Told | None = None,
) -> list[Signal]:
    """Return the signals of a table: names and units from the rows above it.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    above : sequence of rows
        Cells of the rows above the numbers, some of them names and units, others remarks.
    columns : sequence of arrays
        A column each, with NaN where there is no number.
    common : Told, optional
        Rate [Hz] of all columns, and its other meanings.

    Returns
    -------
    list of Signal
        One for each column that is not empty.

    Raises
    ------
    SourceError
        If there are names for another number of columns, or a name is there twice.
    """
    above = [row for row in above if any(row)]
    columns = with_days(columns)
    while len(columns) > 1 and _missing(columns[-1]).all() and not any(_fits(r, len(columns)) for r in above):
        columns = columns[:-1]  # behind a separator at the end of each row
    names, units, others = _header(file, above, len(columns))
    signals = []
    for index, (column, name, unit) in enumerate(zip(columns, names, units, strict=True)):
        filled = np.flatnonzero(~_missing(column))
        if not len(filled) or _is_day(column):
            continue  # nothing, or the day of all rows
        rate = next(
            (found for row in others if "Hz" in row[index] and (found := stated_rate(row[index]))), common
        )
        rate_hz, readings = rate or (None, ())
        label = name or f"column {index + 1}"
        signals.append(Signal(label, column[: filled[-1] + 1], unit, rate_hz, readings=readings))
    shared = [name for name, count in Counter(signal.name for signal in signals).items() if count > 1]
    if shared:
        raise SourceError(f"{file}: {shared[0]}: found this column more than once, expected it once")
    return [*_slower(_with_shorter_times(signals))]


def _is_day(column: npt.NDArray[np.generic]) -> bool:
    return column.dtype.kind == "M" and bool((column == column[0].astype("M8[D]")).all())


def _missing(column: npt.NDArray[np.generic]) -> npt.NDArray[np.bool_]:
    return np.asarray(np.isnat(column) if column.dtype.kind in "Mm" else np.isnan(column))


def _header(
    file: str, above: Sequence[Sequence[str]], width: int
) -> tuple[list[str], list[str], list[Sequence[str]]]:
    """Return names, units, and further rows about each column.

    The names are the row above the units, or the last one above the numbers.
    """
    rows = [row[:width] for row in above if _fits(row, width)]
    blank = [""] * width
    if not rows:
        if above and len(above[-1]) > 1 and width > 1:
            raise SourceError(
                f"{file}: found {len(above[-1])} names above rows of {width} numbers, expected one for each"
            )
        return blank, blank, []
    units = next((i for i in range(1, len(rows)) if _are_units(rows[i], rows[i - 1])), None)
    at = len(rows) - 1 if units is None else units - 1
    others = [row for i, row in enumerate(rows) if i > at and i != units]
    return list(rows[at]), blank if units is None else _plain(rows[units]), others


def _fits(row: Sequence[str], width: int) -> bool:
    """Return whether a row has a cell for each column; one more may be empty."""
    return len(row) == width or (len(row) == width + 1 and not row[-1])


def _plain(units: Sequence[str]) -> list[str]:
    return ["" if unit.strip() == "-" else re.sub(r"^[\[(](.*)[\])]$", r"\1", unit.strip()) for unit in units]


def _are_units(row: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether a row holds units, most of them known or in brackets, and that above it no numbers."""
    plain = [unit for unit in _plain(row) if unit]
    if (
        any(re.fullmatch(r"[\d.,+-]+", text) for text in (*plain, *names))
        or max(map(len, plain), default=0) > 12
    ):
        return False
    bracketed = [cell for cell in row if re.fullmatch(r"\s*(\[.*\]|\(.*\))\s*", cell)]
    return 2 * max(sum(map(_known_unit, plain)), len(bracketed)) > len(plain)


def _known_unit(text: str) -> bool:
    if factor_of(text) is not None:
        return True
    try:
        return not text.isdigit() and bool(parse_unit(symbols(text)))
    except ValueError:
        return text in ("V", "mV", "mV/V", "°C", "degC", "µm/m", "um/m", "mm/m", "µε", "%", "Pa", "MPa", "dB")


def _with_shorter_times(signals: Sequence[Signal]) -> list[Signal]:
    """Return signals; where a column ends before the times do, also the times up to there."""
    times = [signal for signal in signals if is_time(signal)]
    lengths = {len(signal.samples) for signal in signals} - {len(time.samples) for time in times}
    shorter = [
        replace(time, name=f"{time.name} (first {length})", samples=time.samples[:length], derived=True)
        for length in sorted(lengths)
        for time in times
        if length < len(time.samples)
    ]
    return [*signals, *shorter]


def _slower(signals: Sequence[Signal]) -> Iterator[Signal]:
    """Yield signals; where one has a cell in every n-th row only, also the times of these rows."""
    times = [signal for signal in signals if is_time(signal)]
    strides: set[tuple[int, int]] = set()
    for signal in signals:
        missing = _missing(signal.samples)
        if not missing.any() or signal in times:
            yield signal
            continue
        filled = np.flatnonzero(~missing)
        steps = np.diff(filled)
        if len(steps) and steps.min() == steps.max() > 1:
            stride, length = int(steps[0]), len(filled)
            rate_hz = None if signal.rate_hz is None else signal.rate_hz / stride
            yield replace(signal, samples=signal.samples[filled], rate_hz=rate_hz)
            if (stride, length) not in strides:
                strides.add((stride, length))
                for time in times:
                    name = f"{time.name} (every {stride})"
                    yield replace(time, name=name, samples=time.samples[filled], derived=True)
        else:
            yield signal  # what is missing is told by the check of the campaign
