"""Which effects of a screen are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.decide.explanation import Explanation
from discovery.explain.probes import Probe, fit_promising, promising
from discovery.options import Options, no_progress
from discovery.residual.base import ProjectedResidual
from rom.effects import CATALOGUE


def probe(name: str, gain: float, enters: str = "guide") -> tuple[Probe]:
    member = CATALOGUE[name]
    return (Probe(member, member.at(enters, ground=True), gain, 1.0, 1.0),)


def test_a_special_case_of_an_effect_that_is_fitted_is_fitted_too() -> None:
    """Else it could not do for now in place of the wider form."""
    first = ("two-sided-gap", "cubic-stiffness", "even-stiffness", "bouc-wen", "position-friction")
    gains = {name: 100.0 - place for place, name in enumerate(first)}
    gains |= {"quadratic-damping": 60.0, "coulomb-friction": 55.0}
    found = promising([probe(name, gain) for name, gain in gains.items()], 100.0, None)
    assert CRITERIA.screening.fitted_effects == len(first)
    assert [ones[0].effect.name for ones in found] == [*first, "coulomb-friction"]


def test_nothing_is_fitted_where_chance_explains_as_much_as_the_best() -> None:
    """Acceptance would refuse all: the chance of each effect is that of its best probe."""
    probes = [probe("cubic-stiffness", 50.0), probe("coulomb-friction", 40.0)]
    draws, most = int(CRITERIA.chance.draws), CRITERIA.chance.false_alarms
    rare, common = (np.where(np.arange(draws) < share * draws, 60.0, 1.0) for share in (0.5 * most, 2 * most))
    assert len(promising(probes, 100.0, rare)) == len(probes)
    assert promising(probes, 100.0, common) == []


@pytest.mark.parametrize(("left", "others"), [(1.5, {"coulomb-friction"}), (1.1, set())])
def test_where_the_best_fit_leaves_more_than_noise_others_at_its_place_are_fitted(
    left: float, others: set[str]
) -> None:
    """Five forms were fitted, and the right one was the seventh."""
    first = ("two-sided-gap", "cubic-stiffness", "even-stiffness", "bouc-wen", "extra-mode")
    probes = [probe(name, 1000.0 - place) for place, name in enumerate(first)]
    probes += [probe("quadratic-damping", 900.0, "elsewhere"), probe("coulomb-friction", 800.0)]
    probes += [probe("jenkins-slip", 1.0)]  # next to nothing
    rows, before = 1000, 2000.0

    def fit(ones: Sequence[Probe]) -> Explanation:
        mean = left if ones[0].effect.name == "even-stiffness" else 1.8
        return Explanation(ones[0].effect, {"a": before}, {"a": mean * rows}, {"a": rows}, frozenset(), 1)

    residual = SimpleNamespace(residual=np.full(rows, np.sqrt(before / rows)), training=np.ones(rows, bool))
    options = Options(1, no_progress, 0, CRITERIA)
    found = fit_promising(probes, cast(ProjectedResidual, residual), options, fit)
    assert {one.effect.name for one in found} == {*first, *others}
