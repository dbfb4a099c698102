"""TDMS files of LabVIEW and FlexLogger, through the package nptdms."""

from __future__ import annotations

import logging
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.rates import named_rate
from experiments.datasets.signals import Signal
from experiments.datasets.times import ABSOLUTE_S, SHOWN, factor_of, unstated

ENDINGS = (".tdms",)


def read(path: Path) -> list[Signal]:
    """Return the channels of numbers; one goes by "group/channel" where several groups hold its name.

    Raises
    ------
    SourceError
        If the file is cut short, a channel has a scale that nptdms does not apply, or it is not installed.
    """
    nptdms = optional("nptdms", "tdms")
    with _heard(nptdms) as said:
        file = nptdms.TdmsFile.read(str(path))
    if file.file_status.incomplete_final_segment:
        raise SourceError(f"{path.name}: found a last segment that is cut short, expected a whole file")
    for text in said:
        warnings.warn(text, stacklevel=2)
    channels = [channel for group in file.groups() for channel in group.channels() if len(channel)]
    shared = Counter(channel.name for channel in channels)
    signals = []
    for channel in channels:
        name = channel.name if shared[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
        with _heard(nptdms) as said:
            try:
                samples = channel[:]
            except (KeyError, TypeError, ValueError) as cause:  # a number of the scale is missing
                said.append(f"{cause}")
        if said:  # the numbers are those of the converter then
            raise SourceError(
                f"{path.name}: {name}: found a scale that nptdms does not apply ({said[0]}), expected one "
                "that it does: linear, polynomial, table, strain, thermometers; save scaled values"
            )
        above = {**file.properties, **file[channel.group_name].properties}
        signals.append(_signal(name, samples, channel.properties, above))
    return signals


@contextmanager
def _heard(nptdms: Any) -> Iterator[list[str]]:
    """Collect what the package logs as a warning; it would go to the terminal."""
    said: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    logger, console = logging.getLogger("nptdms"), nptdms.log.log_manager.console_handler
    level = console.level
    logger.addHandler(handler)
    console.setLevel(logging.CRITICAL)
    try:
        yield said
    finally:
        logger.removeHandler(handler)
        console.setLevel(level)


def _signal(name: str, samples: Any, known: Mapping[str, Any], above: Mapping[str, Any]) -> Signal:
    if samples.dtype.kind not in "iufMm":
        return Signal(name, np.empty(0), fault="found text or complex numbers, expected real numbers")
    unit = str(known.get("unit_string", "")).strip()
    told = known if "wf_increment" in known else {**above, **known}
    stated = str(told.get("wf_xunit_string", "")).strip()
    axis = stated or "s"
    if (factor := factor_of(axis)) is None and "wf_increment" in told:
        return Signal(name, np.empty(0), fault=f'found wf_xunit_string "{axis}", expected one of {SHOWN}')
    step = float(told.get("wf_increment", 0.0)) * (factor or 0.0)
    if step < 0:
        return Signal(name, np.empty(0), fault=f"found wf_increment {step:g}, expected one above 0")
    if step == 0:  # a property of one's own, such as SampleRate
        found = (named_rate(key, value) for key, value in {**above, **known}.items())
        rate_hz, readings = next(filter(None, found), (None, ()))
        return Signal(name, samples, unit, rate_hz, _start(known), readings)
    # a step of one is what LabVIEW writes for want of another
    readings = unstated(1 / step) if step == 1.0 or not stated else ()
    return Signal(name, samples, unit, 1 / step, _start(known), readings)


def _start(known: Mapping[str, Any]) -> float | None:
    """Return the start [s]: on the clock of the day where it is told, else after the trigger."""
    offset = known.get("wf_start_offset")
    if (moment := known.get("wf_start_time")) is not None:
        since = 1e-9 * float(np.datetime64(moment, "ns").astype(np.int64))
        if since >= ABSOLUTE_S:  # an empty one is in 1904
            return since + float(offset or 0.0)
    return None if offset is None else float(offset)
