"""Figures over frequency or tension: calibration, frequency responses, first mode, joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discovery.views.palette import BACKGROUND, MEASURED, MODEL
from experiments.figures.description import name_points
from experiments.figures.style import FloatArray, panels, styled, tension_axis
from rom.criteria.identification import RULES
from rom.identification.curve_fits import LawFit
from rom.identification.joint import JointEstimate
from rom.identification.reduce import UncoupledTest
from rom.model.laws import Z95
from rom.model.model import Model
from rom.signals.calibration import Calibration

_WIDEST = 3.0  # standard error of a logarithm that is drawn, at most
_TELLING = 0.3  # limits beyond this do not set the axis
_DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}
_FRF_LABEL = {"displacement": "m/N", "velocity": "m/(s N)", "acceleration": "m/(s$^2$ N)"}


@styled
def calibration_curve(
    calibration: Calibration,
    tensions: FloatArray | None = None,
    strain: FloatArray | None = None,
    force: FloatArray | None = None,
) -> Figure:
    """Tension over strain reading (Fig. 4b), the tensile test where given, ticks at measured tensions [N].

    Parameters
    ----------
    calibration : Calibration
        Of the bolt.
    tensions : ndarray, optional
        Tensions of the campaign [N], shape (records,).
    strain, force : ndarray, optional
        The tensile test: reading and force [N], shape (samples,).

    Returns
    -------
    Figure
        One panel.
    """
    figure, axes = panels()
    ax = axes[0, 0]
    reading = _strain_span(calibration, tensions, strain)
    tension = calibration.tension(reading)
    if strain is not None and force is not None:
        ax.plot(strain, force, ".", color=MEASURED, markersize=1.5, label="Tensile test", rasterized=True)
    ax.plot(reading, tension, color=MODEL, label="Calibration polynomial")
    if calibration.covariance is not None:
        half = Z95 * calibration.tension_standard_error(reading)
        ax.fill_between(
            reading, tension - half, tension + half, color=MODEL, alpha=0.2, lw=0, label="95 % limits"
        )
    if tensions is not None and len(tensions):
        place = np.interp(tensions, tension, reading)
        ax.plot(place, tensions, "|", color=MEASURED, markersize=5, label="Records")
    ax.set_xlabel("Strain reading $\\varepsilon$ [gauge unit]")
    ax.set_ylabel("Bolt tension $T$ [N]")
    ax.legend(loc="upper left")
    return figure


def _strain_span(
    calibration: Calibration, tensions: FloatArray | None, strain: FloatArray | None
) -> FloatArray:
    """Return readings from zero to what was calibrated, tested or measured."""
    if strain is not None and len(strain):
        return np.linspace(0.0, float(np.max(strain)), 200)
    if calibration.strain_range is not None:
        return np.linspace(0.0, calibration.strain_range[1], 200)
    top = float(np.max(tensions)) * 1.1 if tensions is not None and len(tensions) else 3000.0
    reading = np.linspace(0.0, 4.0 * top / abs(calibration.coefficients[0] or 1.0), 4000)
    beyond = np.flatnonzero(calibration.tension(reading) >= top)
    return np.linspace(0.0, float(reading[beyond[0] if len(beyond) else -1]), 200)


@styled
def frequency_responses(tests: Sequence[UncoupledTest]) -> Figure:
    """Measured frequency response and fitted mode of every body alone (Fig. 5); coherence where known."""
    bodies = list(dict.fromkeys(test.body for test in tests))
    coherent = any(test.response.coherence is not None for test in tests)
    ratios = [3.0, 1.0] * len(bodies) if coherent else [1.0] * len(bodies)
    figure, axes = panels(
        len(ratios), 1, 8.0 + (52.0 if coherent else 38.0) * len(bodies), height_ratios=ratios
    )
    column = axes[:, 0]
    for row, body in enumerate(bodies):
        ax = column[2 * row if coherent else row]
        own = [test for test in tests if test.body == body]
        _receptances(ax, own)
        if coherent:
            _coherences(column[2 * row + 1], own, ax)
            ax.tick_params(labelbottom=False)
    column[-1].set_xlabel("Frequency [Hz]")
    column[0].legend(loc="upper right")
    return figure


def _receptances(ax: Axes, tests: Sequence[UncoupledTest]) -> None:
    for place, test in enumerate(tests):
        frequency, inside = _band(test)
        s = 2j * np.pi * frequency
        natural, ratio = 2 * np.pi * test.mode.natural_frequency.value, test.mode.damping_ratio.value
        pole = natural * complex(-ratio, np.sqrt(max(1 - ratio**2, 0.0)))
        residue = test.mode.residue
        model = (residue / (s - pole) + np.conj(residue) / (s - np.conj(pole))) * s ** _DERIVATIVES[
            test.response.motion
        ]
        first = place == 0
        ax.semilogy(frequency, np.abs(test.response.frf[inside]), color=MEASURED, lw=0.7, alpha=0.8,
                    label="Measured" if first else None)  # fmt: skip
        ax.semilogy(frequency, np.abs(model), "--", color=MODEL, label="Fitted mode" if first else None)
    mode = tests[0].mode
    ax.set_title(f"{tests[0].body}: $f$ = {mode.natural_frequency.value:.3f} Hz, "
                 f"$\\zeta$ = {100 * mode.damping_ratio.value:.2f} %")  # fmt: skip
    ax.set_ylabel(f"|FRF| [{_FRF_LABEL[tests[0].response.motion]}]")


def _coherences(ax: Axes, tests: Sequence[UncoupledTest], above: Axes) -> None:
    for test in tests:
        frequency, inside = _band(test)
        if test.response.coherence is not None:
            ax.plot(frequency, test.response.coherence[inside], color=MEASURED, lw=0.7)
    ax.set_ylim(0, 1.05)
    ax.set_xlim(above.get_xlim())
    ax.set_ylabel("Coherence [1]")


def _band(test: UncoupledTest) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    natural = test.mode.natural_frequency.value
    inside = (test.response.frequency > 0.5 * natural) & (test.response.frequency < 1.8 * natural)
    return test.response.frequency[inside], inside


@styled
def first_mode_frequency(joint: Sequence[JointEstimate], model: Model | None = None) -> Figure:
    """Average-period frequency of the first mode over tension with 95 % limits (Fig. 6d), and the model's."""
    figure, axes = panels(height_mm=54.0)
    ax = axes[0, 0]
    seen = [(j.tension, j.first_mode.frequency) for j in joint if j.first_mode is not None]
    tension = np.array([t for t, _ in seen])
    grid = tension_axis(ax, tension)
    value = np.array([f.value for _, f in seen])
    error = Z95 * np.array([f.standard_error for _, f in seen])
    ax.errorbar(
        tension, value, error, fmt="o", color=MEASURED, elinewidth=0.6, label="Average period, 95 % limits"
    )
    if model is not None and model.structure.bolted_links:
        ax.plot(grid, [damped_frequencies(model, t)[0] for t in grid], color=MODEL, label="Identified model")
    ax.set_ylabel("First-mode frequency [Hz]")
    ax.legend(loc="lower right")
    return figure


def damped_frequencies(model: Model, tension: float) -> FloatArray:
    """Return Im(s) / (2 pi) of det(s^2 M + s C + K(T)) = 0, ascending [Hz]; overdamped modes are left out."""
    incidence, laws = (
        model.structure.incidence,
        [model.link_laws[name] for name in model.structure.link_names],
    )
    stiffness = incidence.T @ np.diag([float(law.stiffness(tension)) for law in laws]) @ incidence
    damping = incidence.T @ np.diag([float(law.damping(tension)) for law in laws]) @ incidence
    inverse = np.diag(1 / model.structure.masses)
    n = len(inverse)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    found = np.linalg.eigvals(state).imag / (2 * np.pi)
    rising = np.sort(found[found > 1e-9])
    return rising if len(rising) else np.array([np.nan])


@styled
def joint_stiffness(joint: Sequence[JointEstimate], fit: LawFit | None = None) -> Figure:
    """Joint stiffness over tension (Fig. 7a): records, law with 95 % band, the paper's modal estimates."""
    return _joint(joint, fit, "Joint stiffness $k_C$ [N/m]", "stiffness", "lower right")


@styled
def joint_damping(joint: Sequence[JointEstimate], fit: LawFit | None = None) -> Figure:
    """Joint damping over tension (Fig. 7b): records, law with 95 % band, the paper's modal estimates."""
    return _joint(joint, fit, "Joint damping $c_C$ [N s/m]", "damping", "upper right")


def _joint(joint: Sequence[JointEstimate], fit: LawFit | None, label: str, what: str, corner: str) -> Figure:
    figure, axes = panels()
    ax = axes[0, 0]
    tension = np.array([j.tension for j in joint])
    value = np.array([getattr(j, what) for j in joint])
    error = np.array([j.log_errors[what == "damping"] for j in joint])
    error = np.clip(np.nan_to_num(error, posinf=_WIDEST), 0.0, _WIDEST)
    modal = np.array(
        [np.nan if (m := getattr(j, f"modal_{what}")) is None else m for j in joint], dtype=float
    )
    limit = RULES.modal_damping
    doubtful = np.array([j.heaviest_damping_ratio > limit for j in joint])
    grid = tension_axis(ax, tension)
    limits = [value * np.exp(-Z95 * error), value * np.exp(Z95 * error)]
    shown = np.concatenate([value, *(limit[error < _TELLING] for limit in limits)])
    if fit is not None:
        shown = np.concatenate([shown, law_band(ax, fit, grid, "Fitted law, 95 % limits")])
    bars = [value - limits[0], limits[1] - value]
    points = ax.errorbar(tension, value, bars, fmt="o", color=MEASURED, elinewidth=0.6, zorder=3,
                         label="Output error, 95 % limits")  # fmt: skip
    name_points(points.lines[0], [j.file for j in joint])
    low, high = float(shown.min()), float(shown.max())
    margin = 0.12 * (high - low) or 0.1 * high
    low, high = max(low - margin, 0.0), high + margin
    inside = np.isfinite(modal) & (modal >= low) & (modal <= high)
    for chosen, marker, text in ((~doubtful, "s", "Modal (Eqs. 3, 9, 10)"),
                                 (doubtful, "x", f"Modal where $\\zeta$ > {limit:g}")):  # fmt: skip
        if np.any(inside & chosen):
            ax.plot(tension[inside & chosen], modal[inside & chosen], marker, color=BACKGROUND, markersize=5,
                    markerfacecolor="none", markeredgewidth=0.7, label=text, zorder=1)  # fmt: skip
    ax.set_ylim(low, high)
    ax.set_ylabel(label)
    ax.ticklabel_format(axis="y", style="sci", scilimits=(-2, 4), useMathText=True)
    ax.legend(loc=corner)
    return figure


def law_band(ax: Axes, fit: LawFit, grid: FloatArray, label: str) -> FloatArray:
    """Draw a law and its 95 % band; return the values of the law.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    fit : LawFit
        The law and its covariance.
    grid : ndarray
        Tensions [N], shape (points,).
    label : str
        Of the line.

    Returns
    -------
    ndarray
        Values of the law, shape (points,).
    """
    value = fit.curve(fit.law, grid)
    half = Z95 * fit.log_error(grid)
    half = np.where(np.isfinite(half), np.minimum(half, 20.0), 0.0)
    ax.fill_between(grid, value * np.exp(-half), value * np.exp(half), color=MODEL, alpha=0.25, lw=0)
    ax.plot(grid, value, color=MODEL, label=label)
    return np.asarray(value)
