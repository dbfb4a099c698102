from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from discovery.search.quick_likelihood import best_pairs, fitted_sum, marginal_deviance, single_terms
from discovery.search.sparse_regression import Rows

CASES, BINS = 30, 8


def _rows(coefficients: list[float], scatter: float, seed: int = 0) -> Rows:
    rng = np.random.default_rng(seed)
    time = np.linspace(0.1, 1.0, BINS)
    shapes = np.stack([time, np.sqrt(time), 1 - np.exp(-8 * time), time**3], axis=-1)
    columns = shapes * rng.lognormal(2.0, 1.0, size=(CASES, 1, 4))
    true = columns[:, :, : len(coefficients)] @ np.array(coefficients)
    rates = np.exp(scatter * rng.standard_normal(CASES))
    return Rows(columns, true * rates[:, None] + rng.standard_normal((CASES, BINS)))


def test_marginal_deviance_is_that_of_the_normal_density() -> None:
    rng = np.random.default_rng(0)
    y, g, tau = rng.normal(size=6), rng.normal(size=6), 0.7
    found = marginal_deviance(np.array(y @ y), np.array(g @ y), np.array(g @ g), tau)
    density = stats.multivariate_normal(g, np.eye(6) + tau**2 * np.outer(g, g)).logpdf(y)
    assert found == pytest.approx(-2 * density - 6 * np.log(2 * np.pi))


def test_the_true_column_is_the_best_single_term() -> None:
    found = sorted(single_terms(_rows([5.0], 0.2), "x"), key=lambda item: item.deviance)
    assert found[0].columns == (0,)
    assert found[0].coefficients[0] == pytest.approx(5.0, rel=0.2)
    assert found[0].deviance < found[1].deviance - 20


def test_zero_columns_are_left_out() -> None:
    rows = _rows([5.0], 0.2)
    columns = rows.columns.copy()
    columns[:, :, 1] = 0.0
    assert {f.columns[0] for f in single_terms(Rows(columns, rows.target), "x")} == {0, 2, 3}


def test_a_large_scatter_does_not_shrink_a_wrong_law_into_a_good_one() -> None:
    # a law of the wrong shape must pay for it in full, however uncertain its size is
    rows = _rows([50.0], 1.0)
    found = {f.columns[0]: f.deviance for f in single_terms(rows, "x")}
    assert found[3] > found[0] + 1000


def test_the_true_pair_is_the_best_and_its_coefficients_are_found() -> None:
    rows = _rows([0.0, 4.0, 3.0], 0.2)
    sizes = np.array([f.coefficients[0] for f in single_terms(rows, "x")])
    assert best_pairs(rows, sizes, 3)[0] == (1, 2)
    found = fitted_sum(rows, (1, 2), np.ones(2), ("x",))
    assert found.coefficients == pytest.approx((4.0, 3.0), rel=0.3)
    assert found.deviance < fitted_sum(rows, (0, 3), np.ones(2), ("x",)).deviance - 100


def test_judging_finds_the_minimum_over_coefficients() -> None:
    rows = _rows([2.0, 0.0, 0.0, 3.0], 0.3)
    found = fitted_sum(rows, (0, 3), np.array([1.0, 1.0]), ())
    elsewhere = fitted_sum(rows, (0, 3), np.array([4.0, 0.5]), ())
    assert elsewhere.deviance == pytest.approx(found.deviance, abs=0.01)
    assert elsewhere.coefficients == pytest.approx(found.coefficients, rel=0.02)


def test_a_term_of_the_other_sign_keeps_its_sign() -> None:
    rows = _rows([4.0, -1.0], 0.1)
    sizes = np.array([f.coefficients[0] for f in single_terms(rows, "x")])
    assert (0, 1) in best_pairs(rows, sizes, 2, signed=True)
    found = fitted_sum(rows, (0, 1), np.array([1.0, -0.1]), ())
    assert found.coefficients == pytest.approx((4.0, -1.0), rel=0.3)
