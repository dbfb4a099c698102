"""A closed loop in plain words, as a table and as a figure, all from the section of its result file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from discovery.loop.result import Closure
from discovery.views.closure_file import closure_section
from discovery.views.closure_plot import (
    FORCE_HEIGHT_MM,
    draw_force,
    draw_residual,
    has_maps,
    residual_height_mm,
    views,
)
from discovery.views.palette import INCH_PER_MM, WIDTH
from rom import result_views

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


@result_views.summary.register(Closure)
def summary(closure: Closure) -> str:
    """Return the result for people: what was missing, how one knows, what changed, what remains."""
    return "\n".join(closure_section(closure)["summary"].values())


@result_views.frame.register(Closure)
def frame(closure: Closure) -> DataFrame:
    """Return errors before and after every step, a row each."""
    from pandas import DataFrame

    rows = [
        {"model": step.added or "declared", "set": kind, **errors}
        for step in closure.steps
        for kind, errors in step.errors.items()
    ]
    return DataFrame(rows)


@result_views.figure.register(Closure)
def figure(closure: Closure) -> Figure:
    """Draw the residual along every view, before and after; below, where known, the force left unbalanced."""
    from matplotlib.figure import Figure

    data = closure_section(closure)
    parts = [(draw_residual, residual_height_mm(data))] if views(data) else []
    parts += [(draw_force, FORCE_HEIGHT_MM)] if has_maps(data) else []
    heights = [height * INCH_PER_MM for _, height in parts]
    made = Figure(figsize=(WIDTH, sum(heights) or 1.0), layout="constrained")
    if parts:
        below = made.subfigures(len(parts), 1, squeeze=False, height_ratios=heights)[:, 0]
        for (draw, _), part in zip(parts, below, strict=True):
            draw(part, data)
    return made
