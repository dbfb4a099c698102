"""Standard errors against the spread of fits to many sets of data."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.decide.explanation import standard_errors

_RECORDS, _ROWS, _SETS = 25, 30, 400


@pytest.mark.parametrize("shared", [0.0, 0.5], ids=["rows err by themselves", "records err as one"])
def test_standard_errors_are_the_spread_of_the_fits(shared: float) -> None:
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((_RECORDS, _ROWS, 2)) + rng.standard_normal((_RECORDS, 1, 2))
    table = slopes.reshape(-1, 2)
    inverse = np.linalg.inv(table.T @ table)
    found, told = [], []
    for _ in range(_SETS):
        rows = rng.standard_normal((_RECORDS, _ROWS)) + shared * rng.standard_normal((_RECORDS, 1))
        found.append(inverse @ table.T @ rows.ravel())
        left = rows - slopes @ found[-1]
        told.append(standard_errors(inverse, np.einsum("irp,ir->ip", slopes, left)))
    assert np.median(told, axis=0) == pytest.approx(np.std(found, axis=0), rel=0.2)
    of_rows = np.sqrt(np.diag(inverse))
    assert (np.std(found, axis=0) > 1.5 * of_rows).any() == (shared > 0)


def test_records_that_tell_nothing_do_not_count() -> None:
    inverse, scores = np.eye(1), np.array([[3.0], [-1.0], [-2.0]])
    silent = np.concatenate([scores, np.zeros((50, 1))])
    assert standard_errors(inverse, silent) == pytest.approx(standard_errors(inverse, scores))
    assert standard_errors(inverse, scores) == pytest.approx([np.sqrt(14 * 1.5)])
    assert standard_errors(inverse, 0.1 * scores, spread=4.0) == pytest.approx([2.0])
