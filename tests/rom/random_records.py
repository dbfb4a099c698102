"""Records spoilt at random: bytes, cells of a table, and what else than samples a file can hold."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from rom.campaign.record import write_channels
from tests.rom.random_settings import OUTSIDE
from tests.rom.sound_campaign import LOOSENING, sound_channels

H5_OPTIONS: dict[str, dict[str, Any]] = {
    "plain.h5": {},
    "chunked.h5": {"chunks": (50,), "maxshape": (None,)},
    "packed.h5": {"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": (100,)},
    "summed.h5": {"fletcher32": True, "chunks": (100,)},
    "lzf.h5": {"compression": "lzf", "chunks": (100,)},
}
CELLS = (
    "",
    "nan",
    "-inf",
    "1e999",
    "1,5",
    "abc",
    '"',
    '"1"',
    " 1 ",
    "0x10",
    "1_0",
    "\0",
    "é",
    "9" * 400,
    "=1",
)


class Forbidden:
    """An object whose unpickling leaves a trace."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return exec, ("raise SystemError('unpickled')",)


PICKLED = pickle.dumps(Forbidden())


@cache
def sound_records() -> dict[str, bytes]:
    """One loosening record in every layout, by file name."""
    import tempfile

    channels = sound_channels(LOOSENING)
    arrays = {name: channel.samples for name, channel in channels.items()}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, options in H5_OPTIONS.items():
            _write_h5(folder / name, arrays, **options)
        _write_h5(folder / "latest.h5", arrays, libver="latest")
        _write_h5(folder / "v73.mat", {k: v[None] for k, v in arrays.items()}, userblock_size=512)
        with (folder / "v73.mat").open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        savemat(folder / "v5.mat", arrays)
        savemat(folder / "v5packed.mat", arrays, do_compression=True)
        savemat(folder / "v4.mat", arrays, format="4")
        write_channels(folder / "table.csv", channels)
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _write_h5(path: Path, arrays: dict[str, Any], **options: Any) -> None:
    of_file = {key: options.pop(key) for key in ("libver", "userblock_size") if key in options}
    with h5py.File(path, "w", **of_file) as file:
        for name, samples in arrays.items():
            file.create_dataset(name, data=samples, **options)


def random_bytes(random: Random) -> tuple[str, bytes]:
    """A sound record with bytes changed, lost or cut off, more of them where its structure is told."""
    name = random.choice(sorted(sound_records()))
    data = bytearray(sound_records()[name])
    if random.random() < 0.15:
        start = random.randrange(len(data))
        del data[start : random.choice((len(data), start + 1, start + 8, start + 512))]
        return name, bytes(data)
    for _ in range(random.choice((1, 1, 2, 5, 40))):
        place = random.randrange(min(len(data), random.choice((3000, len(data)))))
        width = random.choice((1, 1, 2, 4, 8))
        largest = 256**width - 1
        value = random.choice((0, 1, largest, largest // 2, random.randrange(largest + 1)))
        if random.random() < 0.5:
            data[place] ^= 1 << random.randrange(8)
        else:
            data[place : place + width] = value.to_bytes(width, "little")
    return name, bytes(data)


def random_cells(random: Random) -> tuple[str, bytes]:
    """The sound table with cells, rows, separators or its encoding changed."""
    rows = [line.split(",") for line in sound_records()["table.csv"].decode().splitlines()]
    for _ in range(random.choice((1, 1, 2, 5))):
        row = min(random.choice((0, 1, random.randrange(len(rows)))), len(rows) - 1)
        match random.choice(("cell", "cell", "cell", "row", "again", "more", "fewer", "cut")):
            case "cell":
                rows[row][random.randrange(len(rows[row]))] = random.choice(CELLS)
            case "row":
                rows[row] = [random.choice(CELLS)]
            case "again":
                rows.insert(row, list(rows[row]))
            case "more":
                rows[row].append(random.choice(CELLS))
            case "fewer" if len(rows[row]) > 1:
                rows[row].pop()
            case _:
                del rows[row + 1 :]
    separator, ending = random.choice((",", ",", ",", ";", "\t")), random.choice(("\n", "\n", "\r\n", "\r"))
    text = ending.join(separator.join(row) for row in rows)
    encoding = random.choice(("utf-8", "utf-8", "utf-8", "utf-16", "latin-1"))
    return "table.csv", text.encode(encoding, "replace")


def random_content(random: Random) -> tuple[str, bytes]:
    """A record one of whose channels is something else than samples; a foreign file by a record's name."""
    kind = random.choice(("h5", "h5", "mat", "foreign"))
    if kind == "foreign":
        start = random.choice((b"", b"\0" * 600, b"PK\x03\x04", b"\x89HDF\r\n\x1a\n", b"time_s,strain\n"))
        return random.choice(("a.h5", "a.mat", "a.csv")), start + random.choice((b"", PICKLED, _npy()))
    arrays: dict[str, Any] = {name: c.samples for name, c in sound_channels(LOOSENING).items()}
    name = random.choice(sorted(arrays))
    if kind == "mat":
        arrays[random.choice((name, name, f"rate_hz_{name}"))] = random.choice(_mat_values())
        memory = io.BytesIO()
        savemat(memory, arrays, do_compression=random.random() < 0.5)
        return "a.mat", memory.getvalue()
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        for other, samples in arrays.items():
            if other != name:
                file[other] = samples
        random.choice(_H5_CONTENTS)(file, name)
    return random.choice(("a.h5", "a.mat")), memory.getvalue()


def _npy() -> bytes:
    memory = io.BytesIO()
    np.save(memory, np.array([Forbidden()], dtype=object), allow_pickle=True)
    return memory.getvalue()


def _mat_values() -> tuple[Any, ...]:
    from scipy.sparse import csc_array

    return (
        np.array([Forbidden, 1, "a"], dtype=object).astype(str).astype(object), {"a": {"b": 1.0}}, "text",
        True,
        np.ones((3, 3, 3)), np.zeros((0, 1)), 1e308 * np.ones(1200), np.ones(1200) * 1j, np.nan,
        csc_array(np.eye(4)), np.int64(7), np.arange(1200, dtype=np.uint8), np.array([]), -np.inf,
        np.frombuffer(PICKLED, dtype=np.uint8),
    )  # fmt: skip


def _rated(rate: Any) -> Callable[[h5py.File, str], None]:
    def write(file: h5py.File, name: str) -> None:
        file[name] = np.ones(1200)
        file[name].attrs["rate_hz"] = rate

    return write


def _holding(value: Any, **options: Any) -> Callable[[h5py.File, str], None]:
    return lambda file, name: file.create_dataset(name, data=value, **options)


def _shaped(shape: tuple[int, ...], **options: Any) -> Callable[[h5py.File, str], None]:
    return lambda file, name: file.create_dataset(name, shape=shape, dtype="f8", **options)


def _opaque(file: h5py.File, name: str) -> None:
    file.create_dataset(name, data=np.void(PICKLED))


def _external(file: h5py.File, name: str) -> None:
    file[name] = h5py.ExternalLink(f"../{OUTSIDE}", "strain")


def _raw_outside(file: h5py.File, name: str) -> None:
    file.create_dataset(name, shape=(100,), dtype="u1", external=[("/etc/passwd", 0, 100)])


def _virtual(file: h5py.File, name: str) -> None:
    layout = h5py.VirtualLayout(shape=(300,), dtype="f8")
    layout[:] = h5py.VirtualSource(f"../{OUTSIDE}", "strain", shape=(300,))
    file.create_virtual_dataset(name, layout)


def _own_link(file: h5py.File, name: str) -> None:
    file[name] = h5py.SoftLink(f"/{name}")


def _own_group(file: h5py.File, name: str) -> None:
    file.create_group(name)[name] = file


_H5_CONTENTS: tuple[Callable[[h5py.File, str], Any], ...] = (
    _external, _raw_outside, _virtual, _own_link, _own_group, _opaque,
    _holding(np.array([PICKLED] * 3, "S")), _holding(["text"] * 3),
    _holding([b"a"], dtype=h5py.string_dtype()),
    _holding(np.ones(1200, dtype="f2")), _holding(np.ones(1200, dtype=">f4")), _holding(3.0), _holding(True),
    _holding(np.ones(3, dtype=[("a", "f8"), ("b", "S3")])), _holding(np.ones((40, 30))), _holding("text"),
    _holding(np.arange(1200), dtype=h5py.enum_dtype({"a": 0, "b": 1})), _holding(h5py.Empty("f8")),
    _holding(np.ones(1200), scaleoffset=2, chunks=(100,)), _holding(np.full(1200, 1e308)),
    _shaped((0,)), _shaped((10**12,)), _shaped((10**12,), chunks=(1000,), compression="gzip"),
    _shaped((10**6, 10**6), chunks=(10, 10), fillvalue=1.0), _shaped((1200,)),
    _rated(5e-324), _rated(1e308), _rated([400.0, 1.0]), _rated("400"), _rated(np.bytes_(PICKLED)),
    _rated(np.void(PICKLED)), _rated(h5py.Empty("f8")), _rated(True), _rated(400 + 1j), _rated(399.9999),
)  # fmt: skip
