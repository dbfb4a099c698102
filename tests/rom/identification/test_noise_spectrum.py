"""Floors from before the hits, of records that are not all filtered alike."""

from __future__ import annotations

import numpy as np
import pytest

from rom.identification.ambient_noise import share_left
from rom.identification.noise_spectrum import Quiet, noise_floors
from rom.identification.spectral_model import Linearised

SECONDS, SENSOR, AMBIENT = 0.5, 1e-4, 9.0  # powers a second of record
MODE_HZ = 100.0
LINES = np.arange(1, 401) / SECONDS


def quiet(rng: np.random.Generator, first: int) -> Quiet:
    """Return ambient forces through two masses, and their sensors' noise, from a line on."""
    frequency = LINES[first:]
    peak = 1e-3 + np.exp(-(((frequency - MODE_HZ) / 4) ** 2))  # elsewhere sensors show their own noise
    gain = (peak[:, None, None] * np.diag([1 / 3.0, 1 / 1.5])).astype(np.complex128)
    force, noise = (rng.normal(size=(2, len(frequency), 2, 2)) @ [1, 1j]) * np.sqrt(SECONDS / 2)
    left = (gain @ (np.sqrt(AMBIENT) * force)[:, :, None])[:, :, 0] + np.sqrt(SENSOR) * noise
    none = np.empty((0, 0))
    part = Linearised(none, none, (), left, gain, none, none, gain)
    return Quiet(("coupled", ("lo", "so")), part, frequency, SECONDS, np.ones(len(frequency)))


def test_records_with_other_lowest_lines_share_the_floor_of_the_lines_that_all_have() -> None:
    rng = np.random.default_rng(3)
    ones = [quiet(rng, first) for first in [2] * 20 + [0] * 15 + [1] * 5]
    (floor,) = noise_floors(ones).values()
    np.testing.assert_array_equal(floor.frequency, LINES[2:])
    same = [one.between(len(one.frequency) - 398, len(one.frequency)) for one in ones]
    (told,) = noise_floors(same).values()
    np.testing.assert_array_equal(floor.sensor, told.sensor)
    np.testing.assert_array_equal(floor.ambient, told.ambient)


@pytest.mark.parametrize("firsts", [[0] * 40, [0, 7] * 20])
def test_the_forces_of_the_surroundings_are_told_by_records_of_any_lowest_line(firsts: list[int]) -> None:
    rng = np.random.default_rng(4)
    (floor,) = noise_floors([quiet(rng, first) for first in firsts]).values()
    ambient = floor.ambient[np.argmin(np.abs(floor.frequency - MODE_HZ))]
    assert ambient[0, 0].real == pytest.approx(AMBIENT, rel=0.25)
    assert abs(ambient[0, 1]) < 0.15 * AMBIENT
    np.testing.assert_allclose(floor.sensor, SENSOR, rtol=0.1)


def test_the_share_of_noise_that_a_fit_leaves_is_that_of_the_residual_s_power() -> None:
    """Where end states take most of a line, what is left of it is that much smaller in the mean."""
    rng = np.random.default_rng(2)
    lines = 12
    ends = rng.normal(size=(2 * lines, 4)) * np.repeat(np.geomspace(100, 0.1, lines), 2).reshape(-1, 1)
    ends = ends.reshape(lines, 2, 4).swapaxes(0, 1).reshape(2 * lines, 4)  # real parts, then imaginary ones
    inverse = np.linalg.inv(ends.T @ ends)
    noise = rng.normal(size=(4000, 2 * lines))
    left = noise - noise @ ends @ inverse @ ends.T
    square = np.mean(left.reshape(-1, 2, lines) ** 2, axis=(0, 1))
    none, unweighted = np.empty((0, 0)), np.zeros((lines, 1), dtype=np.complex128)
    part = Linearised(none, none, (), unweighted, unweighted, ends, inverse, unweighted)
    np.testing.assert_allclose(share_left(part), square, atol=0.05)
    assert share_left(part)[0] < 0.1
