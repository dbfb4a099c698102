"""What an experiment found: how many cells, and the table of their main numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from experiments.text.answers import Answer
from experiments.text.tables import Table
from experiments.text.wording import label, mappings, number

Data = Mapping[str, Any]

_HEADS = {
    "command": "Command",
    "campaign": "Campaign",
    "first": "First law, or effects",
    "verdict": "Verdict",
    "error": "Error [%]",
    "error_before": "Error before, or of gamma(T) [%]",
    "error_of": "Error of",
    "hold_out_error": "Error of the loss, held out [%]",
    "known_bolt_error": "Error at a bolt's own rate [%]",
    "probability": "Probability",
    "between_bolts": "ln rate between bolts",
    "between_tests": "ln rate between tests",
    "seed": "Seed",
}
_WITH_LIMITS = ("between_bolts", "between_tests")
_LEFT_OUT = frozenset(
    {"cell", "status", "message", "settings", "folder", "elapsed_s", "cpu_s", "peak_mb", "equation",
     "indistinguishable", "free_numbers", "p_value_against_baseline"}
    | {f"{key}_{side}" for key in _WITH_LIMITS for side in ("low", "high")}
)  # fmt: skip


def answer(data: Data) -> Answer:
    """Return how many cells there are, and which of them failed."""
    rows = mappings(data.get("cells"))
    failed = [row for row in rows if row.get("status") != "ok"]
    done = f"{len(rows) - len(failed)} of {len(rows)} cells are done"
    verdict = f"{done}; {len(failed)} failed." if failed else f"All {len(rows)} cells are done."
    sentences = tuple(f"{row['command']} of {row['campaign']}: {row.get('message')}" for row in failed[:5])
    return Answer("What did this experiment find?", verdict, sentences, (), False if failed else None)


def tables_of_cells(data: Data) -> Iterator[Table]:
    """Yield the table of all cells: the main numbers, and what differs between them."""
    rows = mappings(data.get("cells"))
    keys = [*_HEADS, *dict.fromkeys(key for row in rows for key in row if key not in {*_HEADS, *_LEFT_OUT})]
    filled = {key: [_cell(row, key) for row in rows] for key in keys}
    kept = [key for key in keys if any(cell for cell in filled[key])]
    if rows:
        heads = tuple(_HEADS.get(key, label(key)) for key in kept)
        yield Table("Every cell", heads, tuple(zip(*(filled[key] for key in kept), strict=True)))


def _cell(row: Data, key: str) -> str:
    value = row.get(key)
    if value is None or isinstance(value, list | Mapping):
        return ""
    text = value if isinstance(value, str) else number(value, 3)
    if key in _WITH_LIMITS:
        low, high = (number(row.get(f"{key}_{side}"), 3) for side in ("low", "high"))
        text = f"{text} ({low} to {high})"
    return text
