"""TDMS files of LabVIEW and FlexLogger, through the package nptdms."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from experiments.datasets.collected import optional
from experiments.datasets.signals import Signal

ENDINGS = (".tdms",)


def read(path: Path) -> list[Signal]:
    """Return the channels of numbers; one goes by "group/channel" where several groups hold its name.

    Raises
    ------
    SourceError
        If nptdms is not installed.
    """
    file = optional("nptdms", "tdms").TdmsFile.read(str(path))
    channels = [channel for group in file.groups() for channel in group.channels() if len(channel)]
    shared = Counter(channel.name for channel in channels)
    signals = []
    for channel in channels:
        if channel.dtype.kind not in "iuf":
            continue
        name = channel.name if shared[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
        known = channel.properties
        step = float(known.get("wf_increment", 0.0))
        unit = str(known.get("unit_string", "")).strip()
        start = float(known.get("wf_start_offset", 0.0))
        signals.append(Signal(name, channel[:], unit, 1 / step if step > 0 else None, start))
    return signals
