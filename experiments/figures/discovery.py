"""Figures of a ranking of tension laws, each drawn from what ranking.json holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discovery.criteria.criteria import percent, used_in
from discovery.views.palette import BACKGROUND, BLUE, SKY, VERMILLION
from discovery.views.ranking_plot import (
    LONGEST,
    draw_front,
    draw_leader_board,
    front_points,
    law_name,
    leader_board_height_mm,
    plain_decades,
    ranked,
)
from discovery.views.tension_plot import (
    course_choices,
    courses_height_mm,
    draw_case,
    draw_courses,
    drawn_with_colours,
    nearest_cases,
    tension_of,
)
from experiments.figures.description import name_points
from experiments.figures.style import FloatArray, blank, panels, styled, tension_axis
from experiments.text.wording import set_words
from rom.model.laws import Z95

Data = Mapping[str, Any]

_TERMS, _SELDOM = 12, 0.005
_DRAWN_PERCENT = (0.1, 1000.0)  # errors beyond are drawn at the edge
_HALF_WIDTH = 27  # characters of a name in a legend that leaves room for another
_MOST_DEVIANCE = 60.0


def discovery_figures(data: Data) -> dict[str, Figure]:
    """Return the figures of a ranking by name; what its data do not allow is left out."""
    made: dict[str, tuple[object, Callable[[Data], Figure]]] = {
        "law-leader-board": (len(ranked(data)) > 1, leader_board),
        "law-trajectories": (nearest_cases(_cases(data)), trajectories),
        "law-errors": (_cases(data), errors_over_preload),
        "exponent-profile": (_profiles(data), profiles),
        "accuracy-complexity": (len(front_points(data)) > 1, accuracy_and_complexity),
        "term-inclusion": (_term_shares(data), inclusion),
    }
    return {name: draw(data) for name, (there, draw) in made.items() if there}


def _cases(data: Data) -> list[Data]:
    return list(data.get("cases") or [])


@styled
def leader_board(data: Data) -> Figure:
    """Difference of BIC to the first law, and cross-validated error of the loss, a row a law."""
    figure = blank(leader_board_height_mm(data))
    draw_leader_board(figure, data)
    return figure


def _legend(figure: Figure, ax: Axes) -> None:
    """Put the legend above the panels, in one column where names are long; the figure grows by it."""
    handles, labels = ax.get_legend_handles_labels()
    columns = 1 if max(map(len, labels), default=0) > _HALF_WIDTH else 2
    grown = 0.13 * (-(-len(labels) // columns) - 3)  # [inch], beyond the three rows that there is room for
    figure.set_figheight(figure.get_figheight() + max(grown, 0.0))
    figure.legend(handles, labels, loc="outside upper center", ncols=columns)


@styled
def trajectories(data: Data) -> Figure:
    """Measured tension after the hit with 95 % limits and the course of each law (preloads of Fig. 15)."""
    figure = blank(courses_height_mm(data))
    _legend(figure, draw_courses(figure, data))
    cases = course_choices(data)
    several = len({case.get("campaign") for case in cases}) > 1
    figure.choices = {_case_words(case, several): partial(_one_course, data, case) for case in cases}
    return figure


def _case_words(case: Data, several: bool) -> str:
    """Return the name of a case among the others; that of several bolts says which."""
    parts = [str(case.get("campaign") or "")] if several else []
    parts += [str(case.get("file", "")), f"{tension_of(case):.4g} N"]
    return ", ".join([part for part in parts if part] + (["held out"] if case.get("hold_out") else []))


@styled
def _one_course(data: Data, case: Data) -> Figure:
    figure = blank(height_mm=60.0)
    draw_case(figure, data, case)
    return figure


@styled
def errors_over_preload(data: Data) -> Figure:
    """Error of the loss of every record over its initial tension, for the first laws and the paper's."""
    figure, axes = panels(height_mm=64.0)
    ax = axes[0, 0]
    cases = _cases(data)
    tension = np.array([tension_of(case) for case in cases])
    files = np.array([str(case.get("file", "")) for case in cases])
    ax.axhline(100.0, color=BACKGROUND, lw=0.6, label="No loosening")
    lowest = highest = 100.0
    for place, (name, colour) in enumerate(drawn_with_colours(data)):
        error = np.array([_loss_error(case, name) for case in cases])
        there = np.isfinite(error) & (tension > 0)
        held = np.array([bool(case.get("hold_out")) for case in cases])
        for chosen, face, label in ((there & ~held, colour, law_name(name, LONGEST)),
                                    (there & held, "none", None)):  # fmt: skip
            shown = np.clip(error[chosen], *_DRAWN_PERCENT)
            (points,) = ax.plot(tension[chosen], shown, "oDs"[min(place, 2)], color=colour, label=label,
                                markerfacecolor=face, markersize=3.0, markeredgewidth=0.7)  # fmt: skip
            name_points(points, list(files[chosen]))
        lowest, highest = min([lowest, *error[there]]), max([highest, *error[there]])
    tension_axis(ax, tension, "Initial tension [N]")
    least, most = _DRAWN_PERCENT
    ax.set_ylim(0.8 * max(0.7 * lowest, least), min(1.3 * max(highest, 100.0), 1.2 * most))
    ax.set_yscale("log")  # limits first: of errors that are the same but for rounding it finds none
    plain_decades(ax.yaxis)
    ax.set_ylabel("Error of loss [%]")
    _legend(figure, ax)
    return figure


def _loss_error(case: Data, name: str) -> float:
    value = (case.get("loss_error_percent") or {}).get(name)
    return float("nan") if value is None else float(value)


def _profiles(data: Data) -> list[tuple[str, Data]]:
    motion = data.get("motion_profile") or {}
    named = (
        ("Power of the relative velocity [1]", data.get("exponent_profile") or {}),
        ("Power $q$ of the displacement in $|v|^n |x|^q$ [1]", motion.get("displacement") or {}),
    )
    return [(label, profile) for label, profile in named if len(profile.get("values") or ()) > 1]


@styled
def profiles(data: Data) -> Figure:
    """Badness of fit over the exponent of the relative velocity (and of x against v), with their sets."""
    shown = _profiles(data)
    figure, axes = panels(len(shown), 1, 6.0 + 50.0 * len(shown))
    figure.get_layout_engine().set(hspace=0.08)  # type: ignore[union-attr,call-arg]
    level = percent(used_in(data).ranking.confidence)
    for ax, (label, profile) in zip(axes[:, 0], shown, strict=True):
        _profile(ax, profile, level)
        ax.set_xlabel(label)
    return figure


def _profile(ax: Axes, profile: Data, confidence: str) -> None:
    value, rise = _curve(profile)
    level = float(profile.get("level") or Z95**2)
    low, high = profile.get("low"), profile.get("high")
    ax.axhline(level, color=BACKGROUND, lw=0.6, ls="--")
    if low is not None and high is not None:
        ax.axvspan(low, high, color=VERMILLION, alpha=0.18, lw=0)
        ax.set_title(f"{confidence} set: {set_words(profile)}")
    ax.plot(value, rise, "o-", color=BLUE, markersize=2.5)
    most = min(max(1.2 * float(rise.max()), 2 * level), max(_MOST_DEVIANCE, 10 * level))
    near = np.flatnonzero(rise <= most)
    ax.set_xlim(value[max(near.min() - 1, 0)] - 0.1, value[min(near.max() + 1, len(value) - 1)] + 0.1)
    # The root of the rise is nearly straight in the exponent.
    ax.set_yscale("function", functions=(lambda y: np.sqrt(np.maximum(y, 0.0)), np.square))
    ax.set_yticks([tick for tick in (0, 5, 20, 50, 100, 200, 500, 1000, 5000) if tick <= most])
    ax.set_ylim(0.0, most)
    ax.set_ylabel("Rise of $-2\\,\\ln L$ [1]")


def _curve(profile: Data) -> tuple[FloatArray, FloatArray]:
    """Return values and rises in order, the best value among them."""
    known = profile.get("deviance") or profile["delta_bic"]
    points = {float(x): float(y) for x, y in zip(profile["values"], known, strict=True) if y is not None}
    if profile.get("best") is not None:
        points[float(profile["best"])] = 0.0
    value, rise = np.array(sorted(points.items())).T
    return value, rise - rise.min()


@styled
def accuracy_and_complexity(data: Data) -> Figure:
    """Cross-validated error of the loss over the number of free numbers, with the front of what is best."""
    figure, axes = panels(height_mm=60.0)
    draw_front(axes[0, 0], data)
    _legend(figure, axes[0, 0])
    return figure


def _term_shares(data: Data) -> list[tuple[str, float, float]]:
    """Return forms of terms with their shares in the race and in sparse fits, the most frequent first."""
    race, sparse = (data.get(key) or {} for key in ("chosen_terms", "inclusion"))
    found = [(name, float(race.get(name) or 0), float(sparse.get(name) or 0)) for name in {**race, **sparse}]
    often = [item for item in found if max(item[1:]) >= _SELDOM]
    return sorted(often, key=lambda item: (-item[1], -item[2]))[:_TERMS]


@styled
def inclusion(data: Data) -> Figure:
    """Share of resamples in which the first law, and a sparse fit, has a term of each form."""
    shares = _term_shares(data)
    figure, axes = panels(height_mm=12.0 + 7.0 * len(shares))
    ax = axes[0, 0]
    for row, (name, raced, sparse) in enumerate(shares):
        ax.barh(row, 100 * raced, 0.32, color=BLUE)
        ax.barh(row + 0.24, 100 * sparse, 0.12, color=SKY)
        ax.annotate(law_name(name, 60), (0.0, row - 0.2), xycoords=("axes fraction", "data"), va="bottom")
    ax.set_ylim(len(shares) - 0.6, -0.9)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlim(0, 100)
    ax.set_xlabel("Share of resamples: first law (wide), sparse fit (narrow) [%]")
    return figure
