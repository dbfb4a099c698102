"""Records: the measured channels of one test, read from and written to `.h5`, `.mat` and `.csv` files."""

from __future__ import annotations

import os
import secrets
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rom.campaign.channels import LARGEST, SMALLEST, Channel, FloatArray, default_rate, one_of
from rom.campaign.formats import READERS, WRITERS, LayoutError, Precision, Reader

__all__ = [
    "Channel",
    "FloatArray",
    "Inspection",
    "Precision",
    "RecordError",
    "in_a_line",
    "inspect_channels",
    "read_channels",
    "replacing",
    "write_channels",
]

RATE_TOLERANCE = 1e-4  # relative: rates that differ by less are one rate


class RecordError(ValueError):
    """A record that cannot be used; `faults` holds one line for each fault, which names the channel."""

    def __init__(self, path: Path, faults: tuple[str, ...]) -> None:
        super().__init__("\n".join(f"{path}: {fault}" for fault in faults))
        self.path = path
        self.faults = faults

    def __reduce__(self) -> tuple[type[RecordError], tuple[Path, tuple[str, ...]]]:
        return type(self), (self.path, self.faults)


def read_channels(path: Path | str, motion_rate_hz: float, tension_rate_hz: float) -> dict[str, Channel]:
    """Read every channel of a record file.

    Parameters
    ----------
    path
        File ending in `.h5`, `.mat` (v4 to v7.3) or `.csv`.
    motion_rate_hz, tension_rate_hz
        Rates [Hz] of channels whose file does not state one: force and motion, strain and tension.

    Raises
    ------
    RecordError
        If the file cannot be read, or a channel is not a finite, real, evenly sampled signal of equal length.
    """
    found = inspect_channels(Path(path), motion_rate_hz, tension_rate_hz)
    if found.faults:
        raise RecordError(Path(path), found.faults)
    return dict(found.channels)


@dataclass(frozen=True, eq=False)
class Inspection:
    """A look at a record: its sound channels, a line for each fault, and the names found, sound or not.

    `complete` is False where an unreadable file or an unknown name leaves open what the record holds.
    """

    channels: Mapping[str, Channel]
    faults: tuple[str, ...]
    names: frozenset[str]
    complete: bool


def inspect_channels(
    path: Path, motion_rate_hz: float, tension_rate_hz: float, known: Collection[str] | None = None
) -> Inspection:
    """Read what can be read of a record.

    A channel whose name is not among `known` is a fault and is not read; with None every name will do.

    Parameters
    ----------
    path : Path
        The file.
    motion_rate_hz : float
        Rate of motions and forces [Hz].
    tension_rate_hz : float
        Rate of the bolt's channel [Hz].
    known : collection of str
        Names of channels that may be there; None for any.

    Returns
    -------
    Inspection
        Channels and faults.
    """
    channels: dict[str, Channel] = {}
    faults: list[str] = []
    names: set[str] = set()
    complete = True
    try:
        with np.errstate(all="ignore"):  # of casts: what is no number is told as such
            for name, read in _reader(path)(path):
                if known is not None and name not in known:
                    faults.append(f"{name}: found an unknown channel, expected {one_of(name, known)}")
                    complete = False
                    continue
                names.add(name)
                try:
                    default = default_rate(name, motion_rate_hz, tension_rate_hz)
                    samples, rate = read()
                    channels[name] = _channel(name, samples, rate, default)
                except ValueError as fault:
                    faults.append(f"{name}: {fault}")
    except Exception as cause:  # a parser of foreign bytes may fail in any way; each means an unreadable file
        faults.append(_file_fault(path, cause))
        complete = False
    if complete and not names:
        faults.append("file: found no channel, expected at least one")
        complete = False
    return Inspection(channels, (*faults, *_length_faults(channels)), frozenset(names), complete)


def _reader(path: Path) -> Reader:
    if path.suffix.lower() not in READERS:
        raise LayoutError(f'file: found the ending "{path.suffix}", expected .h5, .mat or .csv')
    if path.exists() and not path.is_file():
        raise LayoutError("file: found a folder or device, expected a file")
    return READERS[path.suffix.lower()]


def _file_fault(path: Path, cause: Exception) -> str:
    if isinstance(cause, LayoutError):
        return str(cause)
    if isinstance(cause, FileNotFoundError):
        return "file: found no such file, expected a record"
    return f"file: found it unreadable, expected a sound {path.suffix} file ({in_a_line(cause)})"


def in_a_line(cause: Exception) -> str:
    """Return what an exception says, in a line; of the system's own what it means."""
    said = os.strerror(cause.errno) if isinstance(cause, OSError) and cause.errno else str(cause)
    return " ".join(said.split())[:200] or type(cause).__name__


def _channel(name: str, values: Any, rate: Any, default_rate_hz: float) -> Channel:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        what = {"c": "complex numbers", "U": "text", "S": "text", "b": "true/false values"}
        raise ValueError(f"found {what.get(array.dtype.kind, array.dtype)}, expected real numbers")
    if array.ndim != 1:
        if array.ndim > 2 or (array.size and max(array.shape, default=0) != array.size) or array.ndim == 0:
            raise ValueError(f"found an array of shape {array.shape}, expected one column of samples")
        array = array.ravel()
    if not array.size:
        raise ValueError("found no samples, expected a signal")
    rate_hz = default_rate_hz if rate is None else _rate(rate, default_rate_hz, array.size)
    samples = np.ascontiguousarray(array, dtype=np.float64)
    _require_usable(samples, rate_hz)
    return Channel(name, samples, rate_hz)


def _rate(value: Any, default_rate_hz: float, samples: int) -> float:
    """Return the stated rate; the campaign's own where the two agree to half a sample over the record."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.size != 1:
        raise ValueError(f"rate_hz: found {value!r}, expected one number above 0")
    rate_hz = float(array.reshape(()))
    if not SMALLEST <= rate_hz <= LARGEST:
        expected = f"a number above 0, from {SMALLEST:g} to {LARGEST:g}"
        raise ValueError(f"rate_hz: found {rate_hz:g}, expected {expected}")
    return default_rate_hz if abs(default_rate_hz / rate_hz - 1) * samples < 0.5 else rate_hz


def _require_usable(samples: FloatArray, rate_hz: float) -> None:
    largest = max(-float(samples.min()), float(samples.max()))
    if largest == 0.0 or SMALLEST <= largest <= LARGEST:  # not of NaN or infinity
        return
    bad = np.flatnonzero(~np.isfinite(samples))
    if not bad.size:
        raise ValueError(
            f"found samples of {largest:.3g} at most, expected a largest one from {SMALLEST:g} to {LARGEST:g}"
        )
    first = int(bad[0])
    what, others = samples[first], f" and {bad.size - 1} more" if bad.size > 1 else ""
    raise ValueError(
        f"found {what} at sample {first} ({first / rate_hz:.6g} s){others}, expected finite numbers"
    )


def _same_rate(first_hz: float, second_hz: float) -> bool:
    return abs(first_hz - second_hz) <= RATE_TOLERANCE * max(first_hz, second_hz)


def _length_faults(channels: Mapping[str, Channel]) -> Iterator[str]:
    """Compare each channel with the length that most of them share (the longest, where they are at odds)."""
    if not channels:
        return
    shared = Counter((len(channel.samples), channel.rate_hz) for channel in channels.values())
    length, rate_hz = max(shared, key=lambda key: (shared[key], key[0] / key[1]))
    for channel in channels.values():
        found = len(channel.samples)
        if _same_rate(channel.rate_hz, rate_hz):
            agree = found == length
        else:
            slow = min(channel.rate_hz, rate_hz)
            agree = abs(channel.duration_s - length / rate_hz) <= (1 + 1e-6) / slow
        if not agree:
            expected = length * channel.rate_hz / rate_hz
            took = f"{channel.duration_s:.6g} s at {channel.rate_hz:g} Hz"
            others = f"{length / rate_hz:.6g} s as in the other channels"
            yield f"{channel.name}: found {found} samples ({took}), expected {expected:.0f} ({others})"


def write_channels(
    path: Path | str, channels: Mapping[str, Channel], precision: Precision = "float64"
) -> None:
    """Write channels to an `.h5`, `.mat` (v5) or `.csv` file; it appears whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    channels : mapping of str to Channel
        Channels by name.
    precision : {"float64", "float32"}
        Precision of the samples in binary files.

    Raises
    ------
    ValueError
        If the ending is another, or a `.csv` is asked to hold rates that do not divide the highest.
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise ValueError(f'{path}: found the ending "{path.suffix}", expected .h5, .mat or .csv')
    with replacing(path) as temporary:
        writer(temporary, channels, precision)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`, which takes its place if all goes well and vanishes otherwise."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
