"""What a figure shows, as data: panels, axes and traces, read off the figure that matplotlib draws.

A figure is drawn once, by matplotlib. The page draws the same traces again so that they can be zoomed and
read (`experiments.report.interactive`); what it needs travels in the figure's own SVG file. A figure that is
no set of traces over two axes has no description: words written into a panel, maps, other scales than linear
and logarithmic ones, whatever `_traces` has no case for.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.spines import Spine
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator

from experiments.results import FIGURE_FORMAT
from rom.campaign.channels import FloatArray

_SCALES = ("linear", "log")
_DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashdot"}
_MARKERS = {
    "o": "circle", "s": "square", "D": "diamond", "^": "triangle", "v": "inverted_triangle", "x": "x",
    ".": "circle", "h": "hex", "|": "dash", "_": "dash",
}  # fmt: skip
_PX_PER_PT = 1.4  # of lines: a plot on the screen is larger than a column of print
_PACKED = 100  # numbers from which an array is coded
_STEPS = 65535  # of a coded array between its ends: less than a pixel of any screen, zoomed a hundredfold
_WIDE = 100.0  # largest over smallest number beyond which their logarithms are coded
_GREEK = {"gamma": "γ", "varepsilon": "ε", "zeta": "ζ", "Delta": "Δ", "ln": "ln", ",": " ", "times": "×"}
_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_NAMES: WeakKeyDictionary[Artist, Sequence[str]] = WeakKeyDictionary()

Data = dict[str, Any]


class Drawn(Figure):
    """A figure; a reader of the page chooses one of ``choices``: what draws each by name, in like panels.

    All may be drawn into one figure, in the place of what it showed before.
    """

    choices: Mapping[str, Callable[[], Figure]] = MappingProxyType({})


class _Trace(NamedTuple):
    """One trace: how it is drawn, its numbers by field."""

    glyph: str
    look: Data
    label: str
    fields: Mapping[str, Any]


def name_points(artist: Artist, names: Sequence[str]) -> None:
    """Name the points of a line, such as by their records; the page shows the name under the cursor."""
    _NAMES[artist] = names


def describe(figure: Figure) -> Data | None:
    """Return what a figure shows; None where it is no set of traces.

    Returns
    -------
    dict
        ``panels``: place, height, axes and looks of traces; ``choices``: the numbers, by the name of what a
        reader chooses from (one without a name where there is no choice).
    """
    draw = dict(figure.choices) if isinstance(figure, Drawn) and figure.choices else {"": lambda: figure}
    looks, titles, choices = [], [], {}
    for name, show in draw.items():
        one = show()
        if not _is_plain(one):
            return None
        traces = [list(_traces(ax)) for ax in one.axes]
        looks.append([[_look(trace) for trace in panel] for panel in traces])
        titles.append([ax.get_title(loc="left") for ax in one.axes])
        choices[name] = [_numbers(ax, panel) for ax, panel in zip(one.axes, traces, strict=True)]
    _name(looks[0])
    if any(_glyphs(other) != _glyphs(looks[0]) for other in looks):
        raise ValueError("figures to choose from must have the same traces in the same panels")
    first = next(iter(draw.values()))()
    panels = map(_panel, first.axes, zip(*titles, strict=True), looks[0])
    return {"format": FIGURE_FORMAT, "panels": list(panels), "choices": choices}


def _glyphs(looks: Sequence[Sequence[Data]]) -> list[list[str]]:
    return [[look["glyph"] for look in panel] for panel in looks]


def _is_plain(figure: Figure) -> bool:
    specs = [ax.get_subplotspec() for ax in figure.axes]
    places = {(spec.rowspan.start, spec.colspan.start) for spec in specs if spec is not None}
    return (
        0 < len(figure.axes) == len(places)  # no two in one place
        and not figure.subfigs
        and all(
            ax.get_xscale() in _SCALES
            and ax.get_yscale() in _SCALES
            and not ax.child_axes
            and not any(text.get_text() for text in ax.texts)
            and all(_has_case(ax, one) for one in ax.get_children())
            for ax in figure.axes
        )
    )


def _has_case(ax: Axes, one: Artist) -> bool:
    """Return whether `_traces` keeps what an artist shows; frames, axes, titles and legends are no traces."""
    if isinstance(one, Spine | Axis | Text | Legend):
        return True
    over = one.get_transform().contains_branch_seperately(ax.transData)
    if type(one) is Line2D:
        marked = str(one.get_marker()) in (*_MARKERS, "None", "", " ")
        return marked and any(over) and one.get_drawstyle() in ("default", "steps-post")
    if type(one) is LineCollection:
        return all(len(line) == 2 for line in one.get_segments())
    if type(one) is Rectangle:
        return one is ax.patch or (any(over) and not one.get_angle())
    return isinstance(one, PolyCollection) and all(over) and not np.any(one.get_offsets())


def _traces(ax: Axes) -> Iterator[_Trace]:
    labels = {id(one.lines[0]): str(one.get_label()) for one in ax.containers if hasattr(one, "lines")}
    for one in sorted(ax.get_children(), key=lambda child: child.get_zorder()):
        match one:
            case Line2D():
                yield from _of_line(ax, one, labels.get(id(one), str(one.get_label())))
            case LineCollection():
                ends = np.array([line[[0, -1]] for line in one.get_segments()]).reshape(-1, 4)
                fields = dict(zip(("x0", "y0", "x1", "y1"), ends.T, strict=True))
                width = float(np.atleast_1d(one.get_linewidth())[0])
                look = {"line_color": _colour(one.get_edgecolor()), "line_width": width}
                yield _Trace("segment", look, str(one.get_label()), fields)
            case PolyCollection():
                look = _area(one.get_facecolor(), one)
                for path in one.get_paths():
                    fields = dict(zip("xy", np.asarray(path.vertices, dtype=float).T, strict=True))
                    yield _Trace("patch", look, str(one.get_label()), fields)
            case Rectangle() if one is not ax.patch:
                yield _of_rectangle(ax, one)


def _of_line(ax: Axes, line: Line2D, label: str) -> Iterator[_Trace]:
    x, y = np.asarray(line.get_xydata(), dtype=float).T
    pen = {
        "line_color": to_hex(line.get_color()),
        "line_width": max(_PX_PER_PT * line.get_linewidth(), 0.8),
        "line_dash": _DASHES.get(str(line.get_linestyle()), "solid"),
        "line_alpha": _alpha(line),
    }
    over_x, over_y = line.get_transform().contains_branch_seperately(ax.transData)
    if not (over_x and over_y):  # a line from edge to edge
        yield _Trace(
            *(("vspan", pen, label, {"x": x[:1]}) if over_x else ("hspan", pen, label, {"y": y[:1]}))
        )
        return
    if line.get_linestyle() not in ("None", "", " "):
        if "steps-post" in line.get_drawstyle():
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        yield _Trace("line", pen, label, {"x": x, "y": y})
    if (marker := _MARKERS.get(str(line.get_marker()))) is not None:
        face = line.get_markerfacecolor()
        look = {
            "marker": marker,
            "size": 2.0 * float(line.get_markersize()),
            "line_color": to_hex(line.get_markeredgecolor()),
            "alpha": _alpha(line),
            "fill_color": None if str(face).lower() == "none" else to_hex(face),
            "angle": np.pi / 2 if line.get_marker() == "|" else 0.0,
        }
        names = {"name": list(_NAMES[line])} if line in _NAMES else {}
        yield _Trace("scatter", look, label, {"x": x, "y": y} | names)


def _of_rectangle(ax: Axes, patch: Rectangle) -> _Trace:
    x0, x1 = sorted((patch.get_x(), patch.get_x() + patch.get_width()))
    y0, y1 = sorted((patch.get_y(), patch.get_y() + patch.get_height()))
    look = _area([patch.get_facecolor()], patch)
    over_x, over_y = patch.get_transform().contains_branch_seperately(ax.transData)
    glyph, fields = "quad", {"left": [x0], "right": [x1], "bottom": [y0], "top": [y1]}
    if not over_y:  # from edge to edge
        glyph, fields = "vstrip", {"x0": [x0], "x1": [x1]}
    elif not over_x:
        glyph, fields = "hstrip", {"y0": [y0], "y1": [y1]}
    return _Trace(glyph, look, str(patch.get_label()), fields)


def _area(colours: Any, artist: Artist) -> Data:
    return {"fill_color": _colour(colours), "fill_alpha": _alpha(artist), "line_width": 0}


def _colour(colours: Any) -> str:
    """Return the first of some colours; black where there is none."""
    return to_hex(colours[0]) if len(colours) else "#000000"


def _alpha(artist: Artist) -> float:
    alpha = artist.get_alpha()
    return 1.0 if alpha is None else float(np.max(alpha))


def _look(trace: _Trace) -> Data:
    return {"glyph": trace.glyph, "fields": list(trace.fields), "look": trace.look,
            "label": plain_text(trace.label)}  # fmt: skip


def _name(panels: Sequence[Sequence[Data]]) -> None:
    """Name traces without a label as the first that looks alike: a legend stands once for all panels."""
    known: dict[tuple[Any, ...], str] = {}
    for look in (look for panel in panels for look in panel):
        pen = look["look"]
        key = (pen.get("line_color"), pen.get("line_dash"), pen.get("marker"), pen.get("fill_color"))
        if not look["label"].startswith("_"):
            known.setdefault(key, look["label"])
        else:
            look["label"] = known.get(key, "")


def _panel(ax: Axes, titles: Sequence[str], traces: Sequence[Data]) -> Data:
    """Return a panel of the first figure to choose; a title's unit is that of the first that has one."""
    spec = ax.get_subplotspec()
    row, column = (spec.rowspan.start, spec.colspan.start) if spec is not None else (0, 0)
    ratios = np.asarray(spec.get_gridspec().get_height_ratios() if spec is not None else [1.0], dtype=float)
    share = float(ratios[row] / ratios.sum())
    axes = {name: _axis(axis, scale) for name, axis, scale in
            (("x", ax.xaxis, ax.get_xscale()), ("y", ax.yaxis, ax.get_yscale()))}  # fmt: skip
    figure = ax.get_figure(root=True)
    assert figure is not None, "panels are of a figure"
    for name, own in axes.items():  # a label that the figure has for all panels
        if not own["label"]:
            own |= _quantity(getattr(figure, f"get_sup{name}label")())
    if not axes["y"]["label"]:  # told in the title
        told = [_quantity(title) for title in titles]
        axes["y"] |= next((one for one in told if one["unit"]), told[0]) | {"label": ""}
    shared = [other for other in figure.axes if ax.get_shared_x_axes().joined(ax, other)]
    place = figure.axes.index(shared[0]) if shared else figure.axes.index(ax)
    height = figure.get_figheight() * 25.4 * share
    return {"row": row, "column": column, "height_mm": height, "shares_x_with": place, **axes,
            "traces": list(traces)}  # fmt: skip


def _axis(axis: Axis, scale: str) -> Data:
    return {"scale": scale, "ticks": _names_on(axis), **_quantity(axis.get_label_text())}


def _names_on(axis: Axis) -> list[list[Any]] | None:
    """Return where an axis has which name; None where it has numbers, which go on when it is zoomed."""
    if not isinstance(axis.get_major_locator(), FixedLocator):
        return None
    places = [float(place) for place in axis.get_ticklocs()]
    words = map(plain_text, axis.get_major_formatter().format_ticks(places))
    ticks: list[list[Any]] = [[place, text] for place, text in zip(places, words, strict=True)]
    return None if ticks and all(_is_number(text) for _, text in ticks) else ticks


def _is_number(text: str) -> bool:
    try:
        float(text.replace("\u2212", "-"))
    except ValueError:
        return False
    return True


def _quantity(label: str) -> Data:
    """Return what an axis shows and in which unit."""
    found = re.search(r"\[([^\]]*)\]\s*$", words := plain_text(label))
    unit = found[1] if found and found[1] != "1" else ""
    return {"label": words, "quantity": words[: found.start()].strip() if found else words, "unit": unit}


def plain_text(text: str) -> str:
    """Return text whose formulas are written in letters, such as γ [s³/m⁴]."""
    text = re.sub(r"\^\{([\d.-]+)\}", r"^\1", text)
    text = re.sub(r"\^(-?\d+)(?!\.?\d)", lambda one: one[1].translate(_POWERS), text)  # no point is raised
    text = re.sub(r"\\math\w+\{([^}]*)\}", lambda one: one[1].replace("\\_", "_"), text)
    text = re.sub(r"\\([A-Za-z]+|,)", lambda one: _GREEK.get(one[1], one[1]), text)
    return text.replace("$", "")


def _numbers(ax: Axes, traces: Sequence[_Trace]) -> Data:
    return {
        "title": plain_text(ax.get_title(loc="left") or ax.get_title()),
        "x": [float(end) for end in ax.get_xlim()],
        "y": [float(end) for end in ax.get_ylim()],
        "traces": [{field: _coded(values) for field, values in trace.fields.items()} for trace in traces],
    }


def _coded(values: Any) -> Any:
    """Return an array as numbers; a long one as its ends and where between them each lies, in base 64."""
    if np.asarray(values).dtype.kind == "U":
        return [str(value) for value in values]
    array: FloatArray = np.asarray(values, dtype=float)
    if len(array) < _PACKED or not np.isfinite(array).all():
        return [float(f"{value:.6g}") if np.isfinite(value) else None for value in array]
    decades = bool(array.min() > 0 and array.max() > _WIDE * array.min())
    array = np.log(array) if decades else array
    low, high = float(array.min()), float(array.max())
    steps = np.round((array - low) / ((high - low) or 1.0) * _STEPS).astype("<u2")
    coded = base64.b64encode(steps.tobytes()).decode("ascii")
    return {"low": low, "high": high, "log": decades, "steps": coded}
