"""What the page draws again is what matplotlib drew: traces, looks, units; other figures stay pictures."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from experiments.figures import courses
from experiments.figures.courses import chosen_records, record_figures
from experiments.figures.description import Drawn, describe, name_points, plain_text
from experiments.figures.style import panels, save
from experiments.report.interactive import (
    description_of,
    legend_of,
    plots_of,
    within_room,
    without_description,
)
from experiments.studies import report
from rom.evaluation.replay import Replay, replay
from rom.model.model import Model
from rom.parameters.he_2025 import paper_model
from rom.signals.processing import Measurement
from tests.experiments.figures.test_figures import measurement

TESTS = (("loosening", 317), ("coupled", 3000))
MODELS = {"Declared model": paper_model(), "Refined model": paper_model()}


def numbers(coded: Any) -> list[float]:
    """Return an array as the page reads it."""
    if isinstance(coded, list):
        return coded
    steps = np.frombuffer(base64.b64decode(coded["steps"]), "<u2")
    values = coded["low"] + (coded["high"] - coded["low"]) * steps / 65535
    return list(np.exp(values) if coded["log"] else values)


def drawn() -> Drawn:
    """A law with its band, points with limits and names, a level, a shaded range."""
    figure, axes = panels()
    ax = axes[0, 0]
    x = np.linspace(1.0, 10.0, 400)
    ax.set_yscale("log")
    ax.fill_between(x, np.exp(x) / 2, 2 * np.exp(x), color="#D55E00", alpha=0.2)
    ax.plot(x, np.exp(x), "--", color="#D55E00", label="$\\gamma$, law")
    points = ax.errorbar([2.0, 3.0], [7.0, 20.0], [1.0, 2.0], fmt="o", color="#000000", label="Records")
    name_points(points.lines[0], ["a.h5", "b.h5"])
    ax.axhline(100.0, color="#8c8c8c", label="Level")
    ax.axvspan(4.0, 5.0, color="#009E73", alpha=0.3)
    ax.axhspan(2.0, 3.0, color="#009E73", alpha=0.3)
    ax.set_xlabel("Bolt tension $T$ [N]")
    ax.set_ylabel("$\\gamma$ [s$^3$/m$^4$]")
    return figure


def test_a_figure_is_described_with_names_units_and_looks() -> None:
    shown = describe(drawn())
    assert shown is not None
    (panel,) = shown["panels"]
    assert (panel["x"]["quantity"], panel["x"]["unit"]) == ("Bolt tension T", "N")
    assert (panel["y"]["label"], panel["y"]["scale"]) == ("γ [s³/m⁴]", "log")
    glyphs = {trace["glyph"]: trace for trace in panel["traces"]}
    assert set(glyphs) == {"patch", "line", "scatter", "segment", "hspan", "vstrip", "hstrip"}
    assert glyphs["line"]["look"]["line_dash"] == "dashed"
    assert {mark.label for mark in legend_of(shown)} == {"γ, law", "Records", "Level"}
    own = dict(zip((t["glyph"] for t in panel["traces"]), shown["choices"][""][0]["traces"], strict=True))
    assert own["scatter"] == {"x": [2.0, 3.0], "y": [7.0, 20.0], "name": ["a.h5", "b.h5"]}
    assert own["vstrip"] == {"x0": [4.0], "x1": [5.0]}
    assert own["hstrip"] == {"y0": [2.0], "y1": [3.0]}
    assert own["segment"]["y0"] == [6.0, 18.0]
    x = np.array(numbers(own["line"]["x"]))
    assert numbers(own["line"]["y"]) == pytest.approx(np.exp(x), rel=1e-3)


@pytest.mark.parametrize(
    ("marks", "ticks"),
    [
        (([0, 1], ["body so", "$x^2$"]), [[0.0, "body so"], [1.0, "x²"]]),
        (([-5, 5],), None),  # numbers, which are others when it is zoomed
        (([],), []),
    ],
)
def test_names_along_an_axis_stay_names(marks: tuple[list[Any], ...], ticks: object) -> None:
    figure, axes = panels()
    axes[0, 0].plot([3.0, 4.0], [0.0, 1.0])
    axes[0, 0].set_yticks(*marks)
    shown = describe(figure)
    assert shown is not None
    (panel,) = shown["panels"]
    assert (panel["y"]["ticks"], panel["x"]["ticks"]) == (ticks, None)


def test_maps_names_in_a_panel_and_other_scales_are_not_described() -> None:
    for spoil in (
        lambda ax: ax.pcolormesh(np.ones((2, 2))),
        lambda ax: ax.annotate("a name", (0.0, 1.0)),
        lambda ax: ax.set_yscale("symlog"),
        lambda ax: ax.text(1.0, 3.0, "Regime I"),
        lambda ax: ax.scatter([1.0], [3.0]),
        lambda ax: ax.add_patch(Circle((1.0, 3.0), 0.1)),
        lambda ax: ax.imshow(np.ones((2, 2))),
        lambda ax: ax.plot([1.0], [3.0], "*"),
        lambda ax: ax.twinx(),
    ):
        figure, axes = panels()
        axes[0, 0].plot([1.0, 2.0], [3.0, 4.0])
        assert describe(figure) is not None
        spoil(axes[0, 0])
        assert describe(figure) is None
    assert describe(Figure()) is None


def test_formulas_become_letters() -> None:
    assert plain_text("$x_\\mathrm{so}$ [µm]") == "x_so [µm]"
    assert plain_text("$s^{-1}$ $10^{12}$ m^2") == "s⁻¹ 10¹² m²"
    assert plain_text("|D v|^2.17 T^0.511 + $|v|^{4.5}$ |x|^2.") == "|D v|^2.17 T^0.511 + |v|^4.5 |x|²."
    assert plain_text("Rise of $-2\\,\\ln L$ [1]") == "Rise of -2 ln L [1]"


@pytest.fixture(scope="module")
def records() -> dict[str, Drawn]:
    found = [measurement(317.0), measurement(3000.0, "coupled", 28.0)]
    return chosen_records("records", record_figures(found, MODELS))


def test_records_are_chosen_from_with_both_models_and_what_they_leave(records: dict[str, Drawn]) -> None:
    shown = describe(records["records"])
    assert shown is not None
    titles = {f"records/{test}_{tension}.h5, {test}, {tension} N" for test, tension in TESTS}
    assert set(shown["choices"]) == titles
    assert [mark.label for mark in legend_of(shown)] == ["Measured", *MODELS]
    (legend,) = records["records"].legends  # of the figure that is printed: the same looks, the same words
    said = [(mark.get_color(), mark.get_linestyle(), words.get_text()) for mark, words in
            zip(legend.get_lines(), legend.get_texts(), strict=True)]  # fmt: skip
    lines = records["records"].axes[0].lines
    assert said == [(line.get_color(), line.get_linestyle(), str(line.get_label())) for line in lines]
    dashes = [trace["look"]["line_dash"] for trace in shown["panels"][0]["traces"]]
    assert dashes == ["solid", "dashed", "dashdot"]
    panel, left = shown["choices"]["records/loosening_317.h5, loosening, 317 N"][:2]
    assert {one[0]["title"] for one in shown["choices"].values()} == {"Displacement of lo [mm]"}  # one unit
    assert shown["panels"][0]["y"]["unit"] == "mm"
    peak = 1e3 * np.abs(measurement(317.0).displacement("lo")).max()
    assert np.abs(numbers(panel["traces"][0]["y"])).max() == pytest.approx(peak, rel=1e-3)
    assert np.abs(numbers(left["traces"][1]["y"])).max() < 1e-3 * peak  # the model that measured it


def test_records_of_one_name_are_all_there_and_a_model_that_diverges_is_told_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = measurement(317.0)
    worse, other = (replace(one, file=f"{folder}/run_1.h5", hold_out=held) for folder, held in
                    (("a", True), ("b", False)))  # fmt: skip
    declared = MODELS["Declared model"]

    def diverging(model: Model, record: Measurement) -> Replay:
        run = replay(model, record)
        ill = model is declared and record.hold_out
        return replace(run, response=replace(run.response, status="diverged")) if ill else run

    monkeypatch.setattr(courses, "replay", diverging)
    told: list[tuple[int, int]] = []
    shown = record_figures((other, worse), MODELS, lambda *now: told.append(now))
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert list(shown) == [
        "a/run_1.h5, loosening, 317 N, held out, Declared model does not finish",
        "b/run_1.h5, loosening, 317 N",
    ]


def test_a_fault_of_a_replay_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("a fault")

    monkeypatch.setattr(courses, "replay", fail)
    with pytest.raises(ValueError, match="a fault"):
        record_figures([measurement(317.0)], MODELS)


def test_figures_to_choose_from_must_be_alike() -> None:
    one, two = drawn(), drawn()
    two.axes[0].plot([1.0, 2.0], [1.0, 2.0])
    one.choices = {"one": lambda: one, "two": lambda: two}
    with pytest.raises(ValueError, match="the same traces"):
        describe(one)


def test_a_file_carries_its_description_and_the_page_takes_it_out(tmp_path: Path) -> None:
    figure = drawn()
    figure.axes[0].set_title("a < b & c")
    svg = save(figure, tmp_path / "law.svg").read_bytes()
    assert description_of(svg) == json.loads(json.dumps(describe(figure)))
    assert description_of(without_description(svg)) is None
    assert b"a &lt; b &amp; c</text>" in svg  # text is text
    assert b"/Type0" in save(figure, tmp_path / "law.pdf").read_bytes()  # an embedded TrueType font


def test_what_does_not_fit_on_the_page_loses_choices_first() -> None:
    choices = {str(number): [list(range(100))] for number in range(8)}
    figures = {"small": {"choices": {"": [1]}}, "large": {"choices": choices}}
    kept = within_room(figures, 2000)
    assert list(kept["large"]["choices"]) == ["0", "2", "4", "6"]
    assert list(within_room(figures, 100)) == ["small"]
    assert within_room(figures, -1.0) == {}


def test_a_page_leaves_out_choices_that_would_make_it_too_large(tmp_path: Path) -> None:
    figure, axes = panels()
    axes[0, 0].plot(np.geomspace(1.0, 2.0, 20_000), np.geomspace(1.0, 3.0, 20_000), label="Line")
    figure.choices = {f"record {number}": lambda: figure for number in range(60)}  # some 100 kB each
    save(figure, tmp_path / "records.svg")
    paper_model().save(tmp_path / "model.json")
    page = report.run(tmp_path)
    assert page.stat().st_size < 5e6
    assert 10 < page.read_text(encoding="utf-8").count("<option") < 60


def test_what_cannot_be_drawn_from_its_description_stays_a_picture() -> None:
    def with_trace(**changes: Any) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(json.dumps(describe(drawn())))
        found["panels"][0]["traces"][0] |= changes
        return found

    found = {
        "sound": with_trace(), "other": with_trace(glyph="add_tools"), "number": with_trace(label=1.0),
        "look": with_trace(look={"unknown": 1}), "infinite": with_trace(look={"line_width": np.inf}),
        "empty": {},
    }  # fmt: skip
    assert list(plots_of(found)) == ["sound"]
