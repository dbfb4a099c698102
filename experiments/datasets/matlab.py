"""MATLAB files of any version, through the package pymatreader: plain variables, and the exports of HBK's
software.

An export holds `Channel_<n>_Data` with `Channel_<n>_Header` (SignalName, Unit) and `File_Header`
(SampleFrequency). All else goes by the name that MATLAB would use: `force`, `run.force`, `runs(2).force`,
`data(:,2)`, `cells{3}`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.parser_process import parsed_apart
from experiments.datasets.rates import named_rate, stated_rate
from experiments.datasets.signals import NOT_UNDERSTOOD, Signal

ENDINGS = (".mat",)
_EXPORTED = re.compile(r"Channel_(\d+)_Data")
_FEW = 8  # numbers that are no signal: a rate for each of a few channels
_PLAIN = (
    "double",
    "single",
    "int",
    "uint",
    "char",
    "logical",
    "cell",
    "struct",
    "sparse",
    "function",
    "unknown",
)
_OF_OBJECTS = re.compile("Complex objects|cannot import Matlab string|Duplicate variable")
_REMEDY = (
    "expected numbers, cells or structures: an object is open to MATLAB alone; save "
    "S = table2struct(T, 'ToScalar', true), of a timetable after T = timetable2table(T)"
)


def read(path: Path) -> list[Signal]:
    """Return every vector and every column of a matrix of numbers.

    A MATLAB table is an object that no reader opens: it is returned as a signal with a fault.

    Raises
    ------
    SourceError
        If pymatreader is not installed.
    """
    optional("pymatreader", "matlab")
    content, said = parsed_apart(_content, path, "MATLAB file")
    objects = _objects(path, content, several=any("Duplicate variable" in text for text in said))
    for text in said:
        if not objects or not _OF_OBJECTS.search(text):
            warnings.warn(text, stacklevel=2)
    rates = {name[8:]: _rate(path, name, value) for name, value in content.items() if name[:8] == "rate_hz_"}
    fields = {n: value for n, value in content.items() if not n.startswith("__") and n not in rates}
    common = _rate_field(fields) or _rate_beside(fields)
    header_rate = _common_rate(content.get("File_Header"))
    signals = [Signal(name, np.empty(0), fault=f"{what}, {_REMEDY}") for name, what in objects.items()]
    for name, value in content.items():
        exported = _EXPORTED.fullmatch(name)
        header = content.get(f"Channel_{exported[1]}_Header") if exported else None
        if isinstance(header, Mapping):
            own, unit = _field(header, "SignalName") or name, _field(header, "Unit")
            signals += [
                replace(found, name=own, unit=unit, **header_rate) for found in _vectors(name, value, None)
            ]
        elif not name.startswith(("__", "rate_hz_", "#")) and name not in objects and name != "None":
            signals += _vectors(name, value, common)
    return [replace(s, **rates[s.name]) if s.name in rates else s for s in signals]


def _content(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the variables of a file, and what its parser warns of: some damage ends the parser's process."""
    from pymatreader import read_mat

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        content = dict(read_mat(str(path)))
    return content, [str(warning.message) for warning in said]


def _objects(path: Path, content: Mapping[str, Any], several: bool) -> dict[str, str]:
    """Return what was found in place of every variable that is an object, such as a table, by its name.

    Of several in a file before 7.3 the last one alone is known by its name: "*" stands for the others.
    """
    import h5py
    from pymatreader import whosmat

    kinds: dict[str, str] = {}
    if h5py.is_hdf5(path):
        kinds = {name: kind for name, _, kind in whosmat(str(path)) if not name.startswith("#")}
    else:
        for name, value in content.items():
            if isinstance(value, Mapping) and {"s0", "s1", "s2"} <= value.keys():
                kinds[_text(value["s0"])] = _text(value["s2"])
            elif isinstance(value, Mapping) and "_Class" in value:
                kinds[name] = _text(value["_Class"])
        if several:
            kinds["*"] = "table or other object"
    return {name: f"found a MATLAB {kind}" for name, kind in kinds.items() if not kind.startswith(_PLAIN)}


def _text(value: Any) -> str:
    """Return the text in an array of one."""
    one = np.asarray(value).ravel()[0]
    return one.decode() if isinstance(one, bytes) else str(one)


@dataclass(frozen=True)
class _RateField:
    """Rate [Hz] that a field of a structure tells, its other meanings, the lengths of vectors beside."""

    rate_hz: float | None
    readings: tuple[float, ...]
    lengths: frozenset[int]

    def of(self, length: int) -> dict[str, Any]:
        """Return the rate of a vector; of several lengths it is that of one, and fits the others."""
        if len(self.lengths) < 2:
            return {"rate_hz": self.rate_hz, "readings": self.readings}
        rates = self.readings if self.rate_hz is None else (self.rate_hz,)
        return {"readings": tuple(rate * length / other for rate in rates for other in sorted(self.lengths))}


def _rate_field(fields: Mapping[str, Any]) -> _RateField | None:
    """Return the rate that a field of a structure tells for the vectors in it."""
    told = {name: found for name, value in fields.items() if (found := named_rate(name, _few(value)))}
    arrays = [v for name, v in fields.items() if isinstance(v, np.ndarray) and name not in told]
    lengths = frozenset(max(a.shape) for a in arrays if a.dtype.kind in "iuf" and a.ndim and a.size > 1)
    return _RateField(*next(iter(told.values())), lengths) if told else None


def _few(value: Any) -> Any:
    """Return a number or a few of them in plain Python, None in place of a vector."""
    if not isinstance(value, np.ndarray | np.number):
        return value
    return value.ravel().tolist() if value.size <= _FEW and value.dtype.kind in "iuf" else None


def _rate_beside(fields: Mapping[str, Any]) -> _RateField | None:
    """Return the one rate that structures without vectors tell, such as `info.fs`."""
    inner = [value for value in fields.values() if isinstance(value, Mapping)]
    found = {
        rate for value in inner if (rate := _rate_field(value) or _rate_beside(value)) and not rate.lengths
    }
    return found.pop() if len(found) == 1 else None


def _vectors(name: str, value: Any, rate: _RateField | None) -> Iterator[Signal]:
    """Yield the vectors in a variable, in the fields of a structure and in cells, with MATLAB's names."""
    if isinstance(value, Mapping):
        length = _structures(value)
        for index in range(length):
            one = {field: items[index] for field, items in value.items()}
            yield from _vectors(f"{name}({index + 1})", one, rate)
        for field, item in ({} if length else value).items():
            yield from _vectors(f"{name}.{field}", item, _rate_field(value) or rate)
    elif isinstance(value, list) and len(value) > 1 and all(isinstance(item, str) for item in value):
        yield Signal(name, np.empty(0), fault="found cells of text, expected a vector of real numbers")
    elif isinstance(value, list):
        for index, item in enumerate(value, start=1):
            yield from _vectors(f"{name}{{{index}}}", item, rate)
    elif isinstance(value, np.ndarray) and value.size > 1:
        yield from _of_array(name, value, rate)


def _structures(value: Mapping[str, Any]) -> int:
    """Return the length of an array of structures, read as a list in each field; 0 for a single one."""
    lengths = {len(items) if isinstance(items, list) else 0 for items in value.values()}
    return lengths.pop() if len(lengths) == 1 and value else 0


def _of_array(name: str, value: npt.NDArray[Any], rate: _RateField | None) -> Iterator[Signal]:
    own = rate.of(max(value.shape)) if rate else {}
    if value.dtype.kind == "O":
        for index, item in enumerate(value.ravel(), start=1):
            yield from _vectors(f"{name}{{{index}}}", item, rate)
    elif value.dtype.kind not in "iuf" or (value.ndim > 2 and max(value.shape) != value.size):
        what = "an array of three dimensions" if value.ndim > 2 else "complex numbers or text"
        yield Signal(name, np.empty(0), fault=f"found {what}, expected a vector or matrix of real numbers")
    elif max(value.shape) == value.size:
        yield Signal(name, value.ravel(), **own)
    else:
        by_columns = value.shape[0] >= value.shape[1]
        for index, vector in enumerate(value.T if by_columns else value, start=1):
            yield Signal(f"{name}(:,{index})" if by_columns else f"{name}({index},:)", vector, **own)


def _common_rate(header: Any) -> dict[str, Any]:
    """Return the rate [Hz] that holds for the whole file; of several each may be that of a signal."""
    text = _field(header, "SampleFrequency") if isinstance(header, Mapping) else ""
    if found := stated_rate(text):
        return {"rate_hz": found[0], "readings": found[1]}
    several = [stated_rate(part) for part in re.split(r"[;\s]+", text)]
    readings = tuple(rate for one in several if one for rate in (one[0], *one[1]))
    return {"readings": readings or ((NOT_UNDERSTOOD,) if text else ())}


def _field(header: Mapping[str, Any], name: str) -> str:
    """Return a field of a header as text; MATLAB's empty text is an array."""
    value = header.get(name, "")
    return str(value).strip() if isinstance(value, str | int | float | np.number) else ""


def _rate(path: Path, name: str, value: Any) -> dict[str, Any]:
    """Return what a variable `rate_hz_<variable>` tells, a number or a text."""
    number = _number(value)
    found = (number, ()) if number is not None else stated_rate(value) if isinstance(value, str) else None
    if found is None:
        raise SourceError(f"{path.name}: {name}: found {value!r:.60}, expected one rate in Hz")
    return {"rate_hz": found[0], "readings": found[1]}


def _number(value: Any) -> float | None:
    if isinstance(value, np.ndarray):
        return float(value.ravel()[0]) if value.size == 1 and value.dtype.kind in "iuf" else None
    return float(value) if isinstance(value, int | float | np.number) else None
