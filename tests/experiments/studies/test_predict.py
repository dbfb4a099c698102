"""A saved model with effects of every kind predicts records that show them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from experiments.studies.predict import _fitted, run, summary
from rom import Model
from rom.campaign.campaign import read_campaign, write_campaign
from rom.effects import CATALOGUE, free_form
from rom.evaluation.error_measures import summarise
from rom.evaluation.evaluate import evaluate
from rom.model.laws import Parameter
from rom.parameters.he_2025 import paper_model
from tests.rom import beams
from tests.rom.shown_records import SETTINGS, channels

EFFECTS = (
    ("coulomb-friction", "flexure_lo", {"F_c": 0.5}),
    ("tightening", "tension", {"g_t": 5.0}),
    ("relaxation-log", "tension", {"A": 0.5}),
    ("tension-drift", "tension", {"d": 0.3}),
    ("force-gain", "sensor:force_lo", {"g": 0.05}),
    ("hum", "sensor:acceleration_so", {"A": 0.2, "B": 0.1}),
    ("calibration-error", "sensor:tension", {"c_1": 0.1}),
)


@pytest.fixture
def truth() -> Model:
    """Return the paper's model with an effect of every kind."""
    model = paper_model()
    for name, enters, values in EFFECTS:
        model = CATALOGUE[name].at(enters).with_values(**values).added_to(model)
    return free_form("q * abs(x) * v", "flexure_so", {"q": Parameter(1e3, "N s/m2")}).added_to(model)


@pytest.fixture
def campaign(truth: Model, tmp_path: Path) -> Path:
    """Return two records of it, as its faulty sensors show them."""
    faults = truth.effects_of("sensor fault")
    files = {"a.h5": 120.0, "b.h5": 400.0}
    settings = SETTINGS.model_copy(
        update={"record": tuple(SETTINGS.record[0].model_copy(update={"file": file}) for file in files)}
    )
    records = [(file, channels(truth, faults, tension_n=tension)) for file, tension in files.items()]
    write_campaign(tmp_path / "campaign", settings, records)
    return tmp_path / "campaign"


def test_a_saved_model_knows_faults_readings_and_own_numbers(
    truth: Model, campaign: Path, tmp_path: Path
) -> None:
    truth.save(tmp_path / "model.json")
    errors = json.loads(run(tmp_path / "model.json", campaign, tmp_path, jobs=2).read_text())["errors"]
    assert errors["records"] == 2
    assert errors["motion_nrmse"] < 0.01
    assert errors["tension_rmse_n"] < 0.1
    judged = evaluate([truth, paper_model()], read_campaign(campaign))
    same, before = (summarise(j.comparisons[place] for j in judged) for place in (0, 1))
    assert errors["motion_nrmse"] == pytest.approx(same["motion_nrmse"], rel=1e-9)
    assert errors["tension_rmse_n"] == pytest.approx(same["tension_rmse_n"], rel=1e-9)
    assert before["motion_nrmse"] is not None
    assert before["motion_nrmse"] > 0.05


@pytest.fixture(scope="module")
def predicted(rig_campaign: Path, results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The identified model on its own campaign, and the file of that."""
    return run(results / "model.json", rig_campaign, tmp_path_factory.mktemp("predicted"), jobs=1)


def test_a_final_tension_has_the_limits_of_one_new_test(predicted: Path) -> None:
    records = json.loads(predicted.read_text())["records"]
    tensions = [r["final_tension_n"] for r in records if r["test"] == "loosening"]
    assert all(t["low"] < t["simulated"] < t["high"] for t in tensions)
    inside = [t["low"] <= t["measured"] <= t["high"] for t in tensions]
    assert sum(inside) >= len(inside) - 1
    others = [r["final_tension_n"] for r in records if r["test"] != "loosening"]
    assert {(t["low"], t["high"]) for t in others} == {(None, None)}


def test_the_summary_says_numbers_and_whose_records_they_are(predicted: Path) -> None:
    lines = summary(predicted)
    assert "On the campaign of its fit, the model is off by" in lines
    assert "noise alone would give" in lines
    assert "measured final tensions lie within their 95 % limits." in lines
    data = json.loads(predicted.read_text())
    assert data["fitted_to_this_campaign"]
    predicted.write_text(json.dumps(data | {"fitted_to_this_campaign": False}))
    assert "With nothing fitted" in summary(predicted)


@pytest.mark.parametrize(
    ("section", "own"),
    [
        ({"fitted_records": ["1", "3"]}, {"a.h5"}),
        ({"fitted_records": ["3"]}, set()),
        ({"campaign_digest": "that of the campaign"}, None),
    ],
)
def test_records_are_known_by_what_they_hold(
    section: dict[str, object], own: set[str] | None, tmp_path: Path
) -> None:
    campaign: Any = SimpleNamespace(digests={"a.h5": "1", "b.h5": "2"})
    paper_model().save(tmp_path / "model.json", identification=section)
    assert _fitted(tmp_path / "model.json", campaign) == own


@pytest.mark.parametrize("damaged", [1e39, "31", {"3": 1}])
def test_fitted_records_that_are_no_list_are_refused(damaged: object, tmp_path: Path) -> None:
    campaign: Any = SimpleNamespace(digests={"a.h5": "1", "b.h5": "2"})
    paper_model().save(tmp_path / "model.json", identification={"fitted_records": damaged})
    with pytest.raises(ValueError, match=r"fitted_records: must be a list of digests"):
        _fitted(tmp_path / "model.json", campaign)


def test_a_campaign_whose_settings_have_changed_is_still_that_of_the_fit(
    predicted: Path, rig_campaign: Path, results: Path, tmp_path: Path
) -> None:
    """A comment in campaign.toml makes a new digest of it; that all is held out now does not undo the fit."""
    shutil.copytree(rig_campaign, tmp_path / "c")
    settings = tmp_path / "c" / "campaign.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text("# mine\n" + text.replace("hold_out = false", "hold_out = true"), encoding="utf-8")
    before, now = (
        json.loads(path.read_text())
        for path in (predicted, run(results / "model.json", tmp_path / "c", tmp_path / "out", jobs=1))
    )
    assert now["campaign_digest"] != before["campaign_digest"]
    assert now["fitted_to_this_campaign"]
    assert now["sets"] == before["sets"]
    assert now["sets"]["errors"]["hold_out"]["records"] == sum(r["hold_out"] for r in before["records"])


def test_files_may_be_read_by_whom_the_system_lets(results: Path, tmp_path: Path) -> None:
    """As any other new file, not by their writer alone."""
    (tmp_path / "plain").touch()
    modes = {path.stat().st_mode for path in (tmp_path / "plain", results / "model.json")}
    assert len(modes) == 1


def test_a_model_of_bodies_predicts_no_campaign_of_modes(tmp_path: Path) -> None:
    beams.campaign(tmp_path / "beam")
    paper_model().save(tmp_path / "model.json")
    with pytest.raises(ValueError, match=r"found a campaign of \[modes\], expected one of bodies"):
        run(tmp_path / "model.json", tmp_path / "beam", tmp_path / "results")
