"""Views of a simulated response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rom import result_views
from rom.campaign.channels import FloatArray
from rom.model.assembly import Response

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


@result_views.summary.register(Response)
def _summary(response: Response) -> str:
    """Return status, length and what became of each tension."""
    lines = [f"{response.status}: {len(response.time)} samples to {response.time[-1]:.6g} s"]
    for name, values in _tensions(response).items():
        lines.append(f"  {name}: {values[0]:.5g} N at first, {values[-1]:.5g} N at last")
    return "\n".join(lines)


@result_views.frame.register(Response)
def _frame(response: Response) -> DataFrame:
    """Return displacement [m], velocity [m/s], acceleration [m/s2] and tension [N] over time [s]."""
    from pandas import DataFrame, Index

    columns = {
        f"{quantity}_{body}": values
        for quantity in ("displacement", "velocity", "acceleration")
        for body, values in getattr(response, quantity).items()
    }
    return DataFrame(columns | _tensions(response), index=Index(response.time, name="time_s"))


def _tensions(response: Response) -> dict[str, FloatArray]:
    if isinstance(response.tension, Mapping):
        return {f"tension_{link}": values for link, values in response.tension.items()}
    return {"tension": response.tension} if len(response.tension) else {}


@result_views.figure.register(Response)
def _figure(response: Response) -> Figure:
    """Draw displacements and tensions over time."""
    from matplotlib.figure import Figure

    tensions = _tensions(response)
    figure = Figure(figsize=(8, 2.5 * (1 + bool(tensions))), layout="constrained")
    axes = figure.subplots(1 + bool(tensions), 1, squeeze=False, sharex=True)[:, 0]
    for body, values in response.displacement.items():
        axes[0].plot(response.time, values, linewidth=0.8, label=body)
    axes[0].set_ylabel("displacement [m]")
    axes[0].legend(frameon=False)
    for label, values in tensions.items():
        axes[1].plot(response.time, values, linewidth=0.8, label=label)
        axes[1].set_ylabel("tension [N]")
    axes[-1].set_xlabel("time [s]")
    return figure
