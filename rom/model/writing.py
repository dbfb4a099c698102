"""model.json: a model written as a file that people can read; `rom.model_file` reads it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rom.campaign.record import replacing
from rom.model.description import LinkLaws, ModelDescription
from rom.model.laws import Law, Parameter
from rom.model.shapes import ModeShapes
from rom.model.structure import Link
from rom.provenance import program_version, versions

FORMAT = "boltlaw-model/1"


def write_model(model: ModelDescription, path: Path, header: Mapping[str, object]) -> None:
    """Write a model; the file appears whole or not at all.

    Parameters
    ----------
    model : ModelDescription
        The model.
    path : Path
        The file.
    header : mapping of str to object
        Entries of the head.
    """
    head = {
        "format": FORMAT,
        "campaign": None,
        "program_version": program_version(),
        "versions": versions(),
        "seed": None,
        "elapsed_s": None,
    }
    text = json.dumps({**head, **header, **_as_data(model)}, indent=2, allow_nan=False) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _as_data(model: ModelDescription) -> dict[str, Any]:
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
        **({} if model.shapes is None else {"modes": _shapes_as_data(model.shapes)}),
        "rate_uncertainty": None if model.rate_uncertainty is None else model.rate_uncertainty.as_data(),
    }


def _shapes_as_data(shapes: ModeShapes) -> dict[str, Any]:
    return {
        "sensors": list(shapes.sensors),
        "names": list(shapes.modes),
        "forces": list(shapes.forces),
        "numbers": _parameters(shapes.numbers),
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
            "low": _finite(p.limits[0]),
            "high": _finite(p.limits[1]),
            "bounds": [_finite(p.bounds[0]), _finite(p.bounds[1])],
            "source": p.source,
            **({"at_bound": True} if p.at_bound else {}),
        }
        for name, p in parameters.items()
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
