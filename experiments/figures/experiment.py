"""The figure of an experiment: the error of every cell, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from discovery.views.palette import BLUE, GREY
from experiments.figures.style import panels, styled

Data = Mapping[str, Any]
_ROW_MM, _MARGIN_MM = 3.6, 14.0
_MOST_ROWS = 80
_LONGEST = 48


def experiment_figures(data: Data) -> dict[str, Figure]:
    """Return the figure of an experiment by name; none where no cell has an error."""
    rows = [row for row in data["cells"] if (row.get("error") or 0.0) > 0.0]
    return {"experiment": errors_of_cells(rows)} if rows else {}


@styled
def errors_of_cells(rows: list[Data]) -> Figure:
    """Draw the error [%] of every cell, a panel for each kind; beside it that before, or of gamma(T)."""
    kinds = list(dict.fromkeys(row["error_of"] for row in rows))
    groups = [[row for row in rows if row["error_of"] == kind][:_MOST_ROWS] for kind in kinds]
    heights = [len(group) * _ROW_MM + _MARGIN_MM for group in groups]
    figure, axes = panels(len(kinds), 1, sum(heights), gridspec_kw={"height_ratios": heights})
    for kind, group, (ax,) in zip(kinds, groups, axes, strict=True):
        places = range(len(group))
        before = [row.get("error_before") or float("nan") for row in group]
        ax.plot(before, places, "o", color=GREY, markerfacecolor="none", label="before, or gamma(T)")
        ax.plot([row["error"] for row in group], places, "o", color=BLUE, label="first law, or after")
        ax.set_yticks(places, [_label(row) for row in group])
        ax.set_ylim(len(group) - 0.5, -0.5)
        ax.set_xscale("log")
        ax.set_xlabel(f"Error of {kind} [%]")
    axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


def _label(row: Data) -> str:
    text = f"{row['campaign']}, {row['command']}, seed {row['seed']}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
