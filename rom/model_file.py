"""model.json: a model as a file that people can read."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rom.model.laws import Law, Parameter, law_from_text
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from rom.provenance import program_version, versions

FORMAT = "boltlaw-model/1"


class ModelFileError(ValueError):
    """A file that is not a model; the message says what was required and what came."""


def write_model(model: Model, path: Path, header: Mapping[str, object]) -> None:
    """Write a model; the file appears whole or not at all."""
    head = {
        "format": FORMAT,
        "campaign": None,
        "program_version": program_version(),
        "versions": versions(),
        "seed": None,
        "elapsed_s": None,
    }
    text = json.dumps({**head, **header, **_as_data(model)}, indent=2, allow_nan=False) + "\n"
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


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
    except (OSError, ValueError) as error:
        raise ModelFileError(f"{path}: must be a model file, got {error}") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise ModelFileError(f"{path}: format must be {FORMAT!r}, got {found!r}")
    try:
        return _from_data(data)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ModelFileError(
            f"{path}: must hold a complete model, got {type(error).__name__}: {error}"
        ) from error


def _as_data(model: Model) -> dict[str, Any]:
    return {
        "bodies": [{"name": b.name, "mass": {"value": b.mass, "unit": "kg"}} for b in model.structure.bodies],
        "links": [_link_as_data(link, model.link_laws[link.name]) for link in model.structure.links],
        "uncoupled_links": [
            {"name": name, "stiffness": _law_as_data(laws.stiffness), "damping": _law_as_data(laws.damping)}
            for name, laws in model.uncoupled_laws.items()
        ],
        "effects": [
            {
                "name": e.name,
                "enters": e.enters,
                "equation": e.equation,
                "parameters": _parameters(e.parameters),
            }
            for e in model.effects
        ],
        "filter": {"cutoff_hz": dict(model.filter_cutoff_hz)},
        "calibration": {"coefficients": list(model.calibration), "unit": "N"},
        "windows": {name: list(window) for name, window in model.windows.items()},
        "sampling": dict(model.sampling),
    }


def _link_as_data(link: Link, laws: LinkLaws) -> dict[str, Any]:
    return {
        "name": link.name,
        "between": [link.first, link.second],
        "law": link.law,
        "stiffness": _law_as_data(laws.stiffness),
        "damping": _law_as_data(laws.damping),
        "tension_rate": None if laws.tension_rate is None else _law_as_data(laws.tension_rate),
    }


def _law_as_data(law: Law) -> dict[str, Any]:
    return {"name": law.name, "equation": law.equation, "parameters": _parameters(law.parameters)}


def _parameters(parameters: Mapping[str, Parameter]) -> dict[str, Any]:
    return {
        name: {
            "value": p.value,
            "unit": p.unit,
            "low": _finite(p.low),
            "high": _finite(p.high),
            "bounds": [_finite(p.bounds[0]), _finite(p.bounds[1])],
            "source": p.source,
        }
        for name, p in parameters.items()
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _from_data(data: Mapping[str, Any]) -> Model:
    structure = Structure(
        bodies=tuple(Body(item["name"], float(item["mass"]["value"])) for item in data["bodies"]),
        links=tuple(_link(item) for item in data["links"]),
    )
    return Model(
        structure=structure,
        link_laws={item["name"]: _laws_from_data(item) for item in data["links"]},
        effects=_effects_from_data(data["effects"]),
        filter_cutoff_hz=data["filter"]["cutoff_hz"],
        calibration=tuple(float(value) for value in data["calibration"]["coefficients"]),
        windows={name: (float(low), float(high)) for name, (low, high) in data["windows"].items()},
        sampling=data["sampling"],
        uncoupled_laws={item["name"]: _laws_from_data(item) for item in data.get("uncoupled_links", ())},
    )


def _link(item: Mapping[str, Any]) -> Link:
    first, second = item["between"]
    return Link(item["name"], first, second, item["law"])


def _effects_from_data(items: list[Mapping[str, Any]]) -> tuple[Any, ...]:
    if not items:
        return ()
    from rom.effects import make

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
