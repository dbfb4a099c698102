"""`boltlaw close --bootstrap N`: replicates that appear whole, go on after a kill, do not depend on jobs."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from experiments.run.execution import execution
from experiments.studies import bootstrap, close
from experiments.text.bootstrap_table import bootstrap_table
from rom.campaign.campaign import read_campaign
from rom.parameters.he_2025 import paper_model
from tests.rom.sound_campaign import write_loosening_campaign

Boltlaw = Callable[..., Any]
RATE_HZ = 4800.0


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loosening record of the paper's model, with noise."""
    place = tmp_path_factory.mktemp("bootstrap") / "campaign"
    write_loosening_campaign(place, RATE_HZ, noise=0.01)
    return place


@pytest.fixture
def results(campaign: Path, tmp_path: Path) -> Path:
    """What a closure of the campaign has left."""
    paper_model().save(tmp_path / "model.json", campaign="c", seed=3)
    found = {**close.NO_CLOSURE, **effects(1.0), "campaign": "c", "seed": 3, "noise_floor": {}}
    found |= {"campaign_digest": read_campaign(campaign).digest, "warnings": [], "set_aside": []}
    sides = {"total": 1.0, "whiteness_p": 0.5}
    found |= {"verdict": "closed", "residual": {"before": sides, "after": sides}}
    (tmp_path / "closure.json").write_text(json.dumps(found), encoding="utf-8")
    return tmp_path


def effects(value: float) -> dict[str, Any]:
    row = {"value": value, "low": value - 0.2, "high": value + 0.2, "unit": "1"}
    effect = {"name": "coulomb-friction", "enters": "joint", "equation": "mu T", "parameters": {"mu": row}}
    told = {"source": "catalogue", "share": 0.9, "share_of": "the residual", "p_value": 0.001}
    return {"effects": [{**effect, **told, "p_value_from": "drawn", "wins": [0, 0], "look_alikes": []}]}


def closer(campaign: Path, out: Path, log: Path) -> None:
    """Stands for a closure: its number comes from the noise of the simulated records."""
    one = read_campaign(campaign)
    level = float(one.load(one.settings.record[0]).channels["tension"].samples[:2000].mean())
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{out.name}\n")
    (out / "closure.json").write_text(json.dumps(effects(1.0 + level - 60.0)), encoding="utf-8")


def failing(campaign: Path, out: Path, log: Path) -> None:
    once = log.with_name("failed")
    if out.name.endswith("2") and not once.exists():
        once.touch()
        raise ValueError("found nothing, expected a record")
    closer(campaign, out, log)


def ran(campaign: Path, results: Path, count: int, jobs: int = 1, closed: Any = closer) -> dict[str, Any]:
    close_one = partial(closed, log=results / "log")
    with execution(local="threading"):
        path = bootstrap.run(campaign, results, count, seed=3, jobs=jobs, closer=close_one)
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def logged(results: Path) -> list[str]:
    return sorted((results / "log").read_text().split()) if (results / "log").exists() else []


def test_limits_and_a_sentence_are_added_and_jobs_change_nothing(
    campaign: Path, results: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = tmp_path_factory.mktemp("other")
    for name in ("model.json", "closure.json"):
        (other / name).write_bytes((results / name).read_bytes())
    before = json.loads((results / "closure.json").read_text())
    one = ran(campaign, results, 8)
    ran(campaign, other, 2, jobs=2)
    for place in ("bootstrap/0001/closure.json", "bootstrap/0002/closure.json"):
        assert (other / place).read_bytes() == (results / place).read_bytes()
    assert {key: one[key] for key in before if key != "summary"} == {
        key: before[key] for key in before if key != "summary"
    }
    (effect,) = one["bootstrap"]["effects"]
    number = effect["parameters"]["mu"]
    assert (effect["named"], effect["first"], number["replicates"]) == (8, 8, 8)
    assert number["low"] < number["value"] < number["high"]
    assert "of 8 campaigns simulated" in close.summary(results / "closure.json")
    (row,) = bootstrap_table(one).rows
    assert row[:4] == ("coulomb-friction, link joint", "8 of 8", "8", "mu")
    values = [json.loads(p.read_text())["effects"][0] for p in (results / "bootstrap").glob("*/closure.json")]
    assert len({row["parameters"]["mu"]["value"] for row in values}) == 8  # each has noise of its own
    assert not list((results / "bootstrap").glob("*/campaign"))


def test_only_what_is_missing_half_made_or_failed_is_run(campaign: Path, results: Path) -> None:
    first = ran(campaign, results, 3, closed=failing)
    assert first["bootstrap"]["failed"] == 1
    done = logged(results)
    (results / "bootstrap" / ".making-0004").mkdir()  # of a run that was killed
    assert ran(campaign, results, 4, closed=failing)["bootstrap"]["replicates"] == 4
    new = [".making-0002", ".making-0004"]
    assert logged(results) == sorted([*done, *new])
    ran(campaign, results, 4)
    assert logged(results) == sorted([*done, *new])


def test_replicates_of_another_model_are_made_again(campaign: Path, results: Path) -> None:
    ran(campaign, results, 1)
    law = paper_model()
    changed = law.with_values({"flexure_lo.damping.c": 1.1 * law.parameter("flexure_lo.damping.c").value})
    changed.save(results / "model.json", campaign="c", seed=3)
    ran(campaign, results, 1)
    assert logged(results) == [".making-0001"] * 2


def test_a_model_that_does_not_describe_the_records_is_not_simulated(campaign: Path, results: Path) -> None:
    told = json.loads((results / "closure.json").read_text()) | {"unfit": "no model"}
    (results / "closure.json").write_text(json.dumps(told))
    assert "bootstrap" not in ran(campaign, results, 2)
    assert not (results / "bootstrap").exists()


def test_records_that_cannot_be_simulated_are_refused_before_the_work(
    tmp_path: Path, boltlaw: Boltlaw
) -> None:
    from tests.discovery import driven_twins as twins

    twins.cycled(tmp_path / "cycled", friction=0.0, seconds=3.0)
    refused = boltlaw("close", tmp_path / "cycled", "--bootstrap", 2, "--out", tmp_path / "out")
    assert refused.code == 2
    assert "--bootstrap" in refused.err
    assert "cycled" in refused.err
    assert not (tmp_path / "out").exists()
