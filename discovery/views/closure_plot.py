"""Figures of a closed loop from what closure.json holds: the residual by views, and the force left."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discovery.views.closure_summary import view_words
from discovery.views.force_plot import FORCE, Units, draw_loop, draw_map, pair, scale_of, units_of
from discovery.views.palette import AFTER, BACKGROUND, BEFORE, GREY
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Data = Mapping[str, Any]
FORCE_HEIGHT_MM: Numerical[float] = 105.0
_WHENS = ("Before", "After")


class View(NamedTuple):
    """Mean squares of a residual along one view, before and after, by label."""

    title: str
    labels: list[str]
    before: Data
    after: Data


def sides(data: Data) -> tuple[Data, Data]:
    """Return what a closure tells of its residual before and after; empty where it does not."""
    residual = data.get("residual") or {}
    before, after = (residual.get(when) or {} for when in ("before", "after"))
    return before, after


def views(data: Data) -> list[View]:
    """Return every view that can be drawn."""
    first, last = sides(data)
    found = []
    for name, after in last.items():
        before = first.get(name) or {}
        if isinstance(before, Mapping) and isinstance(after, Mapping):
            named = [one for one in dict.fromkeys((*before, *after)) if before.get(one) or after.get(one)]
            found += [View(view_words(name), named, before, after)] if named else []
    return found


def forces(data: Data) -> tuple[Data, Data] | None:
    """Return what is told of the unbalanced force, before and after, at the place of most."""
    before, after = (side.get("forces") or () for side in sides(data))
    return pair(before, after)


def has_maps(data: Data) -> bool:
    """Return whether the unbalanced force is told over motion, not by its numbers alone."""
    return all("force_n" in one for one in forces(data) or ({},))


def class_words(text: object) -> str:
    """Return the label of a class as people write it."""
    return re.sub(r"\bum\b", "µm", str(text).replace("_", " "))


def residual_height_mm(data: Data) -> float:
    """Return the height that the views of a residual need."""
    return 14.0 + sum(6.0 + 3.6 * len(view.labels) for view in views(data))


def draw_residual(figure: Figure | SubFigure, data: Data) -> None:
    """Draw the mean square of the residual over that of noise along every view, a row a label.

    What was before is drawn where effects were added.
    """
    shown = views(data)
    heights = [len(view.labels) + 0.6 for view in shown]
    axes = figure.subplots(len(shown), 1, squeeze=False, sharex=True, height_ratios=heights)[:, 0]
    values = [1.0]
    for ax, view in zip(axes, shown, strict=True):
        values += _draw_view(ax, view, bool(data.get("effects") and view.before))
        ax.set_title(view.title)
    last = axes[-1]
    last.set_xlim(min(values) / 1.4, max(values) * 1.4)
    last.set_xscale("log")  # limits first: of values that are the same but for rounding it finds none
    plain_log(last)
    last.set_xlabel("Residual, mean square over that of noise [1]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


def draw_force(figure: Figure | SubFigure, data: Data) -> None:
    """Draw the force left where most was a function of motion: maps with one scale, and first cycles."""
    both = forces(data)
    assert both is not None  # else there is no such figure
    shown = both if data.get("effects") else both[1:]
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.15, 1.0))[:, 0]
    units = units_of(*shown)
    _draw_maps(upper, shown, units)
    ax = lower.subplots()
    for one, colour, when in zip(shown, (BEFORE, AFTER)[-len(shown) :], _WHENS, strict=False):
        draw_loop(ax, one, colour, when, units)
    ax.set_title("First cycles")
    ax.set(xlabel=units.displacement, ylabel=FORCE)
    if len(shown) > 1:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)


def _draw_maps(figure: SubFigure, shown: Sequence[Data], units: Units) -> None:
    """Draw forces over motion side by side with one scale of colours."""
    axes = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    limit = scale_of(*shown)
    for ax, one, when in zip(axes, shown, _WHENS, strict=False):
        mesh = draw_map(ax, one, limit, units)
        ax.set_title(f"{when}, {class_words(one['place'])}" if len(shown) > 1 else class_words(one["place"]))
        ax.set_xlabel(units.displacement)
    axes[0].set_ylabel(units.velocity)
    figure.colorbar(mesh, ax=axes, location="top", aspect=40, shrink=0.8).set_label(FORCE)


def _draw_view(ax: Axes, view: View, changed: bool) -> list[float]:
    """Draw one view and return its values; without what was before, there is one series."""
    rows = np.arange(len(view.labels))
    before = view.before if changed else {}
    old, new = (np.array([_positive(side.get(one)) for one in view.labels]) for side in (before, view.after))
    ax.axvline(1.0, color=BACKGROUND, lw=0.6, ls="--", label="Noise alone")
    if changed:
        ax.hlines(rows, np.fmin(old, new), np.fmax(old, new), color=GREY, lw=0.6)
        draw_before(ax, old)
    ax.plot(new, rows, "o", color=AFTER, label="After" if changed else "Residual")
    ax.set_yticks(rows, [class_words(label) for label in view.labels])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.set_ylim(len(view.labels) - 0.4, -0.6)
    both = np.concatenate([old, new])
    return list(both[np.isfinite(both)])


def draw_before(ax: Axes, values: FloatArray) -> None:
    """Draw what was before as hollow marks, a row a value."""
    ax.plot(values, np.arange(len(values)), "o", color=BEFORE, markersize=5.0, markerfacecolor="white",
            markeredgewidth=0.9, label="Before")  # fmt: skip


def plain_log(ax: Axes, which: str = "x") -> None:
    """Label a logarithmic axis with plain numbers, the denser the fewer decades it spans."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    few, some = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    subs = (1.0,) if high > 100 * low else few if high > 4 * low else some
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _positive(value: object) -> float:
    return float(value) if isinstance(value, int | float) and value > 0 else float("nan")
