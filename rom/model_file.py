"""model.json read back: the laws from their equations, the effects from the catalogue."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rom.effects import make
from rom.model.description import LinkLaws
from rom.model.laws import Parameter, law_from_text
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty
from rom.model.shapes import ModeShapes
from rom.model.structure import Body, Link, Structure
from rom.model.writing import FORMAT

T = TypeVar("T")


class ModelFileError(ValueError):
    """A file that is not a model; the message says what was required and what came."""


def load_model(path: str | Path) -> Model:
    """Read ``model.json``.

    Raises
    ------
    ModelFileError
        If the file is not a model.

    Examples
    --------
    >>> import rom
    >>> rom.paper_model().save("model.json")
    >>> rom.load_model("model.json") == rom.paper_model()
    True
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(f'{path}: must be a model file, got "{error.strerror}"') from error
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path}: must be a model file, got text that is not JSON ({error})") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise ModelFileError(f"{path}: format must be {FORMAT!r}, got {found!r}")
    read: dict[str, Any] = {}
    for section, values in _SECTIONS.items():
        read |= _read_part(path, section, partial(values, data))
    structure = _read_part(path, "bodies and links", lambda: Structure(read.pop("bodies"), read.pop("links")))
    return _read_part(path, "links", lambda: Model(structure=structure, **read))


def _read_part(path: Path, section: str, read: Callable[[], T]) -> T:
    """What a part of the file holds; a fault in it is said with the part's name."""
    try:
        return read()
    except (KeyError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise ModelFileError(f"{path}: {section}: must be as a command writes it, {_cause(error)}") from error


def _cause(error: Exception) -> str:
    """What was found, for people who know the file and not Python."""
    if isinstance(error, KeyError):
        return f'found no "{error.args[0]}"'
    if isinstance(error, TypeError | AttributeError):
        return "found a value of another kind"
    return f"found another value: {error}"


_SECTIONS: Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "bodies": lambda data: {
        "bodies": tuple(Body(item["name"], float(item["mass"]["value"])) for item in data["bodies"])
    },
    "links": lambda data: {
        "links": tuple(_link(item) for item in data["links"]),
        "link_laws": {item["name"]: _laws_from_data(item) for item in data["links"]},
    },
    "uncoupled_links": lambda data: {
        "uncoupled_laws": {item["name"]: _laws_from_data(item) for item in data.get("uncoupled_links", ())}
    },
    "effects": lambda data: {"effects": _effects_from_data(data["effects"])},
    "filter": lambda data: {
        "filter_cutoff_hz": {name: float(value) for name, value in data["filter"]["cutoff_hz"].items()}
    },
    "calibration": lambda data: {
        "calibration": tuple(float(value) for value in data["calibration"]["coefficients"])
    },
    "windows": lambda data: {
        "windows": {name: (float(low), float(high)) for name, (low, high) in data["windows"].items()}
    },
    "sampling": lambda data: {"sampling": data["sampling"]},
    "modes": lambda data: {"shapes": _shapes_from_data(data["modes"]) if "modes" in data else None},
    "rate_uncertainty": lambda data: {
        "rate_uncertainty": RateUncertainty.from_data(data.get("rate_uncertainty"))
    },
}


def _shapes_from_data(item: Mapping[str, Any]) -> ModeShapes:
    sensors, modes, forces = (tuple(map(str, item[key])) for key in ("sensors", "names", "forces"))
    return ModeShapes(sensors, modes, forces, _parameters_from_data(item["numbers"]))


def _link(item: Mapping[str, Any]) -> Link:
    first, second = item["between"]
    return Link(item["name"], first, second, item["law"])


def _effects_from_data(items: list[Mapping[str, Any]]) -> tuple[Any, ...]:
    return tuple(
        make(
            item["name"],
            item["enters"],
            _parameters_from_data(item["parameters"]),
            item.get("equation", ""),
        )
        for item in items
    )


def _laws_from_data(item: Mapping[str, Any]) -> LinkLaws:
    rate = item.get("tension_rate")
    return LinkLaws(
        law_from_text(**_law_from_data(item["stiffness"]), enters="stiffness"),
        law_from_text(**_law_from_data(item["damping"]), enters="damping"),
        None if rate is None else law_from_text(**_law_from_data(rate), enters="tension rate"),
    )


def _law_from_data(item: Mapping[str, Any]) -> dict[str, Any]:
    return {**item, "parameters": _parameters_from_data(item["parameters"])}


def _parameters_from_data(items: Mapping[str, Any]) -> dict[str, Parameter]:
    return {
        name: Parameter(
            float(item["value"]),
            item["unit"],
            item["low"],
            item["high"],
            _bounds(item["bounds"]),
            item["source"],
        )
        for name, item in items.items()
    }


def _bounds(limits: list[float | None]) -> tuple[float, float]:
    low, high = limits
    return (-math.inf if low is None else low, math.inf if high is None else high)
