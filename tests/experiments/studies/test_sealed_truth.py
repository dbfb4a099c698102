"""What is hidden in a campaign of the blind test is not read before its loop has ended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from experiments import run_experiment
from experiments.studies import rig
from experiments.studies.blind.trials import MEASURE
from experiments.studies.experiment import cell as one_cell
from experiments.studies.experiment.cells import Cell
from tests.experiments.studies.experiment_files import HEAD
from tests.experiments.studies.test_blind_test import CUBIC


def test_the_truth_need_not_be_there_before_the_loop_has_ended(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is absent while the cell closes, read by the score; what it says changes nothing of the closure."""
    truth = rig.truth_path(file.parent / "one")

    def sealed(cell: Cell, campaign: Any, folder: Path, jobs: int, then: Any) -> Path:
        def opened(closure: Any) -> None:
            truth.write_text(json.dumps({"undeclared": []}))
            then(closure)

        assert not truth.exists()
        return close(cell, campaign, folder, jobs, opened)

    close = one_cell.COMMANDS["close"]
    file.write_text(f'{HEAD}command = "close"\ncampaigns = ["one"]\nmeasure = "{MEASURE}"\n')
    with monkeypatch.context() as patched:
        patched.setattr(one_cell, "COMMANDS", {"close": sealed})
        (blind,) = run_experiment(file, file.parent / "blind").rows
    assert (blind["status"], blind["truth"], blind["oracle"]["kind"]) == ("ok", [], "declared")
    truth.write_text(json.dumps({"undeclared": [CUBIC]}))
    (told,) = run_experiment(file, file.parent / "told").rows
    assert told["truth"] == [CUBIC]
    one, other = (
        json.loads(next((file.parent / out).glob("cells/*/closure.json")).read_text())
        for out in ("blind", "told")
    )
    assert {key for key in one if one[key] != other[key]} <= {"elapsed_s"}
