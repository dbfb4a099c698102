"""Binary files of catman, the software of HBK's QuantumX amplifiers, through the package apread."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal

ENDINGS = (".bin",)


def read(path: Path) -> list[Signal]:
    """Return the signals of a catman file.

    The step of time in a channel's header is in ms; where there is a time channel as well, it goes before.

    Raises
    ------
    SourceError
        If a channel is shorter than its header says, or apread is not installed.
    """
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

    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # it prints as it goes
        return list(Reader(str(path)).Channels)
