from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import discovery
from discovery.courses.fit import Fit, fit
from discovery.courses.prediction import predict
from discovery.criteria.criteria import CRITERIA
from discovery.laws.candidate import Candidate, Term, baseline
from discovery.laws.factors import tension_exponential, tension_power, velocity_power
from discovery.search.libraries import Scales, TermLibrary, motion_factors
from discovery.search.optimizers import sparse_supports
from discovery.search.sparse_regression import (
    along,
    forward,
    integrals,
    least_squares,
    smoothed,
    usable,
    weighted,
    whitener,
)
from tests.discovery.synthetic import frozen


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return fit(baseline(), frozen())


def test_integrals_are_the_change_that_a_small_term_makes() -> None:
    # so small a coefficient leaves the tension at its start, where T^0 and T agree with a constant
    whole = frozen()
    scales = Scales.of(whole)
    tension = tension_power(0.0, free=True)
    library = TermLibrary("one", scales, (velocity_power(2.0),), (tension,))
    law = Candidate("small", (Term(velocity_power(2.0), tension),), (1e-3,))
    expected = predict(law, whole)
    found = -1e-3 / library.units[0] * integrals(library, whole)[:, :, 0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-11)


def test_along_a_fit_the_true_column_gives_its_own_course_back(fitted: Fit) -> None:
    whole = frozen()
    followed = along(fitted, whole)
    term = fitted.candidate.terms[0]
    library = TermLibrary("true", Scales.of(whole), (term.motion,), (term.tension,))
    rate = fitted.candidate.coefficients[0] / library.units[0] * np.exp(fitted.deviations)
    course = -rate[:, None] * integrals(library, followed)[:, :, 0, 0]
    expected = smoothed(fitted, whole)
    assert np.abs(course - expected).max() < 0.01 * np.abs(expected).max()
    np.testing.assert_array_equal(followed.change, whole.change - fitted.offsets)


def test_whitened_noise_is_white(fitted: Fit) -> None:
    whole = frozen()
    smooth = smoothed(fitted, whole)
    roots = whitener(whole, smooth, np.full(len(whole), 0.3))
    case = 4
    d = smooth[case]
    covariance = whole.covariance[case] + np.diag((0.01 * d) ** 2) + 0.09 * np.outer(d, d)
    np.testing.assert_allclose(roots[case] @ covariance @ roots[case].T, np.eye(len(d)), atol=1e-8)


def test_zero_and_collinear_columns_are_dropped_by_name() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 40))
    kept, dropped = usable(
        np.stack([a, 0 * a, b, -3 * a, a + 1e-2 * b], axis=1), ["a", "zero", "b", "3a", "c"]
    )
    assert kept == [0, 2, 4]
    assert dropped == ("zero", "3a")


def test_every_optimizer_finds_two_terms_among_ten() -> None:
    rng = np.random.default_rng(1)
    unit = rng.normal(size=(200, 10))
    target = 2 * unit[:, 2] + unit[:, 7] + 1e-2 * rng.normal(size=200)
    found = sparse_supports(unit * np.geomspace(1e-6, 1e6, 10), target, rng)
    assert set(found[frozenset({2, 7})]) == {
        "FROLS", "SSR", "STLSQ", "non-negative STLSQ", "SR3", "EnsembleOptimizer"
    }  # fmt: skip


def test_where_signs_are_known_a_path_of_fits_keeps_to_them() -> None:
    """Two near-equal columns whose difference fits best: a fit held to the signs takes one."""
    rng = np.random.default_rng(4)
    first, other, noise = rng.normal(size=(3, 200))
    theta = np.stack([first, first + 0.1 * noise, other], axis=1)
    target = first + 0.5 * other - 0.1 * noise
    free, held = (sparse_supports(theta, target, rng, signed) for signed in (True, False))
    assert all("non-negative STLSQ" not in names for names in free.values())
    paths = {support for support, names in held.items() if "non-negative STLSQ" in names}
    assert frozenset({0, 2}) in paths
    assert not any({0, 1} <= support for support in paths)


def test_the_global_random_state_is_left_as_it_was() -> None:
    before = np.random.get_state()[1].copy()  # type: ignore[index] # noqa: NPY002
    rng = np.random.default_rng(2)
    theta = rng.normal(size=(30, 4))
    supports = [sparse_supports(theta, theta[:, 0], np.random.default_rng(5)) for _ in range(2)]
    assert supports[0] == supports[1]
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # type: ignore[index] # noqa: NPY002


def test_least_squares_keeps_signs_and_starts_small_what_it_leaves_out() -> None:
    theta = np.eye(3)
    target = np.array([2.0, -1.0, 0.0])
    assert np.all(least_squares(theta, target) > 0)
    np.testing.assert_allclose(least_squares(theta, target, signed=True), [2.0, -1.0, 0.06])


def test_rows_of_a_library_carry_the_loss(fitted: Fit) -> None:
    whole = frozen()
    scales = Scales.of(whole)
    library = TermLibrary("few", scales, motion_factors(scales)[:4], (tension_power(), tension_exponential()))
    roots = whitener(whole, smoothed(fitted, whole))
    rows = weighted(integrals(library, whole), whole, roots)
    assert rows.columns.shape == (*whole.change.shape, 8)
    np.testing.assert_allclose(rows.target[2], -roots[2] @ whole.change[2])


def test_forward_steps_over_columns_that_a_resample_left_empty() -> None:
    rng = np.random.default_rng(3)
    theta = rng.normal(size=(30, 5))
    target = theta[:, 4] + 0.3 * theta[:, 2]
    theta[:, 1] = 0.0
    assert forward(theta, target, 2) == [2, 4]
    assert forward(np.zeros((30, 3)), target, 2) == []


def test_an_optimizer_that_is_added_takes_part(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(40, 5))
    monkeypatch.setitem(discovery.OPTIMIZERS, "last", lambda problem: [np.eye(problem.columns)[-1]])
    assert "last" in sparse_supports(theta, theta[:, 0], rng)[frozenset({4})]


def test_largest_support_is_a_criterion() -> None:
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(40, 5))
    one = replace(CRITERIA.search, largest_support=1)
    target = theta @ np.array([1.0, 0.5, 0.0, 0.0, 0.2])
    supports = [
        sparse_supports(theta, target, np.random.default_rng(1), rules=r) for r in (CRITERIA.search, one)
    ]
    assert [max(len(support) for support in found) for found in supports] == [3, 1]
