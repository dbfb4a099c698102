"""Corrected Gauss-Newton steps: along curved valleys, onto ends of ranges, and where slopes tell nothing."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.residual.least_squares import minimum, minimum_nearby
from rom.campaign.channels import FloatArray

TIME_S = np.arange(6000) / 60.0
NOISE = 1e-3
TRUE = np.array([2 * np.pi * 3.0, 0.03, 0.155, 1.0, 1.4])
FREE = (np.array([1.0, 1e-3, 0.0, 0.05, 1.0]), np.array([100.0, 1.0, 0.8, 10.0, 2.0]))


def decay(x: FloatArray) -> FloatArray:
    """Its frequency falls with amplitude: ``w (1 - alpha r / (1 + r))``, ``r = (a / x_s)^q``."""
    frequency, damping, alpha, size, power = x
    amplitude = 0.3 * np.exp(-damping * TIME_S)
    ratio = (amplitude / size) ** power
    phase = np.cumsum(frequency * (1 - alpha * ratio / (1 + ratio))) * TIME_S[1]
    return amplitude * np.cos(phase)


MEASURED = decay(TRUE) + NOISE * np.random.default_rng(3).normal(size=len(TIME_S))


def rows(x: FloatArray) -> FloatArray:
    return (MEASURED - decay(x)) / NOISE


def slopes(x: FloatArray) -> FloatArray:
    steps = 1e-6 * np.abs(x)
    return np.stack([(rows(x + s) - rows(x - s)) / (2 * s.sum()) for s in np.diag(steps)], axis=1)


def settled(_: float) -> float:
    return 0.1


def test_corrections_follow_a_curved_valley_where_plain_steps_creep() -> None:
    """As many rounds of slopes, from softening at a quarter of the amplitude that it needs."""
    start, rounds = TRUE * [1.0, 1.0, 0.2, 0.25, 1.35], 12
    near = minimum(rows, TRUE, slopes, FREE, rounds, settled).rows
    best = float(near @ near)
    found = minimum(rows, start, slopes, FREE, rounds, settled)
    peer = minimum_nearby(rows, start, slopes, FREE, rounds)
    assert float(found.rows @ found.rows) < best + 5.0
    assert float(peer.rows @ peer.rows) > best + 500.0
    assert found.x == pytest.approx(TRUE, rel=0.2)


@pytest.mark.parametrize("nearby", [False, True])
def test_what_would_leave_its_range_ends_at_the_end_of_it(nearby: bool) -> None:
    low, high = FREE[0].copy(), FREE[1].copy()
    low[1] = 0.031
    start = TRUE * [1.0, 1.1, 1.0, 1.0, 1.0]
    found = (
        minimum_nearby(rows, start, slopes, (low, high), 60)
        if nearby
        else minimum(rows, start, slopes, (low, high), 30, settled)
    )
    assert found.x[1] == pytest.approx(0.031, rel=1e-6 if nearby else 0.0)


@pytest.mark.parametrize("rounds", [0, 5])
def test_numbers_that_show_nothing_stay(rounds: int) -> None:
    free = (np.full(2, -np.inf), np.full(2, np.inf))
    found = minimum(
        lambda x: np.array([x[0] - 2.0, 1.0]), np.array([1.0, 7.0]),
        lambda _: np.array([[1.0, 0.0], [0.0, 0.0]]), free, rounds, settled,
    )  # fmt: skip
    assert found.x.tolist() == pytest.approx([2.0 if rounds else 1.0, 7.0])
    assert minimum_nearby(rows, TRUE, slopes, FREE, 0).x.tolist() == TRUE.tolist()


def test_a_damped_step_that_gains_little_along_a_floor_is_not_the_end() -> None:
    """Columns that hardly differ: the first damping leaves nearly all that an undamped step takes off."""
    table = np.array([[1.0, 1.0], [0.0, 1e-3]])
    free = (np.full(2, -np.inf), np.full(2, np.inf))

    def rows(x: FloatArray) -> FloatArray:
        return table @ x - [0.0, 7.0]

    found = minimum(rows, np.zeros(2), lambda _: table, free, 10, lambda _: 1.0)
    assert float(found.rows @ found.rows) < 1.0  # 48 where the first step is taken for the last
