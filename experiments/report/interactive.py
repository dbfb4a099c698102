"""Figures of the page that can be zoomed, moved and read, drawn by Bokeh from their description."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import unescape
from typing import Any, NamedTuple

from experiments.results import FIGURE_FORMAT

Data = Mapping[str, Any]

_DESCRIPTION = re.compile(rb"<dc:description>(.*?)</dc:description>", re.DOTALL)
_METADATA = re.compile(rb"<metadata>.*?</metadata>", re.DOTALL)
_PX_PER_MM, _LEAST_PX = 5.5, 190
_LOG_TICKS = "%.4g"
_GLYPHS = ("line", "scatter", "segment", "patch", "quad", "hspan", "vspan", "hstrip", "vstrip")
_DASHES = {"dashed": "5 3", "dotted": "1.5 2.5", "dashdot": "6 2 1.5 2"}


class Mark(NamedTuple):
    """An entry of a legend: its words, the colour and dashes of a line, the colour of a mark or an area."""

    label: str
    line: str | None
    dashes: str
    mark: str | None
    fill: str


def legend_of(figure: Data) -> tuple[Mark, ...]:
    """Return the legend of a figure, each name once."""
    marks: dict[str, Mark] = {}
    for trace in (trace for panel in figure["panels"] for trace in panel["traces"]):
        label, look, glyph = trace["label"], trace["look"], trace["glyph"]
        if not label or label.startswith("_"):
            continue
        known = marks.get(label, Mark(label, None, "", None, "none"))
        if glyph in ("line", "segment", "hspan", "vspan"):
            dashes = _DASHES.get(look.get("line_dash", ""), "")
            known = known._replace(line=look["line_color"], dashes=dashes)
        else:
            fill = look.get("fill_color") or "none"
            known = known._replace(mark=look.get("line_color", fill), fill=fill)
        marks[label] = known
    return tuple(marks.values())


def description_of(svg: bytes) -> dict[str, Any] | None:
    """Return the description that a figure's SVG carries; None where it has none."""
    found = _DESCRIPTION.search(svg)
    try:
        shown = json.loads(unescape(found[1].decode())) if found else None
    except ValueError:
        return None  # of another program
    return shown if isinstance(shown, dict) and shown.get("format") == FIGURE_FORMAT else None


def without_description(svg: bytes) -> bytes:
    """Return an SVG without what it carries beside the picture."""
    return _METADATA.sub(b"", svg)


def within_room(figures: Mapping[str, dict[str, Any]], room: float) -> dict[str, dict[str, Any]]:
    """Return descriptions that fit on a page: while they do not, the largest loses every second choice."""
    kept = dict(figures)
    sizes = {name: len(json.dumps(figure)) for name, figure in kept.items()}
    while sizes and sum(sizes.values()) > room:
        largest = max(sizes, key=lambda name: sizes[name])
        choices = list(kept[largest]["choices"].items())
        if len(choices) > 1:
            kept[largest] = kept[largest] | {"choices": dict(choices[::2])}
            sizes[largest] = len(json.dumps(kept[largest]))
        else:
            del kept[largest], sizes[largest]
    return kept


def library() -> str:
    """Return Bokeh's script."""
    from bokeh.resources import Resources  # takes a second, and only a page needs it

    return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)


def plots_of(figures: Mapping[str, Data]) -> dict[str, dict[str, Any]]:
    """Return plots without numbers by name; what cannot be drawn from its description stays a picture."""
    made = {}
    for name, figure in figures.items():
        try:  # descriptions come from files, which may be of another version or changed by hand
            json.dumps(figure, allow_nan=False)
            legend_of(figure)
            if not all(isinstance(choice, list) for choice in figure["choices"].values()):
                raise TypeError("choices must be lists of panels")
            made[name] = _plot(figure)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            continue
    return made


def _plot(figure: Data) -> dict[str, Any]:
    """Return Bokeh's document of a figure: panels, tools, a named source for the numbers of each trace."""
    from bokeh.embed import json_item
    from bokeh.layouts import gridplot
    from bokeh.settings import settings

    panels: Sequence[Data] = figure["panels"]
    rows, columns = (1 + max(panel[place] for panel in panels) for place in ("row", "column"))
    grid: list[list[Any]] = [[None] * columns for _ in range(rows)]
    made: list[Any] = []
    for place, panel in enumerate(panels):
        shares = panel["shares_x_with"]
        made.append(_panel(place, panel, made[shares].x_range if shares < place else None))
        grid[panel["row"]][panel["column"]] = made[-1]
    layout = gridplot(grid, sizing_mode="stretch_width", toolbar_options={"logo": None})
    settings.perform_document_validation.set_value(False)  # it takes a third of the time of a page
    return dict(json_item(layout))


def _panel(place: int, panel: Data, x_range: Any) -> Any:
    from bokeh.models import HoverTool, Range1d, Title
    from bokeh.plotting import figure

    plot = figure(
        height=max(_LEAST_PX, round(_PX_PER_MM * panel["height_mm"])),
        sizing_mode="stretch_width",
        x_axis_type=panel["x"]["scale"], y_axis_type=panel["y"]["scale"],
        x_axis_label=panel["x"]["label"] or None, y_axis_label=panel["y"]["label"] or None,
        x_range=x_range or Range1d(name=f"x{place}"), y_range=Range1d(name=f"y{place}"),
        tools="pan,box_zoom,wheel_zoom,reset,save", active_drag="box_zoom", active_scroll=None,
    )  # fmt: skip
    plot.add_layout(Title(name=f"title{place}", text_font_style="normal", text_font_size="13px"), "above")
    for axis, name in ((plot.xaxis[0], "x"), (plot.yaxis[0], "y")):
        axis.axis_label_text_font_style = "normal"
        if (ticks := panel[name]["ticks"]) is not None:
            axis.ticker = [at for at, _ in ticks]
            axis.major_label_overrides = dict(ticks)
    for number, trace in enumerate(panel["traces"]):
        drawn = _trace(plot, f"{place}.{number}", trace)
        if trace["glyph"] in ("line", "scatter"):
            plot.add_tools(HoverTool(renderers=[drawn], tooltips=_tooltips(panel, trace), visible=False,
                                     formatters={"@x": "printf", "@y": "printf"}))  # fmt: skip
    plot.toolbar.autohide = False
    return plot


def _trace(plot: Any, source: str, trace: Data) -> Any:
    from bokeh.models import ColumnDataSource

    fields = trace["fields"]
    if trace["glyph"] not in _GLYPHS:
        raise ValueError(f"found the glyph {trace['glyph']!r}, expected one of {', '.join(_GLYPHS)}")
    return getattr(plot, trace["glyph"])(
        source=ColumnDataSource({field: [] for field in fields}, name=source), name=trace["label"],
        **{field: field for field in fields if field != "name"}, **trace["look"],
    )  # fmt: skip


def _tooltips(panel: Data, trace: Data) -> list[tuple[str, str]]:
    rows = [("", trace["label"].replace("@", "").replace("$", "") or "\u2013")]
    rows += [("", "@name")] if "name" in trace["fields"] else []
    for axis in ("x", "y"):
        if panel[axis]["ticks"] is None:
            unit = panel[axis]["unit"].replace("%", "%%")
            rows.append((panel[axis]["quantity"] or axis, f"@{axis}{{{_LOG_TICKS} {unit}}}"))
    return rows
