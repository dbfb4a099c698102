"""The same campaign and seed give the same results on any number of jobs; results say how to repeat them."""

from __future__ import annotations

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from experiments.studies import rig
from rom.campaign.campaign import read_campaign
from rom.parameters.he_2025 import paper_model
from tests.conftest import Boltlaw, Ran
from tests.discovery import driven_twins as twins
from tests.rom.sound_campaign import write_sound_campaign

MAIN = {"identify": "model.json", "close": "closure.json"}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four preloads, one of them held out."""
    place = tmp_path_factory.mktemp("repeating") / "campaign"
    return rig.run(place, 4, seed=1, duration_s=2.5, hold_out_every=3)


def told(folder: Path) -> dict[str, Any]:
    """All that a folder of results holds, less the clock and the call."""

    def without(data: dict[str, Any]) -> dict[str, Any]:
        return {key: value for key, value in data.items() if key not in ("elapsed_s", "command")}

    found: dict[str, Any] = {path.name: path.read_bytes() for path in folder.glob("*.svg")}
    for path in folder.glob("*.json"):
        data = json.loads(path.read_text(encoding="utf-8"))
        found[path.name] = without(data | {"identification": without(data.get("identification", {}))})
    return found


def same(one: Path, other: Path, main: str) -> None:
    """Hold two folders of results together, file by file."""
    first, second = told(one), told(other)
    assert main in first
    assert first.keys() == second.keys()
    for name in first:
        assert first[name] == second[name], name


def test_a_closure_of_driven_bodies_does_not_depend_on_jobs(tmp_path: Path, boltlaw: Boltlaw) -> None:
    campaign = twins.driven(tmp_path / "campaign", sizes=(1.0, 1.0), extra=lambda x, _: 2e7 * x**3).path
    for jobs in (1, 2):
        ran = boltlaw("close", campaign, "--out", tmp_path / str(jobs), "--jobs", jobs, "--quiet")
        assert (ran.code, ran.out, ran.err) == (0, "", "")
    same(tmp_path / "1", tmp_path / "2", "closure.json")


@pytest.mark.slow
@pytest.mark.variant  # that of driven bodies; test_tension and test_ground_motion say it of what impacts add
@pytest.mark.parametrize("command", ["identify", "close"])
def test_results_do_not_depend_on_jobs(
    command: str, campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    for jobs in (1, 2):
        ran = boltlaw(
            command, campaign, "--out", tmp_path / str(jobs), "--jobs", jobs, "--seed", 7, "--quiet"
        )
        assert (ran.code, ran.out, ran.err) == (0, "", "")
    same(tmp_path / "1", tmp_path / "2", MAIN[command])


@pytest.mark.slow
@pytest.mark.variant  # test_race and test_confidence_sets say it of the race and the exponent
def test_a_ranking_does_not_depend_on_jobs(
    discovered: tuple[Path, Ran], rig_campaign: Path, tmp_path: Path, boltlaw: Boltlaw
) -> None:
    where = ("--out", tmp_path / "1", "--jobs", 1, "--seed", 7, "--quiet")
    ran = boltlaw("discover", rig_campaign, *where, figures=True)
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    same(tmp_path / "1", discovered[0], "ranking.json")


def test_a_result_tells_what_is_needed_to_repeat_it(
    tmp_path: Path, boltlaw: Boltlaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Command, program, libraries, seed, campaign and model, byte by byte."""
    import discovery
    from tests.discovery.sound_closure import closure

    folder = tmp_path / "my campaign"
    write_sound_campaign(folder)
    monkeypatch.setattr("sys.argv", ["boltlaw", "close", str(folder), "--seed", "3"])
    monkeypatch.setitem(vars(discovery), "close_loop", lambda *_, **__: closure(verdict="no-effect"))
    assert boltlaw("close", folder, "--seed", 3, "--jobs", 1).code == 0
    results = tmp_path / "my campaign-results"
    data, model = (json.loads((results / name).read_text()) for name in ("closure.json", "model.json"))
    for head in (data, model | model["identification"]):
        assert head["command"] == f"boltlaw close '{folder}' --seed 3"
        assert head["campaign_digest"] == read_campaign(folder).digest
        assert head["seed"] == 3
        assert head["program_version"] == version("boltlaw")
        assert head["versions"]["python"] == platform.python_version()
        assert {name: version(name) for name in ("numpy", "scipy", "numba", "pysindy")}.items() <= head[
            "versions"
        ].items()


def test_a_prediction_tells_its_model_byte_by_byte(tmp_path: Path, boltlaw: Boltlaw) -> None:
    from hashlib import sha256

    from rom.campaign.campaign import write_campaign
    from tests.rom.shown_records import SETTINGS, channels

    model = paper_model()
    file = SETTINGS.record[0].file
    write_campaign(tmp_path / "campaign", SETTINGS, [(file, channels(model, (), tension_n=120.0))])
    model.save(tmp_path / "model.json")
    ran = boltlaw("predict", tmp_path / "model.json", tmp_path / "campaign", "--out", tmp_path, "--jobs", 1)
    assert ran.code == 0, ran.err
    data = json.loads((tmp_path / "prediction.json").read_text())
    assert data["model_digest"] == sha256((tmp_path / "model.json").read_bytes()).hexdigest()
    assert data["command"]
