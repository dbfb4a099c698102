"""Figures of a closed loop, each drawn from what closure.json holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from discovery.views.force import FORCE, Units, draw_loop, draw_map, scale_of, units_of
from experiments.figures.style import (
    BACKGROUND,
    BLUE,
    GREEN,
    GREY,
    SKY,
    VERMILLION,
    panels,
    styled,
)
from experiments.text.closures import (
    class_words,
    correlations,
    effects_of,
    forces,
    place_words,
    view_words,
)
from experiments.text.wording import number, trimmed
from rom.campaign.channels import FloatArray

Data = Mapping[str, Any]

_BEFORE, _AFTER = VERMILLION, BLUE
_WHENS = ("Before", "After")
_MEASURES = (
    ("motion_nrmse", "Displacement [%]", 100.0),
    ("relative_motion_nrmse", "Relative motion [%]", 100.0),
    ("tension_loss_error_percent_median", "Loss of tension [%]", 1.0),
    ("tension_rmse_n", "Tension [N]", 1.0),
    ("link_force_nrmse", "Link force [%]", 100.0),
)
_SETS = (("hold_out", "Hold-out", "-", BLUE), ("training", "Training", "--", SKY))
_CURVES = (BLUE, GREEN, SKY)
_BOARD_ROWS = 12
_DECADES = 1e3  # that an axis of errors spans at most; less is drawn at its edge


def closure_figures(data: Data) -> dict[str, Figure]:
    """Return the figures of a closure by name; what its data do not allow is left out."""
    made: dict[str, tuple[object, Callable[[Data], Figure]]] = {
        "closure-errors": (len(data.get("steps") or ()) > 1 and _measured(data), errors_by_step),
        "closure-residual": (_views(data), residual_by_view),
        "closure-correlation": (correlations(data), correlation),
        "closure-force": (_has_maps(data), unbalanced_force),
        "closure-screened": (_screened(data), leader_board),
        "closure-effects": (_curves(data), effects),
    }
    return {name: draw(data) for name, (there, draw) in made.items() if there}


def _views(data: Data) -> list[tuple[str, list[str], Data, Data]]:
    """Return title, labels, and mean squares before and after, of every view that can be drawn."""
    residual = data.get("residual") or {}
    found = []
    for view in residual.get("after") or {}:
        before, after = ((residual.get(when) or {}).get(view) or {} for when in ("before", "after"))
        if not (isinstance(before, Mapping) and isinstance(after, Mapping)):
            continue
        labels = [
            label for label in dict.fromkeys((*before, *after)) if before.get(label) or after.get(label)
        ]
        if labels:
            found.append((view_words(view), labels, before, after))
    return found


@styled
def residual_by_view(data: Data) -> Figure:
    """Mean square of the residual over that of noise along every view, before and after, a row a label."""
    views = _views(data)
    counts = [len(labels) for _, labels, _, _ in views]
    height = 14.0 + sum(6.0 + 3.6 * count for count in counts)
    figure, axes = panels(len(views), 1, height, sharex=True, height_ratios=[n + 0.6 for n in counts])
    values: list[float] = [1.0]
    changed = bool(effects_of(data))
    for ax, (title, labels, before, after) in zip(axes[:, 0], views, strict=True):
        values += _view(ax, labels, before if changed else {}, after)
        ax.set_title(title)
    last = axes[-1, 0]
    last.set_xscale("log")
    last.set_xlim(min(values) / 1.4, max(values) * 1.4)
    _plain_log(last)
    last.set_xlabel("Residual, mean square over that of noise [1]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@styled
def correlation(data: Data) -> Figure:
    """How alike lines side by side, and tests that repeat each other, err before and after."""
    labels, *values = zip(*correlations(data), strict=True)
    before, after, chance = (np.array(one) for one in values)
    rows = np.arange(len(labels))
    figure, axes = panels(height_mm=16.0 + 6.0 * len(rows))
    ax = axes[0, 0]
    ax.barh(rows, 2 * chance, 0.7, left=-chance, color=BACKGROUND, alpha=0.3, label="95 % of noise")
    if effects_of(data):
        _hollow(ax, before)
    ax.plot(after, rows, "o", color=_AFTER, label="After" if effects_of(data) else "Residual")
    ax.set_yticks(rows, labels)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(min(-0.1, before.min(), after.min()) - 0.05, 1.0)
    ax.set_xlabel("Correlation of residuals [1]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _has_maps(data: Data) -> bool:
    """Return whether the unbalanced force is told over motion, not by its numbers alone."""
    return all("force_n" in one for one in forces(data) or ({},))


@styled
def unbalanced_force(data: Data) -> Figure:
    """Force left unbalanced where most was a function of motion: maps with one scale, and first cycles."""
    both = forces(data)
    assert both is not None  # else there is no such figure
    shown = both if effects_of(data) else both[1:]
    figure = panels(height_mm=105.0)[0]
    figure.clear()
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.15, 1.0))[:, 0]
    units = units_of(*shown)
    _maps(upper, shown, units)
    ax = lower.subplots()
    for one, colour, when in zip(shown, (_BEFORE, _AFTER)[-len(shown) :], _WHENS, strict=False):
        draw_loop(ax, one, colour, when, units)
    ax.set_title("First cycles")
    ax.set(xlabel=units.displacement, ylabel=FORCE)
    if len(shown) > 1:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)
    return figure


def _maps(figure: SubFigure, shown: Sequence[Data], units: Units) -> None:
    """Draw forces over motion side by side with one scale of colours."""
    axes = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    limit = scale_of(*shown)
    for ax, one, when in zip(axes, shown, _WHENS, strict=False):
        mesh = draw_map(ax, one, limit, units)
        ax.set_title(f"{when}, {class_words(one['place'])}" if len(shown) > 1 else class_words(one["place"]))
        ax.set_xlabel(units.displacement)
    axes[0].set_ylabel(units.velocity)
    figure.colorbar(mesh, ax=axes, location="top", aspect=40, shrink=0.8).set_label(FORCE)


def _view(ax: Axes, labels: Sequence[str], before: Data, after: Data) -> list[float]:
    """Draw one view and return its values; without what was before, there is one series."""
    rows = np.arange(len(labels))
    old, new = (np.array([_positive(side.get(label)) for label in labels]) for side in (before, after))
    ax.axvline(1.0, color=BACKGROUND, lw=0.6, ls="--", label="Noise alone")
    if before:
        ax.hlines(rows, np.fmin(old, new), np.fmax(old, new), color=GREY, lw=0.6)
        _hollow(ax, old)
    ax.plot(new, rows, "o", color=_AFTER, label="After" if before else "Residual")
    ax.set_yticks(rows, [class_words(label) for label in labels])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.set_ylim(len(labels) - 0.4, -0.6)
    both = np.concatenate([old, new])
    return list(both[np.isfinite(both)])


def _hollow(ax: Axes, values: FloatArray) -> None:
    """Draw what was before, a row a value."""
    ax.plot(values, np.arange(len(values)), "o", color=_BEFORE, markersize=5.0, markerfacecolor="white",
            markeredgewidth=0.9, label="Before")  # fmt: skip


def _positive(value: object) -> float:
    return float(value) if isinstance(value, int | float) and value > 0 else float("nan")


def _plain_log(ax: Axes, which: str = "x") -> None:
    """Label a logarithmic axis with plain numbers, the denser the fewer decades it spans."""
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    subs = (
        (1.0,) if high > 100 * low else (1.0, 2.0, 5.0) if high > 4 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    )
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _errors(step: Data, kind: str, key: str) -> float:
    value = ((step.get("errors") or {}).get(kind) or {}).get(key)
    return float("nan") if value is None else float(value)


def _measured(data: Data) -> list[tuple[str, str, float]]:
    """Return the error measures that at least two steps have."""
    steps = data.get("steps") or []
    return [
        measure
        for measure in _MEASURES
        if any(sum(np.isfinite(_errors(s, kind, measure[0])) for s in steps) > 1 for kind, *_ in _SETS)
    ]


@styled
def errors_by_step(data: Data) -> Figure:
    """Errors of the declared model and after every added effect, on hold-out and on training records."""
    measures, steps = _measured(data), data["steps"]
    columns = min(len(measures), 2)
    rows = -(-len(measures) // columns)
    figure, axes = panels(rows, columns, 20.0 + 34.0 * rows)
    for ax, (key, title, factor) in zip(axes.flat, measures, strict=False):
        drawn = {kind: np.array([factor * _errors(step, kind, key) for step in steps]) for kind, *_ in _SETS}
        least = max(float(np.nanmax(errors, initial=0.0)) for errors in drawn.values()) / _DECADES
        values = []
        for kind, label, style, colour in _SETS:
            errors = np.maximum(
                drawn[kind], least
            )  # what is fitted record by record has no error to speak of
            if np.isfinite(errors).any():
                ax.plot(range(len(steps)), errors, f"o{style}", color=colour, label=label)
                values += list(errors[np.isfinite(errors)])
        _error_axis(ax, values)
        ax.set_title(title)
        ax.set_xlim(-0.25, len(steps) - 0.75)
        ax.set_xticks(range(len(steps)), ["none", *map(str, range(1, len(steps)))])
    for ax in axes.flat[len(measures) :]:
        ax.remove()
    figure.supxlabel("Effects added [1]", fontsize=7.5)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _error_axis(ax: Axes, values: Sequence[float]) -> None:
    """Scale the axis of an error: by decades where it spans more than a factor of five, else from zero."""
    if min(values) > 0 and max(values) > 5 * min(values):
        ax.set_yscale("log")
        ax.set_ylim(min(values) / 1.4, max(values) * 1.4)
        _plain_log(ax, "y")
    else:
        ax.set_ylim(0, 1.15 * max([*values, 1e-9]))
        ax.yaxis.set_major_locator(MaxNLocator(4))


def _screened(data: Data) -> list[Data]:
    rows = [row for row in data.get("screened") or [] if row.get("share") is not None]
    return sorted(rows, key=lambda row: -float(row["share"]))[:_BOARD_ROWS]


@styled
def leader_board(data: Data) -> Figure:
    """Share of the first residual that each effect of the catalogue could explain, the best first."""
    rows = _screened(data)
    found = {(effect.get("name"), effect.get("enters")) for effect in effects_of(data)}
    figure, axes = panels(height_mm=12.0 + 6.5 * len(rows))
    ax = axes[0, 0]
    for place, row in enumerate(rows):
        chosen = (row.get("name"), row.get("enters")) in found
        ax.barh(place, 100 * float(row["share"]), 0.32, color=BLUE if chosen else GREY)
        words = f"{row.get('name')}, {place_words(row.get('enters'))}"
        ax.annotate(words + (" (added)" if chosen else ""), (0.0, place - 0.2),
                    xycoords=("axes fraction", "data"), va="bottom")  # fmt: skip
    ax.set_ylim(len(rows) - 0.6, -0.9)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlim(0, max(100 * float(rows[0]["share"]) * 1.05, 1.0))
    ax.set_xlabel("Share of the residual that it could explain [%]")
    return figure


def _curves(data: Data) -> list[Data]:
    drawn = [(effect, effect.get("curve") or {}) for effect in effects_of(data)]
    return [effect for effect, curve in drawn if curve.get("records") and curve.get("kind") in _DRAWN]


@styled
def effects(data: Data) -> Figure:
    """Force or reading of every added effect along motions, or the rate of the tension, a row each."""
    shown = _curves(data)
    figure, axes = panels(len(shown), 2, 16.0 + 44.0 * len(shown))
    for row, effect in zip(axes, shown, strict=True):
        _DRAWN[str(effect["curve"]["kind"])](row, effect["curve"]["records"])
        name = row[0].set_title(f"{effect.get('name')}, {place_words(effect.get('enters'))}")
        name.set_in_layout(False)  # it runs on over the panel beside
    handles, labels = axes[0, 1].get_legend_handles_labels()
    if any(labels):
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _forces(row: Sequence[Axes], records: Sequence[Data]) -> None:
    _along(row[0], records, ("displacement_m", 1e6, "Displacement [µm]"), "force_n")
    _along(row[1], records, ("velocity_m_per_s", 1e3, "Velocity [mm/s]"), "force_n")
    row[0].set_ylabel("Force [N]")


def _readings(row: Sequence[Axes], records: Sequence[Data]) -> None:
    _along(row[0], records, ("displacement_m", 1e6, "Displacement [µm]"), "reading_n")
    _along(row[1], records, ("time_s", 1.0, "Time after the hit [s]"), "reading_n")
    row[0].set_ylabel("ModelCorrection to the reading [N]")


def _along(ax: Axes, records: Sequence[Data], over: tuple[str, float, str], key: str) -> None:
    name, factor, label = over
    for colour, record in zip(_CURVES, records, strict=False):
        place, value = (np.asarray(record[item], dtype=float) for item in (name, key))
        ax.plot(factor * place, value, color=colour, lw=0.6, label=_preload(record))
    ax.set_xlabel(label)
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.yaxis.set_major_locator(MaxNLocator(5))


def _rates(row: Sequence[Axes], records: Sequence[Data]) -> None:
    """Draw the loss rate with (solid) and without (dotted) the effect, and the difference."""
    drawn: tuple[list[float], list[float]] = ([], [])
    for colour, record in zip(_CURVES, records, strict=False):
        speed = 1e3 * np.asarray(record["peak_velocity_m_per_s"], dtype=float)
        without, loss = (
            -np.asarray(record[key], dtype=float) for key in ("rate_without_n_per_s", "rate_n_per_s")
        )
        row[0].plot(speed, without, color=colour, ls=":")
        row[0].plot(speed, loss, color=colour)
        row[1].plot(speed, loss - without, color=colour, label=_preload(record))
        drawn[0].extend([*loss, *without])
        drawn[1].extend(loss - without)
    for ax, values, label in zip(row, drawn, ("Loss rate [N/s]", "ModelCorrection to it [N/s]"), strict=True):
        ax.set_xscale("log")
        ax.set_xlabel("Peak velocity [mm/s]")
        ax.set_ylabel(label)
        _plain_log(ax)
        _rate_axis(ax, [value for value in values if np.isfinite(value)])


def _rate_axis(ax: Axes, values: Sequence[float]) -> None:
    """Scale an axis of rates that may have either sign: four decades, linear about zero."""
    low, high = min([*values, 0.0]), max([*values, 0.0])
    most = max(high, -low) or 1.0
    ax.set_yscale("symlog", linthresh=10.0 ** np.floor(np.log10(most) - 3))
    ax.set_ylim(1.5 * low, 1.5 * high if high > low else 1.0)


_DRAWN: Mapping[str, Callable[[Sequence[Axes], Sequence[Data]], None]] = {
    "force": _forces,
    "reading": _readings,
    "tension rate": _rates,
}


def _preload(record: Data) -> str:
    tension = record.get("initial_tension_n")
    return "" if tension is None else f"{trimmed(number(float(tension), 3))} N"
