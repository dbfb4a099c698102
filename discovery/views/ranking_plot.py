"""The leader board of a ranking from what ranking.json holds, and names of laws for people."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from discovery.laws.candidate import BASELINE, NO_LOOSENING
from discovery.views.palette import BLUE, GREY, VERMILLION
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure, SubFigure

Data = Mapping[str, Any]
_OWN_COLOURS = {BASELINE: VERMILLION, NO_LOOSENING: GREY}
_ROWS: Numerical[int] = 10
LONGEST: Numerical[int] = 48  # characters of a name in a legend
_LAW_WORDS = {BASELINE: "γ(T), the paper's law"}
_NUMBER = r"[\w.+-]+"
_LAW_PATTERNS = (
    (rf"T 10\^\(-{_NUMBER} / \(1 \+ exp\({_NUMBER} T\)\)\)", "γ(T) T"),  # the shape of the paper's Eq. 13
    (r"abs\((\w)\)", r"|\1|"),
    (r"abs\((\w) (\w)\)", r"|\1 \2|"),
    (r"\bgamma\b", "γ"),
    (r"\brho\b", "ρ"),
    ("-", "−"),
)


def law_name(name: str, most: int = 70) -> str:
    """Return the name of a tension law for people, cut where it is longer than `most` characters."""
    shown = re.sub(r"\d+\.\d{4,}", lambda found: f"{float(found[0]):.3g}", _LAW_WORDS.get(name, name))
    for pattern, words in _LAW_PATTERNS:
        shown = re.sub(pattern, words, shown)
    return shown if len(shown) <= most else shown[: most - 1].rstrip() + "…"


def is_law(law: Data, name: str) -> bool:
    """Return whether a row of a ranking is of this law, under its own name or one that is the same law."""
    return name == law.get("name") or name in (law.get("same_as") or ())


def row_name(law: Data) -> str:
    """Return the name of a row's law for people, with the standing law that it is."""
    same = " = ".join(law_name(str(name)) for name in law.get("same_as") or ())
    return law_name(str(law.get("name"))) + (f" (= {same})" if same else "")


# differences of BIC below which the evidence is so strong (R. Kass and A. Raftery, 1995)
_EVIDENCE: Numerical[tuple[tuple[float, str], ...]] = (
    (2.0, "hardly any"),
    (6.0, "positive"),
    (10.0, "strong"),
)
_MANY: Numerical[float] = 1000.0  # a larger difference of BIC says no more


def evidence_words(delta_bic: float) -> str:
    """Return what a difference of BIC means: "very strong evidence, a difference in BIC of 38"."""
    size = abs(delta_bic)
    strength = next((words for most, words in _EVIDENCE if size < most), "very strong")
    shown = f"{size:.3g}" if size <= _MANY else f"more than {_MANY:.0f}"
    return f"{strength} evidence, a difference in BIC of {shown}"


def row_colour(law: Data, other: str = BLUE) -> str:
    """Return the colour of a row's law: the paper's law and no loosening have their own in every figure."""
    return next((colour for name, colour in _OWN_COLOURS.items() if is_law(law, name)), other)


def ranked(data: Data) -> list[Data]:
    """Return the laws of a ranking, the first one first, each once."""
    laws = [law for law in data.get("laws") or [] if isinstance(law, Mapping) and "repeats" not in law]
    return sorted(laws, key=lambda law: float(law.get("rank") or len(laws) + 1))


def leader_board_height_mm(data: Data) -> float:
    """Return the height that the leader board needs."""
    return 16.0 + 9.0 * len(_shown(data))


def _shown(data: Data) -> list[Data]:
    return [law for place, law in enumerate(ranked(data)) if place < _ROWS or is_law(law, BASELINE)]


def draw_leader_board(figure: Figure | SubFigure, data: Data) -> None:
    """Draw the difference of BIC to the first law, and the cross-validated error of the loss, a row a law."""
    shown = _shown(data)
    axes = figure.subplots(1, 2, squeeze=False, sharey=True)
    equal = {str(name) for name in data.get("indistinguishable") or ()}
    for row, law in enumerate(shown):
        colour = row_colour(law)
        face = colour if law["rank"] == 1 or law["name"] in equal else "none"
        keys = ("delta_bic", "cross_validated_loss_error_percent_median")
        for ax, key in zip(axes[0], keys, strict=True):
            if law.get(key) is not None:
                ax.plot(law[key], row, "o", color=colour, markerfacecolor=face, markeredgewidth=0.9)
        name = axes[0, 0].annotate(f"{law['rank']}  {row_name(law)}", (0.0, row - 0.28),
                                   xycoords=("axes fraction", "data"), va="bottom")  # fmt: skip
        name.set_in_layout(False)  # it runs on over the panel beside
    for ax in axes[0]:
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
        ax.hlines(range(len(shown)), 0, 1, transform=ax.get_yaxis_transform(), color=GREY, lw=0.3, zorder=0)
    axes[0, 1].patch.set_visible(False)
    axes[0, 0].set_ylim(len(shown) - 0.6, -0.95)
    _counts_up(axes[0, 0], [law["delta_bic"] for law in shown if law.get("delta_bic") is not None])
    axes[0, 0].set_xlabel("$\\Delta$BIC [1]")
    by_decades(axes[0, 1], "x", [law[key] for law in shown if law.get(key) is not None])
    plain_decades(axes[0, 1].xaxis)
    axes[0, 1].set_xlabel("Cross-validated error [%]")


def _counts_up(ax: Axes, values: Sequence[float]) -> None:
    """Scale an axis about zero that may end at thousands: linear to 10, by decades from there."""
    from matplotlib.ticker import MaxNLocator, NullLocator

    low, top = min([*values, 0.0]), max([*values, 1.0])
    if top - low <= 40:
        margin = 0.06 * (top - low)
        ax.set_xlim(low - margin, top + margin)
        ax.xaxis.set_major_locator(MaxNLocator(4))
        return
    ax.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    most = int(np.ceil(np.log10(top)))
    decades = [10.0**power for power in range(1, most + 1, 1 + most // 5)]
    ax.set_xticks([*(-decade for decade in reversed(decades) if decade <= -low), 0.0, *decades])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlim(1.5 * low - 1.0, 1.5 * top)


def by_decades(ax: Axes, which: Literal["x", "y"], values: Iterable[float]) -> None:
    """Make an axis logarithmic, with room about its values.

    To such an axis, values that differ by rounding alone are one; matplotlib warns of limits at them.

    Parameters
    ----------
    ax : Axes
        Of any unit.
    which : {"x", "y"}
        The axis.
    values : iterable of float
        What is drawn along it; those that have no logarithm ask for no room.
    """
    shown = [float(value) for value in values if 0 < value < np.inf]
    low, high = min(shown, default=1.0), max(shown, default=1.0)
    room = max(1.2, high**0.05 / low**0.05)
    ax.set(**{f"{which}lim": (low / room, high * room)})
    ax.set(**{f"{which}scale": "log"})


def plain_decades(axis: Axis) -> None:
    """Label a logarithmic axis of percent with plain numbers, the denser the fewer decades it spans."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    low, high = axis.get_view_interval()
    dense = LogLocator(subs=(1.0, 2.0, 5.0) if high < 30 * low else (1.0,), numticks=12)
    axis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]) if high < 4 * low else dense)
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def front_points(data: Data) -> FloatArray:
    """Return (free numbers, cross-validated error [%]) of every law with both."""
    rows = [
        (law["free_numbers"], law["cross_validated_loss_error_percent_median"])
        for law in [*ranked(data), *(data.get("considered_laws") or ())]
        if law.get("free_numbers") is not None
        and law.get("cross_validated_loss_error_percent_median") is not None
    ]
    return np.array(rows, dtype=float).reshape(-1, 2)


def draw_front(ax: Axes, data: Data) -> None:
    """Draw the cross-validated error of the loss over the free numbers of all laws, and its Pareto front."""
    from matplotlib.ticker import MaxNLocator

    count, error = front_points(data).T
    ax.plot(count, error, "o", color=GREY, markersize=3.0, alpha=0.6, mew=0, label="Laws")
    steps = np.unique(count)
    best = np.minimum.accumulate([error[count <= step].min() for step in steps])
    ax.step(steps, best, where="post", color=BLUE, label="Best with as many or fewer")
    for law in ranked(data):
        if law["rank"] == 1 or is_law(law, BASELINE) or is_law(law, NO_LOOSENING):
            _point_out(ax, law)
    by_decades(ax, "y", error)
    plain_decades(ax.yaxis)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlim(steps.min() - 0.5, steps.max() + 0.5)
    ax.set_xlabel("Free numbers of the law [1]")
    ax.set_ylabel("Error of loss, cross-validated [%]")


def _point_out(ax: Axes, law: Data) -> None:
    error = law.get("cross_validated_loss_error_percent_median")
    if error is None or law.get("free_numbers") is None:
        return
    name = str(law["name"])
    ax.plot(law["free_numbers"], error, "D", color=row_colour(law), markersize=4.5,
            label=("First: " if law["rank"] == 1 else "") + law_name(name, LONGEST))  # fmt: skip
