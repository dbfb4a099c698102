"""A ranking as people use it: rows as functions and models, the whole table, the front, a short repr."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rom
from discovery.laws.candidate import rivals_always_in_the_race
from discovery.ranking.result import Ranking
from discovery.views import ranking_cases
from discovery.views.ranking_file import ranking_section
from rom.campaign.channels import FloatArray
from rom.model.model import Model
from rom.signals.tension_bins import TensionCourse
from tests.discovery.synthetic import measured
from tests.experiments.studies.test_discover import ranked

_RENAMED = {  # columns of their own
    "cross_validated_loss_error_percent_median": "loss_error_percent",
    "cross_validated_score": "score",
    "p_value_against_baseline": "p_value",
}


@pytest.fixture
def ranking() -> Ranking:
    laws = tuple(ranked(place, law, {}) for place, law in enumerate(rivals_always_in_the_race(), 1))
    return Ranking(laws, 2000, rom.paper_model(), {})


def test_a_row_is_a_function_of_tension_and_motion(ranking: Ranking) -> None:
    row = ranking["constant gamma, quadratic"]
    tension, velocity = np.array([10.0, 200.0]), np.array([0.02, -0.03])
    expected = -row.parameters["gamma"].value * velocity**2 * tension
    np.testing.assert_allclose(row.rate(tension, 1e-5, velocity, 30.0, 2.0), expected)


def test_the_model_of_a_row_is_saved_with_its_law(ranking: Ranking, tmp_path: Path) -> None:
    row = ranking.laws[1]
    row.model.save(tmp_path / "model.json")
    law = rom.load_model(tmp_path / "model.json").link_laws["joint"].tension_rate
    assert law is not None
    assert law.equation == row.equation
    assert {n: p.value for n, p in law.parameters.items()} == {n: p.value for n, p in row.parameters.items()}
    with pytest.raises(ValueError, match="found no identified model with it"):
        _ = replace(row, identified=None).model


def test_the_table_has_all_that_a_result_file_s_rows_have(ranking: Ranking) -> None:
    frame = ranking.to_frame()
    for row in ranking_section(ranking)["laws"]:
        shown = frame.loc[row["rank"]]
        errors = {f"{kind}_{key}": v for kind, held in row.pop("errors").items() for key, v in held.items()}
        assert (shown["wins"], shown["cases"]) == tuple(row.pop("wins_against_baseline"))
        for key, value in {**row, **errors}.items():
            found = shown.name if key == "rank" else shown[_RENAMED.get(key, key)]
            assert found == value or (found != found and value != value) or (value is None and found != found)


def test_the_front_is_drawn_beside_the_leader_board(ranking: Ranking) -> None:
    figure = ranking.plot()
    (front,) = (axes for axes in figure.axes if "Free numbers" in axes.get_xlabel())
    (step,) = (line for line in front.lines if "fewer" in str(line.get_label()))
    errors = {law.free_numbers: [] for law in ranking.laws}  # type: dict[int, list[float]]
    for law in ranking.laws:
        errors[law.free_numbers].append(law.cross_validated_loss_error_percent_median)
    best = [min(e for n, es in errors.items() if n <= most for e in es) for most in sorted(errors)]
    np.testing.assert_allclose(step.get_ydata(), best)


def test_a_ranking_and_its_rows_print_short(ranking: Ranking) -> None:
    assert repr(ranking) == "Ranking(4 laws of 2000 candidates, first: 'gamma(T) baseline')"
    for law in ranking.laws:
        about = f"{law.rank}, {law.name!r}, {law.equation!r}, source={law.source!r}"
        assert repr(law) == f"RankedLaw({about})"


def test_courses_are_drawn_below_with_what_was_measured(ranking: Ranking) -> None:
    courses = measured(preloads=(20.0, 300.0), strengths=(1.0,), length_s=0.5)
    figure = replace(ranking, courses=courses).plot()
    drawn = [axes for axes in figure.axes if axes.get_title(loc="center") in ("20 N", "300 N")]
    assert len(drawn) == 2
    labels = [str(line.get_label()) for line in drawn[0].lines]
    assert {"Before the hit", "γ(T), the paper's law"} <= set(labels)


@pytest.mark.parametrize(("preloads", "drawn"), [((0.5, 20.0, 300.0), {20.0, 300.0}), ((0.5,), set())])
def test_courses_that_are_not_drawn_are_not_simulated(
    ranking: Ranking, monkeypatch: pytest.MonkeyPatch, preloads: tuple[float, ...], drawn: set[float]
) -> None:
    """Those below a newton are not drawn; where there are no others, there is no part for courses."""
    courses = measured(preloads=preloads, strengths=(1.0,), length_s=0.5)
    simulated: list[float] = []

    def recorded(model: Model, chosen: Sequence[TensionCourse]) -> list[FloatArray]:
        simulated.extend(course.preload for course in chosen)
        return predicted(model, chosen)

    predicted = ranking_cases._predicted
    monkeypatch.setattr(ranking_cases, "_predicted", recorded)
    figure = replace(ranking, courses=courses).plot()
    assert set(simulated) == drawn
    assert len(figure.axes) == len(ranking.plot().axes) + len(drawn)
