"""The figure of an experiment: the error of every cell, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discovery.views.palette import BLUE, GREY
from experiments.figures.style import panels, styled

Data = Mapping[str, Any]
_ROW_MM, _MARGIN_MM = 3.6, 26.0
_MOST_ROWS = 80
_LONGEST = 36
_LOGARITHMIC = 30.0  # largest over smallest error beyond which the axis is logarithmic
_MODELS = {"close": ("declared model", "refined model")}
_LAWS = "γ(T)", "first law"
"""What the errors before and after are of, by command; those of the others."""
_SETTINGS = ("laws", "libraries", "optimizers", "max_terms", "criteria", "seed")


def experiment_figures(data: Data) -> dict[str, Figure]:
    """Return the figure of an experiment by name; none where no cell has an error."""
    rows = [row for row in data["cells"] if (row.get("error") or 0.0) > 0.0]
    return {"experiment": errors_of_cells(rows)} if rows else {}


@styled
def errors_of_cells(rows: Sequence[Data]) -> Figure:
    """Draw the error [%] of every cell, a panel for each kind; beside it that of what it is compared with."""
    keys = dict.fromkeys(key for row in rows for key in row if key.partition(".")[0] in _SETTINGS)
    varied = [key for key in keys if len({row.get(key) for row in rows}) > 1]
    kinds = dict.fromkeys(row["error_of"] for row in rows)
    groups = [[row for row in rows if row["error_of"] == kind][:_MOST_ROWS] for kind in kinds]
    heights = [len(group) * _ROW_MM + _MARGIN_MM for group in groups]
    figure, axes = panels(len(groups), 1, sum(heights), gridspec_kw={"height_ratios": heights})
    for group, (ax,) in zip(groups, axes, strict=True):
        _draw(ax, group)
        several = len({row["command"] for row in group}) > 1
        ax.set_yticks(range(len(group)), [_label(row, varied, told=several) for row in group])
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


def _draw(ax: Axes, group: Sequence[Data]) -> None:
    before = [row.get("error_before") or float("nan") for row in group]
    errors = [row["error"] for row in group]
    first, second = _MODELS.get(group[0]["command"], _LAWS)  # no kind of error is of both
    ax.plot(before, range(len(group)), "o", color=GREY, markerfacecolor="none", label=first)
    ax.plot(errors, range(len(group)), "o", color=BLUE, label=second)
    ax.set_ylim(len(group) - 0.5, -0.5)
    if max(errors) > _LOGARITHMIC * min(errors):
        ax.set_xscale("log")
    else:
        ax.set_xlim(left=0.0)
    ax.set_xlabel("Error [%]\n" + group[0]["error_of"].replace(", ", ",\n"))


def _label(row: Data, varied: Sequence[str], *, told: bool) -> str:
    """The campaign, the command where it is to be told, and the settings in which cells differ."""
    settings = [f"{key.rpartition('.')[2]} {row[key]}" for key in varied if row.get(key) is not None]
    text = ", ".join([row["campaign"], *([row["command"]] if told else []), *settings])
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
