"""Spreadsheets (`.xlsx`), through the package openpyxl: a table of numbers on each sheet."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal
from experiments.datasets.tables import named, numbers

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
    tables = {title: signals for title, rows in sheets.items() if (signals := _signals(path.name, rows))}
    if not tables:
        raise SourceError(f"{path.name}: found no rows of numbers, expected a table: names, then numbers")
    if len(tables) == 1:
        return next(iter(tables.values()))
    return [
        Signal(f"{title}/{s.name}", s.samples, s.unit, s.rate_hz, readings=s.readings)
        for title, signals in tables.items()
        for s in signals
    ]


def _signals(file: str, rows: Sequence[Sequence[Any]]) -> list[Signal]:
    import pandas as pd

    sound = [_is_row(row) for row in rows]
    start = next((i for i in range(len(rows) - 1) if sound[i] and sound[i + 1]), None)
    if start is None:
        return []
    body = [row for row in rows[start:] if any(cell is not None for cell in row)]
    width = max(i + 1 for row in body for i, cell in enumerate(row) if cell is not None)
    above = [["" if cell is None else str(cell).strip() for cell in row[:width]] for row in rows[:start]]
    table = pd.DataFrame([row[:width] for row in body])
    return named(file, above, [numbers(f"{file}: column {i + 1}", _plain(table[i])) for i in range(width)])


def _is_row(row: Sequence[Any]) -> bool:
    """Return whether the cells of a row are numbers, as far as there are any."""
    cells = [cell for cell in row if cell is not None]
    return bool(cells) and all(
        isinstance(cell, (int, float, *_DATES)) and not isinstance(cell, bool) for cell in cells
    )


def _plain(column: Any) -> Any:
    """Return a column with times of day as text."""
    return column.map(
        lambda cell: cell.isoformat() if isinstance(cell, datetime.time) else cell
    ).infer_objects()
