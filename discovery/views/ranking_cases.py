"""What every loosening test measured, and its course and loss by laws of a ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discovery.views.tension_plot import drawn_laws, nearest_cases
from rom.campaign.channels import FloatArray
from rom.signals.tension_bins import TensionCourse

if TYPE_CHECKING:
    from discovery.ranking.result import RankedLaw, Ranking
    from rom.model.model import Model


def with_cases(section: Mapping[str, Any], ranking: Ranking) -> dict[str, Any]:
    """Return what ranking.json says with the tests one by one, by the laws that figures draw."""
    return {**section, "cases": case_rows(ranking, drawn_laws(section))}


def with_drawn_cases(section: Mapping[str, Any], ranking: Ranking) -> dict[str, Any]:
    """Return the same with those tests alone whose courses are drawn: no others are simulated."""
    measured, population = case_rows(ranking, ()), ranking.population
    drawn = {id(case) for case in nearest_cases(measured)}
    places = [place for place, case in enumerate(measured) if id(case) in drawn]
    if population is not None:
        population = replace(population, of_course=tuple(population.of_course[k] for k in places))
    courses = tuple(ranking.courses[k] for k in places)
    return with_cases(section, replace(ranking, courses=courses, population=population))


def case_rows(ranking: Ranking, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return what every loosening test measured, and its course and loss by the laws of the figures."""
    predicted = {name: _predicted_of_bolts(ranking, ranking[name]) for name in names}
    population = ranking.population
    bolts = [population.bolts[k].name for k in population.of_course] if population else []
    rows = []
    for place, course in enumerate(ranking.courses):
        loss = course.initial - course.final
        middles = 0.5 * (course.edges_s[1:] + course.edges_s[:-1]) - course.impact_s
        rows.append(
            {
                "file": course.file,
                **({"campaign": bolts[place]} if bolts else {}),
                "hold_out": course.hold_out,
                "preload_n": course.preload,
                "initial_tension_n": course.initial,
                "peak_force_n": np.abs(course.force).max(),
                "loss_n": loss,
                "loss_error_n": course.final_error,
                "time_s": middles,
                "change_n": course.change,
                "change_error_n": np.sqrt(np.diag(course.covariance)),
                "laws": {name: means[place][:-1] - course.initial for name, means in predicted.items()},
                "loss_error_percent": {
                    name: 100 * abs((course.initial - means[place][-1]) / loss - 1) if loss else None
                    for name, means in predicted.items()
                },
            }
        )
    return rows


def _predicted_of_bolts(ranking: Ranking, law: RankedLaw) -> list[FloatArray]:
    """Return what `_predicted` does of each test, of several bolts by the model of its own."""
    from discovery.ranking.result import with_law

    population, courses = ranking.population, ranking.courses
    if population is None:
        return _predicted(with_law(ranking.identified, law), courses)
    found: dict[int, FloatArray] = {}
    for bolt in dict.fromkeys(population.of_course):
        places = [place for place, of in enumerate(population.of_course) if of == bolt]
        model = with_law(population.bolts[bolt].model, law)
        found |= dict(zip(places, _predicted(model, [courses[k] for k in places]), strict=True))
    return [found[place] for place in range(len(courses))]


def _predicted(model: Model, courses: Sequence[TensionCourse]) -> list[FloatArray]:
    """Return the mean tensions [N] of each test in its bins, then in its final window, by full simulation."""
    found: dict[int, FloatArray] = {}
    kinds = [(c.body, c.rate_hz, c.tension_rate_hz, len(c.force), len(c.edges_s)) for c in courses]
    for kind in dict.fromkeys(kinds):
        places = [place for place, other in enumerate(kinds) if other == kind]
        chosen = [courses[place] for place in places]
        forces = np.stack([c.force for c in chosen])
        divisor = kind[2] if kind[1] % kind[2] == 0 else None
        initial = np.array([max(c.initial, 0.0) for c in chosen])
        bins, final = (
            model.mean_tensions(
                forces, kind[1], initial, np.stack(edges), body=kind[0], tension_rate_hz=divisor
            )
            for edges in ([c.edges_s for c in chosen], [_final_edges(c) for c in chosen])
        )
        found |= dict(zip(places, np.concatenate([bins, final], axis=1), strict=True))
    return [found[place] for place in range(len(courses))]


def _final_edges(course: TensionCourse) -> FloatArray:
    start, end = course.final_window
    return np.array([start, min(end, len(course.force) / course.rate_hz)])
