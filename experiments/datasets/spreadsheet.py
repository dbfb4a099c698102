"""Spreadsheets (`.xlsx`), through the package openpyxl: a table of numbers on each sheet."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.datasets.cells import is_number, numbers
from experiments.datasets.collected import SourceError, optional
from experiments.datasets.rates import Told, rate_above
from experiments.datasets.signals import Signal
from experiments.datasets.tables import named

ENDINGS = (".xlsx", ".xlsm")
_DATES = (datetime.datetime, datetime.timedelta, datetime.time)


def read(path: Path) -> list[Signal]:
    """Return the columns of all sheets; with several tables a column goes by "sheet/column".

    Raises
    ------
    SourceError
        If no sheet holds rows of numbers, a cell is text, or openpyxl is not installed.
    """
    book = optional("openpyxl", "xlsx").load_workbook(path, read_only=True, data_only=True)
    try:
        sheets = {sheet.title: list(sheet.iter_rows(values_only=True)) for sheet in book.worksheets}
    finally:
        book.close()
    plain = [row for rows in sheets.values() if _start(rows) is None for row in rows]
    common = rate_above(_remarks(plain))  # a sheet about the others
    tables = {
        title: signals for title, rows in sheets.items() if (signals := _signals(path.name, rows, common))
    }
    if not tables:
        text = next((text for rows in sheets.values() for row in rows if (text := _as_text(row))), None)
        what = "no rows of numbers" if text is None else f'numbers stored as text ("{text}")'
        raise SourceError(f"{path.name}: found {what}, expected a table: names, then cells of numbers")
    if len(tables) == 1:
        return next(iter(tables.values()))
    return [
        Signal(f"{title}/{s.name}", s.samples, s.unit, s.rate_hz, readings=s.readings)
        for title, signals in tables.items()
        for s in signals
    ]


def _signals(file: str, rows: Sequence[Sequence[Any]], common: Told | None) -> list[Signal]:
    import pandas as pd

    start = _start(rows)
    if start is None:
        return []
    body = [row for row in rows[start:] if any(cell is not None for cell in row)]
    width = max(i + 1 for row in body for i, cell in enumerate(row) if cell is not None)
    above = [["" if cell is None else str(cell).strip() for cell in row[:width]] for row in rows[:start]]
    table = pd.DataFrame([row[:width] for row in body])
    columns = [numbers(f"{file}: column {i + 1}", _plain(table[i])) for i in range(width)]
    return named(file, above, columns, rate_above(_remarks(rows[:start])) or common)


def _start(rows: Sequence[Sequence[Any]]) -> int | None:
    """Return where a table of numbers starts, None where there is none."""
    sound = [_is_row(row) for row in rows]
    return next((i for i in range(len(rows) - 1) if sound[i] and sound[i + 1]), None)


def _remarks(rows: Sequence[Sequence[Any]]) -> list[str]:
    return [";".join(str(cell) for cell in row if cell is not None) for row in rows]


def _is_row(row: Sequence[Any]) -> bool:
    """Return whether the cells of a row are numbers, as far as there are any."""
    cells = [cell for cell in row if cell is not None]
    return bool(cells) and all(
        isinstance(cell, (int, float, *_DATES)) and not isinstance(cell, bool) for cell in cells
    )


def _as_text(row: Sequence[Any]) -> str | None:
    """Return the first cell of text in a row whose texts are all numbers."""
    texts = [cell for cell in row if isinstance(cell, str)]
    sound = all(is_number(cell, ".") or is_number(cell, ",") for cell in texts)
    return texts[0] if texts and sound and len(row) > 1 else None


def _plain(column: Any) -> Any:
    """Return a column with times of day as text."""
    return column.map(
        lambda cell: cell.isoformat() if isinstance(cell, datetime.time) else cell
    ).infer_objects()
