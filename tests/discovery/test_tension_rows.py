"""The noise of the tension's courses: what tests that leave it alone share, and what is there before hits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery.tension_rows import noises
from rom.courses import TensionBins

ALLOWED, NOISE, RECORDS = 0.005, 0.01, 12


def bins(rng: np.random.Generator, drift: float, step: float = 0.0) -> TensionBins:
    """Ten bins of a gauge in newton with a drift [N/s], and a change [N] that is the same in all of them."""
    lag, counts = np.linspace(0.05, 1.0, 10), np.full(10, 100.0)
    change = drift * lag + step + NOISE * rng.normal(size=10)
    return TensionBins(np.linspace(0.0, 1.0, 11), change, counts, 1000, lag, 1.0, 1000.0)


def seen(drift: float, step: float = 0.0) -> tuple[Any, ...]:
    """Coupled tests with a drift that all share, and a step at the hit."""
    rng = np.random.default_rng(3)
    settings = SimpleNamespace(test="coupled", hold_out=False)
    return tuple(
        SimpleNamespace(settings=settings, bins=bins(rng, drift, step), before=bins(rng, drift))
        for _ in range(RECORDS)
    )


@pytest.mark.parametrize("drift", [0.15, -0.15])
def test_a_drift_that_all_tests_share_before_their_hits_is_the_gauge_s(drift: float) -> None:
    found = noises(seen(drift), ALLOWED)
    assert found is not None
    steady, drifting = found
    assert np.sqrt(steady.drift) == pytest.approx(ALLOWED)
    assert np.sqrt(drifting.drift) == pytest.approx(abs(drift), rel=0.1)


@pytest.mark.parametrize("step", [0.0, 2.0])
def test_what_tests_share_after_their_hits_alone_is_no_drift(step: float) -> None:
    found = noises(seen(0.0, step), ALLOWED)
    assert found is not None
    assert np.sqrt(found[1].drift) < 4 * ALLOWED
