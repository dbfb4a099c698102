"""File layouts of a record: one variable per channel in `.h5` and `.mat`, one column per channel in `.csv`.

A reader yields each channel's name with a function that reads it: one bad channel does not hide the others.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from rom.campaign.channels import Channel, FloatArray
from rom.campaign.matlab_arrays import level_of, variables

Precision: TypeAlias = Literal["float64", "float32"]
Read: TypeAlias = Callable[[], tuple[Any, Any]]  # samples and rate_hz (None: not stated), as in the file
Reader: TypeAlias = Callable[[Path], Iterator[tuple[str, Read]]]

_FILTERS = ("gzip", "lzf", "shuffle", "fletcher32")
_LARGEST_RATIO = 1100  # gzip packs 1032 bytes into one at most
_CHECKSUM_BYTES = 4
STEP_TOLERANCE = 0.25  # of a sample: jitter of a printed time column; a lost sample is a whole one


class LayoutError(ValueError):
    """A file whose layout as a whole is not what it must be; the message names the key."""


def _read_h5(path: Path) -> Iterator[tuple[str, Read]]:
    import h5py  # slow to load, and not needed to simulate

    with h5py.File(path, "r") as file:
        for name in file:
            yield _in_text(name), partial(_h5_samples, file, name)


def _in_text(name: str | bytes) -> str:
    """A name of HDF5, which comes as bytes where it is no text."""
    return name if isinstance(name, str) else name.decode("utf-8", "backslashreplace")


def _h5_samples(file: Any, name: str) -> tuple[Any, Any]:
    """Read one data set, which must lie in this very file: a link could leave the campaign."""
    import h5py

    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        raise ValueError("found a link to other data, expected a data set in this file")
    item = file[name]
    if not isinstance(item, h5py.Dataset):
        raise ValueError("found a group, expected a data set of samples")
    if item.external is not None or item.is_virtual:
        raise ValueError("found samples stored in another file, expected them in this one")
    if item.dtype.kind == "V" and set(item.dtype.names or ()) in ({"real", "imag"}, {"r", "i"}):
        raise ValueError("found complex numbers, expected real numbers")
    if item.dtype.kind == "O":
        raise ValueError("found text or references, expected real numbers")
    if item.shape is None or "MATLAB_empty" in item.attrs:
        raise ValueError("found no samples, expected a signal")
    _require_stored(item)
    return item[()], item.attrs.get("rate_hz")


def _require_stored(item: Any) -> None:
    """Refuse what damage can make of a data set: more samples than its bytes can hold, filters that crash.

    HDF5 makes up samples that were never stored, and its decoders trust what they are given: that of
    scale-offset, and Fletcher's checksum where a chunk is shorter than the checksum, end the whole process.
    """
    filters = _filters(item)
    if unknown := [name for name in filters if name not in _FILTERS]:
        raise ValueError(f"found the filter {unknown[0]}, expected none or {', '.join(_FILTERS)}")
    stored = item.id.get_storage_size()
    if item.nbytes > stored * (_LARGEST_RATIO if filters else 1):
        raise ValueError(f"found {stored} bytes stored for {item.size} samples, expected more: it is damaged")
    if "fletcher32" in filters:
        chunks = (item.id.get_chunk_info(place).size for place in range(item.id.get_num_chunks()))
        if min(chunks, default=0) <= _CHECKSUM_BYTES:
            raise ValueError("found a chunk without samples, expected a checksum and samples: it is damaged")


def _filters(item: Any) -> tuple[str, ...]:
    import h5py

    names = {h5py.h5z.FILTER_DEFLATE: "gzip", h5py.h5z.FILTER_SHUFFLE: "shuffle"}
    names |= {h5py.h5z.FILTER_FLETCHER32: "fletcher32", h5py.h5z.FILTER_LZF: "lzf"}
    used = item.id.get_create_plist()
    codes = [used.get_filter(place)[0] for place in range(used.get_nfilters())]
    return tuple(names.get(code, f"number {code}") for code in codes)


def _read_mat(path: Path) -> Iterator[tuple[str, Read]]:
    import h5py

    if h5py.is_hdf5(path):
        return _read_mat_hdf5(path)
    return _read_mat_level_5(path) if level_of(path) == 5 else _read_mat_level_4(path)


def _read_mat_hdf5(path: Path) -> Iterator[tuple[str, Read]]:
    import h5py

    def read(name: str) -> tuple[Any, Any]:
        samples, rate = _h5_samples(file, name)
        if f"rate_hz_{name}" in file:
            rate, _ = _h5_samples(file, f"rate_hz_{name}")
        kind = np.asarray(file[name].attrs.get("MATLAB_class", "double")).astype(str).item()
        if kind in ("char", "logical", "cell", "struct"):
            raise ValueError(f"found a MATLAB {kind} variable, expected real numbers")
        return samples, rate

    with h5py.File(path, "r") as file:
        names = {_in_text(name): name for name in file}
        for name in _mat_channels(names):
            yield name, partial(read, names[name])


def _read_mat_level_5(path: Path) -> Iterator[tuple[str, Read]]:
    found = list(variables(path))
    if repeated := [name for name, count in Counter(one.name for one in found).items() if count > 1]:
        raise LayoutError(f"{repeated[0]}: found this variable more than once, expected it once")
    by_name = {one.name: one for one in found}

    def read(name: str) -> tuple[Any, Any]:
        one, rate = by_name[name], by_name.get(f"rate_hz_{name}")
        if one.samples is None:
            raise ValueError(f"found a MATLAB {one.kind} variable, expected real numbers")
        return one.samples, None if rate is None else "text" if rate.samples is None else rate.samples

    for name in _mat_channels(by_name):
        yield name, partial(read, name)


def _read_mat_level_4(path: Path) -> Iterator[tuple[str, Read]]:
    from scipy.io import loadmat

    found = loadmat(str(path), appendmat=False)
    for name in _mat_channels(found):
        yield name, partial(lambda name: (found[name], found.get(f"rate_hz_{name}")), name)


def _mat_channels(names: Collection[str]) -> list[str]:
    """Variables that are channels: not MATLAB's own tables, and not the rate of another variable."""
    own = [name for name in names if not name.startswith(("#", "__"))]
    return [name for name in own if name.removeprefix("rate_hz_") == name or name[8:] not in own]


def _read_csv(path: Path) -> Iterator[tuple[str, Read]]:
    import pandas as pd  # slow to load, and only .csv needs it

    with path.open(encoding="utf-8-sig", newline="") as file:
        header = [cell.strip() for cell in next(csv.reader(file), [])]
    if header[:1] != ["time_s"]:
        raise LayoutError(f'header: found "{", ".join(header)[:60]}", expected "time_s, <channel>, ..."')
    if repeated := [name for name, count in Counter(header).items() if count > 1]:
        raise LayoutError(f"{repeated[0]}: found this column more than once, expected it once")
    table = pd.read_csv(  # in one piece: else a word far down makes the library warn beside the fault
        path, header=None, skiprows=1, skipinitialspace=True, encoding="utf-8-sig", low_memory=False
    )
    if table.shape[1] != len(header):
        raise LayoutError(
            f"file: found {table.shape[1]} cells a row, expected {len(header)} as in the header"
        )
    try:
        time = _csv_time(_numbers(table[0]))
        if (
            not table.iloc[:, 1:].isna().any().all()
        ):  # a channel with a cell in every row: time itself must be even
            _require_even(time)
    except ValueError as fault:
        raise LayoutError(f"time_s: {fault}") from None
    for index, name in enumerate(header[1:], start=1):
        yield name, partial(_csv_column, time, table[index])


def _numbers(column: Any) -> FloatArray:
    import pandas as pd

    if column.dtype.kind in "iuf":
        return np.asarray(column, dtype=np.float64)
    numbers = pd.to_numeric(column, errors="coerce")
    text = column[numbers.isna() & column.notna()]
    if len(text):
        raise ValueError(f'found "{text.iloc[0]}" in data row {text.index[0] + 1}, expected a number')
    return np.asarray(numbers, dtype=np.float64)


def _csv_time(time: FloatArray) -> FloatArray:
    """Return the time column [s] if it rises in even steps."""
    if len(time) < 2:
        raise ValueError(f"found {len(time)} rows, expected at least 2")
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise ValueError(f"found no finite time in data row {row + 1}, expected rising numbers")
    steps = np.diff(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0))
        raise ValueError(
            f"found {time[row + 1]:.9g} after {time[row]:.9g} (data row {row + 2}), expected time to rise"
        )
    return time


def _require_even(time: FloatArray) -> None:
    """Refuse times that are off an even grid by more than rounded digits explain."""
    steps = np.diff(time)
    step = (time[-1] - time[0]) / (len(time) - 1)
    uneven = np.abs(steps - step) > STEP_TOLERANCE * step
    if uneven.any():
        row = int(np.argmax(uneven))
        raise ValueError(
            f"found a step of {steps[row]:.6g} s at {time[row]:.9g} s, "
            f"expected even steps of {np.median(steps):.6g} s"
        )
    drift = np.abs(time - (time[0] + step * np.arange(len(time))))
    if drift.max() > 2 * STEP_TOLERANCE * step:
        raise ValueError(f"found times up to {drift.max():.3g} s off an even grid, expected even steps")


def _csv_column(time: FloatArray, column: Any) -> tuple[FloatArray, float]:
    """Return the filled cells of a column and their rate [Hz]; a slower channel fills fewer cells."""
    cells = _numbers(column)
    filled = ~np.isnan(cells)
    own_time = time[filled]
    if len(own_time) < 2:
        raise ValueError(f"found {len(own_time)} filled cells, expected a signal")
    try:
        _require_even(own_time)
    except ValueError as fault:
        raise ValueError(f"cells are empty or NaN: {fault}") from None
    step = float(own_time[-1] - own_time[0]) / (len(own_time) - 1)
    if own_time[0] - time[0] >= step:
        raise ValueError(f"found the first number at {own_time[0]:.6g} s, expected it at {time[0]:.6g} s")
    return cells[filled], 1 / step


READERS: dict[str, Reader] = {
    ".h5": _read_h5,
    ".mat": _read_mat,
    ".csv": _read_csv,
}


def _write_h5(path: Path, channels: Mapping[str, Channel], precision: Precision) -> None:
    """Contiguous and uncompressed: measured noise hardly shrinks, and reading is ten times as fast."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, channel in channels.items():
            file.create_dataset(name, data=channel.samples.astype(precision)).attrs["rate_hz"] = (
                channel.rate_hz
            )


def _write_mat(path: Path, channels: Mapping[str, Channel], precision: Precision) -> None:
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for name, channel in channels.items():
        variables |= {name: channel.samples.astype(precision), f"rate_hz_{name}": channel.rate_hz}
    savemat(str(path), variables, appendmat=False, oned_as="column")


def _write_csv(path: Path, channels: Mapping[str, Channel], precision: Precision) -> None:
    import pandas as pd

    fastest = max(channels.values(), key=lambda channel: (channel.rate_hz, len(channel.samples)))
    rows = max(len(fastest.samples), 1)
    columns: dict[str, npt.NDArray[Any]] = {"time_s": np.arange(rows) / fastest.rate_hz}
    for name, channel in channels.items():
        step = round(fastest.rate_hz / channel.rate_hz)
        if abs(step * channel.rate_hz - fastest.rate_hz) > 1e-9 * fastest.rate_hz:
            raise ValueError(
                f"{name}: found {channel.rate_hz:g} Hz, "
                f"expected a whole fraction of {fastest.rate_hz:g} Hz in a .csv"
            )
        column = np.full(rows, np.nan, dtype=precision)
        column[: len(channel.samples) * step : step] = channel.samples
        columns[name] = column
    pd.DataFrame(columns).to_csv(path, index=False)


WRITERS: dict[str, Callable[[Path, Mapping[str, Channel], Precision], None]] = {
    ".h5": _write_h5,
    ".mat": _write_mat,
    ".csv": _write_csv,
}
