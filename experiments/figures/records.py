"""Raw channels of records, a figure for each kind of test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.figures.style import FloatArray, panels, styled
from rom.campaign.campaign import Record
from rom.campaign.channels import Channel

_POINTS = 1500  # of a trace as drawn: the extremes of each stretch
_UNITS = dict.fromkeys(("force", "normal", "tension"), "N") | {
    "acceleration": "m/s²", "velocity": "m/s", "displacement": "m"
}  # fmt: skip


@styled
def record_figure(records: Sequence[Record]) -> Figure:
    """Draw every channel of some records of one kind, a panel for each channel name."""
    names = list(dict.fromkeys(name for record in records for name in record.channels))
    figure, axes = panels(len(names), 1, 16.0 + 24.0 * len(names), sharex=True)
    for name, panel in zip(names, axes[:, 0], strict=True):
        for record in records:
            if name in record.channels:
                panel.plot(*envelope(record.channels[name]), linewidth=0.5, alpha=0.7)
        unit = _UNITS.get(name.partition("_")[0], "")
        panel.set_title(name + (f" [{unit}]" if unit else ""))
    axes[-1, 0].set_xlabel("Time [s]")
    return figure


def envelope(channel: Channel) -> tuple[FloatArray, FloatArray]:
    """Return times and samples as drawn: lowest and highest of each stretch of a long signal."""
    samples, time = channel.samples, channel.time
    stretch = len(samples) // (_POINTS // 2)
    if stretch < 2:
        return time, samples
    kept = len(samples) // stretch * stretch
    parts = samples[:kept].reshape(-1, stretch)
    both = np.stack([parts.min(axis=1), parts.max(axis=1)], axis=1).ravel()
    return np.repeat(time[:kept:stretch], 2), both


def figures_by_test(records: Mapping[str, Sequence[Record]]) -> dict[str, Figure]:
    """Return a figure for each kind of test, by name."""
    return {f"check-{test}": record_figure(own) for test, own in records.items()}
