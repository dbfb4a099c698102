"""A ranking of tension laws in plain words, as a leader board and as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from discovery.laws.candidate import BASELINE, NO_LOOSENING
from discovery.ranking.population import Population
from discovery.ranking.result import RankedLaw, Ranking
from discovery.views.closure_file import parameter_row
from discovery.views.palette import INCH_PER_MM, WIDTH
from discovery.views.ranking_cases import with_drawn_cases
from discovery.views.ranking_file import ranking_section
from discovery.views.ranking_plot import (
    draw_front,
    draw_leader_board,
    evidence_words,
    leader_board_height_mm,
)
from discovery.views.tension_plot import courses_height_mm, draw_courses
from rom import result_views
from rom.criteria.number import Numerical
from rom.views.model import with_limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


_FRONT_MM: Numerical[float] = 65.0  # height of the front


@result_views.summary.register(Ranking)
def summary(ranking: Ranking) -> str:
    """Return in plain words what won, how surely, and what it beats."""
    first = ranking.laws[0]
    lines = [f"First of {ranking.considered} candidate laws: {first.name}", f"  dT/dt = {first.equation}"]
    lines += [f"  the same law as {', '.join(first.same_as)}"] if first.same_as else []
    level = first.fit.criteria.level_of_limits
    lines += [f"  {name} = {with_limits(p, 4, level)}" for name, p in first.parameters.items()]
    lines.append(_verdict(first, ranking.rules.better))
    for name in (BASELINE, NO_LOOSENING):
        lines += [_against(first, law) for law in ranking.laws[1:] if name in (law.name, *law.same_as)]
    lines += [_population(ranking.population)] if ranking.population else []
    named = [(law.name, law.chosen) for law in ranking.laws if law.chosen >= ranking.rules.named]
    rest = 1.0 - sum(share for _, share in named)
    shares = [*named, *([("others", rest)] if rest >= ranking.rules.named else [])]
    share = "; ".join(f"{name} {100 * share:.0f} %" for name, share in shares)
    drawn = "bolts" if ranking.population else "preloads"
    lines.append(f"Comes first when {drawn} are drawn again: {share}.")
    if ranking.indistinguishable:
        lines.append(f"These records do not distinguish it from: {'; '.join(ranking.indistinguishable)}.")
    elif ranking.laws[1:]:
        lines.append(f"Next: {'; '.join(law.name for law in ranking.laws[1:4])}.")
    return "\n".join(lines)


@result_views.frame.register(Ranking)
def frame(ranking: Ranking) -> DataFrame:
    """Return the leader board, a row for each law: what decides first, then all else of ``ranking.json``."""
    from pandas import DataFrame

    rows = [
        {
            "rank": law.rank,
            "name": law.name,
            "loss_error_percent": law.cross_validated_loss_error_percent_median,
            "hold_out_loss_error_percent": _error(law, "hold_out", "tension_loss_error_percent_median"),
            "final_tension_error_percent": _error(law, "training", "final_tension_error_percent_mean"),
            "known_bolt_loss_error_percent": law.known_bolt_loss_error_percent_median,
            "score": law.cross_validated_score,
            "delta_bic": law.delta_bic,
            "wins": law.wins_against_baseline[0],
            "cases": law.wins_against_baseline[1],
            "p_value": law.p_value_against_baseline,
            "chosen": law.chosen,
            "probability": law.probability,
            "free_numbers": law.free_numbers,
            "fitted_to": law.fitted_to,
            "source": law.source,
            "equation": law.equation,
            "parameters": {name: parameter_row(p) for name, p in law.parameters.items()},
            "indistinguishable": list(law.indistinguishable),
            "look_alikes": list(law.look_alikes),
            "same_as": list(law.same_as),
            "noise_floor": {kind: dict(floor) for kind, floor in law.noise_floor.items()},
            **{
                f"{records}_{key}": value
                for records in ("training", "hold_out")
                for key, value in (law.errors.get(records) or {}).items()
            },
        }
        for law in ranking.laws
    ]
    return DataFrame(rows).set_index("rank")


@result_views.figure.register(Ranking)
def figure(ranking: Ranking) -> Figure:
    """Draw the leader board, the error of all laws over their numbers with its Pareto front, and courses."""
    from matplotlib.figure import Figure

    data = with_drawn_cases(ranking_section(ranking), ranking)
    heights = [leader_board_height_mm(data), _FRONT_MM]
    heights += [courses_height_mm(data)] if data["cases"] else []
    made = Figure(figsize=(WIDTH, sum(heights) * INCH_PER_MM), layout="constrained")
    parts = made.subfigures(len(heights), 1, squeeze=False, height_ratios=heights).ravel()
    draw_leader_board(parts[0], data)
    axes = parts[1].subplots()
    draw_front(axes, data)
    axes.legend(frameon=False, fontsize="small")
    if data["cases"]:
        labels = draw_courses(parts[2], data).get_legend_handles_labels()
        parts[2].legend(*labels, loc="outside upper center", ncols=2, frameon=False, fontsize="small")
    return made


def _population(population: Population) -> str:
    bolts, tests = (
        f"{one.value:.2g} ({one.low:.2g} to {one.high:.2g})"
        for one in (population.between_bolts, population.between_tests)
    )
    return (
        f"Standard deviation of ln rate between {len(population.bolts)} bolts {bolts}, between tests of "
        f"a bolt {tests}."
    )


def _verdict(first: RankedLaw, better: float) -> str:
    p = first.p_value_against_baseline
    if p is None:
        return "The paper's law itself: no other law describes these records better for its numbers."
    sure = "beyond chance" if p < better else "which may be chance"
    won, cases = first.wins_against_baseline
    return f"Nearer than the gamma(T) baseline on {won} of {cases} records, {sure} (p = {p:.2g})."


def _against(first: RankedLaw, law: RankedLaw) -> str:
    left_out = (
        "at preloads left out" if law.known_bolt_loss_error_percent_median is None else "of bolts left out"
    )
    own, other = (x.cross_validated_loss_error_percent_median for x in (first, law))
    return (
        f"Loss of tension {left_out}: off by {own:.3g} % (median); {law.name}: {other:.3g} %; "
        f"for the {'first' if law.delta_bic >= 0 else 'latter'}: {evidence_words(law.delta_bic)}."
    )


def _error(law: RankedLaw, records: str, key: str) -> float | None:
    found: Mapping[str, Any] = law.errors.get(records) or {}
    return found.get(key)
