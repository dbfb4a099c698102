"""Signals in JSON: lists by name, lists of rows, or objects with name, unit, rate and samples."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.collected import SourceError
from experiments.datasets.signals import Signal
from experiments.datasets.tables import decoded
from experiments.datasets.times import readings_of, stated_rate, unstated

ENDINGS = (".json",)
_SAMPLES = ("samples", "values", "data", "y")
_NAME, _UNIT = ("name", "channel", "label", "signal"), ("unit", "units")
_RATE = ("rate_hz", "sample_rate", "sampling_rate", "samplerate", "fs", "sample_rate_hz", "frequency")
_STEP, _START = ("dt", "step", "increment", "delta_t"), ("start_s", "start", "t0")


def read(path: Path) -> list[Signal]:
    """Return every list of numbers, by the name that leads to it: "run.force".

    Raises
    ------
    SourceError
        If the file is no JSON, or holds no list of numbers.
    """
    try:
        content = json.loads(decoded(path).removeprefix("\ufeff"))
    except (json.JSONDecodeError, RecursionError) as cause:
        raise SourceError(f"{path.name}: found {cause}, expected JSON") from None
    signals = list(_walked("", content, {}))
    if not signals:
        raise SourceError(f"{path.name}: found no list of numbers, expected one for each signal")
    return signals


def _walked(name: str, value: Any, above: Mapping[str, Any]) -> Iterator[Signal]:
    if isinstance(value, dict):
        yield from _of_object(name, value, above)
    elif isinstance(value, list) and len(value) > 1:
        yield from _of_list(name, value, above)


def _of_object(name: str, value: dict[str, Any], above: Mapping[str, Any]) -> Iterator[Signal]:
    told = {
        **above,
        **{key.lower(): item for key, item in value.items() if not isinstance(item, list | dict)},
    }
    columns, rows = value.get("columns"), value.get("data")
    if isinstance(columns, list) and isinstance(rows, list) and rows and isinstance(rows[0], list):
        table = _array(rows)
        if table is not None and table.ndim == 2 and table.shape[1] == len(columns):
            yield from (_signal(str(c), table[:, i], {**told, "name": ""}) for i, c in enumerate(columns))
            return
    samples = next(
        (key for key in value if key.lower() in _SAMPLES and _vector(value[key]) is not None), None
    )
    named = _first(told, _NAME) or _first(told, _UNIT) or _first(told, _RATE)
    if samples is not None and named is not None:
        own = str(_first({k.lower(): v for k, v in value.items()}, _NAME) or name or samples)
        yield _signal(own, _vector(value[samples]), told)
        value = {key: item for key, item in value.items() if key != samples}
    rates = {key: told[key] for key in (*_RATE, *_STEP) if key in told}
    for key, item in value.items():
        yield from _walked(f"{name}.{key}" if name else key, item, rates)


def _of_list(name: str, value: list[Any], above: Mapping[str, Any]) -> Iterator[Signal]:
    array = _array(value)
    if array is not None and array.ndim == 1:
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
    rate, step, start = (_first(told, keys) for keys in (_RATE, _STEP, _START))
    found: tuple[float, tuple[float, ...]] | None = None
    if rate is not None:
        in_hz = any(told.get(key) == rate for key in _RATE if key.endswith("_hz"))
        number = 0.0 if isinstance(rate, str) else float(rate)
        found = stated_rate(rate) if isinstance(rate, str) else (number, () if in_hz else (1e3 * number,))
    elif step is not None:
        seconds = readings_of(step)[0] if isinstance(step, str) else float(step)
        found = (1 / seconds, unstated(1 / seconds)) if seconds > 0 else None
    rate_hz, readings = found if found and found[0] > 0 else (None, ())
    start_s = float(start) if isinstance(start, int | float) else None
    return Signal(name, samples, str(_first(told, _UNIT) or ""), rate_hz, start_s, readings)
