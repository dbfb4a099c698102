"""Tension after the hit, measured and by laws, from what ranking.json holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discovery.laws.candidate import BASELINE, CONSTANT_QUADRATIC, NO_LOOSENING
from discovery.views.palette import BACKGROUND, BLUE, GREEN, GREY, MEASURED, SKY
from discovery.views.ranking_plot import LONGEST, is_law, law_name, ranked, row_colour
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.laws import Z95

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Data = Mapping[str, Any]

_EARLIER = CONSTANT_QUADRATIC  # [47] of He et al. (2025)
_PRINTED_N: Numerical[tuple[float, ...]] = (6.4, 21.5, 61.3, 152.7, 317.0, 700.2)  # there, Fig. 15
LINES = ((BLUE, "-"), (GREEN, "--"), (SKY, "-."))


def drawn_with_colours(data: Data) -> list[tuple[str, str]]:
    """Return the laws of `drawn_laws`, each with its colour."""
    rows = {law["name"]: law for law in ranked(data)}
    names = drawn_laws(data)
    return [(n, row_colour(rows[n], LINES[min(k, len(LINES) - 1)][0])) for k, n in enumerate(names)]


def drawn_laws(data: Data) -> list[str]:
    """Return the laws that figures over cases draw: the first two and the paper's.

    Where that is one of them, the law of earlier work is the third, so that there is something to compare.
    """
    laws = ranked(data)
    chosen = [law for law in laws if not is_law(law, NO_LOOSENING)][:2]
    third = _EARLIER if any(is_law(law, BASELINE) for law in chosen) else BASELINE
    chosen += [law for law in laws if is_law(law, third) and law not in chosen]
    return [str(law["name"]) for law in chosen]


def nearest_cases(cases: Sequence[Data], wanted: Sequence[float] = _PRINTED_N) -> list[Data]:
    """Return the case nearest to each preload [N] by ratio, each once, the hardest hit of those alike.

    Preloads below a newton cannot be compared by ratio and are left out.
    """
    left = [case for case in cases if tension_of(case) > 1.0]
    chosen: list[Data] = []
    for preload in wanted[: len(left)]:
        near = min(abs(np.log(tension_of(case) / preload)) for case in left)
        close = [case for case in left if abs(np.log(tension_of(case) / preload)) < near + 0.1]
        best = max(close, key=lambda case: float(case.get("peak_force_n") or 0.0))
        chosen.append(best)
        left = [case for case in left if case is not best]
    return sorted(chosen, key=tension_of)


def tension_of(case: Data) -> float:
    """Return the tension of a case before the hit [N]."""
    return float(case["initial_tension_n"])


def courses_height_mm(data: Data) -> float:
    """Return the height that the courses need."""
    return 16.0 + 30.0 * _rows(len(nearest_cases(data["cases"])))


def _rows(cases: int) -> int:
    return -(-cases // 2) if cases > 1 else cases


def draw_courses(figure: Figure | SubFigure, data: Data) -> Axes:
    """Draw the courses of the cases nearest to the printed preloads; return axes that have all labels."""
    cases = nearest_cases(data["cases"])
    columns = 2 if len(cases) > 1 else 1
    axes = figure.subplots(_rows(len(cases)), columns, squeeze=False, sharex=True)
    laws = drawn_with_colours(data)
    for ax, case in zip(axes.flat, cases, strict=False):
        _course(ax, case, laws, _scatter(data, tension_of(case)))
    for ax in axes.flat[len(cases) :]:
        ax.remove()
    for column in range(columns):
        lowest = axes[(len(cases) - 1 - column) // columns, column]
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("Time after the hit [s]")
    figure.supylabel("Non-oscillatory tension $T$ [N]", fontsize=axes[0, 0].xaxis.label.get_size())
    first: Axes = axes[0, 0]
    return first


def course_choices(data: Data) -> list[Data]:
    """Return every case that has a course by all drawn laws, by preload."""
    names = drawn_laws(data)

    def is_whole(case: Data) -> bool:
        courses = [case.get("change_n"), *((case.get("laws") or {}).get(name) for name in names)]
        return all(course is not None and None not in course for course in courses)

    known = [case for case in data["cases"] if is_whole(case)]
    return sorted((case for case in known if tension_of(case) > 1.0), key=tension_of)


def draw_case(figure: Figure | SubFigure, data: Data, case: Data) -> None:
    """Draw the course of one case alone.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where to draw.
    data : mapping
        As ranking.json holds it.
    case : mapping
        One of its cases.
    """
    ax = figure.subplots()
    _course(ax, case, drawn_with_colours(data), _scatter(data, tension_of(case)))
    ax.set_xlabel("Time after the hit [s]")
    ax.set_ylabel("Non-oscillatory tension $T$ [N]")


def _course(ax: Axes, case: Data, laws: Sequence[tuple[str, str]], scatter: float) -> None:
    from matplotlib.ticker import MaxNLocator

    time, initial = np.asarray(case["time_s"], dtype=float), tension_of(case)
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
        style = LINES[min(place, 2)][1]
        ax.plot(time, course, style, color=colour, label=law_name(name, LONGEST))
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
