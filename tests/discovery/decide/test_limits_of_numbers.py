"""Limits of fitted numbers: one that ended at an end of its range says so, whatever is known of its error."""

from __future__ import annotations

import numpy as np
import pytest

from discovery.decide.explanation import limited_number
from discovery.residual.ends_of_ranges import on_ends, on_ends_that_suit
from discovery.views.closure_file import parameter_row
from rom.model.laws import Z95, Parameter


@pytest.mark.parametrize("error", [0.0, 0.1, np.inf, np.nan])
@pytest.mark.parametrize(
    ("bounds", "value"), [((0.0, 2.0), 2.0), ((0.0, 2.0), 0.0), ((0.0, np.inf), 0.0), ((-np.inf, 2.0), 2.0)]
)
def test_a_number_at_an_end_says_so_and_has_no_limit_there(
    bounds: tuple[float, float], value: float, error: float
) -> None:
    row = parameter_row(limited_number(Parameter(value, "1", bounds=bounds), error))
    assert row["at_bound"] is True
    assert row["low" if value == bounds[0] else "high"] is None
    assert all(limit is None or np.isfinite(limit) for limit in (row["low"], row["high"]))


@pytest.mark.parametrize("error", [0.0, np.inf, np.nan])
def test_inside_its_range_an_unknown_error_gives_no_limits(error: float) -> None:
    row = parameter_row(limited_number(Parameter(1.0, "1", bounds=(0.0, 2.0)), error))
    assert (row["low"], row["high"], row.get("at_bound")) == (None, None, None)


def test_limits_of_a_frequency_are_those_of_the_square_of_its_period() -> None:
    """Far above a band a frequency is hardly limited above."""
    of, error = Parameter(100.0, "Hz", bounds=(1.0, 1e4)), 2.0
    near, far = limited_number(of, error), limited_number(of, 15 * error)
    assert near.low == pytest.approx(100 - Z95 * error, rel=0.01)
    assert near.high == pytest.approx(100 + Z95 * error, rel=0.01)
    assert far.low == pytest.approx(100 / np.sqrt(1 + 0.6 * Z95))
    assert far.high == 1e4


def test_what_all_but_touches_an_end_is_put_on_it() -> None:
    low, high = np.array([0.0, 1.0, -np.inf, 0.0]), np.array([1.0, 3.0, 0.0, np.inf])
    found = on_ends(np.array([1e-8, 3.0 - 1e-7, -1e-8, 0.5]), low, high)
    assert found.tolist() == [0.0, 3.0, 0.0, 0.5]


def test_what_is_small_beside_its_range_is_put_on_no_end_where_that_leaves_more() -> None:
    """Friction of 3 nN, of a range up to 1 mN, was said to be none."""
    low, high, values = np.zeros(2), np.ones(2), np.array([3e-6, 3e-6])

    def rows(x: np.ndarray) -> np.ndarray:  # the second number tells nothing
        return np.array([1.0 + 1e6 * (x[0] - 3e-6), 1.0])

    found = on_ends_that_suit(rows, values, low, high, near=1e-4, most=0.1)
    assert found.tolist() == [3e-6, 0.0]
    assert on_ends(values, low, high, 1e-4).tolist() == [0.0, 0.0]
