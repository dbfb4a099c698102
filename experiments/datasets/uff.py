"""Universal files (data set 58, text and binary), through the package pyuff."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal
from experiments.datasets.times import SHOWN, factor_of, label, unstated
from experiments.datasets.vectors import rate_of

ENDINGS = (".uff", ".unv", ".uf", ".u58")
_END = b"-1"  # closes every data set; one that is not closed would pass unseen
_BINARY = re.compile(rb"^ *58b", re.MULTILINE)
_HEADER = 12  # lines of a data set 58 before its numbers, with that of its kind
_SINGLE, _SINGLES_ON_A_LINE, _DOUBLES_ON_A_LINE = 2, 6, 4  # numbers; a pair x, y is two of them
_TIME, _SI = 17, 1  # codes of the abscissa's kind and, in data set 164, of the units
_SI_UNITS = {8: "m", 9: "N", 11: "m/s", 12: "m/s2", 13: "N"}  # by the ordinate's kind
_DIRECTIONS = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}


def read(path: Path) -> list[Signal]:
    """Return the functions of time of a universal file.

    A function goes by its first ID line, or by node and direction ("12:+Z") where that is empty or shared.

    Raises
    ------
    SourceError
        If the file is cut short, a function's times are uneven or in no unit of time, or pyuff is missing.
    """
    raw = path.read_bytes()
    if not raw.rstrip(b"\0\x1a \t\r\n").endswith(_END):
        raise SourceError(f"{path.name}: found no -1 at its end, expected a whole universal file")
    sets = _sets(raw)
    in_si = any(one["type"] == 164 and one.get("units_code") == _SI for one in sets)
    functions = [one for one in sets if one["type"] == 58]
    shared = Counter(_title(one) for one in functions)
    return [_signal(path, one, in_si, shared[_title(one)] > 1) for one in functions]


def _sets(raw: bytes) -> list[Mapping[str, Any]]:
    """Return the data sets of functions and units; pyuff gets a copy without blanks that it trips over."""
    package = optional("pyuff", "uff")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "file.uff"
        copy.write_bytes(_unpadded(raw))
        file = package.UFF(str(copy))
        kinds = list(file.get_set_types())
        return [file.read_sets(number) for number, kind in enumerate(kinds) if kind in (58, 164)]


def _unpadded(raw: bytes) -> bytes:
    """Return the bytes without blanks behind the marks of sets and behind the numbers of text."""
    raw = raw.rstrip(b"\0\x1a \t\r\n") + b"\n"
    if _BINARY.search(raw):
        return raw
    lines, since = [], 0
    for line in raw.splitlines():
        mark = line.strip() == _END
        since = 0 if mark else since + 1
        lines.append(b"    -1" if mark else line.rstrip() if since > _HEADER else line)
    return b"\n".join(lines) + b"\n"


def _signal(path: Path, function: Mapping[str, Any], in_si: bool, shared: bool) -> Signal:
    title = _title(function)
    place = f"{function['rsp_node']}:{_DIRECTIONS.get(function['rsp_dir'], function['rsp_dir'])}"
    name = place if shared or not title else title
    data = np.asarray(function["data"])
    if function.get("abscissa_spec_data_type") != _TIME:
        return Signal(
            name, np.empty(0), fault="found another abscissa than time, expected a function of time"
        )
    if data.dtype.kind == "c":
        return Signal(name, np.empty(0), fault="found complex numbers, expected a function of time")
    function = _without_filling(function)
    data = np.asarray(function["data"])
    if len(data) != function["num_pts"]:
        found, expected = len(data), function["num_pts"]
        raise SourceError(f"{path.name}: {name}: found {found} samples, expected {expected} as in its header")
    rate_hz, start_s, readings = _axis(f"{path.name}: {name}", function)
    unit = _text(function.get("ordinate_axis_units_lab"))
    if not unit and in_si:
        unit = _SI_UNITS.get(function.get("ordinate_spec_data_type", 0), "")
    return Signal(name, data, unit, rate_hz, start_s, readings)


def _without_filling(function: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a function without the zeros with which some programs fill its last line of text."""
    pairs, count = function["abscissa_spacing"] == 0, function["num_pts"]
    on_a_line = _SINGLES_ON_A_LINE if function["ord_data_type"] == _SINGLE else _DOUBLES_ON_A_LINE
    surplus = len(function["data"]) - count
    behind = [function[name][count:] for name in (("data", "x") if pairs else ("data",))]
    if function["binary"] or not 0 < surplus < on_a_line / (1 + pairs) or any(map(np.any, behind)):
        return function
    return {**function, "data": function["data"][:count], "x": function["x"][:count]}


def _axis(where: str, function: Mapping[str, Any]) -> tuple[float, float, tuple[float, ...]]:
    """Return rate [Hz], start [s], and the rates that a step without a unit may mean as well."""
    unit = (
        _text(function.get("abscissa_axis_units_lab")) or label(_text(function.get("abscissa_axis_lab")))[1]
    )
    factor = factor_of(unit) if unit else 1.0
    if factor is None:
        raise SourceError(f'{where}: found the unit "{unit}" of its times, expected one of {SHOWN}')
    if function["abscissa_spacing"] == 1:
        start, step = float(function["abscissa_min"]), float(function["abscissa_inc"])
        if not step > 0:
            raise SourceError(f"{where}: found a step of {step:g}, expected an evenly spaced function")
        rate_hz = 1 / (factor * step)
    else:
        times = np.asarray(function["x"], dtype=np.float64)
        start, rate_hz = (
            float(times[0]),
            rate_of(where, factor * (times - times[0]), factor * _printed(times)),
        )
        step = 1 / (factor * rate_hz)
    return rate_hz, factor * start, () if unit and step != 1.0 else unstated(rate_hz)


def _printed(times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return what a time loses in print: half of the last of six digits."""
    return 0.5 * 10.0 ** (np.floor(np.log10(np.maximum(np.abs(times), 1e-30))) - 5)


def _title(function: Mapping[str, Any]) -> str:
    return _text(function.get("id1"))


def _text(value: Any) -> str:
    """Return a text of the file; its word for an empty one is NONE."""
    text = str(value or "").strip()
    return "" if text.upper() == "NONE" else text
