"""An experiment's result file as a figure and as a page: no number in them that is not in the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from experiments.figures.experiment import experiment_figures
from experiments.figures.style import save
from experiments.results import write_result
from experiments.studies import report


def cell(command: str, campaign: str, error: float | None, **more: Any) -> dict[str, Any]:
    of = "motion, hold-out" if command == "close" else "tension loss, bolts left out"
    head = {"cell": "a1", "command": command, "campaign": campaign, "seed": 0, "settings": {}}
    if error is None:
        return {**head, "status": "failed", "message": "spoilt"}
    told = {"error": error, "error_of": of, "error_before": 7 * error}
    return {**head, "status": "ok", "message": "", **told, **more}


CELLS = [
    cell("discover", "a + b", 12.5, first="slip", between_bolts=0.47, between_bolts_low=0.3),
    cell("compare", "a + b", 13.5, first="slip"),
    cell("close", "c", 3.25, first="hum@sensor:force_lo", verdict="closed", oracle={"hold_out": {}}),
    cell("close", "d", None),
]


def test_a_legend_names_what_each_command_compares() -> None:
    laws, effects = experiment_figures({"cells": CELLS})["experiment"].axes
    told = [[text.get_text() for text in axes.get_legend().get_texts()] for axes in (laws, effects)]
    assert told == [["γ(T)", "first law"], ["declared model", "refined model"]]
    assert [text.get_text() for text in laws.get_yticklabels()] == ["a + b, discover", "a + b, compare"]


def test_the_page_of_an_experiment_has_its_table_and_its_figure(tmp_path: Path) -> None:
    content = {"name": "slip and hum", "cells": CELLS}
    write_result(tmp_path / "experiment.json", "experiment", content, campaign=None, seed=None, elapsed_s=1.0)
    save(experiment_figures(content)["experiment"], tmp_path / "experiment.svg")
    page = report.run(tmp_path).read_text(encoding="utf-8")
    assert "<h1>slip and hum</h1>" in page
    assert "3 of 4 cells are done; 1 failed." in page
    assert "close of d: spoilt" in page
    assert "<h2>The experiment</h2>" in page
    for text in ("hum@sensor:force_lo", "12.5", "22.8", "0.470 (0.300 to –)", "closed"):
        assert f">{text}</td>" in page
    assert "Errors of all cells" in page
