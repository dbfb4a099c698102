"""Figures of a closed loop, each drawn from what closure.json holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from discovery.criteria.criteria import used_in
from discovery.detection.limit import NEVER
from discovery.views.closure_plot import (
    FORCE_HEIGHT_MM,
    draw_before,
    draw_force,
    draw_residual,
    has_maps,
    plain_log,
    residual_height_mm,
    views,
)
from discovery.views.closure_summary import MEASURES, Measure, place_words
from discovery.views.force_plot import units_of
from discovery.views.palette import AFTER, BACKGROUND, BLACK, BLUE, GREEN, GREY, PURPLE, SKY, VERMILLION
from experiments.figures.style import blank, panels, styled
from experiments.text.closures import correlations, effects_of
from experiments.text.wording import number, trimmed

Data = Mapping[str, Any]

_SETS = (("hold_out", "Hold-out", "-", BLUE), ("training", "Training", "--", SKY))
_CURVES = (BLUE, GREEN, SKY)
_BOARD_ROWS = 12
_PLACES = ((BLUE, "o"), (VERMILLION, "s"), (GREEN, "^"), (SKY, "D"), (BLACK, "v"), (PURPLE, "h"))
_DECADES = 1e3  # that an axis of errors spans at most; less is drawn at its edge


def closure_figures(data: Data) -> dict[str, Figure]:
    """Return the figures of a closure by name; what its data do not allow is left out."""
    made: dict[str, tuple[object, Callable[[Data], Figure]]] = {
        "closure-errors": (len(data.get("steps") or ()) > 1 and _measured(data), errors_by_step),
        "closure-residual": (views(data), residual_by_view),
        "closure-correlation": (correlations(data), correlation),
        "closure-force": (has_maps(data), unbalanced_force),
        "closure-screened": (_screened(data), leader_board),
        "closure-effects": (_curves(data), effects),
        "closure-limits": (_limits(data), detection_limits),
    }
    return {name: draw(data) for name, (there, draw) in made.items() if there}


@styled
def residual_by_view(data: Data) -> Figure:
    """Mean square of the residual over that of noise along every view, before and after, a row a label."""
    figure = blank(residual_height_mm(data))
    draw_residual(figure, data)
    return figure


@styled
def correlation(data: Data) -> Figure:
    """How alike lines side by side, and tests that repeat each other, err before and after."""
    labels, *values = zip(*correlations(data), strict=True)
    before, after, chance = (np.array(one) for one in values)
    rows = np.arange(len(labels))
    figure, axes = panels(height_mm=16.0 + 6.0 * len(rows))
    ax = axes[0, 0]
    ax.barh(rows, 2 * chance, 0.7, left=-chance, color=BACKGROUND, alpha=0.3,
            label=f"{used_in(data).level_of_noise} of noise")  # fmt: skip
    if effects_of(data):
        draw_before(ax, before)
    ax.plot(after, rows, "o", color=AFTER, label="After" if effects_of(data) else "Residual")
    ax.set_yticks(rows, labels)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlim(min(-0.1, before.min(), after.min()) - 0.05, 1.0)
    ax.set_xlabel("Correlation of residuals [1]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@styled
def unbalanced_force(data: Data) -> Figure:
    """Force left unbalanced where most was a function of motion: maps with one scale, and first cycles."""
    figure = blank(FORCE_HEIGHT_MM)
    draw_force(figure, data)
    return figure


def _errors(step: Data, kind: str, key: str) -> float:
    value = ((step.get("errors") or {}).get(kind) or {}).get(key)
    return float("nan") if value is None else float(value)


def _measured(data: Data) -> list[tuple[str, Measure]]:
    """Return the error measures that at least two steps have."""
    steps = data.get("steps") or []
    return [
        (key, measure)
        for key, measure in MEASURES.items()
        if any(sum(np.isfinite(_errors(s, kind, key)) for s in steps) > 1 for kind, *_ in _SETS)
    ]


@styled
def errors_by_step(data: Data) -> Figure:
    """Errors of the declared model and after every added effect, on hold-out and on training records."""
    measures, steps = _measured(data), data["steps"]
    columns = min(len(measures), 2)
    rows = -(-len(measures) // columns)
    figure, axes = panels(rows, columns, 20.0 + 34.0 * rows)
    for ax, (key, measure) in zip(axes.flat, measures, strict=False):
        drawn = {
            kind: np.array([measure.factor * _errors(step, kind, key) for step in steps])
            for kind, *_ in _SETS
        }
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
        ax.set_title(f"{measure.title} [{measure.unit}]")
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
        plain_log(ax, "y")
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


def _limits(data: Data) -> list[Data]:
    rows = [row for row in data.get("detection_limits") or [] if row.get("parameter")]
    return rows if any(row.get("share_of_default") is not None for row in rows) else []


@styled
def detection_limits(data: Data) -> Figure:
    """Smallest strength that would have been found over the usual one, an effect a row, a place a colour."""
    rows = [row for row in _limits(data) if row.get("value") is not None or row.get("reason") == NEVER]
    labels = list(dict.fromkeys(_strength_label(row, rows) for row in rows))
    places = list(dict.fromkeys(_last_word(row) for row in rows))
    figure, axes = panels(height_mm=24.0 + 4.2 * len(labels))
    ax = axes[0, 0]
    shares = [float(row["share_of_default"]) for row in rows if row["value"] is not None]
    low, high = min([*shares, 0.1]) / 2, 2 * max([*shares, 5.0])
    ax.axvspan(1.0, high, color=GREY, alpha=0.15, lw=0)
    for place, name in enumerate(places):
        colour, marker = _PLACES[place % len(_PLACES)]
        mine = [row for row in rows if _last_word(row) == name]
        at = [labels.index(_strength_label(row, rows)) + _aside(row, rows) for row in mine]
        shown = [np.nan if row["value"] is None else float(row["share_of_default"]) for row in mine]
        ax.plot(shown, at, marker, color=colour, label=name)
        never = [y for row, y in zip(mine, at, strict=True) if row["value"] is None]
        ax.plot([high / 1.3] * len(never), never, marker, color=colour, mfc="none")
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    plain_log(ax)
    ax.set_yticks(range(len(labels)), labels)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(labels) - 0.4, -0.6)
    ax.grid(axis="y", color=GREY, alpha=0.2, lw=0.4)
    ax.set_xlabel("Limit over usual strength [1]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _aside(row: Data, rows: Sequence[Data]) -> float:
    """How far from its line a mark is drawn, so that the places of one strength do not hide each other."""
    label = _strength_label(row, rows)
    beside = [one["enters"] for one in rows if _strength_label(one, rows) == label]
    return 0.25 * (beside.index(row["enters"]) - (len(beside) - 1) / 2)


def _strength_label(row: Data, rows: Sequence[Data]) -> str:
    """Name of an effect; with the strength's where it has several."""
    several = len({one["parameter"] for one in rows if one["name"] == row["name"]}) > 1
    return f"{row['name']}, {row['parameter']}" if several else str(row["name"])


def _last_word(row: Data) -> str:
    """Link, body or tension of an effect; of a sensor its body."""
    kind, _, name = str(row["enters"]).partition(":")
    return name.rpartition("_")[2] if kind == "sensor" else name or kind


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
    units = units_of(*records)
    _along(row[0], records, ("displacement_m", units.factors[0], units.displacement), "force_n")
    _along(row[1], records, ("velocity_m_per_s", units.factors[1], units.velocity), "force_n")
    row[0].set_ylabel("Force [N]")


def _readings(row: Sequence[Axes], records: Sequence[Data]) -> None:
    _along(row[0], records, ("displacement_m", 1e6, "Displacement [µm]"), "reading_n")
    _along(row[1], records, ("time_s", 1.0, "Time after the hit [s]"), "reading_n")
    row[0].set_ylabel("Added to the reading [N]")


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
    for ax, values, label in zip(row, drawn, ("Loss rate [N/s]", "Added to it [N/s]"), strict=True):
        ax.set_xscale("log")
        ax.set_xlabel("Peak velocity [mm/s]")
        ax.set_ylabel(label)
        plain_log(ax)
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
