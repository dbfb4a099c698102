"""One look for every figure: one column wide, colour-blind safe, vector. Nothing global is changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, LogFormatter, LogLocator, NullFormatter, StrMethodFormatter

from experiments.figures.description import Drawn, describe, plain_text
from experiments.figures.pdf_fonts import fonts_cut_once
from rom.campaign.record import replacing

FloatArray = npt.NDArray[np.float64]

COLUMN_MM = 85.0
_MM_PER_INCH = 25.4
_FEW_DECADES = 50.0  # of tension: below, powers of ten alone are too few labels

_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 7.5,
    "axes.labelsize": 7.5,
    "axes.titlesize": 7.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.5,
    "errorbar.capsize": 0.0,
    "svg.fonttype": "none",  # text stays text, as in the PDF
    "pdf.fonttype": 42,
    "svg.hashsalt": "boltlaw",
    "path.simplify": True,
    "figure.autolayout": False,
    "figure.constrained_layout.use": False,
}

P = ParamSpec("P")
R = TypeVar("R")


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function within the style; matplotlib's own settings stay as they were."""

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(_STYLE):
            return function(*args, **kwargs)

    return run


def blank(height_mm: float) -> Drawn:
    """Return a figure one column wide without axes."""
    size = (COLUMN_MM / _MM_PER_INCH, height_mm / _MM_PER_INCH)
    figure = Drawn(figsize=size, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02)  # type: ignore[union-attr,call-arg]
    return figure


def panels(
    rows: int = 1, columns: int = 1, height_mm: float = 58.0, **options: Any
) -> tuple[Drawn, npt.NDArray[Any]]:
    """Return a figure one column wide and its axes, shape (rows, columns).

    Parameters
    ----------
    rows, columns : int
        Panels.
    height_mm : float
        Height of the figure [mm].
    **options : object
        Of ``Figure.subplots``.

    Returns
    -------
    tuple of (Figure, ndarray)
        The axes have shape (rows, columns).
    """
    figure = blank(height_mm)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def tension_axis(axes: Axes, tension: FloatArray, label: str = "Bolt tension $T$ [N]") -> FloatArray:
    """Label the tension axis, logarithmic where it spans a decade; return where to draw curves [N].

    Parameters
    ----------
    axes : Axes
        Whose horizontal axis is the tension.
    tension : ndarray
        Measured tensions [N], shape (records,).
    label : str
        Of the axis.

    Returns
    -------
    ndarray
        Tensions [N], shape (300,).
    """
    low, high = float(np.min(tension)), float(np.max(tension))
    axes.set_xlabel(label)
    if low > 0 and high >= 10 * low:
        axes.set_xscale("log")
        if high < _FEW_DECADES * low:  # each digit of every decade would be labelled, one over the other
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        return np.geomspace(low / 1.2, high * 1.2, 300)
    margin = 0.05 * (high - low) or 0.05 * high or 1.0
    return np.linspace(max(low - margin, 0.0), high + margin, 300)


@styled
def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure by its suffix (.svg, .pdf, .png); it appears whole or not at all.

    An SVG carries what it shows as data (`description.describe`) in its description.

    Raises
    ------
    ValueError
        If the suffix is none of these.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    metadata: dict[str, dict[str, str | None]]  # without dates: same data, same file
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    if kind not in metadata:
        raise ValueError(f"{path}: a figure is written as .svg, .pdf or .png, instead got {path.suffix!r}")
    if kind == "svg" and (shown := describe(figure)) is not None:
        metadata[kind] |= {"Description": json.dumps(shown, separators=(",", ":"), allow_nan=False)}
    _lay_out(figure)
    with replacing(path) as temporary, fonts_cut_once():
        figure.savefig(temporary, format=kind, dpi=300, metadata=metadata[kind])
    return path


class _Letters(Formatter):
    """Labels of another formatter in letters, 10³: formulas take a tenth of the time of a figure."""

    def __init__(self, inner: LogFormatter) -> None:
        self.inner = inner

    def set_axis(self, axis: Any) -> None:
        self.inner.set_axis(axis)

    def set_locs(self, locs: Any) -> None:
        self.inner.set_locs(locs)

    def __call__(self, x: float, pos: int | None = None) -> str:
        return plain_text(self.inner(x, pos))


def _lay_out(figure: Figure) -> None:
    """Place the panels for good: with an engine every file would be laid out anew and drawn twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
            for ticker in (axis.major, axis.minor):
                if isinstance(ticker.formatter, LogFormatter):
                    ticker.formatter = _Letters(ticker.formatter)
        FigureCanvasSVG(figure)  # whose measures of text the engine takes
        engine.execute(figure)
        figure.set_layout_engine(None)
