from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import discovery
from discovery.criteria.criteria import CRITERIA
from discovery.laws.factors import displacement_threshold, tension_exponential, tension_power, velocity_power
from discovery.search.libraries import (
    Library,
    Scales,
    TermLibrary,
    grid,
    motion_factors,
    polynomials,
    printed,
    tension_factors,
)
from tests.discovery.synthetic import frozen


@pytest.fixture(scope="module")
def scales() -> Scales:
    return Scales.of(frozen())


@pytest.fixture(scope="module")
def library(scales: Scales) -> TermLibrary:
    return TermLibrary("all", scales, motion_factors(scales), tension_factors(scales))


def test_scales_are_medians_of_the_campaign(scales: Scales) -> None:
    whole = frozen()
    peaks = [np.abs(whole.of_case(case)[2]).max() for case in range(len(whole))]
    assert scales.velocity == np.median(peaks)
    assert scales.tension == np.median(whole.initial)


def test_the_grid_holds_more_than_two_thousand_distinct_terms(library: TermLibrary) -> None:
    keys = {(term.motion.key, term.tension.key) for term in library.terms}
    assert len(keys) == len(library.terms) == len(set(library.names())) > 2000


def test_whole_powers_come_in_the_order_of_the_polynomial_library() -> None:
    first = [printed(factor) for factor in polynomials(6)[:5]]
    assert first == ["abs(v)^1", "abs(x)^1", "abs(v)^2", "abs(v)^1 abs(x)^1", "abs(x)^2"]


def test_every_column_is_its_term_over_its_scale(library: TermLibrary, scales: Scales) -> None:
    nodes = frozen().of_case(3)[:, 100:160]
    few = TermLibrary("few", scales, library.motions[:30] + library.motions[-3:], library.tensions[:3])
    columns = few.transform(nodes)
    _, x, v, force, damping, tension = nodes
    for column, term, unit in zip(columns.T, few.terms, few.units, strict=True):
        expected = term.motion.of_motion(x, v, force, damping) * term.tension.of_tension(tension)
        np.testing.assert_allclose(column, unit * expected, rtol=1e-9, atol=1e-12 * np.abs(column).max())


def test_the_product_of_the_two_libraries_is_the_tensored_one(library: TermLibrary) -> None:
    nodes = frozen().of_case(5)[:, 90:110]
    motion, tension = library.factors(nodes)
    product = (motion[:, :, None] * tension[:, None, :]).reshape(len(motion), -1)
    np.testing.assert_allclose(library.transform(nodes), product, rtol=1e-12)


def test_every_family_of_tension_factors_is_a_library_of_its_own(library: TermLibrary) -> None:
    _, tension = library._libraries()
    counts = [len(part.functions) for part in tension.libraries]
    assert len(counts) == len({factor.text for factor in library.tensions}) == 4
    assert sum(counts) == len(library.tensions)


def test_columns_are_one_at_the_scales(library: TermLibrary, scales: Scales) -> None:
    there = np.array(
        [[0.0], [scales.displacement], [scales.velocity], [scales.force], [scales.damping], [scales.tension]]
    )
    np.testing.assert_allclose(library.transform(there), 1.0, rtol=1e-9)


def test_names_print_as_equations(library: TermLibrary) -> None:
    names = library.names()
    assert names[0] == "abs(v) T"
    assert any(name == "abs(v)^4 T exp(-T / 300)" for name in names)
    assert printed(displacement_threshold(1e-5, 5e-5)) == "max(abs(x) - 1e-05, 0)^2"


def test_grids_visit_every_point() -> None:
    points = [factor.inner["T_s"].value for factor in grid(tension_exponential())]
    assert points == list(tension_exponential().inner["T_s"].grid)
    assert [f.key for f in grid(tension_power())] == [tension_power().key]
    assert len(grid(velocity_power())) == len(velocity_power().inner["n"].grid)


def test_a_fitted_factor_joins_the_grid_once(scales: Scales) -> None:
    own = tension_exponential(123.0)
    assert len(tension_factors(scales, own)) == len(tension_factors(scales)) + 1
    assert len(tension_factors(scales, tension_exponential(300.0))) == len(tension_factors(scales))


def test_a_library_that_is_added_takes_part(scales: Scales, monkeypatch: pytest.MonkeyPatch) -> None:
    own = velocity_power(7.5)
    monkeypatch.setitem(discovery.LIBRARIES, "own", Library("motion", lambda *_: (own,)))
    assert own.key in {factor.key for factor in motion_factors(scales)}


def test_degree_of_the_polynomials_is_a_criterion(scales: Scales) -> None:
    low = replace(CRITERIA.search, degree=2)
    assert len(motion_factors(scales)) > len(motion_factors(scales, low))
