"""Cells of tables as numbers or times: decimal marks, groups of thousands, dates and times of day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import SourceError

EMPTY = frozenset(("", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf", "+inf"))
_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eEdD][+-]?\d+)?$"),
}
_GROUPED = {  # 1,234.5 and 1'234 alone mean one thing, 1,234 does not
    ".": re.compile(r"[+-]?\d{1,3}((,\d{3})+\.\d*|(,\d{3}){2,}|([ '’\u00a0\u202f]\d{3})+(\.\d*)?)$"),
    ",": re.compile(r"[+-]?\d{1,3}((\.\d{3})+,\d*|(\.\d{3}){2,}|([ '’\u00a0\u202f]\d{3})+(,\d*)?)$"),
}
_DATE = r"\d{4}([-/.])\d\d\1\d\d|\d{1,2}([./-])\d{1,2}\2(?:\d{4}|\d\d)|\d{1,2}[- ][A-Z][a-z]{2}[- ]\d{4}"
_DAY = re.compile(rf"(?:{_DATE})$")
_CLOCK = re.compile(
    rf"(?:(?:{_DATE})[ T])?\d{{1,2}}:\d\d:\d\d(?:[.,:]\d+)?(?: ?[AaPp][Mm])?(?:Z|[+-]\d\d:?\d\d)?$"
)
_DAY_S = 86400.0


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell may be one of a signal: a number, a date or time of day."""
    return any(p.match(cell) for p in (_NUMBER[decimal], _CLOCK, _GROUPED[decimal], _DAY))


def numbers(where: str, column: Any, decimal: str = ".") -> npt.NDArray[np.generic]:
    """Return a column as numbers, or as times where it holds dates.

    Parameters
    ----------
    where : str
        File and column, for messages.
    column : pandas.Series
        Cells of n rows.
    decimal : str
        Decimal mark in text.

    Returns
    -------
    array
        Shape (n,), NaN where a cell is empty.

    Raises
    ------
    SourceError
        If a cell is neither.
    """
    import pandas as pd

    if column.dtype.kind in "iufMm":
        return np.asarray(column, dtype=None if column.dtype.kind in "Mm" else np.float64)
    text = column.astype(object).where(column.notna(), "").astype(str).str.strip()
    grouped = text.str.match(_GROUPED[decimal])
    if grouped.any():  # "1,234" beside "1,234.5" is of thousands as well
        mark = "," if decimal == "." else "."
        text = text.str.replace(rf"(?<=\d)[{re.escape(mark)} '’\u00a0\u202f](?=\d{{3}})", "", regex=True)
    plain = text.str.replace(decimal, ".").str.replace(r"(?<=\d)[dD](?=[+-]?\d)", "e", regex=True)
    found = pd.to_numeric(plain, errors="coerce")
    odd = text[found.isna() & ~text.str.lower().isin(EMPTY)]
    if not len(odd):
        return np.asarray(found, dtype=np.float64)
    if len(odd) == len(text) and all(_CLOCK.match(cell) or _DAY.match(cell) for cell in text):
        return _dates(where, text)
    raise SourceError(f'{where}: found "{odd.iloc[0]}" in data row {odd.index[0] + 1}, expected a number')


def _dates(where: str, text: Any) -> npt.NDArray[np.generic]:
    """Return dates, or times of day that go on after midnight, in ns."""
    import pandas as pd

    first = text.iloc[0]
    text = text.str.replace(",", ".").str.replace(r"(:\d\d:\d\d):(\d+)", r"\1.\2", regex=True)
    try:
        if ":" in first[:3]:
            half = re.search("[AaPp][Mm]$", first.strip())
            of_day = pd.to_datetime("2000-01-01 " + text) - pd.Timestamp("2000-01-01") if half else text
            return _past_midnight(np.asarray(pd.to_timedelta(of_day), dtype="m8[ns]"))
        in_order = bool(re.match(r"\d{4}|\d{1,2}[- ][A-Z]", first)) or first.strip()[-1:] in "Mm"
        dates = pd.to_datetime(text, format="mixed", dayfirst=not in_order, utc=True)
    except ValueError as cause:
        raise SourceError(f'{where}: found "{first}" and {cause}, expected dates or times of day') from None
    return np.asarray(dates.dt.tz_localize(None), dtype="M8[ns]")


def _past_midnight(times: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    seconds = 1e-9 * times.astype(np.int64)
    days = np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -0.5 * _DAY_S)
    return np.asarray(times + days.astype("m8[D]"), dtype="m8[ns]")


def with_days(columns: Sequence[npt.NDArray[np.generic]]) -> list[npt.NDArray[np.generic]]:
    """Return columns; a time of day beside a column of days has the day added, and that column is emptied."""
    found = [column.copy() for column in columns]
    for day, time in pairwise(found):
        if day.dtype.kind == "M" and time.dtype.kind == "m":
            of_day = time.astype(np.int64) % int(1e9 * _DAY_S)
            moment = day + of_day.astype("m8[ns]")
            day[:] = np.datetime64("NaT")
            time[:] = moment - np.datetime64(0, "ns")
    return found
