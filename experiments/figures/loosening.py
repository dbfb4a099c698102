"""Figures of loosening over the initial tension: change of tension and gamma, case by case, and gamma(T)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from discovery.views.palette import BACKGROUND, BLUE, GREEN, MEASURED
from experiments.figures.curves import law_band
from experiments.figures.description import name_points
from experiments.figures.style import FloatArray, panels, styled, tension_axis
from rom.identification.curve_fits import LawFit
from rom.identification.gamma_per_case import GammaEstimate
from rom.model.laws import Z95

REGIME_SPLIT_N = 850.0  # He et al. (2025), Section 3.4


@styled
def tension_change(cases: Sequence[GammaEstimate], split_n: float | None = REGIME_SPLIT_N) -> Figure:
    """Change of tension over initial tension, positive where it tightened, with the two regimes (Fig. 9)."""
    initial = np.array([g.initial for g in cases])
    change = np.array([g.final - g.initial for g in cases])
    error = Z95 * np.nan_to_num([g.loss_error for g in cases], posinf=0.0)
    above = initial > (np.inf if split_n is None else split_n)
    enlarged = above.sum() > 1 and np.abs(change[above]).max() * 3 < np.abs(change).max()
    figure, axes = panels(2 if enlarged else 1, 1, 92.0 if enlarged else 60.0, **_RATIOS[bool(enlarged)])
    _changes(axes[0, 0], initial, change, error)
    tension_axis(axes[0, 0], initial, "Initial tension [N]")
    if split_n is not None and initial.min() < split_n < initial.max():
        axes[0, 0].axvline(split_n, color=BACKGROUND, lw=0.8, ls="--")
        top = axes[0, 0].get_xaxis_transform()
        for shift, side, text in ((0.93, "right", "Regime I"), (1.07, "left", "Regime II")):
            axes[0, 0].text(split_n * shift, 1.0, text, transform=top, ha=side, va="bottom", fontsize=7)
    axes[0, 0].legend(loc="lower left")
    if enlarged:
        _changes(axes[1, 0], initial[above], change[above], error[above])
        axes[1, 0].set_title("Regime II, enlarged")
        axes[1, 0].set_xlabel("Initial tension [N]")
    return figure


_RATIOS: dict[bool, dict[str, list[float]]] = {False: {}, True: {"height_ratios": [1.7, 1.0]}}


def _changes(ax: Axes, initial: FloatArray, change: FloatArray, error: FloatArray) -> None:
    ax.axhline(0.0, color=BACKGROUND, lw=0.6)
    groups = ((change < 0, "o", BLUE, "Net loosening"), (change >= 0, "v", GREEN, "Net tightening"))
    for chosen, marker, colour, text in groups:
        if chosen.any():
            x, y, half = initial[chosen], change[chosen], error[chosen]
            ax.errorbar(x, y, half, fmt=marker, color=colour, elinewidth=0.6, label=text)
    ax.set_ylabel("Change of tension [N]")


@styled
def gamma_cases(gamma: Sequence[GammaEstimate]) -> Figure:
    """Gamma of every case over initial tension (Fig. 12a); loosening above, tightening below zero."""
    figure, axes = panels()
    ax = axes[0, 0]
    tension, value = np.array([g.initial for g in gamma]), np.array([g.gamma for g in gamma])
    bound = np.array([g.at_bound for g in gamma])
    tension_axis(ax, tension, "Initial tension [N]")
    _decades_about_zero(ax, value)
    groups = (
        (value > 0, "o", BLUE, "Net loosening"),
        (value < 0, "v", GREEN, "Net tightening"),
        (value == 0, "s", BACKGROUND, "No change"),
    )
    for chosen, marker, colour, text in groups:
        if np.any(chosen & ~bound):
            ax.plot(tension[chosen & ~bound], value[chosen & ~bound], marker, color=colour, label=text)
    if bound.any():
        ax.plot(tension[bound], value[bound], "x", color=MEASURED, label="At the bound")
    ax.set_ylabel("$\\gamma$ [s$^3$/m$^4$]")
    ax.legend(loc="upper right")
    return figure


def _decades_about_zero(ax: Axes, value: FloatArray) -> None:
    """Scale the vertical axis by decades on both sides of zero, linear within the smallest value's decade."""
    size = np.abs(value[value != 0]) if np.any(value) else np.ones(1)
    low, high = int(np.floor(np.log10(size.min()))), int(np.ceil(np.log10(size.max())))
    ax.set_yscale("symlog", linthresh=10.0**low, linscale=0.6)
    ax.axhline(0.0, color=BACKGROUND, lw=0.6)
    decades = [10.0**power for power in range(low, high + 1, 1 if np.all(value >= 0) else 2)]
    signs = [sign for sign in (-1, 1) if np.any(sign * value > 0)]
    ax.set_yticks(sorted([0.0, *(sign * decade for sign in signs for decade in decades)]), minor=False)
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylim(-3 * 10.0**high if -1 in signs else -(10.0**low), 3 * 10.0**high if 1 in signs else 10.0**low)


@styled
def gamma_law(gamma: Sequence[GammaEstimate], fit: LawFit | None = None) -> Figure:
    """Gamma of the net-loosening cases with 95 % limits, and the fitted law (Fig. 12b)."""
    figure, axes = panels()
    ax = axes[0, 0]
    used = [g for g in gamma if g.gamma > 0 and not g.at_bound]
    tension, value = np.array([g.initial for g in used]), np.array([g.gamma for g in used])
    grid = tension_axis(ax, tension, "Initial tension [N]")
    error = np.clip([g.log_error if np.isfinite(g.log_error) else 0.0 for g in used], 0.0, 3.0)
    lower, upper = value * np.exp(-Z95 * error), value * np.exp(Z95 * error)
    ax.set_yscale("log")
    law = law_band(ax, fit, grid, "$\\gamma(T)$, 95 % limits") if fit is not None else value
    points = ax.errorbar(tension, value, [value - lower, upper - value], fmt="o", color=MEASURED,
                         elinewidth=0.6, label="Per case, 95 % limits", zorder=3)  # fmt: skip
    name_points(points.lines[0], [g.file for g in used])
    ax.set_ylim(0.2 * min(value.min(), law.min()), 5 * max(value.max(), law.max()))
    ax.set_ylabel("$\\gamma$ [s$^3$/m$^4$]")
    ax.legend(loc="upper right")
    return figure
