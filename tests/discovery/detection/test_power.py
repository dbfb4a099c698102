"""The probability that an effect is named, against what is known of normal numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from discovery.decide.acceptance import OVER_NOISE
from discovery.detection.power import Background, Response

GAINS = (150.0, 20.0)
OPEN = Background(cost=1000.0, level=1.0, gains=GAINS)


def response(square: float, *, records: int = 10, dispersion: float = 1.0, error: float = 0.0) -> Response:
    each = np.full(records, square / records)
    return Response(each, each, dispersion, {"motion_nrmse": np.full(records, error)})


@pytest.mark.parametrize("dispersion", [1.0, 4.0])
def test_the_limit_of_a_gain_is_where_a_normal_number_passes_it(dispersion: float) -> None:
    quantile = stats.norm.ppf(0.8) * np.sqrt(dispersion)
    at_limit = (np.sqrt(GAINS[0]) + quantile) ** 2
    assert OPEN.probability(response(at_limit, dispersion=dispersion)) == pytest.approx(0.8, abs=0.05)
    assert OPEN.probability(response(0.1 * at_limit, dispersion=dispersion)) < 0.05
    assert OPEN.probability(response(4 * at_limit, dispersion=dispersion)) > 0.99


def test_a_share_of_a_large_cost_is_asked_for_too() -> None:
    loud = replace(OPEN, cost=1e6)
    assert OPEN.probability(response(400.0)) > 0.99
    assert loud.probability(response(400.0)) == 0.0
    assert loud.probability(response(2e4)) > 0.99


def test_records_that_are_held_out_must_gain() -> None:
    unseen = replace(response(400.0), hold_out=np.full(10, 0.1))
    assert OPEN.probability(unseen) < 0.05


def test_what_few_records_show_is_never_significant() -> None:
    drawn = replace(OPEN, chance=np.full(999, 5.0), by_signs=True)
    for records, found in ((3, 0.0), (10, 1.0)):
        assert drawn.probability(response(4000.0, records=records)) == found


def test_an_error_of_the_motion_must_fall() -> None:
    with_errors = replace(OPEN, errors={"motion_nrmse": np.full(10, 0.01)}, cost=1e4)
    small, large = (with_errors.probability(response(1000.0, error=e)) for e in (1e-4, 0.05))
    assert small < 0.05
    assert large > 0.95


@pytest.mark.parametrize(("cosine", "found"), [(1.0, 1.0), (0.0, 1.0), (-0.5, 0.0)])
def test_an_error_that_an_effect_makes_up_for_does_not_fall_without_it(cosine: float, found: float) -> None:
    with_errors = replace(OPEN, errors={"motion_nrmse": np.full(10, 0.01)}, cost=1e4)
    one = response(1000.0, error=0.004)
    turned = replace(one, phases={"motion_nrmse": np.full(10, cosine)})
    assert with_errors.probability(turned) == pytest.approx(found, abs=0.02)


def test_an_error_of_slow_noise_falls_or_not_by_chance() -> None:
    """What an effect adds is a fifth of the error: 2 % of it where their phases are at right angles."""
    with_errors = replace(OPEN, errors={"motion_nrmse": np.full(1, 0.01)}, cost=1e4)
    one = replace(response(1000.0), changes={"motion_nrmse": np.full(1, 0.0022)})
    spreads = {s: replace(one, phases_by_chance={"motion_nrmse": np.full(1, s)}) for s in (0.0, 0.02, 0.3)}
    sure, likely, open_one = (with_errors.probability(spread) for spread in spreads.values())
    assert sure > likely > open_one
    assert open_one == pytest.approx(0.5, abs=0.1)
    assert spreads[0.3].towards(spreads[0.0], 0.5).phases_by_chance["motion_nrmse"] == pytest.approx(0.15)


def test_an_effect_that_closes_the_residual_need_not_lower_an_error() -> None:
    errors = {"motion_nrmse": np.full(10, 0.01)}
    assert replace(OPEN, errors=errors).probability(response(500.0, error=1e-5)) > 0.99
    assert replace(OPEN, errors=errors, cost=1e4).probability(response(500.0, error=1e-5)) == 0.0


@pytest.mark.parametrize(("cosine", "found"), [(-0.5, 0.0), (0.5, 1.0)])
def test_a_displacement_is_not_met_much_worse_unless_another_one_is_met_better(
    cosine: float, found: float
) -> None:
    """An effect that closes, shows in what is measured, and raises one error by a tenth."""
    change = {OVER_NOISE: 1.0, "motion_nrmse": 0.002, "relative_motion_nrmse": 1e-4}
    phase = {OVER_NOISE: 0.0, "motion_nrmse": -0.6, "relative_motion_nrmse": cosine}
    errors = {name: np.full(1, 1.0 if name == OVER_NOISE else 0.01) for name in change}
    one = replace(response(500.0), changes={n: np.full(1, x) for n, x in change.items()},
                  phases={n: np.full(1, x) for n, x in phase.items()})  # fmt: skip
    assert replace(OPEN, errors=errors).probability(one) == pytest.approx(found, abs=0.02)


def test_where_noise_is_told_from_few_samples_more_is_needed() -> None:
    at_limit = response((np.sqrt(GAINS[0]) + stats.norm.ppf(0.8)) ** 2)
    told = [replace(OPEN, noise_error=error).probability(at_limit) for error in (0.0, 0.15, 0.5)]
    assert told[0] > told[1] > told[2] > 0.5
