"""MATLAB files of any version, through the package pymatreader: plain variables, and the exports of HBK's
software.

An export holds `Channel_<n>_Data` with `Channel_<n>_Header` (SignalName, Unit) and `File_Header`
(SampleFrequency). All else goes by the name that MATLAB would use: `force`, `run.force`, `data(:,2)`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.collected import optional
from experiments.datasets.signals import Signal

ENDINGS = (".mat",)
_EXPORTED = re.compile(r"Channel_(\d+)_Data")


def read(path: Path) -> list[Signal]:
    """Return every vector and every column of a matrix of numbers.

    Raises
    ------
    SourceError
        If pymatreader is not installed.
    """
    content = optional("pymatreader", "matlab").read_mat(str(path))
    rates = {name[8:]: _number(value) for name, value in content.items() if name.startswith("rate_hz_")}
    common = _common_rate(content.get("File_Header"))
    signals = []
    for name, value in content.items():
        exported = _EXPORTED.fullmatch(name)
        header = content.get(f"Channel_{exported[1]}_Header") if exported else None
        if isinstance(header, Mapping):
            own = str(header.get("SignalName", "")).strip() or name
            unit = str(header.get("Unit", "")).strip()
            signals += [Signal(own, array, unit, common) for _, array in _vectors(name, value)]
        elif not name.startswith(("__", "rate_hz_")):
            signals += [Signal(n, array, "", rates.get(n)) for n, array in _vectors(name, value)]
    return signals


def _vectors(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the vectors in a variable, and in the fields of a structure, with their names."""
    if isinstance(value, Mapping):
        for field, item in value.items():
            yield from _vectors(f"{name}.{field}", item)
        return
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.size < 2:
        return
    if max(value.shape) == value.size:
        yield name, value.ravel()
    elif value.ndim == 2:
        by_columns = value.shape[0] >= value.shape[1]
        for index, vector in enumerate(value.T if by_columns else value, start=1):
            yield f"{name}(:,{index})" if by_columns else f"{name}({index},:)", vector


def _common_rate(header: Any) -> float | None:
    """Return the rate [Hz] that holds for the whole file, None where it names several or none."""
    text = str(header.get("SampleFrequency", "")) if isinstance(header, Mapping) else ""
    rates = {float(number.replace(",", ".")) for number in re.findall(r"\d+(?:[.,]\d+)?", text)}
    return rates.pop() if len(rates) == 1 else None


def _number(value: Any) -> float | None:
    array = np.asarray(value)
    return float(array.reshape(())) if array.size == 1 and array.dtype.kind in "iuf" else None
