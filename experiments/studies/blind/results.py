"""Results of a blind test: a file for each campaign of a running test, or one table of them all.

The table has a line of JSON for each campaign, in the order of their files, with what the tables in Markdown
need of it and no more; numbers have seven significant digits.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from experiments.studies.blind.scores import MEASURES, Found, Result
from rom.campaign.record import replacing

TABLE = "results.jsonl"
"""Name of the table in a folder of results."""
_DIGITS = 7
_HEAD = ("group", "label", "seed", "noise", "program", "program_version", "closing_cpu_s", "peak_mb", "fault")


def read_results(folder: Path) -> list[dict[str, Any]]:
    """Return all results in a folder: those of its table, then those of files that are not in it, by name."""
    table = folder / TABLE
    rows = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
    results = [json.loads(row) for row in rows]
    known = {_key(result) for result in results}
    for path in sorted(folder.glob("*.json")):
        content = json.loads(path.read_text(encoding="utf-8"))
        if content.get("format") == "boltlaw-blind-trial/1" and _key(content) not in known:
            results.append(content)
    return results


def _key(result: Result) -> tuple[object, ...]:
    return tuple(result.get(key) for key in ("group", "label", "noise", "seed"))


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
