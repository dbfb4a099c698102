"""Real arrays of MATLAB files of level 5 (v5 to v7.2), every length checked against the bytes that are there.

A damaged file can end the whole process in SciPy's compiled reader; here it is an error with a message. The
format: MathWorks, "MAT-File Format", 2022, ch. 1.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rom.criteria.number import Numerical

_HEADER_BYTES, _TAG_BYTES = 128, 8
_MATRIX, _COMPRESSED = 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHERS = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse", 16: "function", 17: "opaque"}
_LOGICAL, _COMPLEX = 0x200, 0x800
_LARGEST_RATIO: Numerical[int] = 1100  # zlib packs 1032 bytes into one at most


@dataclass(frozen=True)
class Variable:
    """A variable: its samples as MATLAB shapes them, or what it is in place of real numbers."""

    name: str
    samples: npt.NDArray[np.generic] | None
    kind: str


def level_of(path: Path) -> int:
    """Return the level of a MATLAB file that is no HDF5, 4 or 5.

    Raises
    ------
    ValueError
        If its first bytes are of neither.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if 0 in head[:4]:  # a number, where level 5 has text
        return 4
    if head[124:128] not in (b"\0\1IM", b"\1\0MI"):
        raise ValueError("its header is none of MATLAB's")
    return 5


def variables(path: Path) -> Iterator[Variable]:
    """Yield the variables of a file in order; only real arrays have samples.

    Raises
    ------
    ValueError
        If a length or type does not fit the bytes: the file is damaged.
    """
    content = memoryview(path.read_bytes())
    order = "<" if bytes(content[126:128]) == b"IM" else ">"
    place = _HEADER_BYTES
    while place < len(content):
        kind, data, after = _element(content, place, order)
        if kind == _COMPRESSED:
            kind, data, _ = _element(_unpacked(data), 0, order)
        if kind != _MATRIX:
            raise ValueError(f"found an element of type {kind}, expected a variable: it is damaged")
        found = _variable(data, order)
        if found.name:  # else MATLAB's own table of functions
            yield found
        place = after


def _unpacked(data: memoryview) -> memoryview:
    """Return unpacked bytes: no more than the tag within says."""
    packer = zlib.decompressobj()
    try:
        return memoryview(packer.decompress(data, len(data) * _LARGEST_RATIO + _TAG_BYTES))
    except zlib.error as cause:
        raise ValueError(f"found packed bytes that do not unpack: {cause}") from None


def _element(data: memoryview, place: int, order: str) -> tuple[int, memoryview, int]:
    """Return type, bytes, and where the next element begins; short ones have their bytes within the tag."""
    if place + _TAG_BYTES > len(data):
        raise ValueError("found the end of the file within a tag: it is damaged")
    first, second = (int(x) for x in np.frombuffer(data[place : place + _TAG_BYTES], f"{order}u4"))
    kind, size, start = first, second, place + _TAG_BYTES
    if first >> 16:
        kind, size, start = first & 0xFFFF, first >> 16, place + 4
        after = place + _TAG_BYTES
        if size > 4:
            raise ValueError(f"found a short element of {size} bytes, expected 4 at most: it is damaged")
    else:
        after = start + size + (0 if kind == _COMPRESSED else -size % 8)
    if start + size > len(data):
        raise ValueError(f"found {len(data) - start} bytes, expected {size}: it is damaged")
    return kind, data[start : start + size], after


def _variable(data: memoryview, order: str) -> Variable:
    kind, flags, place = _element(data, 0, order)
    if _STORED.get(kind) != "u4" or len(flags) != _TAG_BYTES:
        raise ValueError("found a variable without its flags: it is damaged")
    word = int(np.frombuffer(flags, f"{order}u4")[0])
    number = word & 0xFF
    shape: tuple[int, ...] = ()
    if _OTHERS.get(number) != "opaque":
        kind, sizes, place = _element(data, place, order)
        if _STORED.get(kind) not in ("i4", "u4") or len(sizes) % 4 or len(sizes) < 8:
            raise ValueError("found a variable without a shape: it is damaged")
        shape = tuple(int(x) for x in np.frombuffer(sizes, f"{order}i4"))
    _, text, place = _element(data, place, order)
    name = bytes(text).decode("latin-1")
    if number not in _NUMERIC:
        return Variable(name, None, _OTHERS.get(number, f"class {number}"))
    if word & _LOGICAL:
        return Variable(name, None, "logical")
    if word & _COMPLEX:
        return Variable(name, None, "complex")
    return Variable(name, _samples(data, place, order, shape).astype(_NUMERIC[number], copy=False), "numeric")


def _samples(data: memoryview, place: int, order: str, shape: tuple[int, ...]) -> npt.NDArray[np.generic]:
    if 0 in shape and place >= len(data):
        return np.empty(shape)
    kind, stored, _ = _element(data, place, order)
    if kind not in _STORED:
        raise ValueError(f"found samples of type {kind}, expected numbers: it is damaged")
    numbers = np.dtype(order + _STORED[kind])
    if min(shape) < 0 or math.prod(shape) * numbers.itemsize != len(stored):
        raise ValueError(f"found {len(stored)} bytes of samples, expected those of {shape}: it is damaged")
    return np.frombuffer(stored, numbers).reshape(shape, order="F")
