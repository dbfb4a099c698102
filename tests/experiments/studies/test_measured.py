"""The page on measured data: each number comes from the references, and what is missing is said."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from discovery.loop.result import Closure
from discovery.views.closure_file import closure_section
from experiments.results import plain, write_result
from experiments.studies.measured import main, run
from experiments.text.measured import SETS, alone_table, views_table
from rom.effects import CATALOGUE
from rom.model.laws import Parameter, constant_damping, constant_stiffness
from rom.model.model import LinkLaws, Model
from rom.model.structure import Body, Link, Structure
from tests.discovery.sound_closure import closure, friction

DOCS = Path(__file__).parents[3] / "docs"


def results(folder: Path, found: Closure, campaign: str = "EMPS") -> dict[str, Any]:
    """Write what `boltlaw close` leaves in a folder, with a carriage on a dashpot as the model."""
    folder.mkdir(parents=True)
    model = Model(
        structure=Structure((Body("carriage", 95.3),), (Link("guide", "carriage", "ground", "dashpot"),)),
        link_laws={"guide": LinkLaws(constant_stiffness(0.0), constant_damping(204.25))},
    )
    model = model.with_effect(CATALOGUE["constant-force"].at("body:carriage", {"F_0": Parameter(3.25, "N")}))
    model.save(folder / "model.json", campaign=campaign)
    content = plain(closure_section(found)) | {"command": "boltlaw close emps"}
    for effect in content["effects"]:
        effect["enters"] = "guide"
        effect["curve"] = {"large": [0.0] * 1000}
    write_result(folder / "closure.json", "closure", content, campaign=campaign, seed=3, elapsed_s=12.5)
    return content


def test_the_page_holds_what_was_found(tmp_path: Path) -> None:
    content = results(tmp_path / "results", closure(friction()))
    text = run(tmp_path / "docs", {"emps": tmp_path / "results"}).read_text()
    assert "| carriage: mass | 95.3 | – | kg | 95.1089 |" in text
    assert "| guide: damping: c | 204.25 |" in text
    assert "guide: stiffness" not in text  # a dashpot has none
    force = content["effects"][0]["parameters"]["F_c"]
    (row,) = re.findall(r"\| coulomb-friction, link guide: F_c \|.*", text)
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert float(cells[1]) == pytest.approx(force["value"], rel=1e-2)
    assert [float(limit) for limit in cells[2].split(" to ")] == pytest.approx(
        [force["low"], force["high"]], rel=1e-2
    )
    assert cells[4] == "20.3935"
    assert "| constant-force, body carriage: F_0 | 3.25 | – | N | 3.1648 |" in text
    before = content["errors"]["hold_out"]["before"]["motion_nrmse"]
    (row,) = re.findall(r"\| Displacement, NRMSE \[%\] \|.*", text)
    assert float(row.split("|")[4]) == pytest.approx(100 * before, rel=1e-2)
    assert "| silverbox | no result yet |" in text
    assert "boltlaw close emps --seed 3" in text
    assert "images/measured-emps.svg" in text
    assert (tmp_path / "docs" / "images" / "measured-emps.svg").is_file()


def test_the_page_is_written_again_from_the_references_alone(tmp_path: Path) -> None:
    results(tmp_path / "results", closure(friction()))
    first = run(tmp_path / "docs", {"emps": tmp_path / "results"}).read_text()
    stored = tmp_path / "docs" / "measured" / "emps.json"
    assert stored.stat().st_size < 20_000
    assert "curve" not in re.findall(r'"(\w+)":', stored.read_text())
    assert run(tmp_path / "docs", {}).read_text() == first
    data = json.loads(stored.read_text())
    data["closure"]["summary"] = {"missing": "Words of an older program."}  # not shown
    data["model"]["bodies"][0]["mass"]["value"] = 77.125
    stored.write_text(json.dumps(data))
    assert "77.125" in run(tmp_path / "docs", {}).read_text()


def test_views_and_rivals_are_told_in_their_units() -> None:
    views = {"whiteness_p": 0.1, "force_error_hold_out": 0.1714, "simulation_rms_m in records/a.h5": 0.0142}
    text = views_table({"before": views, "after": {"force_error_hold_out": 0.0496}})
    assert re.search(r"Balance of forces.*, hold-out \[%\] \| 17.1 \| 4.96 \|", text)
    assert re.search(r"Simulated.*, records/a.h5 \[.*mV\] \| 14.2 \| – \|", text)
    assert "whiteness" not in text
    screened = [{"name": "cubic-stiffness", "enters": "guide", "share": 0.064, "strength": 1.0}]
    assert "| cubic-stiffness | link guide | 6.40 |" in alone_table(screened)
    assert (views_table({"before": {}, "after": {}}), alone_table(())) == ("", "")


def test_a_set_in_which_nothing_is_missing_has_its_section_too(tmp_path: Path) -> None:
    results(tmp_path / "results", closure(verdict="no-effect"))
    text = run(tmp_path / "docs", {"emps": tmp_path / "results"}).read_text()
    assert "| emps | no-effect | – |" in text
    assert "| coulomb-friction, link guide: F_c | not found | – |  | 20.3935 |" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["emps"], "SET=RESULTS"),
        (["epms=results"], 'expected "emps"'),
        (["emps=nothing"], "closure.json: found no such file"),
        (["emps=swapped"], "format: found 'boltlaw-model/1'"),
        (["emps=mixed"], "two campaigns"),
        (["emps=broken"], "expected JSON"),
    ],
)
def test_results_that_are_not_such_are_refused_and_nothing_is_written(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for name in ("results", "swapped", "mixed", "broken"):
        results(tmp_path / name, closure(friction()))
    (tmp_path / "swapped" / "closure.json").write_bytes((tmp_path / "swapped" / "model.json").read_bytes())
    model = tmp_path / "mixed" / "model.json"
    model.write_text(model.read_text().replace('"EMPS"', '"other"'))
    (tmp_path / "broken" / "closure.json").write_text("{")
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


def test_the_page_in_the_docs_is_that_of_its_references(tmp_path: Path) -> None:
    """A page that was edited by hand, or is older than its references, is found here."""
    if not (DOCS / "measured.md").exists():
        pytest.skip("docs/measured.md is not written yet: no results of the measured sets are stored")
    (tmp_path / "measured").mkdir()
    for path in (DOCS / "measured").glob("*.json"):
        (tmp_path / "measured" / path.name).write_bytes(path.read_bytes())
    assert run(tmp_path, {}).read_text() == (DOCS / "measured.md").read_text()


def test_every_public_set_has_a_section() -> None:
    from experiments.datasets import PUBLIC

    assert tuple(SETS) == PUBLIC
