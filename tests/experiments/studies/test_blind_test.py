"""The blind test: what it plans, how it scores closures made by hand, its tables, and how it goes on."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w

from experiments.studies import rig
from experiments.studies.blind.__main__ import main
from experiments.studies.blind.measure import measured
from experiments.studies.blind.results import TABLE, read_results, table_row, write_table
from experiments.studies.blind.scores import (
    answer,
    has_needless,
    how_many_found,
    is_confident,
    is_nearest,
    kind_of_place,
    ratio,
    same_class,
    score,
)
from experiments.studies.blind.tables import tables
from experiments.studies.blind.trials import experiment_of, planned
from experiments.studies.experiment.cells import NamedMeasure, read_experiment
from rom.effects import CATALOGUE

Row = dict[str, Any]


def found(name: str, enters: str, *alike: str, source: str = "catalogue", **values: float) -> Row:
    numbers = {key: {"value": v, "low": 0.9 * v, "high": 1.1 * v, "unit": "1"} for key, v in values.items()}
    listed = [{"name": one, "enters": enters, "hold_out_cost": 1.02, "test": ""} for one in alike]
    return {"name": name, "enters": enters, "parameters": numbers, "look_alikes": listed, "source": source}


def hidden(name: str, enters: str, nearest: str | None = None, motion: float = 20.0, **values: float) -> Row:
    return {
        "name": name, "enters": enters, "nearest": nearest,
        "parameters": {key: {"value": value, "unit": "1"} for key, value in values.items()},
        "influence_percent": {"motion": motion, "loss": 1.0, "reading": 2.0, "percent": max(motion, 3.0)},
    }  # fmt: skip


def errors(motion: float, tension: float = 0.5) -> Row:
    return {
        "motion_nrmse": motion, "relative_motion_nrmse": 2 * motion,
        "tension_loss_error_percent_median": 10.0, "tension_rmse_n": tension,
    }  # fmt: skip


def result(
    group: str,
    truth: list[Row],
    effects: list[Row],
    verdict: str = "closed",
    after: Row | None = None,
    noise: float = 1.0,
) -> Row:
    held_out = {"before": errors(0.4, 1.0), "after": after or errors(0.044)}
    return {
        "group": group,
        "label": " + ".join(f"{one['name']}@{one['enters']}" for one in truth) or "clean",
        "noise": noise,
        "program": "a1",
        "seed": 0,
        "truth": truth,
        "closure": {"verdict": verdict, "effects": effects, "errors": {"hold_out": held_out}},
        "oracle": {"hold_out": errors(0.04, 0.25)},
        "closing_cpu_s": 60.0,
        "peak_mb": 1300.0,
    }


CUBIC = hidden("cubic-stiffness", "joint", k3=2.0)


def line(text: str, start: str) -> str:
    return next(one for one in text.splitlines() if one.startswith(f"| {start}"))


def cells(text: str, start: str) -> list[str]:
    return [cell.strip() for cell in line(text, start).strip("|").split("|")]


def test_name_class_listing_and_place_are_scored_apart() -> None:
    right = score(result("one", [CUBIC], [found("cubic-stiffness", "joint")]))
    assert (right.name, right.class_, right.listed, right.unwarned) == (True, True, True, False)
    assert right.kind_of_place
    assert right.place
    alike = score(result("one", [CUBIC], [found("two-sided-gap", "flexure_lo", "cubic-stiffness")]))
    assert (alike.name, alike.class_, alike.listed, alike.unwarned) == (False, True, True, False)
    assert alike.kind_of_place
    assert not alike.place


def test_a_wrong_name_without_the_truth_beside_it_is_unwarned() -> None:
    wrong = score(result("one", [CUBIC], [found("force-gain", "sensor:force_lo", "acceleration-gain")]))
    assert wrong.unwarned
    assert sum(vars(wrong).values()) == 1
    form = score(result("one", [CUBIC], [found("free-form", "joint", source="free-form")]))
    assert not form.unwarned
    assert form.place
    assert not form.class_


def test_nothing_found_scores_nothing_and_names_nothing_wrong() -> None:
    assert not any(vars(score(result("one", [CUBIC], [], "no-effect"))).values())


def test_only_the_effect_named_first_counts() -> None:
    effects = [found("force-gain", "sensor:force_lo"), found("cubic-stiffness", "joint")]
    assert not score(result("one", [CUBIC], effects)).name
    assert not has_needless(result("one", [CUBIC], effects))
    assert has_needless(result("one", [CUBIC], effects[::-1]))
    assert not has_needless(result("one", [CUBIC], [], "no-effect"))


@pytest.mark.parametrize(
    ("enters", "kind"),
    [
        ("joint", "link"),
        ("flexure_lo", "link"),
        ("body:so", "body"),
        ("tension", "tension"),
        ("sensor:tension", "sensor"),
    ],
)
def test_kinds_of_place(enters: str, kind: str) -> None:
    assert kind_of_place(enters) == kind


def test_classes_are_those_of_the_catalogue() -> None:
    assert same_class("cubic-stiffness", "two-sided-gap")
    assert not same_class("cubic-stiffness", "force-gain")
    assert not same_class("cubic-stiffness", "free-form")
    assert same_class("free-form", "free-form")


def test_two_hidden_effects_must_be_found_by_two() -> None:
    truth = [CUBIC, hidden("force-gain", "sensor:force_lo")]
    both = [found("force-gain", "sensor:force_lo"), found("two-sided-gap", "joint", "cubic-stiffness")]
    assert how_many_found(result("two", truth, both)) == 2
    assert how_many_found(result("two", truth, both[:1])) == 1
    one_for_two = [found("two-sided-gap", "joint", "cubic-stiffness", "force-gain")]
    assert how_many_found(result("two", truth, one_for_two)) == 1
    assert how_many_found(result("two", truth, [])) == 0
    elsewhere = [both[0], found("cubic-stiffness", "flexure_lo")]
    assert how_many_found(result("two", truth, elsewhere)) == 2
    assert how_many_found(result("two", truth, elsewhere), placed=True) == 1
    assert how_many_found(result("two", truth, both), placed=True) == 2


def test_a_name_of_the_catalogue_is_confident_only_in_a_closed_verdict() -> None:
    truth = [hidden("outside-fractional-drag", "joint", "quadratic-damping")]
    named = [found("displacement-damping", "joint", "quadratic-damping")]
    closed = result("outside", truth, named)
    assert is_confident(closed)
    assert is_nearest(closed)
    assert answer(closed) == "closed, catalogue"
    assert answer(result("outside", truth, named, "unexplained")) == "unexplained"
    form = [found("free-form", "joint", source="free-form")]
    assert answer(result("outside", truth, form)) == "closed, free-form"
    assert not is_nearest(result("outside", [hidden("outside-even-drag", "joint")], named))


def test_ratios_are_of_what_the_effect_acts_on() -> None:
    motion = result("one", [CUBIC], [])
    assert ratio(motion, "before") == pytest.approx(0.11)
    assert ratio(motion, "oracle") == pytest.approx(1.1)
    tension = result("one", [hidden("loosening-power", "tension")], [])
    assert ratio(tension, "oracle") == pytest.approx(2.0)
    both = result("two", [CUBIC, hidden("loosening-power", "tension")], [])
    assert ratio(both, "before") == pytest.approx(0.5)
    assert np.isnan(ratio(both | {"oracle": {"hold_out": None}}, "oracle"))


def test_the_summary_sets_what_is_reached_beside_what_is_asked() -> None:
    rows = [
        result("clean", [], [], "no-effect"),
        result("clean", [], [found("hum", "sensor:force_lo")]),
        result("one", [CUBIC], [found("cubic-stiffness", "joint", k3=2.1)]),
        result("one", [CUBIC], [found("force-gain", "sensor:force_lo")], after=errors(0.2)),
        result("outside", [hidden("outside-even-drag", "joint")], [], "unexplained"),
        result("outside", [hidden("outside-even-drag", "joint")], [found("hum", "sensor:force_lo")]),
        result("two", [CUBIC, hidden("hum", "sensor:tension")], [found("hum", "sensor:tension")]),
    ]
    text = tables(rows)
    assert cells(text, "no effect: verdict")[1:] == [">= 95 %", *["50 % (1 of 2)"] * 2]
    assert cells(text, "one effect: class")[1:] == [">= 85 %", *["50 % (1 of 2)"] * 2]
    assert cells(text, "one effect: wrong name")[2] == "50 % (1 of 2)"
    assert cells(text, "motion changed")[1:] == ["<= 0.25", *["0.30 (0.11-0.50)"] * 2]
    assert cells(text, "one effect: named or listed")[2] == "50 % (1 of 2)"
    assert cells(text, "one effect: a name after")[2] == "0 % (0 of 2)"
    assert cells(text, "one effect: 95 % limits")[2] == "100 % (1 of 1)"
    assert cells(text, "outside: free-form or")[2] == "50 % (1 of 2)"
    assert cells(text, "outside: closed by another")[2] == "50 % (1 of 2)"
    assert cells(text, "two effects: one found")[2] == "100 % (1 of 1)"
    assert cells(text, "named: hum@sensor:force_lo")[1] == "1"
    assert cells(text, "cubic-stiffness@joint + ")[1:5] == [
        "20, 20",
        "hum@sensor:tension",
        "1",
        "closed, catalogue",
    ]
    assert "| k3 | 1 | 1.05 | 1 of 1 |" in text


def test_what_is_hardly_felt_counts_in_the_second_column_alone() -> None:
    weak = CUBIC | {"influence_percent": {"motion": 1.3, "loss": 0.0, "reading": 0.9, "percent": 1.3}}
    rows = [
        result("clean", [], [], "no-effect"),
        result("one", [CUBIC], [found("cubic-stiffness", "joint")]),
        result("one", [weak], [], "no-effect"),
        result("two", [weak, hidden("hum", "sensor:tension")], [found("hum", "sensor:tension")]),
    ]
    text = tables(rows)
    assert cells(text, "no effect: verdict")[2:] == ["100 % (1 of 1)"] * 2
    assert cells(text, "one effect: itself first or")[2:] == ["100 % (1 of 1)", "50 % (1 of 2)"]
    assert cells(text, "two effects: one found")[2:] == ["-", "100 % (1 of 1)"]


def test_a_row_tells_an_effect_and_what_was_named_in_its_place() -> None:
    rows = [
        result("one", [CUBIC], [found("cubic-stiffness", "joint")]),
        result("one", [CUBIC], [found("bouc-wen", "joint", "jenkins-slip")], "unexplained"),
    ]
    row = cells(tables(rows), "cubic-stiffness | 2")
    assert row[1:9] == ["2", "20 (20-20)", *["1 of 2"] * 4, *["2 of 2"] * 2]
    assert row[10:13] == ["0.4", "0.044", "0.04"]
    assert row[-2:] == ["bouc-wen 1", "jenkins-slip 1"]


def test_effects_are_told_by_kind_with_errors_of_what_they_act_on() -> None:
    gauge, skew = (
        hidden("calibration-error", "sensor:tension"),
        hidden("acceleration-skew", "sensor:acceleration_lo"),
    )
    weak = gauge | {"influence_percent": {"motion": 0.0, "loss": 1.0, "reading": 1.0, "percent": 1.0}}
    rows = [
        result("one", [CUBIC], [found("cubic-stiffness", "joint")]),
        result("one", [gauge], [], "no-effect"),
        result("one", [weak], [], "no-effect"),
        result("one", [skew], [found("acceleration-skew", "sensor:acceleration_lo")]),
    ]
    text = tables(rows)
    force, sensor, gauge_s = (cells(text, kind)[1:] for kind in ("force |", "sensor |", "sensor, tension's"))
    assert force == ["1", "1", force[2], *["1 of 1"] * 3, "0.4", "0.044", "0.04", "in 0"]
    assert sensor[:2] + sensor[3:6] == ["1", "1", *["1 of 1"] * 3]
    assert gauge_s[3:] == ["0 of 1"] * 3 + ["1 N", "0.5 N", "0.25 N", "in 0"]
    assert float(force[2]) == CUBIC["influence_percent"]["percent"]


def test_levels_of_noise_and_faults_are_told_apart() -> None:
    clean = result("clean", [], [], "no-effect")
    broken = {"group": "one", "label": "hum@sensor:tension", "noise": 2.0, "fault": "no", "program": "b2"}
    text = tables([clean, clean | {"noise": 2.0}, broken])
    assert "## Noise x 1: 1 campaigns" in text
    assert "## Noise x 2: 1 campaigns" in text
    assert "- hum@sensor:tension: no" in text
    assert text.count("states of the program") == 1


def test_every_core_effect_is_planned_once_for_every_seed() -> None:
    trials = planned(clean=3, each=2, outside=1, two=2, first=10)
    core = sorted(name for name, member in CATALOGUE.items() if member.core)
    for seed in (10, 11):
        assert sorted(t.hidden[0][0] for t in trials if t.group == "one" and t.seed == seed) == core
    assert [t.seed for t in trials if t.group == "clean"] == [10, 11, 12]
    assert all(rig.KINDS[t.hidden[0][0]].outside for t in trials if t.group == "outside")
    assert len(set(trials)) == len(trials)
    assert [t.seed for t in trials] == sorted(t.seed for t in trials)


def test_every_campaign_draws_its_noise_and_no_other_number_by_it() -> None:
    one, many = planned(clean=30, each=1), planned(clean=30, each=1, noise=[0.5, 1.0, 2.0])
    assert {t.noise for t in one} == {1.0}
    counts = [sum(t.noise == level for t in many) for level in (0.5, 1.0, 2.0)]
    assert min(counts) > len(many) / 6
    assert [(t.group, t.seed, t.hidden) for t in one] == [(t.group, t.seed, t.hidden) for t in many]
    assert many == planned(clean=30, each=1, noise=[0.5, 1.0, 2.0])


def test_places_are_visited_in_turn_unless_one_is_named() -> None:
    turns = planned(each=3, names=["cubic-stiffness"])
    assert [t.hidden[0][1] for t in turns] == ["joint", "flexure_lo", "flexure_so"]
    hammers = planned(each=2, names=["force-gain"])
    assert [t.hidden[0][1] for t in hammers] == ["sensor:force_lo"] * 2  # so is struck in one test alone
    named = planned(each=2, names=["cubic-stiffness@flexure_so"])
    assert [t.hidden[0][1] for t in named] == ["flexure_so"] * 2
    with pytest.raises(ValueError, match="cubic-stiffness"):
        planned(each=1, names=["cubic-stifness"])


def test_pairs_share_no_class_and_go_with_the_seed() -> None:
    for trial in planned(two=20):
        (one, _), (other, _) = trial.hidden
        assert not same_class(one, other)
    assert planned(two=1, first=4)[0] == planned(two=5)[4]


def test_a_test_is_an_experiments_file(tmp_path: Path) -> None:
    """A cell for each trial, those of the first seed first."""
    trials = planned(clean=2, each=2, two=2, names=["cubic-stiffness", "hum@sensor:tension"])
    (tmp_path / "blind.toml").write_text(tomli_w.dumps(experiment_of(trials)))
    experiment = read_experiment(tmp_path / "blind.toml")
    assert experiment.own_process
    told = [(c.settings["rig.seed"], c.settings["rig.undeclared"]) for c in experiment.cells]
    assert told == [(t.seed, [f"{name}@{enters}" for name, enters in t.hidden]) for t in trials]
    (measure,) = {cell.measure for cell in experiment.cells}
    assert isinstance(measure, NamedMeasure)
    assert measure.function is measured
    assert {(cell.command, cell.seed) for cell in experiment.cells} == {("close", 0)}
    assert experiment.sources[1].name == "seed 0, noise 1, undeclared cubic-stiffness@joint"


def cell_of(row: Row, folder: Path) -> None:
    """The folder of a cell as a run leaves it."""
    cell = folder / "cells" / f"{row['group']}{row['seed']}"
    cell.mkdir(parents=True)
    hidden = [] if row["label"] == "clean" else row["label"].split(" + ")
    content = {
        "settings": {"rig.undeclared": hidden, "rig.seed": row["seed"], "rig.noise": row["noise"]},
        "program_version": "0.1",
        "status": "failed" if "fault" in row else "ok",
        "message": row.get("fault", ""),
    }
    if "fault" not in row:
        content["numbers"] = {key: row[key] for key in ("program", "truth", "oracle")}
        content |= {"cpu_s": row["closing_cpu_s"], "peak_mb": row["peak_mb"]}
        (cell / "closure.json").write_text(json.dumps(row["closure"]))
    (cell / "cell.json").write_text(json.dumps(content))


def test_results_are_those_of_cells_a_fault_among_them(tmp_path: Path) -> None:
    broken = {"group": "outside", "label": "outside-even-drag@joint", "seed": 4, "noise": 2.0}
    one = result("one", [CUBIC], [found("cubic-stiffness", "joint")])
    for row in (one, broken | {"fault": "ZeroDivisionError: by nothing"}):
        cell_of(row, tmp_path)
    (tmp_path / "cells" / ".making-x").mkdir()
    read = read_results(tmp_path)
    assert table_row(read[0]) == table_row(one) | {"program_version": "0.1"}
    assert read[1] == broken | {"program_version": "0.1", "fault": "ZeroDivisionError: by nothing"}


def test_the_tables_alone_need_no_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = result("one", [CUBIC], [found("cubic-stiffness", "joint")])
    cell_of(row, tmp_path)
    main(["--out", str(tmp_path), "--table-only"])
    shown = capsys.readouterr().out
    assert "100 % (1 of 1)" in line(shown, "one effect: itself first |")
    assert (tmp_path / "tables.md").read_text() == shown


def test_the_truth_and_what_could_be_reached_are_set_beside_a_closure(tmp_path: Path) -> None:
    rig.truth_path(tmp_path / "campaign").write_text(json.dumps({"undeclared": []}))
    closure: Any = SimpleNamespace(before={"hold_out": errors(0.1)})
    told = measured(closure, tmp_path / "campaign")
    assert told["truth"] == []
    assert told["oracle"] == {"kind": "declared", "hold_out": errors(0.1)}
    rig.truth_path(tmp_path / "campaign").write_text(json.dumps({"undeclared": [{"name": "hum"}]}))
    told = measured(closure, tmp_path / "campaign")
    assert told["oracle"]["hold_out"] is None  # the closure stands without its measure
    assert told["oracle"]["fault"].startswith("KeyError")


def test_the_stored_tables_are_those_of_the_stored_results() -> None:
    stored = Path(__file__).parents[3] / "docs" / "blind"
    assert (stored / "tables.md").read_text(encoding="utf-8") == tables(read_results(stored)) + "\n"


def test_gathered_results_give_the_same_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        result("one", [CUBIC], [found("cubic-stiffness", "joint")]),
        result("clean", [], [], "no-effect"),
        {"group": "clean", "label": "clean", "noise": 1.0, "fault": "ValueError: no"},
    ]
    for place, row in enumerate(rows):
        cell_of(row | {"seed": place}, tmp_path)
    table = tmp_path / "gathered" / TABLE
    table.parent.mkdir()
    main(["--out", str(tmp_path), "--table-only", "--gather", str(table)])
    shown = capsys.readouterr().out
    assert "ValueError: no" in shown
    main(["--out", str(table.parent), "--table-only"])
    assert capsys.readouterr().out == shown


def test_a_cell_that_the_table_holds_counts_once(tmp_path: Path) -> None:
    row = result("clean", [], [], "no-effect") | {"seed": 3}
    write_table([row], tmp_path / TABLE)
    for seed in (3, 4):
        cell_of(row | {"seed": seed}, tmp_path)
    assert [one["seed"] for one in read_results(tmp_path)] == [3, 4]
