"""Free forms of the tension's rate: proposed from courses, fitted as effects are, kept if they help more."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rom
from discovery.courses.frozen_motion import freeze
from discovery.courses.tension_likelihood import law_candidate
from discovery.criteria.criteria import CRITERIA
from discovery.decide.explanation import Explanation
from discovery.explain import free_rate
from discovery.explain.free_rate import free_rates
from discovery.explain.tension import TensionFindings
from discovery.explain.tension_law import LawSearch, _without_strength
from discovery.localisation.tension import tension_views
from discovery.options import Options
from discovery.residual.course_fit import CourseFits, Misfit
from discovery.residual.tension import TensionResidual
from discovery.residual.tension_data import TensionData
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, LawChange, free_form
from rom.model.laws import Parameter
from rom.parameters.he_2025 import nominal_impact
from tests.discovery.explain.test_tension import seen_of, whole
from tests.discovery.synthetic import measured

_NUMBERS = ("gamma_d", "gamma_i", "rho")
_G = 0.15
_ROOT = "max(T, 0) * follow * sqrt(abs(v) / 0.05)"


def rate(text: str, value: float) -> LawChange:
    found = free_form(f"rate - (g_1 * {text})", "tension", {"g_1": Parameter(value, "1/s")})
    assert isinstance(found, LawChange)
    return found


@cache
def data(g: float = 0.0, follows: float = 0.0) -> TensionData:
    """Loosening tests of the paper's law, a rate more that is alike in all, seen by a gauge c |v|."""
    true = law_candidate(rom.paper_model(), rate(_ROOT, g), _NUMBERS, sharing=0)
    preloads = (8.0, 20.0, 60.0, 150.0, 300.0, 700.0, 1500.0, 3000.0, 40.0, 500.0)  # two are held out
    held = whole(freeze(rom.paper_model(), measured(true, preloads=preloads, scatter=0.5, length_s=1.0)))
    held = replace(held, change=held.change + follows * mean_speed(held.nodes, held.starts, held.courses[0]))
    seen = tuple(seen_of(held, case) for case in range(len(held)))
    return TensionData(held.model, seen, held, len(seen) - 4, np.ones(len(seen)), _NUMBERS)


def mean_speed(nodes: FloatArray, starts: Any, course: Any) -> FloatArray:
    """Mean of |v| over the bins of all cases."""
    edges = course.edges_s - course.impact_s
    return np.stack(
        [
            [
                np.abs(nodes[2, a:b][(nodes[0, a:b] >= low) & (nodes[0, a:b] <= high)]).mean()
                for low, high in pairwise(edges)
            ]
            for a, b in pairwise(starts)
        ]
    )


def test_a_rate_outside_the_catalogue_is_proposed_by_its_form() -> None:
    found = {change.equation: change for _, change in free_rates(data(_G))}
    number = found[f"rate - (g_1 * {_ROOT})"].parameters["g_1"]  # the best of one term
    assert number.value == pytest.approx(_G, rel=0.05)
    assert number.unit == "1/s"
    assert len(found) == 5
    assert max(len(change.parameters) for change in found.values()) <= 3


def test_proposals_depend_on_the_seed_alone() -> None:
    one, two = ([e.equation for _, e in free_rates(data(_G), seed=3)] for _ in range(2))
    assert one == two


def test_what_a_gauge_that_follows_the_speed_explains_as_well_is_no_rate() -> None:
    assert free_rates(data(_G))
    assert free_rates(data(0.0, 30.0)) == ()


def test_a_proposal_is_fitted_as_effects_of_the_catalogue_are() -> None:
    of = data(_G)
    search = LawSearch(of)
    base = search.fits.law_alone()
    assert not base.misfit.is_noise
    single = [(m, e) for m, e in free_rates(of) if len(e.parameters) == 1][:1]
    (found,), _ = search.explained(single, base, lambda: None)
    number = found.effect.parameters["g_1"]
    assert found.left is not None
    assert found.left < 1.5
    assert found.p_value == 0.001
    assert found.gains[of.training :].sum() > 10
    assert number.low is not None
    assert number.high is not None
    assert number.low < _G < number.high
    assert number.high - number.low < 0.3 * _G


def test_what_noise_gives_as_well_has_a_chance_that_says_so() -> None:
    of = data()
    search = LawSearch(of)
    member = CATALOGUE["loosening-ratchet"]
    (found,), _ = search.explained([(member, member.at("tension"))], search.fits.law_alone(), lambda: None)
    assert found.p_value is not None
    assert found.p_value > CRITERIA.chance.false_alarms


def test_a_free_form_that_explains_nothing_is_without_strength() -> None:
    assert list(_without_strength(rate(_ROOT, _G)).values) == [0.0]


def residual_of(monkeypatch: pytest.MonkeyPatch, of: TensionData) -> TensionResidual:
    monkeypatch.setattr(TensionResidual, "data", of)
    return TensionResidual(None, None, of.model)  # type: ignore[arg-type]


def test_courses_at_noise_ask_for_no_free_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_rate, "free_rates", None)  # not to be called
    residual = residual_of(monkeypatch, data())
    assert free_rate.explain(residual, Options()) == ()
    assert residual.misfit.is_noise
    assert tension_views(residual.misfit)


@pytest.mark.parametrize(("unseen", "kept"), [(1.8, 0), (30.0, 1)])
def test_held_out_records_must_ask_for_a_free_form(
    monkeypatch: pytest.MonkeyPatch, unseen: float, kept: int
) -> None:
    one = Explanation(
        rate(_ROOT, _G), {"t": 900.0, "h": 100.0}, {"t": 860.0, "h": 100.0 - unseen}, {"t": 200, "h": 50},
        frozenset({"h"}), 1, left=1.0,
    )  # fmt: skip
    found = TensionFindings((one,), Misfit(9.0, 200.0))
    monkeypatch.setattr(free_rate, "compared", lambda *_: found)
    assert len(free_rate.explain(residual_of(monkeypatch, data(_G)), Options())) == kept


def test_a_model_has_one_free_form_in_its_tension_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_rate, "free_rates", None)
    of = data(_G)
    held = replace(of, model=replace(of.model, effects=(rate("max(T, 0)", 1e-6),)))
    residual = residual_of(monkeypatch, held)
    assert free_rate.explain(residual, Options()) == ()
    assert not residual.misfit.is_noise


def test_what_is_left_over_has_a_place() -> None:
    of = data(_G)
    noisy, quiet = (CourseFits(d).law_alone() for d in (of, data()))
    told, still = tension_views(noisy.misfit), tension_views(quiet.misfit)
    assert set(told) == {"tension_by_preload", "tension_by_velocity", "tension_by_time"}
    assert all(0.2 < value < 2.0 for profile in still.values() for _, value in profile)
    assert max(value for _, value in told["tension_by_preload"]) > 2 * max(
        v for _, v in still["tension_by_preload"]
    )
    for profile in told.values():
        low, high = min(v for _, v in profile), max(v for _, v in profile)
        assert low <= noisy.misfit.level <= high


def test_a_model_with_a_free_rate_is_kept_and_simulated(tmp_path: Path) -> None:
    model = rom.paper_model().with_effect(rate(_ROOT, _G))
    model.save(tmp_path / "model.json")
    loaded = rom.load_model(tmp_path / "model.json")
    assert loaded.effects == model.effects
    force = {"lo": nominal_impact(1600.0, 19200, 0.7)}
    with_it, without = (m.simulate(force, 19200, 100.0).tension for m in (loaded, rom.paper_model()))
    assert np.asarray(with_it)[-1] < np.asarray(without)[-1] - 0.1
    assert np.array_equal(np.asarray(with_it), np.asarray(model.simulate(force, 19200, 100.0).tension))
