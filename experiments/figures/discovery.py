"""Figures of a ranking of tension laws, each drawn from what ranking.json holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from discovery.criteria.criteria import percent, used_in
from discovery.laws.candidate import BASELINE, NO_LOOSENING
from discovery.views.palette import BACKGROUND, BLUE, GREEN, GREY, MEASURED, SKY, VERMILLION
from discovery.views.ranking_figure import (
    draw_front,
    draw_leader_board,
    front_points,
    is_law,
    law_name,
    leader_board_height_mm,
    plain_decades,
    ranked,
    row_colour,
)
from experiments.figures.style import FloatArray, blank, panels, styled, tension_axis
from experiments.text.wording import set_words
from rom.model.laws import Z95

Data = Mapping[str, Any]

_EARLIER = "constant gamma, quadratic"  # [47] of He et al. (2025)
_PRINTED_N = (6.4, 21.5, 61.3, 152.7, 317.0, 700.2)  # preloads of He et al. (2025), Fig. 15
_TERMS, _SELDOM = 12, 0.005
_DRAWN_PERCENT = (0.1, 1000.0)  # errors beyond are drawn at the edge
_LINES = ((BLUE, "-"), (GREEN, "--"), (SKY, "-."))
_LONGEST, _HALF_WIDTH = 48, 27  # characters of a name in a legend, and of one that leaves room for another
_MOST_DEVIANCE = 60.0


def discovery_figures(data: Data) -> dict[str, Figure]:
    """Return the figures of a ranking by name; what its data do not allow is left out."""
    made: dict[str, tuple[object, Callable[[Data], Figure]]] = {
        "law-leader-board": (len(ranked(data)) > 1, leader_board),
        "law-trajectories": (_cases(data), trajectories),
        "law-errors": (_cases(data), errors_over_preload),
        "exponent-profile": (_profiles(data), profiles),
        "accuracy-complexity": (len(front_points(data)) > 1, accuracy_and_complexity),
        "term-inclusion": (_term_shares(data), inclusion),
    }
    return {name: draw(data) for name, (there, draw) in made.items() if there}


def _cases(data: Data) -> list[Data]:
    return list(data.get("cases") or [])


def _drawn(data: Data) -> list[tuple[str, str]]:
    """Return the laws of `drawn_laws`, each with its colour."""
    rows = {law["name"]: law for law in ranked(data)}
    names = drawn_laws(data)
    return [(n, row_colour(rows[n], _LINES[min(k, len(_LINES) - 1)][0])) for k, n in enumerate(names)]


def drawn_laws(data: Data) -> list[str]:
    """Return the laws that figures over cases draw: the first two and the paper's.

    Where that is one of them, the law of earlier work is the third, so that there is something to compare.
    """
    laws = ranked(data)
    chosen = [law for law in laws if not is_law(law, NO_LOOSENING)][:2]
    third = _EARLIER if any(is_law(law, BASELINE) for law in chosen) else BASELINE
    chosen += [law for law in laws if is_law(law, third) and law not in chosen]
    return [str(law["name"]) for law in chosen]


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


def nearest_cases(cases: Sequence[Data], wanted: Sequence[float] = _PRINTED_N) -> list[Data]:
    """Return the case nearest to each preload [N] by ratio, each once, the hardest hit of those alike.

    Preloads below a newton cannot be compared by ratio and are left out.
    """
    left = [case for case in cases if _tension(case) > 1.0]
    chosen: list[Data] = []
    for preload in wanted[: len(left)]:
        near = min(abs(np.log(_tension(case) / preload)) for case in left)
        close = [case for case in left if abs(np.log(_tension(case) / preload)) < near + 0.1]
        best = max(close, key=lambda case: float(case.get("peak_force_n") or 0.0))
        chosen.append(best)
        left = [case for case in left if case is not best]
    return sorted(chosen, key=_tension)


def _tension(case: Data) -> float:
    return float(case["initial_tension_n"])


@styled
def trajectories(data: Data) -> Figure:
    """Measured tension after the hit with 95 % limits and the course of each law (preloads of Fig. 15)."""
    cases = nearest_cases(_cases(data))
    columns = 2 if len(cases) > 1 else 1
    rows = -(-len(cases) // columns)
    figure, axes = panels(rows, columns, 16.0 + 30.0 * rows, sharex=True)
    laws = _drawn(data)
    for ax, case in zip(axes.flat, cases, strict=False):
        _course(ax, case, laws, _scatter(data, _tension(case)))
    for ax in axes.flat[len(cases) :]:
        ax.remove()
    for column in range(columns):
        lowest = axes[(len(cases) - 1 - column) // columns, column] if len(cases) > column else None
        if lowest is not None:
            lowest.tick_params(labelbottom=True)
            lowest.set_xlabel("Time after the hit [s]")
    figure.supylabel("Non-oscillatory tension $T$ [N]", fontsize=7.5)
    _legend(figure, axes[0, 0])
    return figure


def _course(ax: Axes, case: Data, laws: Sequence[tuple[str, str]], scatter: float) -> None:
    time, initial = np.asarray(case["time_s"], dtype=float), _tension(case)
    measured = initial + np.asarray(case["change_n"], dtype=float)
    error = Z95 * np.asarray(case["change_error_n"], dtype=float)
    ax.axhline(initial, color=BACKGROUND, lw=0.6, ls=":", label="Before the hit")
    ax.errorbar(time, measured, error, fmt="o", color=MEASURED, markersize=2.5, elinewidth=0.6,
                label="Measured, 95 % limits", zorder=3)  # fmt: skip
    shown = [initial, *(measured - error), *(measured + error)]
    for place, (name, colour) in enumerate(laws):
        predicted = (case.get("laws") or {}).get(name)
        if predicted is None:
            continue
        course = initial + np.asarray(predicted, dtype=float)
        if place == 0:
            shown += [*_scattered(ax, time, course, initial, scatter), *course]
        style = _LINES[min(place, 2)][1]
        ax.plot(time, course, style, color=colour, label=law_name(name, _LONGEST))
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    ax.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))  # rivals far off may leave it
    ax.set_xscale("log")
    ax.set_title(f"{initial:.3g} N" + (", held out" if case.get("hold_out") else ""))
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.yaxis.set_major_locator(MaxNLocator(4))


def _scattered(
    ax: Axes, time: FloatArray, course: FloatArray, initial: float, scatter: float
) -> tuple[float, float]:
    """Draw where 68 % of tests lie by the scatter of the rate, a power of T / T_0; return the ends."""
    if not scatter or initial <= 0:
        return initial, initial
    share = np.log(np.clip(course / initial, 1e-9, None))
    fast, slow = (initial * np.exp(share * np.exp(sign * scatter)) for sign in (1, -1))
    ax.fill_between(time, fast, slow, color=GREY, alpha=0.25, lw=0, label="68 % of tests, by the first law")
    return float(fast.min()), float(slow.max())


def _scatter(data: Data, tension: float) -> float:
    """Return the standard deviation of the log rate from test to test, at a tension [N]."""
    known = data.get("scatter") or {}
    if known.get("a") is None or known.get("b") is None or tension <= 0:
        return 0.0
    return float(np.exp(np.clip(known["a"] + known["b"] * np.log(tension / 100.0), -7.0, 1.5)))


@styled
def errors_over_preload(data: Data) -> Figure:
    """Error of the loss of every record over its initial tension, for the first laws and the paper's."""
    figure, axes = panels(height_mm=64.0)
    ax = axes[0, 0]
    cases = _cases(data)
    tension = np.array([_tension(case) for case in cases])
    ax.axhline(100.0, color=BACKGROUND, lw=0.6, label="No loosening")
    lowest = highest = 100.0
    for place, (name, colour) in enumerate(_drawn(data)):
        error = np.array([_loss_error(case, name) for case in cases])
        there = np.isfinite(error) & (tension > 0)
        held = np.array([bool(case.get("hold_out")) for case in cases])
        for chosen, face, label in ((there & ~held, colour, law_name(name, _LONGEST)),
                                    (there & held, "none", None)):  # fmt: skip
            ax.plot(tension[chosen], np.clip(error[chosen], *_DRAWN_PERCENT), "oDs"[min(place, 2)],
                    color=colour, markerfacecolor=face, markersize=3.0, markeredgewidth=0.7,
                    label=label)  # fmt: skip
        lowest, highest = min([lowest, *error[there]]), max([highest, *error[there]])
    tension_axis(ax, tension, "Initial tension [N]")
    ax.set_yscale("log")
    least, most = _DRAWN_PERCENT
    ax.set_ylim(0.8 * max(0.7 * lowest, least), min(1.3 * max(highest, 100.0), 1.2 * most))
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
