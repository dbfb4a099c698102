"""MATLAB files with objects, such as tables, that MATLAB alone can read."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat


def tag(kind: int, data: bytes) -> bytes:
    """Return an element of a MATLAB file."""
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def opaque(name: str, kind: str) -> bytes:
    """Return a variable of MATLAB 7 that is an object: class 17, of the system of classes MCOS."""
    parts = (
        tag(6, struct.pack("<II", 17, 0)) + tag(1, name.encode()) + tag(1, b"MCOS") + tag(1, kind.encode())
    )
    inner = tag(6, struct.pack("<II", 13, 0)) + tag(5, struct.pack("<ii", 6, 1)) + tag(1, b"")
    inner += tag(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    return tag(14, parts + tag(14, inner))


def with_object(path: Path, kind: str, variables: Mapping[str, Any], name: str = "T") -> None:
    """Write variables and an object behind them."""
    savemat(path, variables)
    with path.open("ab") as file:
        file.write(opaque(name, kind))


def with_object_73(path: Path, kind: str, variables: Mapping[str, Any]) -> None:
    """Write variables and an object T in a file of version 7.3."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            file.create_dataset(name, data=values[None]).attrs["MATLAB_class"] = np.bytes_(b"double")
        item = file.create_dataset("T", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32))
        item.attrs["MATLAB_class"] = np.bytes_(kind.encode())
        item.attrs["MATLAB_object_decode"] = 3
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
