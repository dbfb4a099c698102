"""Figures of tension in time: traces, error of the final tension, overlays of motion and tension."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discovery.views.palette import BACKGROUND, BLUE, MEASURED, MODEL, SKY
from discovery.views.ranking_plot import by_decades
from experiments.figures.description import name_points
from experiments.figures.style import FloatArray, panels, styled, tension_axis
from rom.campaign.campaign import WindowSettings
from rom.evaluation.error_measures import Comparison
from rom.model.assembly import Response
from rom.signals.filters import displacement
from rom.signals.motion import time_factor
from rom.signals.processing import Measurement, TensionRecord

_LINES = 500  # a trace is drawn as the extremes of so many pieces: no wider than a printer's line
_SHOWN_S = 0.6


@styled
def tension_traces(measurements: Sequence[Measurement], windows: WindowSettings) -> Figure:
    """Measured tension of several records, its non-oscillatory part and window means (Figs. 10, 11)."""
    used = [(m, m.tension) for m in measurements if m.tension is not None]
    columns = 2 if len(used) > 1 else 1
    rows = -(-len(used) // columns)
    figure, axes = panels(rows, columns, 12.0 + 32.0 * rows)
    for ax, (measurement, tension) in zip(axes.flat, used, strict=False):
        _trace(ax, tension, windows, (measurement.impact_s or 0.0))
        ax.set_title(f"{tension.initial:.4g} N ({_signed(-tension.loss)} N)")
    for ax in axes.flat[len(used) :]:
        ax.remove()
    figure.supxlabel("Time [s]", fontsize=7.5)
    figure.supylabel("Bolt tension [N]", fontsize=7.5)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, columnspacing=1.0
    )
    return figure


def _trace(ax: Axes, tension: TensionRecord, windows: WindowSettings, impact_s: float) -> None:
    end = min(len(tension.samples) / tension.rate_hz, windows.final_s[1])
    stop = int(end * tension.rate_hz)
    time = np.arange(stop) / tension.rate_hz
    ax.plot(*thinned(time, tension.samples[:stop]), color=SKY, lw=0.4, label="Measured")
    ax.plot(*thinned(time, tension.non_oscillatory[:stop]), color=BLUE, lw=0.9, label="Non-oscillatory")
    for place, ((start, finish), mean) in enumerate(
        ((windows.initial_s, tension.initial), (windows.final_s, tension.final))
    ):
        ax.plot(
            [start, min(finish, end)],
            [mean, mean],
            color=MODEL,
            lw=1.4,
            label=None if place else "Window mean",
        )
    ax.set_xlim(0, end)
    ax.axvline(impact_s, color=BACKGROUND, lw=0.5, ls=":")
    ax.ticklabel_format(axis="y", useOffset=False)


def _signed(value: float) -> str:
    return f"{value:+.3g}".replace("-", "−")


def thinned(time: FloatArray, samples: FloatArray, pieces: int = _LINES) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest sample of every piece, in order of time: all that a plot can show.

    Parameters
    ----------
    time : ndarray
        Time [s], shape (samples,).
    samples : ndarray
        Any unit, shape (samples,).
    pieces : int
        Two samples are kept of each.

    Returns
    -------
    tuple of ndarray
        Time and samples, shape (2 pieces,); as they are where they are few.
    """
    size = len(samples) // pieces
    if size < 4:
        return time, samples
    used = size * pieces
    blocks = samples[:used].reshape(pieces, size)
    offset = size * np.arange(pieces)[:, None]
    pairs = np.sort(offset + np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1).ravel()
    return time[pairs], samples[pairs]


@styled
def final_tension_errors(
    training: Sequence[Comparison],
    hold_out: Sequence[Comparison] = (),
    no_loosening: Sequence[Comparison] = (),
) -> Figure:
    """Error of the final tension, as the paper takes it (Fig. 14), and of the loss.

    `no_loosening` compares the model with dT/dt = 0 with the same records. Hollow:
    records that tightened, which the paper leaves out.

    Parameters
    ----------
    training : sequence of Comparison
        Records that were fitted to.
    hold_out : sequence of Comparison
        Records that no fit used.
    no_loosening : sequence of Comparison
        The same records by the model with dT/dt = 0.

    Returns
    -------
    Figure
        Two panels.
    """
    figure, axes = panels(2, 1, 92.0, sharex=True)
    groups = ((no_loosening, "_", BACKGROUND, "No loosening"), (training, "o", BLUE, "Model, training"),
              (hold_out, "D", MODEL, "Model, hold-out"))  # fmt: skip
    sizes = {"_": 7.0, "o": 3.5, "D": 4.0}
    initial: list[float] = []
    drawn: tuple[list[float], list[float]] = ([], [100.0])
    for group, marker, colour, text in groups:
        used = [
            c
            for c in group
            if c.finished and np.isfinite(c.measured_final) and np.isfinite(c.simulated_final)
        ]
        if not used:
            continue
        tension = np.array([c.initial_tension for c in used])
        tight = np.array([c.measured_final >= c.initial_tension for c in used])
        files = np.array([c.file for c in used])
        initial += list(tension)
        names = ("final_error_percent", "loss_error_percent")
        for ax, name, seen in zip(axes[:, 0], names, drawn, strict=True):
            values = np.maximum([getattr(c, name) for c in used], 1e-6)
            seen += list(values)
            for chosen, face, label in ((~tight, colour, text), (tight, "none", None)):
                (points,) = ax.plot(tension[chosen], values[chosen], marker, color=colour, label=label,
                                    markersize=sizes[marker], markerfacecolor=face,
                                    markeredgewidth=0.8)  # fmt: skip
                name_points(points, list(files[chosen]))
    labels = ("Error of final tension [%]", "Error of loss [%]")
    for ax, seen, label in zip(axes[:, 0], drawn, labels, strict=True):
        by_decades(ax, "y", seen)
        ax.set_ylabel(label)
    axes[1, 0].axhline(100.0, color=BACKGROUND, lw=0.6)
    tension_axis(axes[1, 0], np.array(initial or [1.0]), "Initial tension [N]")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, columnspacing=1.0
    )
    return figure


@styled
def overlays(pairs: Sequence[tuple[Measurement, Response]]) -> Figure:
    """Measured and simulated displacement of the struck body, and tension, a row a record (Figs. 13, 15).

    The simulated motion passes through the measurement's own filter chain first.
    """
    with_tension = any(m.tension is not None for m, _ in pairs)
    figure, axes = panels(len(pairs), 2 if with_tension else 1, 14.0 + 30.0 * len(pairs))
    for row, (measurement, response) in zip(axes, pairs, strict=True):
        _motion_overlay(row[0], measurement, response)
        if with_tension:
            _tension_overlay(row[1], measurement, response)
    for ax in axes[-1]:
        ax.set_xlabel("Time after impact [s]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _motion_overlay(ax: Axes, measurement: Measurement, response: Response) -> None:
    body = struck_body(measurement)
    motion, rate = measurement.motion[body], measurement.rate_hz
    quantity = getattr(response, motion.kind)[body]
    simulated = displacement(motion.kind, quantity, rate, measurement.chain)
    impact, shown_s = measurement.impact_s or 0.0, _SHOWN_S * time_factor(measurement.strongest_hz)
    start, stop = int(max(impact - shown_s / 12, 0.0) * rate), int((impact + shown_s) * rate)
    time = np.arange(measurement.samples)[start:stop] / rate - impact
    scale, unit = (1e6, "µm") if np.abs(measurement.displacement(body)).max() < 1e-4 else (1e3, "mm")
    ax.plot(
        *thinned(time, scale * measurement.displacement(body)[start:stop]),
        color=MEASURED,
        lw=0.9,
        label="Measured",
    )
    ax.plot(*thinned(time, scale * simulated[start:stop]), "--", color=MODEL, lw=0.9, label="Simulated")
    ax.set_ylabel(f"$x_\\mathrm{{{_math(body)}}}$ [{unit}]")
    if measurement.tension is not None:
        ax.set_title(f"Preload {measurement.tension.initial:.4g} N")
    if len(time) > 1:
        ax.set_xlim(time[0], time[-1])


def _tension_overlay(ax: Axes, measurement: Measurement, response: Response) -> None:
    tension = measurement.tension
    if tension is None or not isinstance(response.tension, np.ndarray) or not response.tension.size:
        ax.set_axis_off()
        return
    impact, shown_s = measurement.impact_s or 0.0, 5 * _SHOWN_S * time_factor(measurement.strongest_hz)
    stop = int((impact + shown_s) * tension.rate_hz)
    time = np.arange(len(tension.samples))[:stop] / tension.rate_hz - impact
    ax.plot(*thinned(time, tension.samples[:stop]), color=BACKGROUND, lw=0.3, alpha=0.6)
    ax.plot(*thinned(time, tension.non_oscillatory[:stop]), color=MEASURED, lw=0.9)
    inside = response.time <= stop / tension.rate_hz
    ax.plot(*thinned(response.time[inside] - impact, response.tension[inside]), "--", color=MODEL, lw=0.9)
    ax.set_ylabel("$T$ [N]")
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.set_xlim(time[0], time[-1])


def struck_body(measurement: Measurement) -> str:
    """Return the moving body with the largest force, the first one where no force is measured on any."""
    forced = {
        body: float(np.abs(f).max()) for body, f in measurement.force.items() if body in measurement.motion
    }
    return max(forced, key=lambda body: forced[body]) if forced else next(iter(measurement.motion))


def _math(text: str) -> str:
    return "".join(c if c.isalnum() else "\\_" if c == "_" else " " for c in text)
