"""Triangular factors of tall matrices, block by block."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.residual.block_qr import triangle


@pytest.mark.parametrize("rows", [3, 100, 512, 1300])
def test_a_triangle_by_blocks_is_that_of_the_whole_matrix(rows: int) -> None:
    matrix = np.random.default_rng(rows).standard_normal((rows, 5))
    whole, found = np.linalg.qr(matrix, mode="r"), triangle(matrix)
    assert found.shape == whole.shape
    np.testing.assert_allclose(np.abs(found), np.abs(whole), atol=1e-12 * np.abs(whole).max())


def test_the_last_column_of_the_triangle_has_what_least_squares_leaves() -> None:
    """Columns that differ by a millionth: normal equations would have lost it to rounding."""
    rng = np.random.default_rng(0)
    first, change, target = rng.standard_normal((3, 2000))
    columns = np.stack([first, first + 1e-6 * change], axis=1)
    found = triangle(np.column_stack([columns, target]))
    steps = np.linalg.solve(found[:2, :2], found[:2, 2])
    known = np.linalg.lstsq(columns, target, rcond=None)[0]
    np.testing.assert_allclose(steps, known, rtol=1e-8)
    left = float(np.linalg.norm(target - columns @ known))
    assert abs(found[2, 2]) == pytest.approx(left, rel=1e-12)
