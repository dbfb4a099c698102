"""Good files of every format that `boltlaw import` reads, and damage of bytes."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.experiments.datasets.matlab_objects import with_object, with_object_73
from tests.experiments.datasets.test_cells import LABVIEW
from tests.experiments.datasets.test_tables import CATMAN, written_xlsx
from tests.experiments.source_files import (
    Signals,
    write_catman,
    write_matlab,
    write_matlab_73,
    write_matlab_export,
    write_tdms,
    write_uff,
    write_uff_binary,
)

N, HZ = 48, 19200
FORCE, ACCELERATION = np.round(np.random.default_rng(0).standard_normal((2, N)), 4)
SIGNALS: Signals = {"F": (FORCE, "N", HZ), "A": (ACCELERATION, "m/s2", HZ)}
ROWS = np.stack([np.arange(N) / HZ, FORCE, ACCELERATION], axis=1).tolist()


def lines(separator: str, decimal: str) -> str:
    """Return rows of numbers."""
    return "\n".join(separator.join(f"{x:.9g}".replace(".", decimal) for x in row) for row in ROWS)


def text(content: str, encoding: str = "utf-8") -> Callable[[Path, Signals], None]:
    """Return what writes a text."""
    return lambda path, _: path.write_bytes(content.encode(encoding)) and None


HEAD = LABVIEW.format(axes="One", decimal=".", late="5", dimension="Time", step=1 / HZ)

KINDS: dict[str, tuple[str, str, Callable[[Path, Signals], None]]] = {
    "catman": ("catman", ".bin", write_catman),
    "catman text": ("catman", ".asc", text(CATMAN + lines("\t", ","), "cp1252")),
    "matlab": ("matlab", ".mat", write_matlab),
    "matlab export": ("matlab", ".mat", write_matlab_export),
    "matlab 7.3": ("matlab", ".mat", write_matlab_73),
    "matlab object": ("matlab", ".mat", lambda path, _: with_object(path, "table", {"F": FORCE})),
    "matlab object 7.3": ("matlab", ".mat", lambda path, _: with_object_73(path, "table", {"F": FORCE})),
    "uff": ("uff", ".uff", write_uff),
    "uff binary": ("uff", ".uff", write_uff_binary),
    "tdms": ("tdms", ".tdms", write_tdms),
    "csv": ("csv", ".csv", text("time,F,A\ns,N,m/s2\n" + lines(",", "."))),
    "csv utf-16": ("csv", ".csv", text("Zeit;F;A\n" + lines(";", ","), "utf-16")),
    "columns": ("csv", ".txt", text("# time F A\n" + lines(" ", "."))),
    "labview": ("csv", ".lvm", text(f"{HEAD}X_Value\tF\tA\tComment\n" + lines("\t", "."))),
    "xlsx": ("xlsx", ".xlsx", lambda path, _: written_xlsx(path, {"run": [["time", "F", "A"], *ROWS]})),
    "json": ("json", ".json", text(json.dumps({"fs": HZ, "F": FORCE.tolist(), "A": ACCELERATION.tolist()}))),
}
TOKENS = (
    b"",
    b"\0",
    b"NaN",
    b"1e999",
    b"-1",
    b"\xff\xfe",
    b",",
    b";",
    b"\n",
    b'"',
    b"{",
    b"[",
    b"time",
    b"    -1\n",
)


@cache
def sound(kind: str) -> bytes:
    """Return the bytes of a good file."""
    _, ending, write = KINDS[kind]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a{ending}"
        write(path, SIGNALS)
        return path.read_bytes()


def damaged(raw: bytes, random: np.random.Generator) -> bytes:
    """Return bytes with some changed, cut out, repeated, or put in."""
    found = bytearray(raw)
    for _ in range(int(random.integers(1, 5))):
        start = int(random.integers(0, len(found) + 1))
        stop = min(len(found), start + int(2 ** random.uniform(0, 12)))
        match int(random.integers(0, 7)):
            case 0:
                del found[start:]
            case 1:
                del found[start:stop]
            case 2:
                found[start:start] = found[start:stop]
            case 3:
                found[start:start] = TOKENS[int(random.integers(len(TOKENS)))]
            case 4:
                found[start : start + 8] = random.bytes(8)
            case 5:
                for place in random.integers(0, max(len(found), 1), size=3):
                    found[place : place + 1] = random.bytes(1)
            case _:
                for place in random.integers(0, min(len(found), 400) + 1, size=2):  # where headers are
                    found[place : place + 1] = random.bytes(1)
    return bytes(found)
