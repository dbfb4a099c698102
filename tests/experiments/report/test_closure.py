"""A closed loop as figures, tables and plain words: all that closure.json holds, and no more."""

from __future__ import annotations

import html
import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from discovery.loop.refitted_numbers import with_limits
from discovery.loop.result import Closure
from discovery.views.closure_file import closure_section
from experiments.figures.closure import closure_figures
from experiments.figures.description import describe
from experiments.figures.style import COLUMN_MM, save
from experiments.results import plain
from experiments.studies import report
from experiments.studies.close import model_section
from experiments.text import closures
from experiments.text.equations import effect_equations
from rom.effects import CATALOGUE
from rom.model.laws import Parameter
from tests.discovery.sound_closure import (
    LADDER,
    closure,
    force_map,
    friction,
    threshold,
)

ALL = {"closure-errors", "closure-residual", "closure-screened", "closure-effects", "closure-limits"}
COMMAND = "boltlaw close campaign"


def curves() -> list[dict[str, Any]]:
    """Curves of a force, a rate and a reading, as the study works them out."""
    phase = np.linspace(0.0, 6.0, 50)
    force = {"displacement_m": 1e-4 * np.sin(phase), "velocity_m_per_s": 0.03 * np.cos(phase),
             "force_n": np.tanh(30 * np.cos(phase))}  # fmt: skip
    reading = {"displacement_m": 1e-4 * np.sin(phase), "time_s": phase, "reading_n": -0.1 * phase}
    speed = np.geomspace(1e-3, 0.1, 20)
    rate = {"peak_velocity_m_per_s": speed, "rate_without_n_per_s": -1e6 * speed**4,
            "rate_n_per_s": np.where(speed > 0.025, -1e5 * speed**4, 0.0)}  # fmt: skip
    return [
        {
            "kind": kind,
            "records": [{"file": "a.h5", "initial_tension_n": tension, **one} for tension in (6.0, 2995.4)],
        }
        for kind, one in (("force", force), ("tension rate", rate), ("reading", reading))
    ]


def content(found: Closure, *drawn: dict[str, Any] | None) -> dict[str, Any]:
    data = closure_section(found) | {"command": COMMAND, "campaign_digest": "0123abcd"}
    for row, curve in zip(data["effects"], drawn or [None] * len(data["effects"]), strict=True):
        row["curve"] = curve
    made: dict[str, Any] = json.loads(json.dumps(plain(data), allow_nan=False))
    return made


def two() -> dict[str, Any]:
    return content(closure(friction(), threshold()), *curves()[:2])


def test_a_closure_gives_every_figure_one_column_wide_with_units(tmp_path: Path) -> None:
    made = closure_figures(two())
    assert set(made) == ALL
    for name, figure in made.items():
        assert figure.get_figwidth() == pytest.approx(COLUMN_MM / 25.4)
        path = save(figure, tmp_path / f"{name}.svg")
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
        for axes in figure.axes:
            labels = axes.get_xlabel() + axes.get_ylabel()
            assert not labels or "[" in labels, f"{name}: an axis without unit: {labels}"


def test_classes_effects_and_steps_are_named_where_a_figure_is_zoomed() -> None:
    made = closure_figures(two())
    for name, axis, words in (
        ("residual", "y", "acceleration lo"),
        ("limits", "y", "cubic-stiffness"),
        ("errors", "x", "none"),
    ):
        shown = describe(made[f"closure-{name}"])
        assert shown is not None
        assert words in [text for panel in shown["panels"] for _, text in panel[axis]["ticks"]], name


@pytest.mark.parametrize(
    ("lacking", "gone"),
    [
        ("steps", {"closure-errors"}),
        ("residual", {"closure-residual"}),
        ("screened", {"closure-screened"}),
        ("detection_limits", {"closure-limits"}),
        ("effects", {"closure-effects"}),
        ("summary", set()),
    ],
)
def test_missing_data_is_a_missing_figure(lacking: str, gone: set[str]) -> None:
    data = two()
    del data[lacking]
    assert set(closure_figures(data)) == ALL - gone


def test_nothing_and_the_least_that_the_contract_asks_for_give_no_figures() -> None:
    least = {"effects": [{"name": "x"}], "steps": [{"added": "x", "errors": {}}],
             "residual": {"before": {"body": "lo"}, "after": {"whiteness_p": 0.3}}}  # fmt: skip
    assert closure_figures({}) == closure_figures(least) == {}


def test_gaps_are_left_out_of_the_figures() -> None:
    data = two()
    data["steps"][1]["errors"]["hold_out"]["motion_nrmse"] = None
    data["residual"]["after"]["by_test"]["coupled"] = None
    del data["residual"]["after"]["by_channel"]["tension"]
    data["screened"][0]["share"] = None
    data["effects"][0]["curve"]["records"][0]["initial_tension_n"] = None
    for figure in closure_figures(data).values():
        figure.draw_without_rendering()
        for axes in figure.axes:
            assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()


def test_the_residual_is_drawn_before_and_after_and_once_where_nothing_changed() -> None:
    data = two()
    axes = closure_figures(data)["closure-residual"].axes
    titles = [ax.get_title(loc="left") for ax in axes]
    assert titles == ["Channel", "Kind of test", "Frequency", "Preload", "Amplitude"]
    lines = {line.get_label(): list(line.get_xdata()) for line in axes[0].get_lines()}
    for when in ("before", "after"):
        assert lines[when.capitalize()] == list(data["residual"][when]["by_channel"].values())
    same = closure_figures(content(closure(verdict="no-effect")))["closure-residual"].axes[0]
    assert [line.get_label() for line in same.get_lines()] == ["Noise alone", "Residual"]


def test_correlations_are_drawn_beside_what_noise_has() -> None:
    data = two()
    for when, value in (("before", 0.9), ("after", 0.01)):
        data["residual"][when] |= {"repeatability": value, "line_correlation_coupled": value / 2}
    data["residual"]["after"] |= {"repeatability_chance": 0.1, "line_correlation_coupled_chance": 0.03}
    (axes,) = closure_figures(data)["closure-correlation"].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "Lines side by side, coupled",
        "Tests that repeat each other",
    ]
    drawn = {line.get_label(): list(line.get_xdata()) for line in axes.get_lines()}
    assert drawn == {"Before": [0.45, 0.9], "After": [0.005, 0.01]}
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([0.06, 0.2])
    del (
        data["residual"]["after"]["repeatability_chance"],
        data["residual"]["after"]["line_correlation_coupled"],
    )
    assert "closure-correlation" not in closure_figures(data)


def with_forces(found: Closure) -> Closure:
    """The same with the force that is left, before and after."""
    before, after = (
        replace(residual, forces=(force_map("body so", scale), force_map("joint", 2 * scale)))
        for residual, scale in ((found.residual_before, 1.0), (found.residual_after, 0.01))
    )
    return replace(found, residual_before=before, residual_after=after)


def test_the_force_left_is_drawn_with_one_scale_and_as_loops() -> None:
    figure = closure_figures(content(with_forces(closure(friction()))))["closure-force"]
    figure.draw_without_rendering()
    first, second, bar, loops = figure.axes
    assert [ax.get_title(loc="left") for ax in (first, second)] == ["Before, joint", "After, joint"]
    assert first.collections[0].get_clim() == second.collections[0].get_clim()
    assert [line.get_label() for line in loops.get_lines()] == ["Before", "After"]
    for ax in (first, loops):
        assert "[µm]" in ax.get_xlabel()
    assert bar.get_xlabel() == "Force [N]"
    alone = closure_figures(content(with_forces(closure(verdict="no-effect"))))["closure-force"]
    assert len(alone.axes) == 3


def test_the_page_tells_the_force_that_is_left(tmp_path: Path) -> None:
    words = shown(content(with_forces(closure(friction()))), tmp_path)
    for part in (
        "The force left at joint Before After Mean square over that of noise [1] 20.0 0.200",
        "A function of displacement and velocity [%] 80.0 80.0",
        "Work in a cycle, first three [mJ] 0.0400 0.0400",
    ):
        assert part in words, part
    assert "force_n" not in words


def test_errors_are_drawn_step_by_step() -> None:
    data = two()
    axes = closure_figures(data)["closure-errors"].axes
    assert [ax.get_title(loc="left") for ax in axes][2:] == ["Loss of tension [%]", "Tension [N]"]
    held, _ = axes[0].get_lines()
    expected = [100 * step["errors"]["hold_out"]["motion_nrmse"] for step in data["steps"]]
    assert list(held.get_ydata()) == pytest.approx(expected)
    assert [text.get_text() for text in axes[0].get_xticklabels()] == ["none", "1", "2"]


def test_errors_of_almost_nothing_are_drawn_at_the_edge() -> None:
    data = two()
    for step in data["steps"]:
        step["errors"]["training"]["motion_nrmse"] = 1e-12
    axes = closure_figures(data)["closure-errors"].axes[0]
    low, high = axes.get_ylim()
    assert high / low < 3e3
    assert all(low < value < high for line in axes.get_lines() for value in line.get_ydata())


def test_the_board_marks_what_was_added() -> None:
    (axes,) = closure_figures(two())["closure-screened"].axes
    named = [text.get_text() for text in axes.texts]
    assert named[:2] == ["coulomb-friction, link flexure_lo (added)", "quadratic-damping, link flexure_lo"]
    assert [bar.get_width() for bar in axes.patches][:2] == pytest.approx([83.0, 79.0])


def test_what_a_gauge_shows_is_drawn_over_displacement_and_time() -> None:
    data = content(closure(friction(), threshold()), None, curves()[2])
    axes = closure_figures(data)["closure-effects"].axes
    assert [ax.get_xlabel() for ax in axes] == ["Displacement [µm]", "Time after the hit [s]"]
    data["effects"][1]["curve"]["kind"] = "of another version"
    assert "closure-effects" not in closure_figures(data)


def test_headlines_are_the_errors_on_records_that_no_fit_has_seen() -> None:
    data = two()
    first = closures.answer(data).headlines[0]
    assert first.raw == data["errors"]["hold_out"]["after"]["motion_nrmse"]
    assert first.shown == "10.1 → 1.20 %"
    assert first.words == "displacement, NRMSE, hold-out"
    data["noise_floor"] = {"hold_out": {"motion_nrmse": 0.011, "tension_loss_error_percent_median": 2.0}}
    data["noise_floor"]["hold_out"]["tension_loss_error_percent_median_with_variability"] = 36.3
    words = [line.words for line in closures.answer(data).headlines]
    assert words[0] == "displacement, NRMSE, hold-out; noise alone: 1.10\u00a0%"
    assert words[-1] == "loss of tension, median error, hold-out; noise and variability: 36.3\u00a0%"
    unseen = closures.answer(content(closure(friction(), hold_out=0))).headlines[0]
    assert unseen.words.endswith("training")


def shown(data: dict[str, Any], folder: Path) -> str:
    """Return the words of the page of a closure and its model."""
    head = {
        "format": "boltlaw-closure/1",
        "campaign": "c",
        "program_version": "0",
        "seed": 0,
        "elapsed_s": 1.0,
    }
    (folder / "closure.json").write_text(json.dumps(head | data), encoding="utf-8")
    for name, figure in closure_figures(data).items():
        save(figure, folder / f"{name}.svg")
    text = re.sub(r"<style>.*?</style>", "", report.run(folder).read_text(encoding="utf-8"), flags=re.DOTALL)
    bare = html.unescape(re.sub(r"<[^>]+>", " ", text)).replace("\u2062", " ")
    return re.sub(r"\s+", " ", bare)


def test_the_page_shows_errors_equations_numbers_look_alikes_and_figures(tmp_path: Path) -> None:
    data = two()
    found = closure(friction(), threshold())
    found.model.save(tmp_path / "model.json", identification=model_section(data))
    (tmp_path / "gamma-law.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>', encoding="utf-8")
    words = shown(data, tmp_path)
    for part in (
        "Is anything missing from the model, and what?",
        "The model lacked coulomb-friction (link flexure_lo) and loosening-threshold (tension)",
        "What remains: the mean square of the residual was 38 and is 1.02 times that of noise",
        "Hold-out, before Hold-out, after Training, before",
        "figures of other commands: of the model without what the closed loop added",
        "Parameters of the refined model",
        "Displacement, NRMSE [%] 10.1 1.20 9.84",
        "Step by step, hold-out",
        "F c 0.100 0.0900 to 0.110 N",
        f"quadratic-damping link flexure_lo 1.07 {LADDER}",
        "Hold-out records that it improves: 9 of 10",
        "p below 10⁻⁴",
        "F: force that pulls the first body back.",
        "Ṫ₀: rate of the law of loosening before this change",
        "Along Most was left at Before After Channel acceleration lo 60.2 1.03",
        "Where the residual lives (16)",
        "Amplitude 50 µm and more 60.2 1.03",
        "acceleration-gain sensor acceleration_lo 2 % 0.01",
        "Where the residual lived.",
        "coulomb-friction, link flexure_lo F = ( F c + μ T ) tanh ( v v s )",
    ):
        assert part in words, part
    assert "Which reduced-order model" not in words  # the closure has judged that model already
    assert "Errors of the model" not in words
    assert "Closure: " not in words


def test_the_page_shows_numbers_of_links_and_masses_with_their_limits(tmp_path: Path) -> None:
    numbers = {
        "body.lo.mass": Parameter(8.6, "kg", 8.5, 8.7),
        "flexure_lo.damping.c": Parameter(8.2, "N s/m", 8.1, 8.3),
    }
    found = replace(closure(friction()), refitted=numbers)
    found = replace(found, model=with_limits(found.model, numbers))
    data = content(found, *curves()[:1])
    found.model.save(tmp_path / "model.json", identification=model_section(data))
    words = shown(data, tmp_path)
    assert "c flexure_lo: damping 8.20 8.10 to 8.30 N m −1 s" in words
    assert "m body lo 8.60 8.50 to 8.70 kg" in words
    assert words.count("8.50 to 8.70") == 1  # no number stands in two tables
    assert words.count("body.lo.mass") == 0
    (tmp_path / "model.json").unlink()
    words = shown(data, tmp_path)
    assert "Numbers of links and masses, fitted again" in words
    assert "body.lo.mass 8.60 8.50 to 8.70 kg" in words


def test_a_model_that_was_made_otherwise_is_judged_beside_the_closure(tmp_path: Path) -> None:
    other = model_section(two()) | {"command": "boltlaw identify campaign"}
    closure(friction()).model.save(tmp_path / "model.json", identification=other)
    assert "Which reduced-order model" in shown(two(), tmp_path)


def test_a_closure_that_others_wrote_is_shown_by_what_it_has(tmp_path: Path) -> None:
    effect = {"name": "<b>odd</b>", "enters": "joint", "equation": "mu T tanh(v / v_s)",
              "parameters": {"mu": {"value": 0.021, "low": 0.019, "high": 0.023, "unit": "1"}},
              "look_alikes": [{"name": "other", "hold_out_cost": 1.07}]}  # fmt: skip
    words = shown({"verdict": "closed", "effects": [effect]}, tmp_path)
    for part in (
        "<b>odd</b>",
        "Added: <b>odd</b>.",
        "F = μ T tanh",
        "0.0210 0.0190 to 0.0230",
        "other – 1.07 –",
    ):
        assert part in words, part


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_every_equation_of_the_catalogue_is_typeset(name: str) -> None:
    member = CATALOGUE[name]
    lines = effect_equations(member.equation, member.places[0])
    assert len(lines) == member.equation.count(";") + 1
    for line in lines:
        assert "<code>" not in line
        ElementTree.fromstring(line.replace("&nbsp;", " "))


@pytest.mark.parametrize(
    ("text", "enters", "expected"),
    [
        ("rate * max(1 - v_th / abs(v), 0) ** 4", "tension", "T˙=T˙0max(1−vth|v|,0)4"),
        ("dz1/dt = v - z1 / tau", "joint", "z˙1=v−z1τ"),
        ("F = where(b > e, b, 2 * c) * x", "joint", "F={bwhere b>e2celsex"),
        ("y' + r * y = y_true'", "sensor:acceleration_lo", "y˙+ry=y˙true"),
        ("y(t) = y_true(t - tau)", "sensor:tension", "y(t)=ytrue(t−τ)"),
        ("b = 1.5e-7 * x", "joint", "b=1.5·10−7x"),
        ("a * abs(x)", "body:lo", "F=a|x|"),
    ],
)
def test_equations_of_effects_keep_their_meaning(text: str, enters: str, expected: str) -> None:
    (line,) = effect_equations(text, enters)
    bare = html.unescape(re.sub(r"<[^>]+>", "", line)).replace("\u2062", "").replace("\u00a0", " ")
    assert bare == expected


def test_a_limit_is_drawn_over_the_usual_strength_and_hollow_where_there_is_none() -> None:
    (axes,) = closure_figures(two())["closure-limits"].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "cubic-stiffness", "even-stiffness", "constant-force",
    ]  # fmt: skip
    drawn = [line for line in axes.get_lines() if len(line.get_xdata())]
    filled = {x for line in drawn if line.get_markerfacecolor() != "none" for x in line.get_xdata()}
    assert {x for x in filled if np.isfinite(x)} == {0.14, 0.2, 1.3}
    (hollow,) = (line for line in drawn if line.get_markerfacecolor() == "none")
    assert hollow.get_xdata()[0] > 1.3


def test_every_place_of_a_limit_has_a_colour_of_its_own() -> None:
    """The page's legend, which can be clicked, tells traces by colour alone."""
    row = two()["detection_limits"][0]
    places = ["body:lo", "body:so", "flexure_lo", "flexure_so", "joint", "tension"]
    rows = [row | {"enters": place, "value": 1.0, "share_of_default": 0.1} for place in places]
    (axes,) = closure_figures(two() | {"detection_limits": rows})["closure-limits"].axes
    named = {line.get_label(): line.get_color() for line in axes.get_lines() if line.get_label()[:1] != "_"}
    assert set(named) == {place.removeprefix("body:") for place in places}
    assert len(set(named.values())) == len(places)
