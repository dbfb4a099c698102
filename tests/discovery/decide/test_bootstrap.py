"""Limits from closures of simulated campaigns: errors drawn from known laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from discovery.criteria.bootstrap import Bootstrap
from discovery.decide.bootstrap import bootstrap_limits


def closed(value: float, half: float | None, name: str = "cubic-stiffness") -> dict[str, Any]:
    low, high = (None, None) if half is None else (value - half, value + half)
    row = {"value": value, "low": low, "high": high, "unit": "N/m3"}
    return {"effects": [{"name": name, "enters": "joint", "parameters": {"k3": row}}]}


def drawn(bias: float, spread: float, count: int, seed: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """A closure of the truth 0 and replicates of it; limits are claimed for errors of deviation 1."""
    generator = np.random.default_rng(seed)
    half = 1.96 * np.exp(0.3 * generator.standard_normal(count + 1))
    error = (bias + spread * generator.standard_normal(count + 1)) * half / 1.96
    here = float(error[0])
    return closed(here, half[0]), [closed(here + e, h) for e, h in zip(error[1:], half[1:], strict=True)]


@pytest.mark.parametrize("count", [8, 40])
@pytest.mark.parametrize(("bias", "spread"), [(0.0, 1.0), (3.0, 1.0), (-1.0, 2.5)])
def test_limits_hold_the_truth_whatever_the_bias_and_the_width_that_closures_claim(
    count: int, bias: float, spread: float
) -> None:
    held, trials = 0, 400
    for seed in range(trials):
        told = bootstrap_limits(*drawn(bias, spread, count, seed))
        number = told["effects"][0]["parameters"]["k3"]
        held += number["low"] <= 0.0 <= number["high"]
    assert abs(held / trials - 0.95) < 4 * np.sqrt(0.95 * 0.05 / trials)


def test_bias_is_told_with_its_sign_and_taken_out() -> None:
    replicates = [closed(10.0 + 0.5 + e, 1.0) for e in (-0.1, 0.1) * 4]
    number = bootstrap_limits(closed(10.0, 1.0), replicates)["effects"][0]["parameters"]["k3"]
    assert number["bias"] == pytest.approx(0.5)
    assert number["value"] == pytest.approx(9.5)
    assert number["low"] < 9.5 < number["high"]


def test_limits_are_never_narrower_than_those_of_the_closure() -> None:
    replicates = [closed(10.0 + e, 0.5) for e in (-0.01, 0.01) * 4]
    number = bootstrap_limits(closed(10.0, 1.0), replicates)["effects"][0]["parameters"]["k3"]
    assert (number["low"], number["high"]) == pytest.approx((9.0, 11.0))


def test_replicates_count_where_they_name_the_effect_first_among_others_or_not() -> None:
    other = closed(1.0, 0.1, "coulomb-friction")["effects"]
    first, second = closed(2.0, 0.1), {"effects": other + closed(2.0, 0.1)["effects"]}
    told = bootstrap_limits(closed(2.0, 0.1), [first, second, {"effects": other}, {"effects": []}], failed=1)
    (effect,) = told["effects"]
    assert (told["replicates"], told["failed"], told["named_any"]) == (4, 1, 3)
    assert (effect["named"], effect["first"]) == (2, 1)


def test_too_few_replicates_with_limits_give_none() -> None:
    fewest = Bootstrap().fewest
    replicates = [closed(2.0 + 0.01 * k, 0.1) for k in range(fewest - 1)] + [closed(5.0, None)]
    number = bootstrap_limits(closed(2.0, 0.1), replicates)["effects"][0]["parameters"]["k3"]
    assert number["low"] is number["high"] is number["bias"] is None
    assert (number["value"], number["replicates"]) == (2.0, fewest - 1)
    enough = bootstrap_limits(closed(2.0, 0.1), replicates, criteria=Bootstrap(fewest=fewest - 1))
    assert enough["effects"][0]["parameters"]["k3"]["low"] is not None


def test_false_alarms_of_a_closure_without_effects_are_counted() -> None:
    told = bootstrap_limits({"effects": []}, [closed(1.0, 0.1), {"effects": []}, {"effects": []}])
    assert (told["named_any"], told["effects"]) == (1, [])
