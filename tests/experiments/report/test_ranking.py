"""A ranking as figures, tables and plain words: all that ranking.json holds, and no more."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from discovery.criteria.criteria import CRITERIA, used_in
from discovery.views.ranking_plot import law_name
from discovery.views.tension_plot import drawn_laws, nearest_cases
from experiments.figures.captions import caption
from experiments.figures.discovery import discovery_figures
from experiments.figures.style import COLUMN_MM, save
from experiments.studies import report
from experiments.text import rankings
from experiments.text.wording import set_words
from tests.experiments.sound_ranking import BASELINE, WINNER, law, laws, ranking

ALL = {
    "law-leader-board",
    "law-trajectories",
    "law-errors",
    "exponent-profile",
    "accuracy-complexity",
    "term-inclusion",
}
SECOND = "|D v|^n T exp(-T/T_s)"


def test_a_ranking_gives_every_figure_one_column_wide_with_units(tmp_path: Path) -> None:
    made = discovery_figures(json.loads(json.dumps(ranking())))
    assert set(made) == ALL
    for name, figure in made.items():
        assert figure.get_figwidth() == pytest.approx(COLUMN_MM / 25.4)
        path = save(figure, tmp_path / f"{name}.svg")
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
        for axes in figure.axes:
            labels = axes.get_xlabel() + axes.get_ylabel()
            assert not labels or "[" in labels, f"{name}: an axis without unit: {labels}"


@pytest.mark.parametrize(
    ("lacking", "gone"),
    [
        ("laws", {"law-leader-board", "accuracy-complexity"}),
        ("cases", {"law-trajectories", "law-errors"}),
        ("inclusion", set()),
        ("chosen_terms", set()),
        ("motion_profile", set()),
        ("exponent_profile", set()),
        ("proposals", set()),
    ],
)
def test_missing_data_is_a_missing_figure(lacking: str, gone: set[str]) -> None:
    data = ranking()
    del data[lacking]
    assert set(discovery_figures(data)) == ALL - gone


def test_terms_of_race_and_sparse_fits_are_drawn_side_by_side() -> None:
    (axes,) = discovery_figures(ranking())["term-inclusion"].axes
    assert [text.get_text() for text in axes.texts] == [
        law_name(form) for form in ("|v|^p T exp(-T/T_s)", "|F|^m T", "|D v|^n T exp(-T/T_s)", "|x|^q T")
    ]
    widths = [bar.get_width() for bar in axes.patches if isinstance(bar, Rectangle)]
    assert widths == pytest.approx([90.0, 86.0, 10.0, 0.0, 0.0, 40.0, 0.0, 6.0])


def test_no_data_give_no_figures() -> None:
    assert discovery_figures({"exponent_profile": {"values": [], "delta_bic": []}}) == {}


def test_gaps_are_left_out_of_the_figures() -> None:
    data = ranking()
    data["laws"][2] |= {"cross_validated_loss_error_percent_median": None, "delta_bic": None}
    data["exponent_profile"] |= {"low": None, "high": None, "level": None}
    data["exponent_profile"]["delta_bic"][0] = None
    data["cases"][0]["loss_error_percent"] = {WINNER: None}
    data["cases"][1] |= {"laws": {}, "initial_tension_n": 0.0}
    for figure in discovery_figures(data).values():
        figure.draw_without_rendering()
        for axes in figure.axes:
            assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()


def test_trajectories_show_the_hardest_hit_nearest_to_each_printed_preload() -> None:
    chosen = nearest_cases(ranking()["cases"])
    tensions = [case["initial_tension_n"] for case in chosen]
    assert tensions == sorted(tensions)
    assert np.array(tensions) / (6.4, 21.5, 61.3, 152.7, 317.0, 700.2) == pytest.approx(1.0, abs=0.2)
    assert {case["peak_force_n"] for case in chosen} == {1608.7}
    assert len(nearest_cases(ranking()["cases"][:2])) == 2


def test_courses_of_tests_below_a_newton_alone_are_not_drawn() -> None:
    data = ranking()
    data["cases"] = [case | {"initial_tension_n": 0.5} for case in data["cases"][:2]]
    made = discovery_figures(data)
    assert "law-trajectories" not in made
    assert "law-errors" in made


def test_figures_over_cases_draw_the_first_laws_and_always_the_papers() -> None:
    assert drawn_laws(ranking()) == [WINNER, SECOND, BASELINE]
    data = ranking()
    data["laws"] = [law(1, BASELINE, "0", 10.0, 0.0), law(2, WINNER, "0", 11.0, 4.0), *laws()[5:]]
    assert drawn_laws(data) == [BASELINE, WINNER, "constant gamma, quadratic"]
    data["laws"] = [law(1, "no loosening", "0", 100.0, 0.0), law(2, BASELINE, "0", 110.0, 4.0)]
    assert drawn_laws(data) == [BASELINE]


def test_a_law_given_that_is_a_standing_one_says_so_and_takes_its_place() -> None:
    data = ranking()
    own = data["laws"][2] | {"name": "mine", "source": "given", "same_as": [BASELINE]}
    data["laws"][2] = own
    assert drawn_laws(data) == [WINNER, SECOND, "mine"]
    board = rankings.tables(data)[0]
    named = [str(row[1]) for row in board.rows]
    assert named[2].replace("\u00a0", " ") == "mine (= γ(T), the paper's law)"
    told = " ".join(rankings.answer(data).sentences)  # type: ignore[union-attr]
    assert "that of the paper's law by 19.9" in told
    only = data | {"laws": [own | {"rank": 1}, *data["laws"][4:]], "considered": 1}
    found = rankings.answer(only)
    assert found is not None
    assert found.verdict.startswith("The paper's law ranks first")
    assert "Laws given: 1, 1 of which is a standing one, beside 3 other standing ones." in found.sentences


def test_numbers_in_words_are_those_of_the_criteria_that_were_used() -> None:
    """A result file holds what is not the default: the same p is beyond chance by one, not by another."""
    used = CRITERIA.changed(ranking={"confidence": 0.9, "better": 1e-4}, chance={"normal_quantile": 1.645})
    data = ranking() | {"criteria": used.changes}
    assert used_in(data) == used
    assert CRITERIA.changes == {}
    found = rankings.answer(data)
    assert found is not None
    assert "may be chance (p = 4 × 10⁻⁴)" in found.verdict
    title = discovery_figures(data)["exponent-profile"].axes[0].get_title(loc="left")
    heads = next(t.columns for t in rankings.tables(data) if t.caption == "Parameters of the first laws")
    told = [*found.sentences, title, caption("exponent-profile", used)[1], *heads]
    assert sum("90 % " in text for text in told) == 4
    assert not any("95 %" in text for text in told)


def test_the_profile_shows_its_sets() -> None:
    axes = discovery_figures(ranking())["exponent-profile"].axes
    assert [ax.get_title(loc="left") for ax in axes] == ["95 % set: 3.8 to 4.25", "95 % set: 0.21 at most"]


@pytest.mark.parametrize(
    ("reach", "words"),
    [
        ("identified", "3.8 to 4.25"),
        ("open below", "4.25 at most"),
        ("open above", "3.8 at least"),
        ("not identifiable", "open, 3.8 to 4.25 all do"),
    ],
)
def test_an_open_set_is_called_open(reach: str, words: str) -> None:
    assert set_words({"low": 3.8, "high": 4.25, "reach": reach}) == words


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reach": "identified"}, "loosening goes with exponent 4.02 (95 % set: 3.8 to 4.25)."),
        (
            {"reach": "not identifiable"},
            "these records leave the exponent of loosening open (95 % set: open",
        ),
        ({"explains_the_courses": False}, "but none explains the courses to within noise and scatter."),
    ],
)
def test_an_exponent_is_said_with_what_it_is_worth(changes: dict[str, Any], words: str) -> None:
    profile = {"best": 4.02, "low": 3.8, "high": 4.25} | changes
    found = rankings.answer(
        ranking() | {"exponent_profile": profile, "motion_profile": {"driver": "neither"}}
    )
    assert found is not None
    text = " ".join(found.sentences)
    assert words in text
    assert "No product of powers of velocity and displacement" in text


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"low": 0.5, "high": 2.9977}, "0.5 to 3, ends next to 3, the end of the range searched."),
        ({"low": 0.002, "high": 1.5}, "0.002 to 1.5, ends next to 0."),
        ({"low": 0.5, "high": 1.5}, "Velocity and displacement both act."),
    ],
)
def test_a_set_that_ends_at_the_edge_of_a_claim_supports_none(ends: dict[str, float], words: str) -> None:
    """Were larger exponents searched, or the limits a little wider, the same records would say otherwise."""
    velocity = {"low": 1.0, "high": 2.0, "values": [0.0, 2.0, 4.5], "reach": "identified"}
    displacement = {"values": [0.0, 1.0, 3.0], "reach": "identified"} | ends
    motion = {"driver": "both", "velocity": velocity, "displacement": displacement}
    found = rankings.answer(ranking() | {"motion_profile": motion})
    assert found is not None
    text = " ".join(found.sentences)
    assert words in text
    assert ("is open with these records" in text) is (words != "Velocity and displacement both act.")


@pytest.mark.parametrize(("tests", "claimed"), [(9, False), (10, True)])
def test_few_tests_leave_open_what_drives(tests: int, claimed: bool) -> None:
    """With a test for each number nothing tells how tests differ: both was said where velocity acts alone."""
    sets = {name: {"low": 1.0, "high": 2.0, "values": [0.0, 4.5]} for name in ("velocity", "displacement")}
    motion = {"driver": "both", "tests": tests, "numbers": 5} | sets
    found = rankings.answer(ranking() | {"motion_profile": motion})
    assert found is not None
    text = " ".join(found.sentences)
    assert ("Velocity and displacement both act." in text) is claimed
    assert ("9 tests for the 5 free numbers of a law with both are few" in text) is not claimed


def test_a_difference_of_bic_is_said_as_what_it_means() -> None:
    rows = laws()
    for rise, words in ((72411.0, "very strong evidence, a difference in BIC of more than 1000"),
                        (1.5, "for it: hardly any evidence, a difference in BIC of 1.5")):  # fmt: skip
        rows[2]["delta_bic"] = rise
        found = rankings.answer(ranking() | {"laws": rows})
        assert found is not None
        assert words in " ".join(found.sentences)


@pytest.mark.parametrize(
    ("free", "tests", "words"),
    [
        (1, 1, "law's one free number was fitted to one test."),
        (2, 3, "law's 2 free numbers were fitted to 3 tests, 1.5 for each number."),
    ],
)
def test_free_numbers_and_tests_are_counted(free: int, tests: int, words: str) -> None:
    rows = laws()
    rows[0]["free_numbers"] = free
    cases = [ranking()["cases"][0] | {"hold_out": False}] * tests
    found = rankings.answer(ranking() | {"laws": rows, "cases": cases})
    assert found is not None
    assert words in " ".join(found.sentences)


def test_a_law_that_is_right_in_the_mean_of_all_tests_is_off_by_what_is_said() -> None:
    """Rates scatter by 0.1 exp(0.5 ln(T / 100 N)) about those of the law, gauges by 1 N; a third is lost."""
    rng, tension, loss = np.random.default_rng(0), 150.0, 50.0
    tau = 0.1 * (tension / 100) ** 0.5
    rates = np.log(tension / (tension - loss)) * np.exp(tau * rng.standard_normal(4000))
    measured = -tension * np.expm1(-rates) + rng.standard_normal(4000)
    case = {"loss_n": loss, "loss_error_n": 1.0, "initial_tension_n": tension}
    data = ranking() | {"cases": [case], "scatter": {"a": float(np.log(0.1)), "b": 0.5}}
    found = rankings.answer(data)
    assert found is not None
    (said,) = (text for text in found.sentences if "right in their mean" in text)
    off = np.median(np.abs(loss - measured) / measured)
    assert float(said.split()[-2]) == pytest.approx(100 * off, rel=0.05)
    known = rankings.answer(data | {"scatter": {}})
    assert known is not None
    assert "right in their mean" not in " ".join(known.sentences)


def test_records_of_one_name_are_all_to_choose_from() -> None:
    data = ranking()
    case = data["cases"][0] | {"initial_tension_n": 100.0}
    files = [case | {"file": f"{folder}/run_1.h5"} for folder in "ab"]
    bolts = [case | {"file": "run_1.h5", "campaign": bolt} for bolt in ("first", "second")]
    for cases in (files, bolts):
        figure = discovery_figures(data | {"cases": cases})["law-trajectories"]
        assert len(figure.choices) == 2  # type: ignore[attr-defined]
    assert list(figure.choices)[1].startswith("second, run_1.h5, 100 N")  # type: ignore[attr-defined]


def verdict(**changes: Any) -> tuple[str, bool | None]:
    found = rankings.answer(ranking() | changes)
    assert found is not None
    return found.verdict, found.good


def test_the_verdict_says_which_law_and_how_sure() -> None:
    text, good = verdict(indistinguishable=[])
    assert text == f"“{law_name(WINNER)}” ranks first and beats the paper's law beyond chance (p = 4 × 10⁻⁴)."
    assert good is True
    text, good = verdict()
    assert "do not distinguish it from another one" in text
    assert good is None
    text, good = verdict(indistinguishable=[SECOND, BASELINE])
    assert "do not distinguish it from the paper's law" in text
    assert good is None


def test_an_advantage_that_may_be_chance_is_called_so() -> None:
    doubtful = laws()
    doubtful[0]["p_value_against_baseline"] = 0.03
    text, good = verdict(laws=doubtful, indistinguishable=[])
    assert "may be chance (p = 0.03)" in text
    assert good is None


@pytest.mark.parametrize(
    ("off", "noise", "said"), [(0.12, 0.01, True), (0.12, 0.119, False), (0.02, 0.01, False)]
)
def test_a_motion_that_is_off_beyond_noise_is_said_beside_laws_that_rest_on_it(
    off: float, noise: float, said: bool
) -> None:
    changed = laws()
    changed[0]["errors"]["training"]["motion_nrmse"] = off
    changed[0]["noise_floor"] = {"training": {"motion_nrmse": noise}}
    found = rankings.answer(ranking() | {"laws": changed})
    assert found is not None
    assert ("and laws rest on it: `boltlaw close` says" in " ".join(map(str, found.sentences))) is said


@pytest.mark.parametrize(("preloads", "said"), [(5, True), (16, False)])
def test_where_preloads_are_too_few_for_a_small_p_it_is_said(preloads: int, said: bool) -> None:
    doubtful = laws()
    doubtful[0]["p_value_against_baseline"] = 0.12
    kept = [case for case in ranking()["cases"] if not case["hold_out"]][: 3 * preloads]
    text, _ = verdict(laws=doubtful, indistinguishable=[], cases=kept)
    assert (f"With {preloads} preloads, one sign each, p is hardly ever small." in text) is said


@pytest.mark.parametrize(
    ("first", "equals", "part", "good"),
    [
        (BASELINE, [], "no other law describes these records as well", True),
        (
            BASELINE,
            [WINNER],
            "The paper's law ranks first; these records do not distinguish it from another one",
            None,
        ),
        ("no loosening", [], "a bolt that never loosens", False),
    ],
)
def test_the_papers_law_and_no_law_may_come_first(
    first: str, equals: list[str], part: str, good: bool | None
) -> None:
    changed = [law(1, first, "0", 10.0, 0.0), law(2, WINNER, "0", 12.0, 3.0)]
    text, found = verdict(laws=changed, indistinguishable=equals)
    assert part in text
    assert found is good


def test_the_page_answers_first_and_shows_every_table(tmp_path: Path) -> None:
    (tmp_path / "ranking.json").write_text(json.dumps(ranking()), encoding="utf-8")
    for name, figure in discovery_figures(ranking()).items():
        save(figure, tmp_path / f"{name}.svg")
    text = report.run(tmp_path).read_text(encoding="utf-8")
    for part in (
        "how sure is that?",
        "nearer than the paper's law on 44 of 58 records",
        "off by 12.6\u00a0% (median)",
        "exponent 4.02 (95\u00a0% set: 3.8 to 4.25)",
        "3 hits of 400 N for 2.1 ms at a preload of 150 N; then a hit of 1609 N for 0.4 ms",
        "Velocity drives the loosening",
        "570 to 1",
        "2310 candidate laws were considered; 7 are ranked.",
        "Laws of loosening, ranked by re-simulation",
        "m<sup>−4</sup> s<sup>3</sup>",
        "Tests that would separate the first laws most",
        "Leader board of tension laws",
        "clipped force",
    ):
        assert part in text.replace("&#39;", "'"), part
    assert text.count("<math>") >= 7 + 3  # a rate a law, a symbol a parameter
    assert "peak_force_n" not in text
    assert "Ranking: " not in text


def test_criteria_that_are_no_longer_there_are_left_out() -> None:
    old = {"ranking": {"better": 1e-4, "gone": 2.0}, "former": {"least": 3.0}}
    assert used_in({"criteria": old}).changes == {"ranking": {"better": 1e-4}}


def test_laws_fitted_to_losses_alone_are_named() -> None:
    rows = laws()
    rows[1]["fitted_to"] = "losses"
    (table, *_) = rankings.tables(ranking() | {"laws": rows})
    sentence = "Fitted to the losses alone, since their tension histories are not those measured: rank 2."
    assert sentence in str(table.note)
    assert list(rankings.of_losses(ranking())) == []
