"""Files of catman, the software of HBK's QuantumX amplifiers: binary through apread, or text."""

from __future__ import annotations

import io
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from experiments.datasets import tables
from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal

ENDINGS = (".bin", *tables.ENDINGS)


def read(path: Path) -> list[Signal]:
    """Return the signals of a catman file, binary or its ASCII export.

    The step of time in a channel's header is in ms; where there is a time channel as well, it goes before.

    Raises
    ------
    SourceError
        If a channel is shorter than its header says, or apread is not installed.
    """
    if path.suffix.lower() in tables.ENDINGS:
        return tables.read(path)
    signals = []
    for channel in _channels(path):
        if len(channel.data) != channel.length:
            raise SourceError(
                f"{path.name}: {channel.Name}: found {len(channel.data)} samples, "
                f"expected {channel.length} as in its header"
            )
        step_ms = float(channel.extHeader.get("dt", 0.0))
        rate_hz = 1e3 / step_ms if step_ms > 0 else None
        signals.append(Signal(channel.Name.strip(), channel.data, channel.unit.strip("\0 "), rate_hz))
    return signals


def _channels(path: Path) -> list[Any]:
    apread = optional("apread", "catman")

    class Reader(apread.APReader):  # type: ignore[misc, name-defined]
        """Reads and pairs nothing: the package would ask at the keyboard which channel is the time."""

        def connect(self) -> None:
            """Leave the channels as they are."""

    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(io.StringIO()):  # to the latter it draws a bar of progress
        reader = Reader(str(path))
    if text := said.getvalue().strip():  # it assumes a precision where a header is none that it knows
        raise SourceError(
            f"{path.name}: found a header that apread does not know, expected one it does ({text})"
        )
    if empty := reader.numChannels - len(reader.Channels):
        warnings.warn(f"{empty} channels are empty or broken", stacklevel=2)
    return list(reader.Channels)
