"""Universal files (data set 58, text and binary), through the package pyuff."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.datasets.collected import SourceError, optional
from experiments.datasets.signals import Signal

ENDINGS = (".uff", ".unv", ".uf", ".u58")
_END = b"-1"  # closes every data set; one that is not closed would pass unseen
_TIME, _SI = 17, 1  # codes of the abscissa's kind and, in data set 164, of the units
_SI_UNITS = {8: "m", 9: "N", 11: "m/s", 12: "m/s2", 13: "N"}  # by the ordinate's kind
_DIRECTIONS = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}


def read(path: Path) -> list[Signal]:
    """Return the functions of time of a universal file.

    A function goes by its first ID line, or by node and direction ("12:+Z") where that is empty or shared.

    Raises
    ------
    SourceError
        If the file is cut short, a function is not evenly spaced, or pyuff is not installed.
    """
    if not path.read_bytes().rstrip().endswith(_END):
        raise SourceError(f"{path.name}: found no -1 at its end, expected a whole universal file")
    file = optional("pyuff", "uff").UFF(str(path))
    kinds = list(file.get_set_types())
    sets = [file.read_sets(number) for number, kind in enumerate(kinds) if kind in (58, 164)]
    in_si = any(one["type"] == 164 and one.get("units_code") == _SI for one in sets)
    functions = [one for one in sets if one["type"] == 58 and one.get("abscissa_spec_data_type") == _TIME]
    shared = Counter(_title(one) for one in functions)
    return [_signal(path, one, in_si, shared[_title(one)] > 1) for one in functions]


def _signal(path: Path, function: Mapping[str, Any], in_si: bool, shared: bool) -> Signal:
    title = _title(function)
    place = f"{function['rsp_node']}:{_DIRECTIONS.get(function['rsp_dir'], function['rsp_dir'])}"
    name = place if shared or not title else title
    step = float(function["abscissa_inc"])
    if function["abscissa_spacing"] != 1 or step <= 0:
        raise SourceError(f"{path.name}: {name}: found uneven times, expected an evenly spaced function")
    if len(function["data"]) != function["num_pts"]:
        found, expected = len(function["data"]), function["num_pts"]
        raise SourceError(f"{path.name}: {name}: found {found} samples, expected {expected} as in its header")
    unit = _text(function.get("ordinate_axis_units_lab"))
    if not unit and in_si:
        unit = _SI_UNITS.get(function.get("ordinate_spec_data_type", 0), "")
    return Signal(name, function["data"], unit, 1 / step, float(function["abscissa_min"]))


def _title(function: Mapping[str, Any]) -> str:
    return _text(function.get("id1"))


def _text(value: Any) -> str:
    """Return a text of the file; its word for an empty one is NONE."""
    text = str(value or "").strip()
    return "" if text.upper() == "NONE" else text
