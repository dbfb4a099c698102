"""One page of whatever result files a folder holds: right numbers, escaped names, no network, no script."""

import errno
import hashlib
import json
import os
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from experiments.report.results import ResultError
from experiments.studies import report
from rom.parameters.he_2025 import paper_model
from tests.experiments.made_up import HOSTILE, errors, identification

HEADLINES = ("tension_loss_error_percent_median", "final_tension_error_percent_median", "motion_nrmse")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    paper_model().save(
        tmp_path / "model.json",
        campaign=f"lab {HOSTILE} & co",
        seed=7,
        elapsed_s=12.5,
        identification=identification(),
    )
    (tmp_path / "gamma-law.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"/>', "utf-8"
    )
    (tmp_path / "my-own figure.svg").write_text("<svg><script>alert(1)</script></svg>", "utf-8")
    return tmp_path


def write(folder: Path, kind: str, **content: Any) -> None:
    head = {
        "format": f"boltlaw-{kind}/1",
        "campaign": "c",
        "program_version": "0.1.0",
        "seed": 1,
        "elapsed_s": 1.0,
    }
    (folder / f"{kind}.json").write_text(json.dumps(head | content), encoding="utf-8")


class Page(HTMLParser):
    """Tags, attributes and text of a page; void elements aside, every tag must be closed in order."""

    VOID = frozenset({"meta", "link", "img", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))

    def values(self, tag: str, attribute: str) -> list[str]:
        return [
            attributes[attribute] or ""
            for name, attributes in self.tags
            if name == tag and attribute in attributes
        ]


def page(folder: Path) -> Page:
    return Page(report.run(folder).read_text(encoding="utf-8"))


def test_headline_numbers_are_those_of_the_file(folder: Path) -> None:
    shown = page(folder)
    held = identification()["errors"]["hold_out"]
    expected = [held[key] for key in HEADLINES]
    assert [float(value) for value in shown.values("data", "value")] == expected
    assert "21.4 %" in shown.words
    assert "The tension law predicts more than a bolt that never loosens" in shown.words
    assert "records that no fit has seen" in shown.words


def test_parameters_come_with_limits_and_units(folder: Path) -> None:
    data = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    joint = next(link for link in data["links"] if link["name"] == "joint")
    joint["stiffness"]["parameters"]["k_i"] |= {"value": 976300.0, "low": 970000.0, "high": 982000.0}
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    assert re.search(r"joint: stiffness 976300 970000 to 982000 N m −1", page(folder).words)


def test_a_mass_that_was_identified_has_its_limits(folder: Path) -> None:
    data = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    mass = data["bodies"][0]["mass"]["value"]
    data["identification"]["linear"] = [{"name": "body.lo.mass", "value": mass, "error_percent": 1.0}]
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    low, high = (f"{mass * (1 + sign * 0.0196):.3g}" for sign in (-1, 1))
    assert re.search(rf"m body lo \S+ {low}\d* to {high}\d* kg", page(folder).words)


def test_numbers_of_a_link_without_the_bolt_stand_beside_those_with_it(folder: Path) -> None:
    data = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    (flexure,) = (link for link in data["links"] if link["name"] == "flexure_lo")
    alone = flexure["stiffness"]["parameters"]["k"] | {"value": 8150.0, "low": 8080.0, "high": 8219.0}
    laws = {key: flexure[key] for key in ("damping", "tension_rate")}
    bolt_out = {
        "name": "flexure_lo",
        "stiffness": flexure["stiffness"] | {"parameters": {"k": alone}},
        **laws,
    }
    (folder / "model.json").write_text(json.dumps(data | {"uncoupled_links": [bolt_out]}), encoding="utf-8")
    assert "flexure_lo: stiffness, bolt out 8150 8080 to 8219 N m −1" in page(folder).words


def test_versions_stand_once_and_by_file_where_they_differ(folder: Path) -> None:
    data = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    own = {"versions": {"Python": "3.11", "NumPy": "2.1"}}
    (folder / "model.json").write_text(json.dumps(data | own), encoding="utf-8")
    both = ("Versions of ranking.json", "Versions of model.json")
    for version, count in (("2.1", 1), ("2.2", 2)):
        write(folder, "ranking", laws=[], versions={"Python": "3.11", "NumPy": version})
        words = page(folder).words
        assert words.count("NumPy") == count
        assert [head in words for head in both] == [count == 2] * 2


def test_warnings_of_a_ranking_are_not_those_of_the_refined_model(folder: Path) -> None:
    effect = {"name": "x", "enters": "joint", "parameters": {}}
    marked = "ranking.json: links had not settled"
    others = "ranking.json and figures of other commands: of the model without what the closed loop added"
    for effects in ([], [effect]):
        write(folder, "closure", verdict="closed", effects=effects, warnings=[])
        write(folder, "ranking", laws=[], warnings=["links had not settled"])
        words = page(folder).words
        assert "links had not settled" in words
        assert (marked in words) is (others in words) is bool(effects)


def test_names_are_escaped_and_nothing_runs_or_loads(folder: Path) -> None:
    text = report.run(folder).read_text(encoding="utf-8")
    shown = Page(text)
    assert not [tag for tag, _ in shown.tags if tag in ("script", "iframe", "object", "embed")]
    assert HOSTILE in shown.words  # as text
    assert "default-src 'none'" in shown.values("meta", "content")[-1]
    links = shown.values("img", "src") + shown.values("link", "href") + shown.values("a", "href")
    assert len(shown.values("img", "src")) == 2
    assert all(link.startswith(("data:", "#")) for link in links)


def test_every_anchor_has_its_place(folder: Path) -> None:
    shown = page(folder)
    ids = [attributes["id"] for _, attributes in shown.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in shown.values("a", "href")} <= set(ids)


def test_laws_and_motion_are_typeset(folder: Path) -> None:
    text = report.run(folder).read_text(encoding="utf-8")
    assert text.count('<math display="block">') == 3  # k, c and dT/dt
    assert text.count('<p class="terms">') == 2  # a body each
    assert "<mfrac>" in text
    assert "<mi>γ</mi>" in text


def test_how_it_was_made(folder: Path) -> None:
    words = page(folder).words
    for part in ("model.json", "0123abcd", "Seed 7", "12.5", f"boltlaw identify {HOSTILE}"):
        assert part in words


def test_the_same_files_make_the_same_page(folder: Path, tmp_path: Path) -> None:
    first = report.run(folder, tmp_path / "first").read_bytes()
    assert report.run(folder, tmp_path / "second.html").read_bytes() == first
    assert (tmp_path / "second.html").is_file()


def test_a_broken_file_is_named_and_the_rest_is_shown(folder: Path) -> None:
    (folder / "closure.json").write_text('{"format": "boltlaw-closure/1", ', encoding="utf-8")
    (folder / "prediction.json").mkdir()
    (folder / "ranking.json").write_text('{"laws": []}', encoding="utf-8")
    (folder / "other.json").write_text("[1, 2]", encoding="utf-8")
    words = page(folder).words
    assert "closure.json: could not be read" in words
    assert f"prediction.json: could not be read as a result file ({os.strerror(errno.EISDIR)})" in words
    assert "ranking.json: could not be read" in words
    assert "other.json" not in words


ODD = {
    "closure": {"command": ["close"], "errors": {}},
    "ranking": {"command": {}, "laws": []},
}


@pytest.mark.parametrize("kind", ODD)
def test_a_file_with_a_value_of_another_kind_is_named_and_the_rest_is_shown(kind: str, folder: Path) -> None:
    write(folder, kind, **ODD[kind])
    found = page(folder)
    assert f"{kind}.json: could not be read as a result file (found a value of another kind" in found.words
    assert "Seed 7" in found.words
    (folder / "model.json").unlink()
    with pytest.raises(ResultError, match=rf"{kind}\.json: could not be read"):
        report.run(folder)


def test_half_a_letter_costs_no_page(folder: Path) -> None:
    write(folder, "prediction", errors=errors(1.0), records=[], command="boltlaw \ud800 predict")
    assert "boltlaw ? predict" in page(folder).words


def test_what_is_of_another_model_than_the_one_shown_says_so(folder: Path) -> None:
    """`discover` writes its model.json where that of `identify` was; a prediction may be of either."""
    digest = hashlib.sha256((folder / "model.json").read_bytes()).hexdigest()
    other = "prediction.json: of another model than model.json here."
    figures = "figures of other commands: of the identified model; model.json, the equations and the"
    for made, told in ((digest, False), ("0" * 64, True), (["a.h5"], True)):
        write(folder, "prediction", errors=errors(1.0), records=[], model_digest=made)
        assert (other in page(folder).words) is told
    for command, told in (("boltlaw discover", False), (f"boltlaw identify {HOSTILE}", True)):
        write(folder, "ranking", laws=[], command=command)
        assert (figures in page(folder).words) is told
    for drawn in folder.glob("*.svg"):
        drawn.unlink()
    (folder / "law-errors.svg").write_text("<svg/>", "utf-8")
    assert figures not in page(folder).words


def test_the_truth_of_the_rig_is_not_shown(folder: Path) -> None:
    write(folder, "truth", secret=42424242.0)
    assert "42424242" not in page(folder).words


@pytest.mark.parametrize("make", [lambda path: path / "nowhere", lambda path: path])
def test_a_folder_without_results_is_refused(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    with pytest.raises(ResultError, match="expected"):
        report.run(make(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_reproduction_says_what_is_outside(tmp_path: Path) -> None:
    row = {
        "quantity": "loss, 5.9 N",
        "paper": 4.74e-7,
        "ours": 4.9e-7,
        "unit": "N",
        "tolerance": 7e-8,
        "within": True,
    }
    far = row | {"quantity": "loss, 152.7 N", "paper": 5.44, "ours": 9.0, "within": False}
    write(tmp_path, "reproduction", rows=[row, far], errors={"identified model": errors(1.0)})
    words = page(tmp_path).words
    assert "1 of 2 printed numbers are met" in words
    assert "Outside: loss, 152.7 N." in words
    assert "4.74 × 10⁻⁷" in words
    write(tmp_path, "reproduction", rows=[row])
    assert "All 1 printed numbers are met" in page(tmp_path).words


def test_later_and_unknown_files_are_shown(tmp_path: Path) -> None:
    a = {"value": 0.5, "low": 0.4, "high": 0.6, "unit": "1/m"}
    law = {"rank": 1, "name": "slip work", "equation": "-a * abs(F * v)", "parameters": {"a": a}}
    profile = {"values": [2, 3, 4], "delta_bic": [9.0, 2.0, 0.0]}
    write(tmp_path, "ranking", laws=[law | {"errors": {"hold_out": errors(1.0)}}], exponent_profile=profile)
    effect = {"name": "coulomb-friction", "enters": "joint", "equation": "mu T tanh(v / v_s)"}
    both = {"before": errors(2.0), "after": errors(1.0)}
    steps, residual = [{"added": "x", "errors": {"hold_out": errors(1.0)}}], {"after": {"whiteness_p": 0.3}}
    two = {"training": both, "hold_out": both}
    write(tmp_path, "closure", verdict="closed", effects=[effect], errors=two, steps=steps, residual=residual)
    predicted = [{"file": "r.h5", "final_tension_n": {"simulated": 1.5}}]
    write(tmp_path, "prediction", errors=errors(1.0), records=predicted)
    deep = {"a": {"b": {"c": {"d": {"e": [{"f": 1}]}}}}}
    write(tmp_path, "novelty", deep=deep, flat=[1, 2], nothing=None)
    words = page(tmp_path).words
    for part in (
        "“slip work” ranks first",
        "slip work a 0.500 0.400 to 0.600 m −1",
        "The loop closes",
        "Added: coulomb-friction",
        "Hold-out, before",
        "Loss of tension, median error [%] 42.8 21.4",
        "noise were left [1] – 0.3",
        "The model is off by",
        "Final tension [N], simulated",
        "Novelty: flat",
    ):
        assert part in words, part


def test_a_model_alone_is_shown_without_a_verdict(tmp_path: Path) -> None:
    paper_model().save(tmp_path / "model.json")
    words = page(tmp_path).words
    assert "masses: 2, links: 3" in words
    assert "91800" in words


def test_absent_parts_leave_gaps_not_faults(tmp_path: Path) -> None:
    for kind in ("model", "reproduction", "prediction", "ranking", "closure"):
        write(tmp_path, kind)
    assert "How it was made" in page(tmp_path).words
