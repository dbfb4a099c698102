"""Bolts that were watched at rest: what of their tension is slow, and what is noise."""

from __future__ import annotations

from dataclasses import dataclass

from rom.criteria.number import Group, number

_TRIED = "clean synthetic campaigns, 1 Hz to 1 kHz, noise white, filtered, flicker, quantised: "


@dataclass(frozen=True)
class AtRest(Group):
    """Bolts that were watched at rest: what of their tension is slow, and what is noise."""

    slow_lines: int = number(
        16, "1", "first lines of a record, half-waves over its length, that tell of effects",
        _TRIED + "32 leave noise filtered at the 20th line unexplained in 20 of 20, 16 in 3 of 20",
    )  # fmt: skip
    noise_span: int = number(
        16, "1", "times as many lines, from those on, that tell the gauge's noise",
        _TRIED + "no effect is named in any",
    )  # fmt: skip
    lines_of_record: int = number(8, "1", "lines of a short record for each slow one")
    outlier: float = number(
        16.0, "1", "power of a line over the noise, above which it is a disturbance and no noise",
        "normal noise is above it in one line of 16,000",
    )  # fmt: skip
    shortest_time: float = number(0.1, "1", "shortest time constant in intervals between samples")
    longest_time: float = number(
        10.0, "1", "longest time constant in lengths of the longest record",
        "slower ones are a straight line in any record",
    )  # fmt: skip
    times: int = number(9, "1", "time constants between these that are tried")
