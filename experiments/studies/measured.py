"""Write docs/measured.md: what `boltlaw close` finds in measured data of others.

`python -m experiments.studies.measured` writes the page from the references in docs/measured/. With
SET=RESULTS it first takes the results of `boltlaw close` in the folder RESULTS as that set's reference.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.results import plain
from experiments.text.measured import SETS, page
from rom.campaign.channels import one_of
from rom.campaign.record import replacing

FORMAT = "boltlaw-measured/1"
_LEFT_OUT = ("curve",)  # of an effect: large, and drawn in the report only
_MAPS = ("displacement_m", "velocity_m_per_s", "force_n", "loop")  # of a force: large, and drawn at once


class MeasuredError(ValueError):
    """Results that cannot become a reference; the message says what was found and expected."""


def reference(name: str, results: Path) -> dict[str, Any]:
    """Return the reference of a set: closure.json and the refined model's parameters, small.

    Raises
    ------
    ValueError
        If the set is not known, or the folder does not hold what `boltlaw close` writes.
    """
    if name not in SETS:
        raise MeasuredError(f"{name}: found no such set, expected {one_of(name, SETS)}")
    closure = _read(results / "closure.json", "boltlaw-closure/1")
    model = _read(results / "model.json", "boltlaw-model/1")
    if closure.get("campaign") != model.get("campaign"):
        raise MeasuredError(f"{results}: found closure.json and model.json of two campaigns, expected one")
    effects = [
        {key: value for key, value in effect.items() if key not in _LEFT_OUT} for effect in closure["effects"]
    ]
    residual = {when: _without_maps(views) for when, views in closure["residual"].items()}
    kept = {**closure, "effects": effects, "residual": residual}
    return {
        "format": FORMAT,
        "set": name,
        "closure": kept,
        "model": {key: model[key] for key in ("bodies", "links", "effects")},
    }


def _without_maps(views: Mapping[str, Any]) -> dict[str, Any]:
    forces = [{k: v for k, v in one.items() if k not in _MAPS} for one in views.get("forces", ())]
    return {**views, "forces": forces} if forces else dict(views)


def _read(path: Path, expected: str) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise MeasuredError(f"{path}: found no such file, expected one by `boltlaw close`") from None
    except ValueError as cause:
        raise MeasuredError(f"{path}: found {cause}, expected JSON") from None
    found = data.get("format") if isinstance(data, dict) else None
    if found != expected:
        raise MeasuredError(f"{path}: format: found {found!r}, expected {expected!r}")
    return dict(data)


def run(docs: Path, results: Mapping[str, Path]) -> Path:
    """Store references of new results, then write page and figures of all references; return the page.

    Raises
    ------
    ValueError
        If results or a reference are not what they should be; nothing is written then.
    """
    from experiments.figures.closure import closure_figures
    from experiments.figures.style import save

    new = {name: reference(name, folder) for name, folder in results.items()}
    stored = {path.stem: _read(path, FORMAT) for path in sorted((docs / "measured").glob("*.json"))}
    every = {**stored, **new}
    text = page(every)
    figures = {name: closure_figures(one["closure"]).get("closure-residual") for name, one in every.items()}
    for name, folder in results.items():
        closure = _read(folder / "closure.json", "boltlaw-closure/1")
        figures[f"{name}-force"] = closure_figures(closure).get("closure-force")
    for folder in (docs / "measured", docs / "images"):
        folder.mkdir(parents=True, exist_ok=True)
    for name, one in new.items():
        content = json.dumps(plain(one), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        _write(docs / "measured" / f"{name}.json", content)
    for name, figure in figures.items():
        if figure is not None:
            save(figure, docs / "images" / f"measured-{name}.svg")
    return _write(docs / "measured.md", text)


def _write(path: Path, text: str) -> Path:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page; a fault of the input takes one line."""
    parser = argparse.ArgumentParser("python -m experiments.studies.measured", description=__doc__)
    parser.add_argument("results", nargs="*", metavar="SET=RESULTS", help="new results of boltlaw close")
    parser.add_argument("--docs", type=Path, default=Path("docs"), metavar="DIR", help="default: docs")
    options = parser.parse_args(arguments)
    pairs = [text.partition("=") for text in options.results]
    if wrong := [name for name, _, folder in pairs if not folder]:
        parser.error(f"found {wrong[0]}, expected SET=RESULTS")
    try:
        path = run(options.docs, {name: Path(folder) for name, _, folder in pairs})
    except ValueError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
