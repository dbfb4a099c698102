"""Campaigns whose records do not fit what they declare: named in every result file, never passed over."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.text.suspicions import describes, lines, misfit
from experiments.text.verdicts import answer
from rom.campaign.campaign import read_campaign, write_campaign
from rom.campaign.record import Channel
from rom.parameters.he_2025 import paper_model
from tests.conftest import Boltlaw
from tests.rom.bolted import RATE_HZ as BOLTED_RATE_HZ
from tests.rom.bolted import bolted_campaign

FILES = {"identify": "model", "discover": "ranking", "close": "closure"}
KEYS = ["record", "channel", "finding", "factor", "likely", "confidence"]
Change = Callable[[str, np.ndarray], np.ndarray]


def spoilt(source: Path, folder: Path, change: Change, only: Collection[int] | None = None) -> Path:
    """Write a campaign anew with the samples of some records changed, by channel."""
    campaign = read_campaign(source)

    def channels(place: int) -> dict[str, Channel]:
        found = campaign.load(campaign.settings.record[place]).channels
        if only is not None and place not in only:
            return dict(found)
        return {name: Channel(name, change(name, c.samples), c.rate_hz) for name, c in found.items()}

    records = ((record.file, channels(place)) for place, record in enumerate(campaign.settings.record))
    write_campaign(folder, campaign.settings, records)
    return folder


def times(prefix: str, factor: float) -> Change:
    return lambda name, samples: samples * factor if name.startswith(prefix) else samples


def content(folder: Path, kind: str) -> Any:
    return json.loads((folder / f"{kind}.json").read_text(encoding="utf-8"))


G = ("acceleration", 1 / 9.80665, "acceleration in g", 9.80665)
SIGN = ("force", -1.0, "force sign", -1.0)


@pytest.mark.parametrize(
    ("command", "prefix", "factor", "likely", "mended"),
    [
        *((command, *G) for command in FILES),
        ("identify", *SIGN),
        *(pytest.param(command, *SIGN, marks=pytest.mark.variant) for command in ("discover", "close")),
    ],
)
def test_where_no_record_is_left_the_reasons_are_written_and_the_code_is_3(
    command: str, prefix: str, factor: float, likely: str, mended: float,
    rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw,
) -> None:  # fmt: skip
    folder = spoilt(rig_campaign, tmp_path / "spoilt", times(prefix, factor))
    ran = boltlaw(command, folder, "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 3
    (line,) = ran.err.splitlines()
    assert likely in line
    assert f"scale = {mended:.2g}" in line
    data = content(tmp_path / "out", FILES[command])
    count = len(read_campaign(folder).settings.record)
    assert len({row["record"] for row in data["suspicions"]}) == count
    assert all(list(row) == KEYS for row in data["suspicions"])
    assert {row["likely"] for row in data["suspicions"]} == {likely}
    assert np.median([row["factor"] for row in data["suspicions"]]) == pytest.approx(mended, rel=0.01)
    assert len(data["set_aside"]) >= count
    assert f"suspicion: {likely}" in ran.out
    assert boltlaw("report", tmp_path / "out").code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'class="answer bad"' in page
    assert likely in page


def test_the_few_records_in_g_are_set_aside_and_the_others_are_judged(
    rig_campaign: Path, results: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    folder = spoilt(rig_campaign, tmp_path / "spoilt", times("acceleration", 1 / 9.80665), only=(2, 7, 9))
    ran = boltlaw("predict", results / "model.json", folder, "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 0
    data = content(tmp_path / "out", "prediction")
    files = {read_campaign(folder).settings.record[place].file for place in (2, 7, 9)}
    assert {row["record"] for row in data["suspicions"]} == files
    assert {line.partition(":")[0] for line in data["set_aside"]} == files
    assert data["errors"]["motion_nrmse"] < 0.1
    assert "suspicion: acceleration in g" in ran.out


def test_a_strain_beyond_its_calibration_ends_no_command(
    rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    """Five times the strain: the cubic calibration falls there, to tensions far below zero."""
    folder = spoilt(rig_campaign, tmp_path / "spoilt", times("strain", 5.0))
    ran = boltlaw("identify", folder, "--out", tmp_path / "out", "--jobs", 1, figures=True)
    assert ran.code in (0, 3)
    assert "slack" not in ran.out + ran.err
    assert "strain beyond its calibration" in ran.out
    data = content(tmp_path / "out", "model")
    named = {row["record"] for row in data["suspicions"] if row["likely"] == "strain beyond its calibration"}
    assert named
    assert f", {len(named)} set aside" in ran.out
    assert list((tmp_path / "out").glob("**/*.svg"))


def windowed(rate_1_per_s: float) -> Change:
    """Return the exponential window of an analyser over motions and force."""

    def change(name: str, samples: np.ndarray) -> np.ndarray:
        fading = np.exp(-rate_1_per_s * np.arange(len(samples)) / BOLTED_RATE_HZ)
        return samples if name == "tension" else samples * fading

    return change


def settling(tau_s: float) -> Change:
    """Return sensors that still settle by a tenth of their greatest reading."""

    def change(name: str, samples: np.ndarray) -> np.ndarray:
        fading = np.exp(-np.arange(len(samples)) / BOLTED_RATE_HZ / tau_s)
        return samples + 0.1 * np.abs(samples).max() * fading if name.startswith("acceleration") else samples

    return change


@pytest.mark.parametrize("structure", ["block", "chain"])
@pytest.mark.parametrize(
    ("change", "likely"),
    [
        (windowed(2.0), "exponential window"),
        (windowed(8.0), "exponential window"),
        (settling(0.5), "sensor still settling"),
        (settling(5.0), "sensor still settling"),
    ],
)
def test_a_damping_that_windows_or_settling_sensors_would_add_is_not_stated(
    change: Change, likely: str, structure: str, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    bolted_campaign(tmp_path / "c", structure, [20.0, 400.0])
    folder = spoilt(tmp_path / "c", tmp_path / "spoilt", change)
    ran = boltlaw("identify", folder, "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 3
    assert f"found all 4 training records set aside, expected one that is not: {likely}" in ran.err
    data = content(tmp_path / "out", "model")
    assert {row["likely"] for row in data["suspicions"]} == {likely}
    assert "damping:" not in ran.out


def test_too_few_tests_left_to_compare_laws_end_with_3_and_the_reason(
    tmp_path: Path, boltlaw: Boltlaw
) -> None:
    """Of six loosening tests two are held out, and the strains of another two are beyond the calibration."""
    bolted_campaign(tmp_path / "c", "block", np.geomspace(10.0, 1500.0, 6).tolist(), strain=20.0)
    ran = boltlaw("discover", tmp_path / "c", "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 3
    (line,) = ran.err.splitlines()
    assert "3 are left, expected 4 or more: strain beyond its calibration" in line
    assert content(tmp_path / "out", "ranking")["laws"] == []
    assert ran.out.splitlines()[-1] == f"wrote {tmp_path / 'out' / 'ranking.json'}"


def test_exchanged_accelerometers_leave_no_test_of_the_joint(
    rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    campaign = read_campaign(rig_campaign)
    pair = {"acceleration_lo": "acceleration_so", "acceleration_so": "acceleration_lo"}

    def channels(place: int) -> dict[str, Channel]:
        found = campaign.load(campaign.settings.record[place]).channels
        named = {n: found.get(pair.get(n, n), c) for n, c in found.items()}
        return {name: Channel(name, c.samples, c.rate_hz) for name, c in named.items()}

    folder = tmp_path / "spoilt"
    records = ((record.file, channels(place)) for place, record in enumerate(campaign.settings.record))
    write_campaign(folder, campaign.settings, records)
    ran = boltlaw("identify", folder, "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 3
    assert "coupled, loosening" in ran.err
    assert "channels exchanged" in ran.err
    data = content(tmp_path / "out", "model")
    moving = {r.file for r in campaign.settings.record if r.test != "uncoupled"}
    assert {row["record"] for row in data["suspicions"]} == moving
    assert boltlaw("discover", folder, "--out", tmp_path / "laws", "--jobs", 1).code == 3
    assert content(tmp_path / "laws", "ranking")["laws"] == []


def test_a_prediction_that_is_far_off_ends_with_3_and_says_so_in_red(
    rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    model = paper_model()
    model.save(tmp_path / "model.json")
    text = (tmp_path / "model.json").read_text(encoding="utf-8").replace("8963.6", "4000.0", 1)
    (tmp_path / "model.json").write_text(text, encoding="utf-8")
    ran = boltlaw("predict", tmp_path / "model.json", rig_campaign, "--out", tmp_path / "out", "--jobs", 1)
    data = content(tmp_path / "out", "prediction")
    assert data["suspicions"] == []
    if data["errors"]["motion_nrmse"] < 0.5:
        pytest.fail(f"expected a bad model, found {data['errors']['motion_nrmse']}")
    assert ran.code == 3
    assert "displacements are off by" in ran.err
    told = answer("prediction", data)
    assert told is not None
    assert told.good is False
    assert "the model does not describe the motion" in f"{told.verdict} {told.sentences}"


def test_a_sound_prediction_ends_with_0(
    rig_campaign: Path, results: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    ran = boltlaw("predict", results / "model.json", rig_campaign, "--out", tmp_path / "out", "--jobs", 1)
    assert ran.code == 0
    assert content(tmp_path / "out", "prediction")["suspicions"] == []
    assert content(results, "model")["suspicions"] == []


def test_the_line_says_what_is_off_and_the_likeliest_cause() -> None:
    assert misfit({"motion_nrmse": 0.49, "failed": 0, "records": 3}, (), ["force in kN"]) is None
    text = misfit({"motion_nrmse": 2.06, "failed": 0, "records": 3}, (), ["force in kN"])
    assert text is not None
    assert "displacements are off by 206 %" in text
    assert text.endswith("likeliest cause: force in kN")
    assert "2 of 3 simulations" in (misfit({"failed": 2, "records": 3}, (), ()) or "")
    assert not describes({"motion_nrmse": 2.06})


def test_the_closed_loop_is_not_recommended_by_itself() -> None:
    off = {"motion_nrmse": 2.06, "failed": 0, "records": 3}
    assert "`boltlaw close` looks for a missing effect" in (misfit(off, (), ()) or "")
    assert (misfit(off, (), (), closed=True) or "").endswith("check masses and links of campaign.toml")


def test_records_of_one_suspicion_share_a_line() -> None:
    rows = [
        {"record": f"r{i}.h5", "channel": "force_a", "finding": "f", "factor": 1e3, "likely": "force in kN"}
        for i in range(5)
    ]
    assert lines({"suspicions": rows}) == ["force in kN, force_a in r0.h5, r1.h5, r2.h5 and 2 more: f"]
