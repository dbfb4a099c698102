"""Tables that compare: the paper's numbers beside ours, error measures of every result file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.report.results import Result
from experiments.text.tables import Table, errors_table
from experiments.text.wording import label, mappings, number, plain, trimmed

Data = Mapping[str, Any]

_WORDS = {
    "model": "model in model.json",
    "reproduction": "model",
}
_DIGITS = {"paper": 4, "ours": 4, "tolerance": 2}
_ROW = ("quantity", "paper", "ours", "unit", "tolerance", "within")


def comparison_tables(results: Sequence[Result]) -> list[Table]:
    """Return every table that compares, in the order of the results."""
    tables: list[Table | None] = []
    for result in results:
        found = result.data if result.data.get("errors") else identification_of(result.data)
        if result.kind == "reproduction":
            tables.append(_reproduction(result.data))
        if result.kind not in ("ranking", "closure"):
            caption = f"Errors of the {_WORDS.get(result.kind, result.kind)}"
            tables.append(errors_table(found.get("errors"), caption, found.get("noise_floor")))
    return [table for table in tables if table is not None]


def identification_of(data: Data) -> Data:
    """Return the section of model.json that an identification writes; empty where there is none."""
    found = data.get("identification")
    return found if isinstance(found, Mapping) else {}


def _reproduction(data: Data) -> Table | None:
    rows = mappings(data.get("rows"))
    others = dict.fromkeys(key for row in rows for key in row if key not in {*_ROW, "bound"})
    cells = tuple(tuple(_cell(row, key) for key in (*_ROW, *others)) for row in rows)
    heads = tuple(label(key) for key in (*_ROW, *others))
    return Table("The paper's numbers and ours", heads, cells) if cells else None


def _cell(row: Data, key: str) -> str:
    if key == "tolerance" and row.get("bound"):
        return "not above"
    if key in _DIGITS:
        return trimmed(number(row.get(key), _DIGITS[key]))
    if key == "unit" and row.get(key) == "1":
        return ""
    return "no ✗" if key == "within" and row.get(key) is False else plain(row.get(key))
