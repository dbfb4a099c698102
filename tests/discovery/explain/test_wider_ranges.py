"""Ranges of numbers that a fit has brought to where theirs end."""

from __future__ import annotations

import math

import pytest

from discovery.explain.wider_ranges import widened
from rom.effects import CATALOGUE, ModelCorrection


def at_end(name: str, number: str, *, high: bool = True) -> ModelCorrection:
    """An effect with a number at an end of its range."""
    effect = CATALOGUE[name].at("flexure_lo", ground=True)
    low_end, high_end = effect.parameters[number].bounds
    return effect.with_values(**{number: high_end if high else low_end})


@pytest.mark.parametrize("high", [False, True])
def test_the_end_at_which_a_strength_lies_moves_away(high: bool) -> None:
    effect = at_end("even-stiffness", "k2", high=high)
    low, high_end = effect.parameters["k2"].bounds
    wider = widened([effect], 10.0)
    assert wider is not None
    assert wider[0].parameters["k2"].bounds == ((low, 10 * high_end) if high else (10 * low, high_end))
    assert wider[0].parameters["k2"].value == effect.parameters["k2"].value


def test_inside_a_range_and_at_zero_nothing_moves() -> None:
    inside = CATALOGUE["even-stiffness"].at("flexure_lo", ground=True)
    none = CATALOGUE["coulomb-friction"].at("flexure_lo", ground=True).with_values(F_c=0.0, mu=0.0)
    assert widened([inside, none], 10.0) is None


def test_a_number_without_a_unit_keeps_its_range() -> None:
    assert widened([at_end("jenkins-slip", "kappa")], 10.0) is None


def test_a_frequency_goes_no_higher_than_the_records_tell() -> None:
    mode = CATALOGUE["extra-mode"].at("body:lo")
    highest = mode.parameters["f3"].bounds[1]
    mode = mode.with_values(f3=highest)
    assert widened([mode], 10.0, highest) is None
    wider = widened([mode], 10.0, math.inf)
    assert wider is not None
    assert wider[0].parameters["f3"].bounds[1] == 10 * highest
