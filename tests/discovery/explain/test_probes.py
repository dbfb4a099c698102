"""Which effects of a screen are fitted."""

from __future__ import annotations

import numpy as np

from discovery.criteria.criteria import CRITERIA
from discovery.explain.probes import Probe, promising
from rom.effects import CATALOGUE


def probe(name: str, gain: float) -> tuple[Probe]:
    member = CATALOGUE[name]
    return (Probe(member, member.at("guide", ground=True), gain, 1.0, 1.0),)


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
