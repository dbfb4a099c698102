"""What the commands write: keys, numbers that agree with each other, the same on any number of processes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from experiments.studies import identify, reproduce
from rom.identification.gamma_per_case import GammaEstimate

Boltlaw = Callable[..., Any]


def without_clock(path: Path) -> dict[str, Any]:
    """Return a result file less what tells one run from another."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    del data["elapsed_s"]
    data.get("identification", {}).pop("command", None)
    return data


def numbers(value: Any) -> Iterator[Any]:
    """Walk through all that a JSON value holds."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers(item)
    else:
        yield value


def test_identify_writes_a_model_and_figures_beside_the_campaign(results: Path, rig_campaign: Path) -> None:
    assert results == rig_campaign.with_name("campaign-results")
    data = json.loads((results / "model.json").read_text(encoding="utf-8"))
    assert data["format"] == "boltlaw-model/1"
    assert data["campaign"]
    assert data["program_version"]
    assert data["seed"] == 0
    assert data["elapsed_s"] > 0
    figures = {path.stem for path in results.glob("*.svg")}
    assert {"calibration", "joint-stiffness", "joint-damping", "gamma-law", "tension-change"} <= figures
    assert not [path for path in results.iterdir() if path.suffix not in (".json", ".svg", ".pdf")]
    assert {path.stem for path in results.glob("*.pdf")} == figures


def test_identify_tells_how_it_found_the_model(results: Path) -> None:
    section = json.loads((results / "model.json").read_text(encoding="utf-8"))["identification"]
    assert len(section["joint"]) == 7  # one of eight preloads is held out
    assert len(section["gamma"]) == 7
    assert section["errors"]["training"]["records"] + section["errors"]["hold_out"]["records"] == 18
    for kind in ("training", "hold_out"):
        loss = "tension_loss_error_percent_median"
        assert section["errors"][kind][loss] < 10.0
        assert section["errors"]["no_loosening"][kind][loss] == pytest.approx(100.0)


@pytest.fixture(scope="module")
def prediction(results: Path, rig_campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What `boltlaw predict` says of the campaign itself."""
    from experiments.cli import run

    out = tmp_path_factory.mktemp("prediction")
    arguments = ["predict", str(results / "model.json"), str(rig_campaign), "--out", str(out), "--quiet"]
    assert run([*arguments, "--jobs", "1", "--seed", "3"]) == 0
    assert [path.name for path in out.iterdir()] == ["prediction.json"]
    loaded: dict[str, Any] = json.loads((out / "prediction.json").read_text(encoding="utf-8"))
    return loaded


def test_a_prediction_has_the_keys_that_others_read(prediction: dict[str, Any]) -> None:
    assert prediction["format"] == "boltlaw-prediction/1"
    assert prediction["seed"] == 3
    assert {"campaign", "program_version", "elapsed_s"} <= set(prediction)
    assert set(prediction["errors"]) == {
        "motion_nrmse",
        "relative_motion_nrmse",
        "final_tension_error_percent_mean",
        "final_tension_error_percent_median",
        "final_tension_error_percent_max",
        "tension_loss_error_percent_median",
        "link_force_nrmse",
        "tension_rmse_n",
        "tension_course_within_band",
        "records",
        "failed",
    }
    assert prediction["errors"]["records"] == 18
    assert prediction["errors"]["failed"] == 0
    assert prediction["errors"]["link_force_nrmse"] is None  # no record of a link driven on its own
    for row in prediction["records"]:
        assert {"file", "initial_tension_n", "final_tension_n", "motion_nrmse"} <= set(row)
        assert set(row["final_tension_n"]) == {"simulated", "low", "high", "measured"}


def test_held_out_courses_are_said_to_lie_within_their_limits_as_a_prediction_finds(
    results: Path, prediction: dict[str, Any]
) -> None:
    found = json.loads((results / "model.json").read_text(encoding="utf-8"))["identification"]["errors"]
    held = [row["tension_course_within_band"] for row in prediction["records"] if row["hold_out"]]
    known = [share for share in held if share is not None]
    assert found["hold_out"]["tension_course_within_band"] == pytest.approx(sum(known) / len(known))
    assert found["training"]["tension_course_within_band"] is None
    assert 0.5 < prediction["sets"]["errors"]["training"]["tension_course_within_band"] <= 1.0


def test_a_prediction_agrees_with_the_errors_it_reports(prediction: dict[str, Any]) -> None:
    rows = [row for row in prediction["records"] if row["file"].startswith("records/loosening")]
    percent = sorted(
        100 * abs(tension["simulated"] - tension["measured"]) / tension["measured"]
        for row in rows
        for tension in [row["final_tension_n"]]
    )
    assert len(percent) == 8
    assert prediction["errors"]["final_tension_error_percent_max"] == pytest.approx(percent[-1])
    assert prediction["errors"]["final_tension_error_percent_mean"] == pytest.approx(sum(percent) / 8)
    assert percent[-1] < 2.0
    uncoupled = next(row for row in prediction["records"] if "uncoupled" in row["file"])
    assert uncoupled["initial_tension_n"] is None
    assert set(uncoupled["final_tension_n"].values()) == {None}


def test_nothing_is_said_when_quiet_and_numbers_do_not_depend_on_jobs(
    results: Path, rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    for jobs in (1, 2):
        out = tmp_path / str(jobs)
        ran = boltlaw(
            "predict", results / "model.json", rig_campaign, "--out", out, "--jobs", jobs, "--quiet"
        )
        assert (ran.code, ran.out, ran.err) == (0, "", "")
    one, two = (without_clock(tmp_path / jobs / "prediction.json") for jobs in "12")
    assert one == two


def test_a_hidden_law_and_softer_hits_are_told_by_the_truth_alone(tmp_path: Path, boltlaw: Boltlaw) -> None:
    folder = tmp_path / "hidden"
    ran = boltlaw("rig", folder, "--cases", 2, "--duration-s", 2.5, "--hold-out-every", 0,
                  "--strengths", "1,0.6", "--law", "power-2", "--jobs", 1)  # fmt: skip
    assert (ran.code, ran.err) == (0, "")
    assert len(list(folder.glob("records/loosening*"))) == 4
    assert "power" not in (folder / "campaign.toml").read_text(encoding="utf-8")
    truth = json.loads((tmp_path / "hidden.truth.json").read_text(encoding="utf-8"))
    assert (truth["law"], truth["strengths"]) == ("power-2", [1.0, 0.6])
    assert [term["velocity_power"] for term in truth["plant"]["loosening"]] == [2.0]


@pytest.mark.variant
def test_identification_does_not_depend_on_jobs(
    results: Path, rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    ran = boltlaw("identify", rig_campaign, "--out", tmp_path / "two", "--jobs", 2)
    assert ran.code == 0
    assert "joint stiffness" in ran.out
    assert without_clock(tmp_path / "two" / "model.json") == without_clock(results / "model.json")


def test_the_seed_alone_decides_what_the_rig_measures(tmp_path: Path, boltlaw: Boltlaw) -> None:
    small = ("--cases", 2, "--duration-s", 2.5, "--quiet")
    for name, seed, jobs in (("a", 5, 1), ("b", 5, 2), ("c", 6, 1)):
        ran = boltlaw("rig", tmp_path / name, *small, "--seed", seed, "--jobs", jobs)
        assert (ran.code, ran.out, ran.err) == (0, "", "")
    from rom.campaign.campaign import read_campaign

    a, b, c = (read_campaign(tmp_path / name).digest for name in "abc")
    assert a == b
    assert a != c


def test_nan_is_never_written(results: Path, prediction: dict[str, Any]) -> None:
    text = (results / "model.json").read_text(encoding="utf-8")
    assert not re.search(r"\b(NaN|Infinity|-Infinity)\b", text)
    for value in (*numbers(json.loads(text)), *numbers(prediction)):
        assert value is None or isinstance(value, str | bool | int | float)
        assert value not in (float("inf"), float("-inf"))


def gamma_estimate(initial: float, loss: float) -> GammaEstimate:
    return GammaEstimate(f"{initial:g}", initial, initial - loss, 0.01, 1e6 * loss, 0.1, False)


def test_convergence_splits_where_the_changes_become_small() -> None:
    """Fig. 9: large changes of either sign below about 850 N, small losses above."""
    below = [gamma_estimate(50 + 80 * i, loss) for i, loss in enumerate([8, -5, 9, 7, -9, 6, 8, -7, 5, 9])]
    above = [gamma_estimate(t, 0.5 + 1e-4 * t) for t in range(900, 3000, 200)]
    found = identify.convergence([*above, *below])
    assert 770 < found["split_n"] < 900
    assert found["largest_loss_above_n"] == pytest.approx(0.79)
    assert (found["tightening"], found["tightening_above"], found["cases"]) == (3, 0, 21)


def test_few_cases_have_no_regimes() -> None:
    found = identify.convergence([gamma_estimate(t, 1.0) for t in (10.0, 100.0, 1000.0)])
    assert found["split_n"] is None


def test_summary_names_laws_limits_and_errors(results: Path) -> None:
    text = identify.summary(results / "model.json")
    assert re.search(r"joint stiffness: k_i / .* k_i = [\d.e+]+ \[[\d.e+]+, [\d.e+]+\] N/m", text)
    assert re.search(
        r"hold-out: motion [\d.]+ % \(noise alone: [\d.]+ %\); final tension mean [\d.]+ %", text
    )
    assert "no loosening" in text
    assert "exponent = 4 (held)" in text
    assert text.count("(held)") == 1
    assert re.search(
        r"flexure_lo stiffness, bolt out: k = [\d.e+]+ \[[\d.e+]+, [\d.e+]+\] N/m$", text, re.MULTILINE
    )
    assert not re.search(r" 1(,|$)", text, re.MULTILINE)  # a number without unit has none
    for low, high in re.findall(r"\[([-\d.e+]+), ([-\d.e+]+)\]", text):
        assert low != high
    assert re.search(r"lo mass: [\d.]+ kg( given| \[[\d.]+, [\d.]+\])$", text, re.MULTILINE)
    assert re.search(r"joint stiffness: .* \(7 records for \d free numbers\)$", text, re.MULTILINE)
    errors = json.loads((results / "model.json").read_text(encoding="utf-8"))["identification"]["errors"]
    own, still = errors["hold_out"], errors["no_loosening"]["hold_out"]
    assert f"motion {100 * own['motion_nrmse']:.2f} % (noise alone" in text
    mean, median, loss = (
        f"{key}_error_percent_{kind}"
        for key, kind in (("final_tension", "mean"), ("final_tension", "median"), ("tension_loss", "median"))
    )
    assert f"mean {own[mean]:.2f} %, median {own[median]:.2f} % (no loosening: {still[mean]:.2f} %, " in text
    assert f"loss median {own[loss]:.1f} % (no loosening: {still[loss]:.1f} %; noise alone" in text


@pytest.mark.parametrize(
    ("paper", "ours", "tolerance", "bound", "within"),
    [
        (1.0, 1.1, 0.2, False, True),
        (1.0, 1.3, 0.2, False, False),
        (1.0, 0.7, 0.2, False, False),
        (1.25, 0.6, 0.0, True, True),
        (1.25, 1.3, 0.0, True, False),
        (1.0, float("nan"), 0.2, False, False),
    ],
)
def test_a_row_is_within_its_tolerance_or_below_its_bound(
    paper: float, ours: float, tolerance: float, bound: bool, within: bool
) -> None:
    assert reproduce.Row("loss", paper, ours, "N", tolerance, "why", bound).within is within
