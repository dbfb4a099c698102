"""What ranking.json says of a ranking of tension laws, but for its header and the tests one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from scipy import stats

from discovery.laws.candidate import rivals_always_in_the_race
from discovery.views.closure_file import parameter_row

if TYPE_CHECKING:
    from discovery.ranking.confidence_sets import ExponentProfile, MotionProfile
    from discovery.ranking.population import Population
    from discovery.ranking.result import RankedLaw, Ranking
    from discovery.separating_tests.impacts import Proposal


def ranking_section(ranking: Ranking) -> dict[str, Any]:
    """Return what ranking.json says, but for its header and the tests one by one."""
    population, changes = ranking.population, ranking.laws[0].fit.criteria.changes
    level = float(stats.chi2.ppf(ranking.rules.confidence, 1))
    return {
        **({"criteria": changes} if changes else {}),
        **({} if population is None else {"population": _population_row(population)}),
        "laws": [*map(_law_row, ranking.laws), *_repeated(ranking.laws)],
        "considered": ranking.considered,
        "indistinguishable": list(ranking.indistinguishable),
        "inclusion": dict(ranking.inclusion),
        "chosen_terms": ranking.chosen_terms,
        "scatter": dict(zip(("a", "b"), ranking.scatter, strict=True)),
        "exponent_profile": _profile_row(ranking.profile, level),
        "motion_profile": _motion_row(ranking.motion_profile, level),
        "proposals": [_proposal_row(test) for test in ranking.proposals],
        "set_aside": list(ranking.set_aside),
        "warnings": list(ranking.warnings),
    }


def _law_row(law: RankedLaw) -> dict[str, Any]:
    return {
        "rank": law.rank,
        "name": law.name,
        "equation": law.equation,
        "parameters": {name: parameter_row(parameter) for name, parameter in law.parameters.items()},
        "errors": {kind: dict(law.errors.get(kind) or {}) for kind in ("training", "hold_out")},
        "noise_floor": {kind: dict(floor) for kind, floor in law.noise_floor.items()},
        "cross_validated_loss_error_percent_median": law.cross_validated_loss_error_percent_median,
        "cross_validated_score": law.cross_validated_score,
        **(
            {}
            if law.known_bolt_loss_error_percent_median is None
            else {"known_bolt_loss_error_percent_median": law.known_bolt_loss_error_percent_median}
        ),
        "delta_bic": law.delta_bic,
        "wins_against_baseline": list(law.wins_against_baseline),
        "p_value_against_baseline": law.p_value_against_baseline,
        "chosen": law.chosen,
        "probability": law.probability,
        "indistinguishable": list(law.indistinguishable),
        "free_numbers": law.free_numbers,
        "fitted_to": law.fitted_to,
        "look_alikes": list(law.look_alikes),
        "same_as": list(law.same_as),
        "source": law.source,
    }


def _repeated(laws: Sequence[RankedLaw]) -> Iterator[dict[str, Any]]:
    """Yield the row of a law once more for every other name that its equation has in the race.

    Readers of the file look for standing laws by name; a probability counts once.
    """
    others = [(law, name) for law in laws for name in law.same_as]
    standing = {law.name for law in rivals_always_in_the_race()}
    for rank, (law, name) in enumerate(others, len(laws) + 1):
        source = "baseline" if name in standing else "given"
        named = {"rank": rank, "name": name, "source": source, "repeats": law.name}
        none = {"chosen": 0.0, "probability": 0.0, "indistinguishable": [], "same_as": []}
        yield {**_law_row(law), **named, **none}


def _population_row(population: Population) -> dict[str, Any]:
    return {
        "between_bolts": asdict(population.between_bolts),
        "between_tests": asdict(population.between_tests),
        "tension_n": population.tension,
        "bolts": [
            {"campaign": bolt.name, "tests": bolt.tests, "deviation": asdict(bolt.deviation)}
            for bolt in population.bolts
        ],
    }


def _profile_row(profile: ExponentProfile | None, level: float) -> dict[str, Any]:
    if profile is None:
        return {"values": [], "delta_bic": []}
    return {
        "values": profile.values,
        "delta_bic": profile.delta_bic,
        "deviance": profile.deviance,
        "best": profile.best,
        "low": profile.low,
        "high": profile.high,
        "reach": profile.reach,
        "level": level * profile.dispersion,
        "explains_the_courses": profile.fits,
    }


def _motion_row(profile: MotionProfile | None, level: float) -> dict[str, Any] | None:
    if profile is None:
        return None
    return {
        "driver": profile.driver,
        "tests": profile.tests,
        "numbers": profile.numbers,
        "velocity": _profile_row(profile.velocity, level),
        "displacement": _profile_row(profile.displacement, level),
    }


def _proposal_row(test: Proposal) -> dict[str, Any]:
    return {
        "body": test.body,
        **({"bolt": test.bolt} if test.bolt else {}),
        "peak_force_n": test.peak_force,
        "pulse_s": test.pulse_length,
        "preload_n": test.preload,
        "hits": test.hits,
        "expected_gain": test.expected_gain,
        "odds": test.odds,
        "separates": list(test.laws),
    }
