"""The numbers of all cells as one table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.studies.experiment.cell import CELLS, RESULT
from experiments.studies.experiment.cells import Cell

if TYPE_CHECKING:
    import pandas as pd

TABLE = "experiment.csv"
_SHOWN = (
    "command",
    "campaign",
    "seed",
    "first",
    "error",
    "error_before",
    "probability",
    "verdict",
    "between_bolts",
)
_VARIED = ("laws", "libraries", "optimizers", "max_terms", "criteria")
"""Columns of the summary; those of the rig are in the name of the campaign."""


@dataclass(frozen=True)
class ExperimentTable:
    """What an experiment found: a row for each cell, in the order of its file.

    Attributes
    ----------
    name : str
        Of the experiment.
    path : Path
        Its ``experiment.json``.
    rows : tuple of dict
        Campaign, what differs between cells, status, message and main numbers of each cell.
    """

    name: str
    path: Path
    rows: tuple[dict[str, Any], ...]

    def __repr__(self) -> str:
        return f"ExperimentTable({self.name!r}, {len(self.rows)} cells, {len(self.failed)} failed)"

    @property
    def failed(self) -> tuple[dict[str, Any], ...]:
        """Rows of cells that failed."""
        return tuple(row for row in self.rows if row["status"] != "ok")

    def to_frame(self) -> pd.DataFrame:
        """Return a row for each cell."""
        return _frame(self.rows).infer_objects()

    def summary(self) -> str:
        """Return the table for people, and a line for every cell that failed."""
        frame = self.to_frame()
        shown = [name for name in frame if name in _SHOWN or str(name).partition(".")[0] in _VARIED]
        lines = [self.name, frame[shown].to_string(index=False, na_rep="", float_format="{:.4g}".format)]
        lines += [f"failed: {row['campaign']}, {row['command']}: {row['message']}" for row in self.failed]
        return "\n".join(lines)


def _frame(rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    columns = dict.fromkeys(key for row in rows for key in row)
    return pd.DataFrame([[row.get(key) for key in columns] for row in rows], columns=[*columns], dtype=object)


def as_csv(rows: Sequence[dict[str, Any]]) -> str:
    """Return rows as text, numbers with all their digits; what is no number or text as JSON."""
    flat = [
        {key: json.dumps(v) if isinstance(v, list | dict) else v for key, v in row.items()} for row in rows
    ]
    return str(_frame(flat).to_csv(index=False, lineterminator="\n"))


def read_rows(cells: Sequence[Cell], out: Path) -> tuple[dict[str, Any], ...]:
    """Read the result of every cell; of the settings, those are columns that differ between cells."""
    settings = [cell.settings for cell in cells]
    keys = dict.fromkeys(key for one in settings for key in one)
    varied = [key for key in keys if len({json.dumps(one.get(key)) for one in settings}) > 1]
    rows = []
    for cell, own in zip(cells, settings, strict=True):
        found = json.loads((out / CELLS / cell.digest / RESULT).read_text(encoding="utf-8"))
        head = {"cell": cell.digest, "command": cell.command, "campaign": cell.source.name}
        differs = {key: _text(own.get(key)) for key in varied if key != "seed"}
        told = {"status": found["status"], "message": found["message"]}
        rows.append({**head, **differs, "seed": cell.seed, **told, **found.get("numbers", {})})
    return tuple(rows)


def _text(value: Any) -> Any:
    return "; ".join(map(str, value)) if isinstance(value, list) else value
