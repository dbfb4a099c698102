"""Headers of LabVIEW's text files (`.lvm`): names, units, steps and starts of the columns below them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

from experiments.datasets.collected import SourceError
from experiments.datasets.rates import Told, named_rate
from experiments.datasets.times import ABSOLUTE_S, factor_of, unstated

_FIRST, _END = "LabVIEW Measurement", "***End_of_Header***"


class Column(NamedTuple):
    """What the header tells of a column."""

    name: str
    unit: str = ""
    rate: Told | None = None
    start_s: float | None = None


def is_labview(lines: Sequence[str]) -> bool:
    """Return whether lines are those of such a file."""
    return bool(lines) and lines[0].strip("\t ;,").startswith(_FIRST)


class Header(NamedTuple):
    """Columns, separator and decimal mark, and the lines of numbers cut to these columns."""

    columns: list[Column]
    separator: str
    decimal: str
    body: list[str]


def header(file: str, lines: Sequence[str]) -> Header:
    """Return what the header tells, and the lines of numbers.

    Raises
    ------
    SourceError
        If the file has no end of its header, several segments, or an axis other than time.
    """
    ends = [index for index, line in enumerate(lines) if line.strip().startswith(_END)]
    if not ends or ends[-1] + 1 >= len(lines):
        raise SourceError(f"{file}: found no {_END} above numbers, expected a whole LabVIEW measurement file")
    if len(ends) > 2:
        raise SourceError(
            f"{file}: found {len(ends) - 1} segments, expected one; save each in a file of its own"
        )
    at = ends[-1] + 1
    mark = next((mark for mark in "\t;," if mark in lines[at]), "\t")
    rows = [line.split(mark) for line in lines[: at + 1]]
    told = {row[0].strip(): row[1:] for row in rows[: ends[0]]}
    own = {row[0].strip(): row[1:] for row in rows[ends[0] + 1 : at - 1] if len(row) > 1}
    names = [cell.strip() for cell in rows[at]]
    said = names[-1] == "Comment"  # a column of words that rows may leave out
    names = names[:-1] if said else names
    axes = {cell.strip() for cell in own.get("X_Dimension", [])} - {"", "Time"}
    if axes:
        raise SourceError(f'{file}: found X_Dimension "{axes.pop()}", expected Time')
    columns, channel = [], 0
    for index, name in enumerate(names):
        if name.startswith("X_Value") or not (name or index):
            columns.append(Column("X_Value" if index == 0 else f"X_Value {index + 1}", "s"))
        else:
            try:
                columns.append(_column(name, own, channel, (told.get("X_Columns") or ["One"])[0].strip()))
            except ValueError:
                step = _cell(own, "Delta_X", channel)
                raise SourceError(f'{file}: {name}: found Delta_X "{step}", expected a number') from None
            channel += 1
    decimal = "," if mark != "," and "".join(told.get("Decimal_Separator", [])).strip() == "," else "."
    return Header(columns, mark, decimal, [_cut(x, mark, len(names)) if said else x for x in lines[at + 1 :]])


def _cut(line: str, mark: str, width: int) -> str:
    """Return a line without its comment; one with more behind it stays as it is, to be refused."""
    cells = line.split(mark)
    return line if len(cells) > width + 2 else mark.join(cells[:width])


def _cell(own: dict[str, list[str]], key: str, channel: int) -> str:
    cells = own.get(key, [])
    return cells[channel].strip() if channel < len(cells) else ""


def _column(name: str, own: dict[str, list[str]], channel: int, axes: str) -> Column:
    """Return a column; where it has no X of its own, step and start are those of the header."""
    step, unit = _cell(own, "Delta_X", channel), _cell(own, "X_Unit_Label", channel)
    rate = named_rate("dt", float(step.replace(",", "."))) if step else None
    if rate and rate.rate_hz and unit and (factor := factor_of(unit)):
        rate = Told(rate.rate_hz / factor)
    elif rate and rate.rate_hz and not unit:  # LabVIEW counts in s; one is what it writes for want of a step
        rate = Told(rate.rate_hz, unstated(1.0) if rate.rate_hz == 1 else ())
    start = _start(own, channel) if axes == "No" else None
    return Column(name, _cell(own, "Y_Unit_Label", channel), rate, start)


def _start(own: dict[str, list[str]], channel: int) -> float | None:
    """Return the start [s] on the clock of the day, None where date or time is not told."""
    day, time = _cell(own, "Date", channel), _cell(own, "Time", channel).replace(",", ".")
    first = _cell(own, "X0", channel).replace(",", ".")
    try:
        whole, _, part = time.partition(".")
        moment = datetime.strptime(f"{day} {whole}", "%Y/%m/%d %H:%M:%S")
        since = (moment - datetime(1970, 1, 1)).total_seconds() + float(f"0.{part or 0}")
        return since + float(first or 0.0) if since >= ABSOLUTE_S else None
    except ValueError:
        return None
