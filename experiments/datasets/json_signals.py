"""Signals in JSON: lists by name, lists of rows, or objects with name, unit, rate and samples."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.cells import numbers
from experiments.datasets.collected import SourceError
from experiments.datasets.rates import Told, named_rate
from experiments.datasets.signals import Signal
from experiments.datasets.tables import decoded

ENDINGS = (".json",)
_SAMPLES = ("samples", "values", "data", "y")
_NAME, _UNIT = ("name", "channel", "label", "signal", "id"), ("unit", "units")
_START = ("start_s", "start", "t0", "x0", "t_start", "start_time", "x_start")
_FEW = 8  # numbers that are no signal: a rate for each of a few channels
_RATE = "rate of the samples"  # a key of what is known above: no file has it


def read(path: Path) -> list[Signal]:
    """Return every list of numbers, by the name that leads to it: "run.force".

    Raises
    ------
    SourceError
        If the file is no JSON, or holds no list of numbers.
    """
    text = decoded(path).removeprefix("\ufeff")
    try:
        content = _parsed(text)
    except (json.JSONDecodeError, RecursionError) as cause:
        raise SourceError(f"{path.name}: found {cause}, expected JSON") from None
    signals = list(_walked("", content, {}))
    if not signals:
        raise SourceError(f"{path.name}: found no list of numbers, expected one for each signal")
    return signals


def _parsed(text: str) -> Any:
    """Return the content of a text, of one with an object in each line a list of them."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2 or not all(line.strip().startswith("{") for line in lines):
            raise
        return [json.loads(line) for line in lines]


def _walked(name: str, value: Any, above: Mapping[str, Any]) -> Iterator[Signal]:
    if isinstance(value, dict):
        yield from _of_object(name, value, above)
    elif isinstance(value, list) and len(value) > 1:
        yield from _of_list(name, value, above)


def _of_object(name: str, value: dict[str, Any], above: Mapping[str, Any]) -> Iterator[Signal]:
    own = {key.lower(): item for key, item in value.items() if not isinstance(item, list | dict)}
    told = {**above, **own}
    if rate := _rate_in(value):
        told[_RATE] = rate
    if isinstance(units := value.get("units"), dict):
        told["units"] = units
    columns, rows = value.get("columns"), value.get("data")
    if isinstance(columns, list) and isinstance(rows, list) and rows and isinstance(rows[0], list):
        table = _array(rows)
        if table is not None and table.ndim == 2 and table.shape[1] == len(columns):
            given = units if isinstance(units, list) and len(units) == len(columns) else [""] * len(columns)
            for index, (column, unit) in enumerate(zip(columns, given, strict=True)):
                yield _signal(str(column), table[:, index], told | ({"unit": unit} if unit else {}))
            return
    samples = next(
        (key for key in value if key.lower() in _SAMPLES and _vector(value[key]) is not None), None
    )
    if samples is not None and (_first(told, (*_NAME, *_UNIT)) or _RATE in told):
        yield _signal(str(_first(own, _NAME) or name or samples), _vector(value[samples]), told)
        value = {key: item for key, item in value.items() if key != samples}
    shared = {key: told[key] for key in (_RATE, "units") if key in told}
    shared = {key: item for key, item in shared.items() if key == _RATE or isinstance(item, dict)}
    for key, item in value.items():
        yield from _walked(f"{name}.{key}" if name else key, item, shared)


def _rate_in(value: Mapping[str, Any], *, inner: bool = False) -> Told | None:
    """Return the rate that an object tells, or one in it that holds no lists, such as "info"."""
    long = [key for key, item in value.items() if isinstance(item, list) and len(item) > _FEW]
    if inner and long:
        return None
    unit = str(_first(value, _UNIT) or "") if inner else ""  # "sampling": {"rate": 25.6, "unit": "kHz"}
    for key, item in value.items():
        named = f"{key} {unit}" if unit.lower().endswith("hz") else key
        if (
            key not in long
            and not isinstance(item, dict | None)
            and (found := named_rate(named, item, weak=True))
        ):
            return found
    found_in = [_rate_in(item, inner=True) for item in value.values() if isinstance(item, dict)]
    rates = {found for found in found_in if found}
    return rates.pop() if len(rates) == 1 else None


def _of_list(name: str, value: list[Any], above: Mapping[str, Any]) -> Iterator[Signal]:
    array = _array(value)
    if all(isinstance(item, str) for item in value):
        yield _of_texts(name, value, above)
    elif array is not None and array.ndim == 1:
        yield _signal(name or "column 1", array, above)
    elif array is not None and array.ndim == 2:
        by_rows = array.shape[0] >= array.shape[1]
        for index, vector in enumerate(array.T if by_rows else array, start=1):
            yield _signal(f"{name}(:,{index})" if by_rows else f"{name}({index},:)", vector, above)
    elif all(isinstance(row, dict) for row in value):
        shared = [k for k in value[0] if all(isinstance(row.get(k), int | float | None) for row in value)]
        if shared and not any(isinstance(item, list) for item in value[0].values()):
            for key in shared:
                column = np.array(
                    [np.nan if row.get(key) is None else row[key] for row in value], dtype=float
                )
                yield _signal(f"{name}.{key}" if name else key, column, above)
        else:
            for index, item in enumerate(value):
                yield from _walked(f"{name}({index + 1})" if name else f"({index + 1})", item, above)


def _of_texts(name: str, value: list[str], above: Mapping[str, Any]) -> Signal:
    """Return numbers or dates that are written as text, or a signal with a fault."""
    import pandas as pd

    try:
        return _signal(name, numbers(name, pd.Series(value)), above)
    except SourceError as fault:
        what = str(fault).removeprefix(f"{name}: ")
        return Signal(name, np.empty(0), fault=what)


def _array(value: list[Any]) -> Any:
    """Return numbers as an array, None where it is something else."""
    try:
        array = np.array([np.nan if item is None else item for item in value])
    except ValueError:
        return None
    return array if array.dtype.kind in "iuf" and array.ndim in (1, 2) else None


def _vector(value: Any) -> Any:
    array = _array(value) if isinstance(value, list) and len(value) > 1 else None
    return array if array is not None and array.ndim == 1 else None


def _first(told: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    return next((told[key] for key in keys if told.get(key) not in (None, "")), None)


def _signal(name: str, samples: Any, told: Mapping[str, Any]) -> Signal:
    rate = told.get(_RATE) or Told(None)
    start = _first(told, _START)
    start_s = float(start) if isinstance(start, int | float) else None
    unit = _first(told, _UNIT) or ""
    if isinstance(unit, dict):
        unit = unit.get(name, unit.get(name.rpartition(".")[2], ""))
    return Signal(name, samples, str(unit), rate.rate_hz, start_s, rate.readings)
