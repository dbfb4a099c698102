"""One page of whatever result files a folder holds: right numbers, escaped names, no network, no script."""

import errno
import hashlib
import html
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
from experiments.text.equations import expression, math
from experiments.text.tables import errors_table, unit_shown
from experiments.text.verdicts import answer
from experiments.text.wording import label, number, with_limits
from rom.parameters.he_2025 import paper_model

HEADLINES = ("tension_loss_error_percent_median", "final_tension_error_percent_median", "motion_nrmse")
HOSTILE = '<script>alert("x")</script>'


def errors(scale: float, records: int = 14) -> dict[str, Any]:
    return {
        "motion_nrmse": 0.0123 * scale,
        "relative_motion_nrmse": 0.0821 * scale,
        "final_tension_error_percent_mean": 3.66 * scale,
        "final_tension_error_percent_median": 1.15 * scale,
        "final_tension_error_percent_max": 62.8 * scale,
        "tension_loss_error_percent_median": 21.4 * scale,
        "link_force_nrmse": None,
        "tension_rmse_n": 0.31 * scale,
        "records": records,
        "failed": 0,
    }


def identification(hold_out: float = 1.0) -> dict[str, Any]:
    return {
        "records": 40,
        "set_aside": [f"records/a.h5: clipped {HOSTILE}"],
        "warnings": ["records/b.h5: strain leaves the calibrated range"],
        "errors": {
            "training": errors(0.9),
            "hold_out": errors(hold_out, 7),
            "no_loosening": {"training": errors(4.0), "hold_out": errors(4.5, 7)},
        },
        "joint": [
            {"file": f"c{i}.h5", "tension_n": 10.0 * i, "modal_stiffness_n_per_m": None} for i in range(20)
        ],
        "convergence": {"split_n": 850.0, "cases": 20},
        "command": f"boltlaw identify {HOSTILE}",
        "campaign_digest": "0123abcd",
    }


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


def test_what_is_of_another_model_than_the_one_shown_says_so(folder: Path) -> None:
    """`discover` writes its model.json where that of `identify` was; a prediction may be of either."""
    digest = hashlib.sha256((folder / "model.json").read_bytes()).hexdigest()
    other = "prediction.json: of another model than model.json here."
    figures = "figures of other commands: of the identified model; model.json, the equations and the"
    for made, told in ((digest, False), ("0" * 64, True)):
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
        "With nothing fitted",
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


@pytest.mark.parametrize(
    ("loss", "final", "good"), [(20.0, 1.0, True), (180.0, 9.0, False), (20.0, 9.0, None)]
)
def test_the_verdict_weighs_both_measures(loss: float, final: float, good: bool | None) -> None:
    measures = ("tension_loss_error_percent_median", "final_tension_error_percent_median")
    own = errors(1.0) | dict(zip(measures, (loss, final), strict=True))
    rest = errors(1.0) | dict(zip(measures, (100.0, 2.0), strict=True))
    section = {"errors": {"training": own, "hold_out": errors(0, 0), "no_loosening": {"training": rest}}}
    found = answer("model", {"identification": section})
    assert found is not None
    assert found.good is good
    assert "none was held out" in found.sentences[0]


@pytest.mark.parametrize(
    ("units", "shown"),
    [
        (("s3/m4", "m^-4 s^3", "s^3 m^-4", "s**3/m**4"), "m<sup>−4</sup> s<sup>3</sup>"),
        (("N s/m", "N s m^-1", "N m^-1 s"), "N m<sup>−1</sup> s"),
        (("1/J", "J^-1"), "J<sup>−1</sup>"),
        (("1", "N/N"), ""),
        (("decades per cycle (5)",), "decades per cycle (5)"),
    ],
)
def test_one_unit_is_typeset_alike_however_it_was_written(units: tuple[str, ...], shown: str) -> None:
    assert {str(unit_shown(unit)) for unit in units} == {shown}


@pytest.mark.parametrize(
    ("fitted", "question", "words"),
    [
        (
            True,
            "Does the model meet the campaign that it was fitted to?",
            "only its 2 hold-out records were",
        ),
        (False, "Does the model predict a campaign to which it was not fitted?", "With nothing fitted"),
        (None, "Does the model predict this campaign?", "file does not say which campaign it was fitted to"),
    ],
)
def test_a_prediction_says_whose_campaign_it_is_and_what_noise_alone_would_make(
    fitted: bool | None, question: str, words: str
) -> None:
    floor = {"motion_nrmse": 0.0099, "tension_loss_error_percent_median": 1.5}
    floor["tension_loss_error_percent_median_with_variability"] = 18.0
    data = {
        "errors": errors(1.0), "noise_floor": floor, "fitted_to_this_campaign": fitted,
        "sets": {"errors": {"hold_out": errors(1.0, 2)}},
    }  # fmt: skip
    found = answer("prediction", data)
    assert found is not None
    assert found.question == question
    text = " ".join((found.verdict, *found.sentences))
    assert words in text
    assert "1.23 % (NRMSE), where noise alone would give 0.990 %" in text
    assert "noise alone: 1.50 %, with the variability between tests: 18.0 %" in text
    table = errors_table(data["errors"], "", floor)
    assert table is not None
    assert ("– noise alone would give [%]", "0.990") in table.rows


def test_every_number_in_a_sentence_is_that_of_its_key() -> None:
    """Errors differ from each other, so that one in the place of another is another sentence."""
    found = answer("model", {"identification": identification()})
    assert found is not None
    assert found.verdict == (
        "The tension law predicts more than a bolt that never loosens: it is off by 21.4 % of a record's "
        "loss (median), no loosening by 96.3 %."
    )
    final = "The final tension is off by 1.15 % (median; mean 3.66 %, largest 62.8 %)"
    small = "Where a loss is a small share of the tension, this measure is small for any law."
    assert found.sentences == (
        "The model was identified from 40 records and checked on records that no fit has seen.",
        f"{final}, without loosening by 5.17 %. {small}",
        "The error of the displacements is 1.23 % (NRMSE).",
        "1 record of doubtful quality set aside, listed below.",
        "1 warning, listed below.",
    )
    assert [one.shown for one in found.headlines] == ["21.4 %", "1.15 %", "1.23 %"]
    bands = [{"low": 1.0, "high": 2.0, "measured": measured} for measured in (0.9, 1.5, 2.1, 1.9, 1.0)]
    records = [{"final_tension_n": band} for band in (*bands, {"low": None, "high": None, "measured": 1.5})]
    told = answer("prediction", {"errors": errors(1.0) | {"failed": 2}, "records": records})
    assert told is not None
    assert told.sentences == (
        "14 records compared; 2 simulations did not finish.",
        "The error of the displacements is 1.23 % (NRMSE): the model does not describe the motion.",
        f"{final}. {small}",
        "3 of 5 measured final tensions lie within their 95 % limits.",
        "The model's file does not say which campaign it was fitted to.",
    )
    assert [one.shown for one in told.headlines] == ["21.4 %", "1.15 %", "1.23 %"]


def test_a_prediction_of_before_says_nothing_of_records_held_out() -> None:
    data = {"errors": errors(1.0), "fitted_to_this_campaign": True}
    found, told = answer("prediction", data), answer("prediction", data | {"sets": {}})
    assert found is not None
    assert told is not None
    assert found.sentences[-1] == "This campaign is that of the fit."
    assert told.sentences[-1].endswith("none of its records was held out.")


def test_numbers_and_keys_in_words() -> None:
    assert number(4.74e-7) == "4.740 × 10⁻⁷"
    assert number(-0.00922, 3) == "−0.00922"
    assert number(976300.0) == "976300"
    assert number(-0.0) == "0"
    assert number(None) == number(float("nan")) == "–"
    assert with_limits(11.7912, 11.5, 12.1) == ("11.8", "11.5 to 12.1")
    assert with_limits(4.0, None, None) == ("4", "–")
    assert label("tension_loss_n") == "Tension loss [N]"
    assert label("modal_damping_ns_per_m") == "Modal damping [N s/m]"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a - (b - c)", "a−(b−c)"),
        ("(a - b) - c", "a−b−c"),
        ("-(a + b) * c", "−(a+b)c"),
        ("a * -b", "a(−b)"),
        ("(-a) ** 2", "(−a)2"),
        ("2 * 3", "2·3"),
        ("max(T, 0) * abs(v) ** n", "T|v|n"),
        ("mu T tanh(v / v_s)", "μTtanh(vvs)"),
    ],
)
def test_expressions_keep_their_meaning(text: str, expected: str) -> None:
    shown = expression(text)
    assert shown is not None
    plain = html.unescape(re.sub(r"<[^>]+>", "", str(math(shown)))).replace("\u2062", "")
    assert plain == expected


@pytest.mark.parametrize(
    "text", ["", "a =", "__import__('os')", "a if b else c", "'x'", "a.b", "[1]", "(" * 500]
)
def test_what_is_no_expression_is_not_typeset(text: str) -> None:
    assert expression(text) is None
