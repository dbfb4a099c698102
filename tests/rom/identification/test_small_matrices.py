"""Products and inverses of many small matrices are those of NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from rom.identification.ambient_noise import whitener
from rom.identification.small_matrices import by_one, inverse, positive_part, product, root_of
from rom.identification.spectral_model import _receptance

_LINES = 7


def _drawn(*shape: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.standard_normal((_LINES, *shape)) + 1j * rng.standard_normal((_LINES, *shape))


@pytest.mark.parametrize("bodies", [1, 2, 3])
@pytest.mark.parametrize("columns", [1, 2, 12])
def test_products_are_those_of_numpy(bodies: int, columns: int) -> None:
    a, b = _drawn(bodies, bodies), _drawn(bodies, columns)
    np.testing.assert_allclose(product(a, b), a @ b, rtol=1e-12)
    np.testing.assert_allclose(by_one(a, b[0].real), a @ b[0].real, rtol=1e-12)


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_inverses_undo_a_matrix(bodies: int) -> None:
    a = _drawn(bodies, bodies)
    unit = np.broadcast_to(np.eye(bodies), a.shape)
    np.testing.assert_allclose(inverse(a) @ a, unit, atol=1e-12)


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_noise_of_forces_and_sensors_is_white_behind_its_whitener(bodies: int) -> None:
    gain, root, sensor = _drawn(bodies, bodies), _drawn(bodies, bodies)[::-1], np.arange(1.0, bodies + 1)
    answer = gain @ root
    white = whitener(gain, root, sensor)
    power = answer @ answer.conj().swapaxes(1, 2) + np.diag(sensor)
    unit = np.broadcast_to(np.eye(bodies), power.shape)
    np.testing.assert_allclose(white @ power @ white.conj().swapaxes(1, 2), unit, atol=1e-12)


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_a_whitener_knows_sensors_that_are_quieter_than_rounding_of_strong_forces(bodies: int) -> None:
    """Forces that move all channels alike: what channels show apart is the sensors' noise alone."""
    gain, root = np.zeros((2, _LINES, bodies, bodies), dtype=np.complex128)
    gain[:, :, 0], root[:, 0, 0] = 1.0, 1e9
    white = whitener(gain, root, np.ones(bodies))
    apart = white[:, :, :1] - white[:, :, 1:]
    assert np.isfinite(white).all()
    assert np.abs(white.sum(axis=2)).max() < 1e-6
    if bodies > 1:
        np.testing.assert_allclose(np.linalg.norm(apart[..., 0], axis=1), np.sqrt(2.0), rtol=1e-6)


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_a_receptance_undoes_a_dynamic_stiffness(bodies: int) -> None:
    mass, damping, stiffness = _drawn(bodies, bodies)[:3].real  # of no symmetry: each entry has its place
    s = 2j * np.pi * np.linspace(0.1, 2.0, _LINES)
    found = _receptance(s, mass, damping, stiffness)
    whole = s[:, None, None] ** 2 * mass + s[:, None, None] * damping + stiffness
    unit = np.broadcast_to(np.eye(bodies), whole.shape)
    np.testing.assert_allclose(found @ whole, unit, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        _receptance(s, *np.zeros((3, bodies, bodies)))


@pytest.mark.parametrize("bodies", [2, 3])
def test_what_has_no_inverse_or_root_is_refused(bodies: int) -> None:
    flat = np.ones((_LINES, bodies, bodies), dtype=np.complex128)
    with pytest.raises(np.linalg.LinAlgError):
        inverse(flat)
    with pytest.raises(np.linalg.LinAlgError):
        whitener(0 * flat, flat, np.zeros(bodies))
    assert np.isnan(whitener(np.nan * flat, flat, np.ones(bodies))).any()  # a fit gone astray is no fault


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_a_positive_part_is_that_of_the_eigenvalues_and_its_root_gives_it_again(bodies: int) -> None:
    a = _drawn(bodies, bodies)
    a[0], a[1], a[2] = 0, -np.eye(bodies), np.diag([1.0, -2.0, 3.0][:bodies])
    a[3] = a[3] @ a[3].conj().T
    level, direction = np.linalg.eigh((a + a.conj().swapaxes(1, 2)) / 2)
    expected = (direction * np.maximum(level, 0.0)[:, None]) @ direction.conj().swapaxes(1, 2)
    found = positive_part(a)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    root = root_of(found)
    np.testing.assert_allclose(root @ root.conj().swapaxes(1, 2), expected, atol=1e-12)
