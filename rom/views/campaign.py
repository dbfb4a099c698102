"""Views of a campaign."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rom import result_views
from rom.campaign.campaign import Campaign

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


@result_views.summary.register(Campaign)
def _summary(campaign: Campaign) -> str:
    """Return what a campaign holds: structure, records by kind, preloads."""
    settings = campaign.settings
    lines = [f"{settings.name}: {len(settings.record)} records of {', '.join(settings.body_names)}"]
    lines += [f"  {link.name}: {link.law}, between {' and '.join(link.between)}" for link in settings.link]
    for test, count in Counter(record.test for record in settings.record).items():
        records = campaign.select(test)
        held = sum(record.hold_out for record in records)
        preloads = [record.preload_n for record in records if record.preload_n is not None]
        span = f", preloads {min(preloads):.4g} to {max(preloads):.4g} N" if preloads else ""
        lines.append(f"  {test}: {count}, {held} of them held out{span}")
    return "\n".join(lines)


@result_views.frame.register(Campaign)
def _frame(campaign: Campaign) -> DataFrame:
    """Return a row for each record, by file."""
    from pandas import DataFrame

    rows = [record.model_dump() for record in campaign.settings.record]
    return DataFrame(rows).set_index("file")[["test", "bodies", "preload_n", "hold_out"]]


@result_views.figure.register(Campaign)
def _figure(campaign: Campaign) -> Figure:
    """Draw the nominal preload of every record over its kind of test; held-out records are hollow.

    Without any preload records are drawn in the order of the campaign.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3), layout="constrained")
    axes = figure.subplots()
    places = {r.file: r.preload_n for r in campaign.settings.record if r.preload_n is not None}
    if places:
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xlabel("nominal preload [N]")
    else:
        places = {r.file: float(number) for number, r in enumerate(campaign.settings.record, 1)}
        axes.set_xlabel("record, in the order of the campaign [1]")
    for hold_out, face in ((False, "C0"), (True, "none")):
        chosen = [r for r in campaign.select(hold_out=hold_out) if r.file in places]
        label = "held out" if hold_out else "training"
        axes.scatter(
            [places[r.file] for r in chosen], [r.test for r in chosen], facecolors=face, edgecolors="C0",
            label=label,
        )  # fmt: skip
    axes.legend(frameon=False)
    return figure
