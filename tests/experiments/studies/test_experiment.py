"""Experiments as files: every cell once, on whatever carries it out, after whatever stopped it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import experiments
from discovery.laws.candidate import BASELINE
from experiments.results import plain
from experiments.studies.experiment import cell as one_cell
from experiments.studies.experiment import run as study
from experiments.studies.experiment.cells import Cell, read_experiment
from tests.discovery import driven_twins as twins
from tests.experiments.studies.experiment_files import HEAD, SMALL, WITHOUT_FIGURES, table_of

Boltlaw = Callable[..., Any]
LAW = '[[law]]\nname = "own"\nrate = "-a * abs(v) * T"\nparameters = { a = { value = 1.0, unit = "1/m" } }\n'


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Campaign and seed of every cell that is run, in place of the loop itself."""
    cells: list[tuple[str, int]] = []

    def closed(cell: Cell, campaign: Path, folder: Path, _jobs: int, then: Any) -> Path:
        then("the closure")
        cells.append((cell.source.name, cell.seed))
        if (campaign / "spoil").exists():
            raise ValueError("spoilt")
        errors = {
            "motion_nrmse": None, "link_force_nrmse": 0.1 + cell.seed / 3,
            "tension_loss_error_percent_median": None,
        }  # fmt: skip
        both = {"before": errors, "after": errors}
        found = {"effects": [], "verdict": "no-effect", "errors": {"hold_out": both, "training": both}}
        path = folder / "closure.json"
        path.write_text(json.dumps(found | {"campaign_digest": cell.source.digest}))
        return path

    monkeypatch.setattr(one_cell, "COMMANDS", dict.fromkeys(one_cell.COMMANDS, closed))
    return cells


def test_cells_are_the_product_of_what_each_command_uses(file: Path) -> None:
    file.write_text(
        HEAD
        + 'command = ["discover", "compare", "close"]\ncampaigns = ["one"]\nseeds = [3, 4]\n'
        + '[[rig]]\nname = "r"\ncases = 4\nlaw = ["power-2", "power-3"]\nnoise = 0.5\n'
        + '[search]\nmax_terms = [1, 2]\nlibraries = [["velocity"], ["velocity", "constant gamma"]]\n'
        + "[criteria.ranking]\nfolds = [4, 8]\n"
        + LAW
    )
    from discovery.search.libraries import LIBRARIES

    names = list(LIBRARIES)[:2]
    file.write_text(
        file.read_text().replace('"velocity"', f'"{names[0]}"').replace('"constant gamma"', f'"{names[1]}"')
    )
    found = read_experiment(file)
    assert [source.name for source in found.sources] == ["one", "r, law power-2", "r, law power-3"]
    count = dict.fromkeys(("discover", "compare", "close"), 0)
    for cell in found.cells:
        count[cell.command] += 1
    campaigns, seeds, folds = 3, 2, 2
    searches = 2 * 2
    assert count == {
        "discover": campaigns * seeds * folds * searches,
        "compare": campaigns * seeds * folds,
        "close": campaigns * seeds * folds,
    }
    assert len({cell.digest for cell in found.cells}) == len(found.cells)
    first = next(cell for cell in found.cells if cell.source.name == "r, law power-2")
    assert first.settings == {
        "rig.cases": 4, "rig.noise": 0.5, "rig.law": "power-2", "laws": "own",
        "libraries": [names[0]], "max_terms": 1, "criteria.ranking.folds": 4, "seed": 3,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nmae = 1\n", ("nmae: found an unknown key", '"name" (nearest')),
        ("[[rig]]\nstrenghts = [1.0]\n", ("rig[0].strenghts: found an unknown key", '"strengths"')),
        ("[[rig]]\n[[rig]]\nfoo = 1\n", ("rig[1].foo: found an unknown key", "cases", "noise")),
        ("[search]\nlibrary = ['x']\n", ("search.library: found an unknown key", '"libraries"')),
        ("[search]\nlibraries = ['velocty']\n", ("library: found 'velocty'", "expected one of")),
        ("[search]\nmax_terms = [1, 0]\n", ("search.max_terms: found 0", "a number of terms")),
        ("[criteria.rankng]\nfolds = 1\n", ("criteria: expected a group of", "'rankng'")),
        ("[criteria.ranking]\nfold = 1\n", ("criteria.ranking: expected numbers of", "got fold")),
        ("[criteria]\nranking = 8\n", ("criteria.ranking: found 8", "[criteria.GROUP]")),
        ("[[rig]]\ncases = 1\n", ("rig[0]: cases: got 1, expected at least 2",)),
        ("[[rig]]\nlaw = 'power-9'\n", ("rig[0]: law: got 'power-9'", "power-2")),
        ("[[rig]]\nundeclared = ['frction']\n", ("rig[0]: undeclared: ", "frction")),
        ("[[rig]]\ninfluence_percent = [60, 3]\n", ("rig[0]: influence_percent: got [60", "smallest")),
        (
            "[[rig]]\nundeclared = ['hum:A=1']\ninfluence_percent = [3, 60]\n",
            ("rig[0]: undeclared: got values in 'hum:A=1'", "drawn"),
        ),
        ("[[rig]]\nnoise = [1.0, 'low']\n", ("rig[0].noise: found 'low', expected a factor",)),
        ("[[rig]]\n[[rig]]\n", ("found one campaign twice, 'rig' and 'rig'",)),
        ("laws = ['none.toml']\n", ("none.toml: cannot be read",)),
        ("[[law]]\nname = 'own'\n", ("law[0].rate: found nothing, expected an expression",)),
        (LAW.replace("1/m", "1"), ("law[0]: law 'own': found a rate in", "expected N/s")),
    ],
)
def test_what_cannot_be_is_one_line_that_names_the_key(
    text: str, words: tuple[str, ...], file: Path, boltlaw: Boltlaw
) -> None:
    file.write_text(SMALL + text)
    told = boltlaw("run", file)
    assert told.code == 2
    (line,) = told.err.splitlines()
    assert line.startswith(str(file.parent))
    assert all(word in line for word in words), line
    assert not (file.parent / "slip-results").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("format: found nothing", "name: found nothing")),
        (HEAD, ("campaigns: found nothing",)),
        (HEAD.replace("/1", "/2"), ("format: found 'boltlaw-experiment/2'",)),
        (HEAD + 'command = "compare"\ncampaigns = ["one"]\n', ("laws: found nothing",)),
        (HEAD + 'command = "clsoe"\ncampaigns = ["one"]\n', ("command: found 'clsoe'", '"close"')),
        (HEAD + 'campaigns = ["none"]\n', ("campaigns[0]: ", "no such file")),
        (HEAD + 'campaigns = ["one", "./one"]\n', ("found one campaign twice, 'one' and './one'",)),
        ("name = [", ("not TOML",)),
        (
            HEAD + 'command = "close"\ncampaigns = [["one", "two"]]\n',
            ("'one + two'", '"discover" or "compare"'),
        ),
        (HEAD + 'campaigns = [["one"]]\n', ("campaigns: found", "lists of the folders")),
        (HEAD + "[[rig]]\nbolts = 1\n", ("rig[0]: bolts: got 1, expected 2 or more",)),
        (HEAD + "[[rig]]\nbetween_bolts = 0.5\n", ("rig[0]: between_bolts: got 0.5", "a number of bolts")),
        (SMALL + 'measure = "none:f"\n', ("measure: found 'none:f'", "MODULE:FUNCTION")),
    ],
)
def test_what_is_missing_is_told(text: str, words: tuple[str, ...], file: Path, boltlaw: Boltlaw) -> None:
    file.write_text(text)
    told = boltlaw("run", file)
    assert told.code == 2
    assert len(told.err.splitlines()) == len(words) if text == "" else 1
    assert all(word in told.err for word in words), told.err


def test_a_second_call_runs_nothing_and_writes_the_same(file: Path, ran: list[tuple[str, int]]) -> None:
    table = experiments.run_experiment(file)
    assert ran == [("one", 0), ("one", 1), ("two", 0), ("two", 1)]
    frame = table.to_frame()
    assert list(frame["error"]) == [100 * (0.1 + seed / 3) for seed in (0, 1, 0, 1)]
    assert list(frame["campaign"]) == ["one", "one", "two", "two"]
    first = table_of(table.path.parent)
    again = experiments.run_experiment(file)
    assert len(ran) == 4
    assert again.rows == table.rows
    assert table_of(table.path.parent) == first
    found = json.loads(table.path.read_text())
    assert [{k: row[k] for k in table.rows[0]} for row in found["cells"]] == list(plain(table.rows))
    assert [one["digest"] for one in found["campaigns"]] == [
        source.digest for source in read_experiment(file).sources
    ]
    assert (table.path.parent / "experiment.svg").is_file()


def test_only_cells_whose_settings_or_records_changed_run_again(
    file: Path, ran: list[tuple[str, int]]
) -> None:
    experiments.run_experiment(file)
    ran.clear()
    file.write_text(SMALL.replace("[0, 1]", "[1, 2]"))
    experiments.run_experiment(file)
    assert ran == [("one", 2), ("two", 2)]
    ran.clear()
    shutil.rmtree(file.parent / "two")
    twins.cycled(file.parent / "two", friction=0.0, seed=5, seconds=3.0)
    experiments.run_experiment(file)
    assert ran == [("two", 1), ("two", 2)]
    ran.clear()
    file.write_text(SMALL)  # as it was at first
    table = experiments.run_experiment(file)
    assert ran == [("two", 0)]
    assert len(table.rows) == 4


def test_a_failed_cell_does_not_stop_the_others(
    file: Path, ran: list[tuple[str, int]], boltlaw: Boltlaw
) -> None:
    (file.parent / "one" / "spoil").touch()
    told = boltlaw("run", file, "--out", file.parent / "out")
    assert told.code == 3
    assert told.err.splitlines() == ["2 of 4 cells failed, the first of them close of one: spoilt"]
    rows = json.loads((file.parent / "out" / "experiment.json").read_text())["cells"]
    assert [(row["status"], row["message"]) for row in rows] == [("failed", "spoilt")] * 2 + [("ok", "")] * 2
    ran.clear()
    (file.parent / "one" / "spoil").unlink()
    assert boltlaw("run", file, "--out", file.parent / "out").code == 0
    assert ran == [("one", 0), ("one", 1)]


def test_a_fault_of_the_program_in_a_cell_says_where(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_cell, "COMMANDS", {"close": lambda *_: {}["lost"]})
    table = experiments.run_experiment(file)
    assert len(table.failed) == 4
    assert table.rows[0]["message"].startswith("KeyError: 'lost' (test_experiment.py, line ")


@pytest.mark.usefixtures("ran")
def test_a_folder_of_other_results_is_refused(
    file: Path, monkeypatch: pytest.MonkeyPatch, boltlaw: Boltlaw
) -> None:
    folder = experiments.run_experiment(file).path.parent
    before = table_of(folder)
    file.write_text(SMALL.replace("slip", "other"))
    told = boltlaw("run", file)
    assert told.code == 2
    assert "found results of the experiment 'slip', expected those of 'other'" in told.err
    file.write_text(SMALL)
    monkeypatch.setattr(study, "program_version", lambda: "99.0")
    told = boltlaw("run", file)
    assert told.code == 2
    assert "found 4 cells of version" in told.err
    assert len(told.err.splitlines()) == 1
    assert table_of(folder) == before


@pytest.mark.usefixtures("ran")
def test_campaigns_of_the_rig_are_made_once_and_removed(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def rig(folder: Path, *_: Any, **options: Any) -> Path:
        made.append(options)
        folder.mkdir()
        return folder

    monkeypatch.setattr(one_cell.rig, "run", rig)
    rigs = '[[rig]]\nname = "r"\nseed = [1, 2]\nundeclared = ["coulomb-friction"]\nstrengths = [1, 0.5]\n'
    file.write_text(HEAD + 'command = "close"\nseeds = [0, 1]\n' + rigs)
    table = experiments.run_experiment(file)
    assert [row["status"] for row in table.rows] == ["ok"] * 4
    assert list(table.to_frame()["rig.seed"]) == [1, 1, 2, 2]
    assert [one["seed"] for one in made] == [1, 2]
    assert made[0]["strengths"] == (1.0, 0.5)
    assert [one.name for one in made[0]["undeclared"]] == ["coulomb-friction"]
    assert not (table.path.parent / "campaigns").exists()
    file.write_text(
        file.read_text().replace("seeds", "keep_campaigns = true\nseeds").replace("[0, 1]", "[0, 5]")
    )
    experiments.run_experiment(file)
    assert len(list((table.path.parent / "campaigns").glob("*/campaign"))) == 2


def test_several_bolts_are_one_cell(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders in a list of their own, or bolts of the rig: their campaigns go to the command together."""
    given: list[list[str]] = []
    limited = {"value": 0.47, "low": 0.3, "high": None}

    def rig(folder: Path, *_: Any, rate: float, **__: Any) -> Path:
        folder.mkdir()
        (folder / "rate").write_text(str(rate))
        return folder

    def ranked(cell: Cell, campaign: tuple[Path, ...], folder: Path, _jobs: int, _then: Any) -> Path:
        given.append([(one / "rate").read_text() if cell.source.options else one.name for one in campaign])
        law = {
            "name": BASELINE, "cross_validated_loss_error_percent_median": 12.0, "equation": "",
            "free_numbers": 1, "known_bolt_loss_error_percent_median": 5.0, "probability": 1.0,
            "p_value_against_baseline": None,
            "errors": {"hold_out": {}}, "indistinguishable": [],
        }  # fmt: skip
        found = {"laws": [law], "population": {"between_bolts": limited, "between_tests": limited}}
        path = folder / "ranking.json"
        path.write_text(json.dumps(found | {"campaign_digest": cell.source.digest}))
        return path

    monkeypatch.setattr(one_cell.rig, "run", rig)
    monkeypatch.setattr(one_cell, "COMMANDS", {"discover": ranked})
    text = HEAD + 'campaigns = [["one", "two"]]\n[[rig]]\nbolts = 3\nbetween_bolts = 0.5\n'
    file.write_text(text)
    table = experiments.run_experiment(file)
    assert not table.failed
    folders, rates = given
    assert folders == ["one", "two"]
    assert len({*rates}) == 3
    first = table.rows[0]
    assert (first["campaign"], first["error_of"]) == ("one + two", "tension loss, bolts left out")
    assert (first["known_bolt_error"], first["between_bolts"], first["between_bolts_low"]) == (5.0, 0.47, 0.3)
    assert not (table.path.parent / "campaigns").exists()


def columns(_result: object, campaign: Path) -> dict[str, object]:
    return {"folder": campaign.name, "number": 2, "nothing": float("nan")}


@pytest.mark.usefixtures("ran")
def test_columns_of_ones_own(file: Path) -> None:
    plain_table = experiments.run_experiment(file, file.parent / "plain")
    table = experiments.run_experiment(file, measure=columns)
    assert [row["folder"] for row in table.rows] == ["one", "one", "two", "two"]
    assert [row["number"] for row in table.rows] == [2] * 4
    assert [row["nothing"] for row in table.rows] == [None] * 4
    cells = [{row["cell"] for row in one.rows} for one in (plain_table, table)]
    assert not cells[0] & cells[1]  # without these columns it is another cell


def test_each_cell_in_a_process_of_its_own_measured_by_a_module_beside_the_file(file: Path) -> None:
    """A process that is killed, often for want of memory, fails its cell alone."""
    (file.parent / "own_columns.py").write_text(
        "import os\n\ndef pid(_, campaign):\n"
        "    return {'pid': os.getpid()} if campaign.name == 'one' else os.kill(os.getpid(), 9)\n"
    )
    text = WITHOUT_FIGURES + SMALL.replace("seeds", 'own_process = true\nmeasure = "own_columns:pid"\nseeds')
    file.write_text(text.replace("[0, 1]", "0"))
    table = experiments.run_experiment(file)
    assert [row["status"] for row in table.rows] == ["ok", "failed"]
    assert table.rows[0]["pid"] != os.getpid()
    assert "killed by signal 9" in table.failed[0]["message"]
    cell = json.loads(table.path.read_text())["cells"][0]
    assert cell["peak_mb"] > 50
    assert cell["cpu_s"] > 0


def test_a_measure_of_the_same_name_beside_another_file_is_not_taken_for_this_one(
    file: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    module = "def f(_, campaign):\n    return {}\n"
    other = tmp_path_factory.mktemp("other") / "slip.toml"
    for path in (other, file):
        (path.parent / "twice_named.py").write_text(module)
        path.write_text(HEAD + 'measure = "twice_named:f"\n[[rig]]\n')
    assert read_experiment(other).cells[0].measure is not None
    with pytest.raises(ValueError, match=r"slip.toml: measure: found the module 'twice_named' in .*other"):
        read_experiment(file)
