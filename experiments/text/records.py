"""What a campaign's records are, in words: how many of which kind, and the range of each channel."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from experiments.text.suspicions import lines as suspicion_lines
from rom.campaign.channels import BOLT_CHANNELS

Data = Mapping[str, Any]

_UNITS = {"acceleration": "m/s2", "velocity": "m/s", "displacement": "m", "force": "N", "tension": "N"}
_EXPONENT = 6  # from this power of ten on numbers are shown with one


def counted(tests: Iterable[tuple[str, bool]]) -> str:
    """Return how many records there are of each kind of test, and how many are held out."""
    every = list(tests)
    kinds = ", ".join(f"{count} {test}" for test, count in Counter(test for test, _ in every).items())
    held = sum(hold_out for _, hold_out in every)
    noun = "record" if len(every) == 1 else "records"
    return f"{len(every)} {noun} ({kinds}), {held or 'none'} held out"


def checked(found: Data) -> Iterator[str]:
    """Yield lines on what was read: the records, each with its channels and doubts, and what is suspected."""
    rows, suspected = found["records"], suspicion_lines(found)
    yield f"{found['campaign']}: {counted((row['test'], row['hold_out']) for row in rows)}"
    for row in rows:
        about = [row["test"], f"{row['duration_s']:.4g} s"]
        about += [f"{row['preload_n']:g} N"] if row["preload_n"] is not None else []
        about += ["held out"] if row["hold_out"] else []
        channels = ", ".join(_channel(name, channel) for name, channel in row["channels"].items())
        yield f"{row['file']} ({', '.join(about)}): {channels}{_calibrated(row.get('calibrated_n'))}"
        yield from (f"  doubtful: {doubt}" for doubt in row["doubts"])
    yield from (f"suspicion: {text}" for text in suspected)
    if not suspected and not any(row["doubts"] for row in rows):
        yield "no record is doubtful, and none contradicts campaign.toml"


def _channel(name: str, channel: Data) -> str:
    low, high = _range(channel["minimum"], channel["maximum"])
    unit = _unit(name)
    return f"{name} {low} to {high}{unit and ' '}{unit} at {channel['rate_hz']:g} Hz"


def _calibrated(tension: Sequence[float] | None) -> str:
    """Return the tension that a strain stands for."""
    return "" if tension is None else ", by its calibration {} to {} N".format(*_range(*tension))


def _range(low: float, high: float) -> tuple[str, str]:
    """Return both ends with at least three digits, and two of what lies between them."""
    size, span = max(abs(low), abs(high)), high - low
    whole = math.floor(math.log10(size)) if size > 0 else 0
    digits = max(3, whole + 1 if whole < _EXPONENT else 3)
    if span > 0:
        digits = min(max(digits, whole - math.floor(math.log10(span)) + 2), 12)
    return f"{low:.{digits}g}", f"{high:.{digits}g}"


def _unit(name: str) -> str:
    """Return the unit of a channel; the strain's is that of its calibration, which nobody states."""
    quantity = name if name in BOLT_CHANNELS else name.removeprefix("link_").removeprefix("normal_")
    return _UNITS.get(quantity.partition("_")[0], "")
