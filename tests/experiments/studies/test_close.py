"""`boltlaw close`: what it writes, what it refuses, and the plain words that it prints."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import discovery
from discovery.loop.result import Closure
from experiments.studies import close
from experiments.studies.effect_curves import effect_curves
from rom.campaign.campaign import CampaignError, read_campaign
from rom.effects import CATALOGUE
from rom.identification.identify import identify
from rom.model.model import Model
from rom.model_file import load_model
from rom.parameters.he_2025 import nominal_impact, paper_model
from tests.discovery import driven_twins as twins
from tests.discovery.sound_closure import closure, friction, skew, threshold, unknown_force
from tests.rom.sound_campaign import sound_settings, write_loosening_campaign, write_sound_campaign

Boltlaw = Callable[..., Any]
Finding = Callable[[Closure], list[tuple[Any, ...]]]
RATE_HZ = 4800.0
FIGURES = {f"closure-{name}.svg" for name in ("errors", "residual", "screened", "effects", "limits")}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("close") / "campaign"
    write_sound_campaign(place)
    return place


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A loosening record of the paper's model, without noise."""
    place = tmp_path_factory.mktemp("moving") / "campaign"
    write_loosening_campaign(place, RATE_HZ)
    return place


@pytest.fixture
def finding(monkeypatch: pytest.MonkeyPatch) -> Finding:
    """Let the loop return a closure made by hand; what it was called with is kept."""

    def let(found: Closure) -> list[tuple[Any, ...]]:
        calls: list[tuple[Any, ...]] = []

        def close_loop(*arguments: Any, model: Model | None, **_: Any) -> Closure:
            calls.append((*arguments, model))
            return found

        monkeypatch.setitem(vars(discovery), "close_loop", close_loop)
        return calls

    return let


def load(folder: Path) -> dict[str, Any]:
    text = (folder / "closure.json").read_text(encoding="utf-8")
    assert not re.search(r"\b(NaN|Infinity|-Infinity)\b", text)
    data: dict[str, Any] = json.loads(text)
    return data


@pytest.fixture(scope="module")
def made(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command writes where the loop finds two effects."""
    from experiments.cli import run

    found, calls = replace(closure(friction(), threshold()), declared=paper_model()), []
    out = tmp_path_factory.mktemp("made") / "results"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(vars(discovery), "close_loop", lambda *call, **_: calls.append(call) or found)
        assert run(["close", str(campaign), "--out", str(out), "--jobs", "1", "--seed", "4", "--quiet"]) == 0
    (call,) = calls
    assert (call[0].path, call[1], call[3]) == (campaign, 1, 4)
    return out


def test_the_closure_has_the_keys_that_others_read(made: Path) -> None:
    data = load(made)
    assert data["format"] == "boltlaw-closure/1"
    assert {"campaign", "program_version", "seed", "elapsed_s", "command", "campaign_digest"} <= set(data)
    assert data["seed"] == 4
    assert data["verdict"] == "closed"
    first, second = data["effects"]
    assert {"name", "enters", "equation", "parameters", "look_alikes", "source"} <= set(first)
    assert (first["name"], first["enters"], first["source"]) == (
        "coulomb-friction",
        "flexure_lo",
        "catalogue",
    )
    assert first["parameters"]["F_c"] == {"value": 0.1, "low": 0.09, "high": pytest.approx(0.11), "unit": "N"}
    assert first["look_alikes"][0]["hold_out_cost"] == 1.07
    assert set(first["look_alikes"][0]) == {"name", "enters", "hold_out_cost", "test"}
    assert (second["share"], second["p_value"], second["wins"]) == (0.31, 0.0, [4, 5])
    assert [step["added"] for step in data["steps"]] == ["", "coulomb-friction", "loosening-threshold"]
    for kind in ("training", "hold_out"):
        assert data["errors"][kind]["before"] == data["steps"][0]["errors"][kind]
        assert data["errors"][kind]["after"] == data["steps"][-1]["errors"][kind]
    assert data["residual"]["before"]["by_channel"]["acceleration_lo"] == pytest.approx(60.2)
    assert data["residual"]["after"]["whiteness_p"] == 0.31
    assert data["screened"][1]["name"] == "quadratic-damping"
    limits = data["detection_limits"]
    assert {"name", "enters", "parameter", "unit", "value", "felt_percent", "share_of_default"} <= set(
        limits[0]
    )
    assert all((limit["value"] is None) == bool(limit["reason"]) for limit in limits)
    assert data["set_aside"]
    assert data["warnings"]


def test_the_summary_says_what_was_missing_and_with_which_numbers(made: Path) -> None:
    text = close.summary(made / "closure.json")
    for part in ("The loop closes", "What was missing: coulomb-friction", "F_c = 0.1 N", "What remains: ",
                 "note: records/loosening_004"):  # fmt: skip
        assert part in text, part


def test_every_figure_is_there_and_nothing_else(made: Path) -> None:
    assert {path.name for path in made.iterdir()} == {
        "closure.json", "model.json", "closure-records.svg", "closure-records.pdf", *FIGURES,
        *(name.replace(".svg", ".pdf") for name in FIGURES),
    }  # fmt: skip
    assert b"Refined model" in (made / "closure-records.svg").read_bytes()


def test_the_model_holds_the_effects_and_its_errors(made: Path, campaign: Path) -> None:
    model = load_model(made / "model.json")
    assert [effect.name for effect in model.effects] == ["coulomb-friction", "loosening-threshold"]
    force = {"lo": nominal_impact(1600.0, RATE_HZ, 1.0)}
    lost, declared = (m.simulate(force, RATE_HZ, 150.0).tension for m in (model, paper_model()))
    assert 150.0 - lost[-1] < 0.8 * (150.0 - declared[-1])
    section = json.loads((made / "model.json").read_text(encoding="utf-8"))["identification"]
    assert section["errors"]["hold_out"] == load(made)["errors"]["hold_out"]["after"]
    digests = read_campaign(campaign).digests
    assert section["fitted_records"] == sorted(digests[r["file"]] for r in sound_settings()["record"]
                                               if not r.get("hold_out"))  # fmt: skip


@pytest.mark.parametrize(
    ("found", "words", "lacking"),
    [
        (closure(skew()), "sensor acceleration_so", {"closure-effects.svg"}),
        (closure(verdict="no-effect"), "Nothing is missing", {"closure-effects.svg", "closure-errors.svg"}),
        (closure(unknown_force(), verdict="unexplained", hold_out=0), "still missing", set()),
    ],
    ids=["sensor", "no-effect", "free-form"],
)
def test_every_verdict_is_written_and_exits_with_0(
    found: Closure,
    words: str,
    lacking: set[str],
    campaign: Path,
    tmp_path: Path,
    boltlaw: Boltlaw,
    finding: Finding,
) -> None:
    finding(found)
    ran = boltlaw("close", campaign, "--out", tmp_path, "--jobs", 1, figures=True)
    assert ran.code == 0, ran.err
    assert words in ran.out
    assert load(tmp_path)["verdict"] == found.verdict
    names = {effect.name for effect in load_model(tmp_path / "model.json").effects}
    assert names == {effect.effect.name for effect in found.effects}
    assert {path.name for path in tmp_path.glob("*.svg")} == FIGURES - lacking
    if found.effects and found.effects[0].source == "free-form":
        assert load(tmp_path)["effects"][0]["p_value"] is None  # was not a number


def test_quiet_says_nothing_and_results_go_beside_the_campaign(
    tmp_path: Path, boltlaw: Boltlaw, finding: Finding
) -> None:
    write_sound_campaign(tmp_path / "campaign")
    finding(closure(verdict="no-effect"))
    ran = boltlaw("close", tmp_path / "campaign", "--jobs", 1, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    assert (tmp_path / "campaign-results" / "closure.json").is_file()


def test_the_loop_starts_from_the_law_of_a_given_model(
    campaign: Path, tmp_path: Path, boltlaw: Boltlaw, finding: Finding
) -> None:
    calls, path = finding(closure(verdict="no-effect")), tmp_path / "model.json"
    paper_model().save(path)
    ran = boltlaw("close", campaign, "--model", path, "--out", tmp_path / "results", "--jobs", 1)
    assert (ran.code, ran.err) == (0, "")
    ((*_, model),) = calls
    assert model == paper_model()


@pytest.mark.parametrize("text", [None, "{}", '{"format": "boltlaw-closure/1"}'])
def test_what_is_no_model_starts_no_loop(
    text: str | None, campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    path = tmp_path / "model.json"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    ran = boltlaw("close", campaign, "--model", path, "--out", tmp_path / "results", "--jobs", 1)
    assert ran.code == 2
    assert ran.err.startswith(str(path))
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "results").exists()


def test_a_model_of_another_structure_starts_no_loop(
    campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    path = tmp_path / "model.json"  # there, flexure_so is a dashpot
    paper_model().save(path)
    ran = boltlaw("close", campaign, "--model", path, "--out", tmp_path / "results", "--jobs", 1)
    assert ran.code == 2
    assert ran.err.startswith("model: found bodies lo, so and links flexure_lo (linear, lo to ground), ")
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(("error", "code"), [(CampaignError(["a.h5: found 3"]), 2), (KeyError("x"), 1)])
def test_nothing_is_written_on_a_failure(
    error: Exception,
    code: int,
    campaign: Path,
    tmp_path: Path,
    boltlaw: Boltlaw,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setitem(vars(discovery), "close_loop", fail)
    ran = boltlaw("close", campaign, "--out", tmp_path / "results", "--jobs", 1)
    assert (ran.code, ran.out) == (code, "")
    assert not (tmp_path / "results").exists()


def test_a_figure_that_cannot_be_drawn_is_told_and_costs_no_result(
    campaign: Path, tmp_path: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch,
    finding: Finding,
) -> None:  # fmt: skip
    def fail(_: object) -> None:
        raise RuntimeError("no ink")

    finding(replace(closure(friction()), declared=paper_model()))
    monkeypatch.setattr("experiments.figures.closure.closure_figures", fail)
    ran = boltlaw("close", campaign, "--out", tmp_path / "results", "--jobs", 1, figures=True)
    assert ran.code == 0
    assert "note: figures were not drawn: RuntimeError: no ink" in ran.out
    assert (tmp_path / "results" / "closure-records.svg").exists()  # others are drawn


def test_a_malformed_campaign_is_refused_before_the_work(
    tmp_path: Path, boltlaw: Boltlaw, finding: Finding
) -> None:
    write_sound_campaign(tmp_path / "campaign")
    (tmp_path / "campaign" / "records/loosening.h5").unlink()
    calls = finding(closure(friction()))
    ran = boltlaw("close", tmp_path / "campaign", "--jobs", 1)
    assert ran.code == 2
    (line,) = ran.err.splitlines()
    assert "records/loosening.h5" in line
    assert calls == []


def test_the_force_of_an_effect_is_the_one_that_acts_along_the_motion(moving: Path) -> None:
    """Of dry friction: its limit times tanh of the velocity; of cubic stiffness: the cube."""
    cubic = CATALOGUE["cubic-stiffness"].at("joint")
    model = paper_model().with_effect(friction().effect).with_effect(cubic)
    rubbed, hardened = effect_curves(model, model.effects, read_campaign(moving))
    assert rubbed is not None
    assert hardened is not None
    assert rubbed["kind"] == hardened["kind"] == "force"
    (first,), (second,) = rubbed["records"], hardened["records"]
    assert first["initial_tension_n"] == pytest.approx(60.0, abs=0.1)
    assert np.abs(second["displacement_m"]).max() > 5e-5
    assert first["force_n"] == pytest.approx(0.1 * np.tanh(first["velocity_m_per_s"] / 1e-3), abs=1e-9)
    assert second["force_n"] == pytest.approx(4.5e12 * second["displacement_m"] ** 3, rel=1e-9)


def test_without_an_impact_a_force_runs_over_the_whole_record(tmp_path: Path) -> None:
    driven = twins.driven(tmp_path / "driven")
    effect = CATALOGUE["cubic-stiffness"].at("guide").with_values(k3=1.0)
    (curve,) = effect_curves(identify(driven).with_effect(effect), [effect], driven)
    assert curve is not None
    record = curve["records"][0]
    measured = driven.load(driven.select(hold_out=False)[0]).channels["displacement_mass"].samples
    assert np.abs(record["displacement_m"]).max() == pytest.approx(np.abs(measured).max(), rel=0.05)


def test_a_changed_rate_is_zero_below_its_threshold(moving: Path) -> None:
    model = paper_model().with_effect(threshold().effect)
    (curve,) = effect_curves(model, model.effects, read_campaign(moving))
    assert curve is not None
    assert curve["kind"] == "tension rate"
    (record,) = curve["records"]
    speed, rate, without = (
        record[key] for key in ("peak_velocity_m_per_s", "rate_n_per_s", "rate_without_n_per_s")
    )
    below = speed < 0.025
    assert below.any()
    assert (rate[below] == 0.0).all()
    assert (without[below] < 0.0).all()
    assert 0.05 < rate[-1] / without[-1] < 0.95
    law = paper_model().link_laws["joint"].tension_rate
    assert law is not None
    mean = 3 / 8 * float(law.rate(record["initial_tension_n"], 0.0, speed[-1]))  # mean of cos^4
    assert without[-1] == pytest.approx(mean, rel=1e-6)


def test_what_a_gauge_shows_runs_over_the_whole_record(moving: Path) -> None:
    creep = CATALOGUE["relaxation-log"].at("tension").with_values(A=0.2, t_0=0.1)
    follows = CATALOGUE["tension-follows-displacement"].at("tension").with_values(a=1e4)
    model = paper_model().with_effect(creep).with_effect(follows)
    first, second = effect_curves(model, model.effects, read_campaign(moving))
    assert first is not None
    assert second is not None
    assert first["kind"] == second["kind"] == "reading"
    (creeping,), (following,) = first["records"], second["records"]
    assert creeping["time_s"][[0, -1]] == pytest.approx([-0.5, 2.5], abs=0.01)
    crept = -0.2 * np.log1p(np.maximum(creeping["time_s"], 0.0) / 0.1)
    assert creeping["reading_n"] == pytest.approx(crept, abs=1e-3)
    assert following["reading_n"] == pytest.approx(1e4 * following["displacement_m"])


def test_forces_on_bodies_and_faults_have_no_curve_and_no_record_is_run(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("a record was run")

    monkeypatch.setattr("experiments.studies.effect_curves.replay", never)
    pushed = CATALOGUE["constant-force"].at("body:lo")
    model = paper_model().with_effect(skew().effect).with_effect(pushed)
    assert effect_curves(model, model.effects, read_campaign(campaign)) == [None, None]
