"""Pictures of the force that a model leaves unbalanced, from what a result file holds of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

Data = Mapping[str, Any]
FORCE = "Force [N]"
_Units = tuple[tuple[float, str, float], ...]  # below [m] or [m/s], unit, factor
_LENGTHS: Numerical[_Units] = ((2e-3, "µm", 1e6), (2.0, "mm", 1e3), (np.inf, "m", 1.0))
_SPEEDS: Numerical[_Units] = ((2.0, "mm/s", 1e3), (np.inf, "m/s", 1.0))
_COLOURS, _NOWHERE = "RdBu_r", "0.93"
_MOST: Numerical[float] = 95.0  # percentile of a map that has the deepest colour: single bins may be far off
_MIDDLE: Numerical[float] = 0.15  # of a decade, on either side of rest


def pair(before: Sequence[Data], after: Sequence[Data]) -> tuple[Data, Data] | None:
    """Return the force before and after at the place where most of it was a function of motion.

    Bodies that move together share a residual; but only where the force is that is missing the same motion
    always finds the same force. None without any place.
    """
    left = {one["place"]: one for one in after}
    both = [(one, left[one["place"]]) for one in before if one["place"] in left]
    return max(both, key=lambda one: explained_level(one[0]), default=None)


def explained_level(one: Data) -> tuple[float, float]:
    """Mean square over noise of what the map at a place explains, and of all of the force there."""
    level, share = (float(one.get(key) or 0.0) for key in ("level", "explained"))
    return level * share, level


def scale_of(*maps: Data) -> float:
    """Return the force [N] that has the deepest colour in all of some maps."""
    values = np.abs(np.concatenate([_values(one).ravel() for one in maps]))
    known = values[np.isfinite(values)]
    return float(np.percentile(known, _MOST)) if known.size and known.any() else 1.0


@dataclass(frozen=True)
class Units:
    """Names of the axes of motion with their units, and the factors from SI to these."""

    displacement: str
    velocity: str
    factors: tuple[float, float]


def units_of(*maps: Data) -> Units:
    """Return units in which the motion of some maps makes short numbers."""
    (length, by_length), (speed, by_speed) = (
        next((unit, factor) for below, unit, factor in known if largest < below)
        for key, known in (("displacement_m", _LENGTHS), ("velocity_m_per_s", _SPEEDS))
        for largest in [max(_largest(one[key]) for one in maps)]
    )
    return Units(f"Displacement [{length}]", f"Velocity [{speed}]", (by_length, by_speed))


def _largest(values: Sequence[float | None]) -> float:
    return float(np.nanmax(np.abs(np.asarray(values, dtype=np.float64)), initial=0.0))


def draw_map(ax: Axes, one: Data, limit: float, units: Units) -> QuadMesh:
    """Draw the mean force over displacement and velocity, red where it pulls back; grey: no motion.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    one : mapping
        Edges ``displacement_m`` [m], ``velocity_m_per_s`` [m/s] and ``force_n`` [N], shape
        (velocities, displacements).
    limit : float
        Force of the deepest colour [N].
    units : Units
        Of the axes.

    Returns
    -------
    QuadMesh
        For a colour bar.
    """
    keys = ("displacement_m", "velocity_m_per_s")
    x, v = (factor * np.asarray(one[key]) for key, factor in zip(keys, units.factors, strict=True))
    # as an image: hundreds of cells would be most of a page's bytes, and show seams
    mesh = ax.pcolormesh(x, v, _values(one), cmap=_COLOURS, vmin=-limit, vmax=limit, rasterized=True)
    ax.set_facecolor(_NOWHERE)
    for axis, edges, scale in ((ax.xaxis, x, ax.set_xscale), (ax.yaxis, v, ax.set_yscale)):
        middle = float(np.abs(edges).min())
        scale("symlog", linthresh=middle, linscale=_MIDDLE)
        ticks = _ticks(middle, float(edges.max()))
        # along the width the zero between two labels would touch both
        shown = [f"{t:g}".replace("-", "−") if t or axis is ax.yaxis or len(ticks) < 5 else "" for t in ticks]
        axis.set_ticks(ticks, shown)
        axis.set_ticks([], minor=True)
    return mesh


def draw_loop(ax: Axes, one: Data, colour: str, label: str, units: Units) -> None:
    """Draw the force over displacement in the first cycles of the record with the largest motion.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    one : mapping
        Its ``loop`` has ``displacement_m`` [m] and ``force_n`` [N].
    colour, label : str
        Of the line.
    units : Units
        Of the axes.
    """
    x, force = (np.asarray(one["loop"][key], dtype=float) for key in ("displacement_m", "force_n"))
    ax.plot(units.factors[0] * x, force, color=colour, lw=0.8, label=label)


def _ticks(middle: float, largest: float) -> list[float]:
    """Zero and powers of ten beyond the first bins on either side, four at most."""
    powers = [10.0**n for n in range(-12, 13) if 1.5 * middle <= 10.0**n <= largest][-2:]
    return [*(-p for p in reversed(powers)), 0.0, *powers]


def _values(one: Data) -> FloatArray:
    return np.array(one["force_n"], dtype=np.float64)
