"""A motion that is late behind the force, on a free chain of three blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rom.campaign.channels import FloatArray
from rom.criteria.suspicions import Suspicions
from rom.signals.delays import Window

RATE_HZ, FIRST, LAST, REACH = 10_000.0, 470, 750, 30
USUAL = 2.2  # samples
MASSES = np.array([3.0, 2.0, 1.5])


def chain() -> Window:
    """The accelerations of three blocks on springs of 400 and 300 kN/m, the first hit for 3 ms."""
    force = np.zeros(1000)
    force[500:530] = 200 * np.sin(np.pi * np.arange(30) / 30) ** 2
    stiffness = np.array([[4e5, -4e5, 0.0], [-4e5, 7e5, -3e5], [0.0, -3e5, 3e5]])
    still = np.zeros((3, 3))
    by_mass = -stiffness / MASSES[:, None]
    system = np.block([[still, np.eye(3)], [by_mass, 1e-4 * by_mass]])
    pushed = np.r_[0.0, 0.0, 0.0, 1 / MASSES[0], 0.0, 0.0][:, None]
    _, moved, _ = signal.lsim((system, pushed, system[3:], pushed[3:]), force, np.arange(1000) / RATE_HZ)
    noise = 1e-3 * np.random.default_rng(1).normal(size=moved.shape)
    rows = list((moved + noise).T)
    square = (LAST - FIRST) * np.array([0.0, *[1e-6] * 3])
    return Window(force, rows, (FIRST, LAST), 0, (0, 0, 0), RATE_HZ, (False,) * 3, square, 5, Suspicions())


def later(row: FloatArray, samples: int) -> FloatArray:
    return np.r_[np.full(samples, row[0]), row[:-samples]]


def delayed(window: Window, place: int, samples: int) -> Window:
    rows = [later(row, samples) if i == place else row for i, row in enumerate(window.rows)]
    return replace(window, rows=rows)


@pytest.mark.parametrize("place", range(3))
def test_the_delay_of_one_motion_is_told(place: int) -> None:
    found = delayed(chain(), place, 12).delay(REACH, 0, USUAL)
    assert found.places == (place,)
    assert found.samples == pytest.approx(12, abs=0.5)


def test_motions_in_time_have_no_delay() -> None:
    assert chain().delay(REACH, 0, USUAL).samples == pytest.approx(0, abs=0.5)


@pytest.mark.parametrize("place", range(3))
def test_at_the_end_of_what_is_looked_at_no_delay_is_told(place: int) -> None:
    """Misfits fall up to there: where they are least is not known."""
    found = delayed(chain(), place, 16).delay(REACH // 2, 0, USUAL)
    assert found.places != (place,)
