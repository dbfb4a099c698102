"""Results of a blind test: the cells of its experiment, or one table of them all.

The table has a line of JSON for each campaign, with what the tables in Markdown need of it and no more;
numbers have seven significant digits.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.studies import rig
from experiments.studies.blind.scores import MEASURES, Found, Result
from experiments.studies.blind.trials import Group
from experiments.studies.experiment.cell import CELLS, RESULT
from rom.campaign.record import replacing

TABLE = "results.jsonl"
"""Name of the table in a folder of results."""
_DIGITS = 7
_HEAD = ("group", "label", "seed", "noise", "program", "program_version", "closing_cpu_s", "peak_mb", "fault")


def read_results(folder: Path) -> list[dict[str, Any]]:
    """Return all results in a folder: those of its table, then those of cells that are not in it, by name."""
    table = folder / TABLE
    rows = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
    results = [json.loads(row) for row in rows]
    known = {_key(result) for result in results}
    cells = (result_of_cell(path.parent) for path in folder.glob(f"{CELLS}/[!.]*/{RESULT}"))
    return results + sorted((one for one in cells if _key(one) not in known), key=_key)


def result_of_cell(folder: Path) -> dict[str, Any]:
    """Return what a cell says: what was hidden, the closure, the oracle; of one that failed, its message."""
    cell = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    hidden, settings = cell["settings"]["rig.undeclared"], cell["settings"]
    label = " + ".join(hidden) or "clean"
    head = {"group": group_of(hidden), "label": label, "seed": settings["rig.seed"]}
    head |= {"noise": settings["rig.noise"], "program_version": cell["program_version"]}
    if cell["status"] != "ok":
        return {**head, "fault": cell["message"]}
    closure = json.loads((folder / "closure.json").read_text(encoding="utf-8"))
    told = {key: cell["numbers"][key] for key in ("program", "truth", "oracle")}
    return {**head, **told, "closure": closure, "closing_cpu_s": cell["cpu_s"], "peak_mb": cell["peak_mb"]}


def group_of(hidden: Sequence[str]) -> Group:
    """Return the group of a campaign that hides effects ``NAME@PLACE``."""
    if len(hidden) != 1:
        return "two" if hidden else "clean"
    return "outside" if rig.KINDS[hidden[0].partition("@")[0]].outside else "one"


def _key(result: Result) -> tuple[Any, ...]:
    """What makes a trial another one, as results are ordered."""
    return tuple(result[key] for key in ("group", "label", "noise", "seed"))


def write_table(results: Iterable[Result], path: Path) -> None:
    """Write results as a table, a line each."""
    lines = [json.dumps(table_row(result), ensure_ascii=False) for result in results]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def table_row(result: Result) -> dict[str, Any]:
    """Return what the tables need of a campaign's result."""
    row = {key: result[key] for key in _HEAD if key in result}
    if "fault" not in result:
        row |= {"truth": [_true_effect(truth) for truth in result["truth"]]}
        row |= {"closure": _closure(result["closure"]), "oracle": _oracle(result["oracle"])}
    rounded: dict[str, Any] = _rounded(row)
    return rounded


def _true_effect(truth: Found) -> dict[str, Any]:
    return {
        "name": truth["name"],
        "enters": truth["enters"],
        "nearest": truth["nearest"],
        "influence_percent": truth["influence_percent"],
        "parameters": _values(truth["parameters"], ("value",)),
    }


def _closure(closure: Mapping[str, Any]) -> dict[str, Any]:
    errors = closure["errors"]["hold_out"]
    return {
        "verdict": closure["verdict"],
        "effects": [
            {
                "name": effect["name"],
                "enters": effect["enters"],
                "source": effect["source"],
                "parameters": _values(effect["parameters"], ("value", "low", "high")),
                "look_alikes": [
                    {"name": other["name"], "enters": other["enters"]} for other in effect["look_alikes"]
                ],
            }
            for effect in closure["effects"]
        ],
        "errors": {"hold_out": {when: _measures(errors[when]) for when in ("before", "after")}},
    }


def _oracle(oracle: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _measures(oracle[key]) for key in ("hold_out", "true_values") if key in oracle}


def _measures(errors: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return None if errors is None else {measure: errors[measure] for measure in MEASURES}


def _values(parameters: Mapping[str, Mapping[str, Any]], keys: Iterable[str]) -> dict[str, Any]:
    return {name: {key: number[key] for key in keys} for name, number in parameters.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
