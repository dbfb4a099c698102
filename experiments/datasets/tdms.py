"""TDMS files of LabVIEW and FlexLogger, through the package nptdms."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal

ENDINGS = (".tdms",)


def read(path: Path) -> list[Signal]:
    """Return the channels of numbers; one goes by "group/channel" where several groups hold its name.

    Raises
    ------
    SourceError
        If the file is cut short, or nptdms is not installed.
    """
    nptdms = optional("nptdms", "tdms")
    nptdms.log.log_manager.set_level(logging.ERROR)  # it would tell of what is refused here
    file = nptdms.TdmsFile.read(str(path))
    if file.file_status.incomplete_final_segment:
        raise SourceError(f"{path.name}: found a last segment that is cut short, expected a whole file")
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
