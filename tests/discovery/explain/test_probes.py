"""Which effects of a screen are fitted."""

from __future__ import annotations

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
    found = promising([probe(name, gain) for name, gain in gains.items()], 100.0)
    assert CRITERIA.screening.fitted_effects == len(first)
    assert [ones[0].effect.name for ones in found] == [*first, "coulomb-friction"]
