from __future__ import annotations

from discovery.discover import _left_out


def test_columns_that_no_sparse_fit_could_take_are_named() -> None:
    assert _left_out(()) == ()
    (few,) = _left_out(("abs(D v) T", "abs(D v)^2 T"))
    assert few.endswith("multiples of others: abs(D v) T; abs(D v)^2 T")
    (many,) = _left_out([f"abs(x)^{q} T" for q in range(9)])
    assert many.endswith("abs(x)^4 T and 4 more")
