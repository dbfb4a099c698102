"""Libraries and optimizers of one's own: pysindy's objects in the search, and names that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pysindy
import pytest

import discovery
import rom
from discovery.courses.fit import fit
from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.laws.candidate import Candidate, Term, baseline
from discovery.laws.factors import tension_power, velocity_power
from discovery.ranking.race import race
from discovery.search.libraries import Scales, tension_factors
from discovery.search.pysindy_libraries import expression_of, read_library
from discovery.search.quick_likelihood import Found
from discovery.search.selection import select
from discovery.search.shortlist import Proposals, propose
from discovery.search.sparse_regression import node_weights
from tests.discovery.synthetic import measured

CUBIC = Candidate("cubic", (Term(velocity_power().held(n=3.0), tension_power()),), (600.0,))


UNREAD: Any = SimpleNamespace(path=Path(), settings=None, digest="", digests={}, criteria=None)


def abs_of(v: Any) -> Any:
    return np.abs(v)


@cache
def frozen() -> FrozenMotion:
    return freeze(
        rom.paper_model(),
        measured(CUBIC, preloads=(20.0, 60.0, 300.0, 1000.0), scatter=0.1, length_s=0.5),
    )


def proposed(libraries: list[Any] | None, optimizers: list[Any] | None = None, terms: int = 3) -> Proposals:
    whole = frozen()
    rules = whole.criteria.changed(search={"largest_support": terms})
    limited = replace(whole, criteria=rules)
    return propose(limited, fit(baseline(), limited), 0, selection=select(libraries, optimizers))


def column(function: Callable[..., Any], name: str) -> pysindy.CustomLibrary:
    """A column of all five inputs."""

    def of_all(v: Any, x: Any, T: Any, F: Any, D: Any) -> Any:
        return function(SimpleNamespace(v=v, x=x, T=T, F=F, D=D))

    return pysindy.CustomLibrary([of_all], [lambda *_: name])


def cube() -> pysindy.CustomLibrary:
    return column(lambda m: np.abs(m.v) ** 3 * m.T, "|v|^3 T")


def rivals() -> pysindy.ConcatLibrary:
    """The truth beside three others, as pysindy joins libraries."""
    others = (
        column(lambda m: m.v**2 * m.T, "v^2 T"),
        column(lambda m: np.abs(m.x) ** 1.5 * np.exp(-m.T / 300), "abs(x)**1.5 * exp(-T / 300)"),
        column(lambda m: np.abs(m.D * m.v) * m.T, "|D v| T"),
    )
    return pysindy.ConcatLibrary([cube(), *others])


@pytest.mark.parametrize(
    ("name", "expression"),
    [
        ("v^2 x", "v ** 2 * x"),
        ("|v|^1.5 T exp(-T / 300)", "abs(v) ** 1.5 * T * exp(-T / 300)"),
        ("-2 |D v| max(T, 0)", "-2 * abs(D * v) * max(T, 0)"),
        ("(v + x)^2 T", "(v + x) ** 2 * T"),
    ],
)
def test_a_feature_name_is_an_expression(name: str, expression: str) -> None:
    assert expression_of(name) == expression


def test_a_law_of_columns_is_the_sum_of_their_values() -> None:
    whole = frozen()
    library = read_library(rivals(), "own", whole, signed=True)
    scaled = np.array([3.0, -2.0, 0.5])
    law = library.law(Found((0, 2, 3), tuple(scaled), 0.0, ("pysindy:own/by hand",)))
    assert law.name == "|v|^3 T - |x|^1.5 exp(-T/300) + |D v| T"
    _, x, v, force, damping, tension = nodes = whole.of_case(2)
    inputs = np.stack([v, x, tension, force, damping], axis=1)
    values = np.asarray(rivals().fit(inputs).transform(inputs))[:, [0, 2, 3]]
    expected = -values @ (scaled / library.scales[[0, 2, 3]])
    np.testing.assert_allclose(law.rate.rate(tension, x, v, force, damping), expected, rtol=1e-9)
    means = library.integrals[2, :, 3] * library.scales[3]
    np.testing.assert_allclose(means, node_weights(nodes[0], whole) @ values[:, 2], rtol=1e-9)


@pytest.mark.parametrize(
    ("optimizer", "selected"),
    [
        (pysindy.STLSQ(threshold=0.3), "|v|^3 T"),
        (pysindy.SR3(reg_weight_lam=0.2, max_iter=1000), "|v|^3 T + v^2 T"),
        (pysindy.SSR(), "|v|^3 T"),
        (pysindy.FROLS(), "|v|^3 T"),
        (pysindy.EnsembleOptimizer(pysindy.STLSQ(threshold=0.3), bagging=True, n_models=5), "|v|^3 T"),
    ],
    ids=["STLSQ", "SR3", "SSR", "FROLS", "EnsembleOptimizer"],
)
def test_what_an_optimizer_of_pysindy_selects_names_it(optimizer: Any, selected: str) -> None:
    found = proposed([rivals()], [optimizer])
    first = found.candidates[0]
    assert first.name == "|v|^3 T"
    assert first.parameters["gamma"].value == pytest.approx(600.0, rel=0.2)
    assert first.parameters["gamma"].unit == "m^-3 s^2"
    law = next(law for law in found.candidates if law.name == selected)
    assert f"pysindy:ConcatLibrary/{type(optimizer).__name__}" in law.source.split("; ")
    assert found.notes == ()
    assert not hasattr(optimizer, "coef_")  # a copy was fitted


class TwoLargest:
    """An optimizer that pysindy does not have: the two columns of largest correlation."""

    def fit(self, theta: np.ndarray[Any, Any], target: np.ndarray[Any, Any]) -> TwoLargest:
        np.testing.assert_allclose([*np.linalg.norm(theta, axis=0), np.linalg.norm(target)], 1.0)
        self.coef_ = theta.T @ target
        self.coef_[np.argsort(np.abs(self.coef_))[:-2]] = 0.0
        return self


def test_an_optimizer_of_one_s_own_takes_part_and_alone() -> None:
    found = proposed([rivals()], [TwoLargest()])
    pairs = [law for law in found.candidates if len(law.free) == 2]
    assert [law.source for law in pairs] == ["pysindy:ConcatLibrary/TwoLargest"]


def test_coefficients_that_no_column_has_are_refused() -> None:
    class OneTooMany(TwoLargest):
        def fit(self, theta: np.ndarray[Any, Any], target: np.ndarray[Any, Any]) -> TwoLargest:
            self.coef_ = np.append(super().fit(theta, target).coef_, 1.0)
            return self

    with pytest.raises(ValueError, match=r"OneTooMany: found coef_ of shape \(5,\), expected one finite"):
        proposed([rivals()], [OneTooMany()])
    silent = SimpleNamespace(fit=lambda *_: None)
    with pytest.raises(ValueError, match=r"found coef_ of shape \(1,\), expected one finite number"):
        proposed([rivals()], [silent])


def test_polynomials_leave_out_what_loosens_a_bolt_at_rest() -> None:
    found = proposed([pysindy.PolynomialLibrary(degree=2)], ["STLSQ"], terms=1)
    (note,) = (text for text in found.notes if "left out" in text)
    assert note.endswith("columns that are not zero while nothing moves: 1; T; T^2")
    names = {law.name for law in found.candidates}
    assert {"v^2", "x T", "v D"} <= {name.removeprefix("- ") for name in names}
    assert all(len(law.free) == 1 for law in found.candidates)
    assert all(law.law().rate(100.0, 0.0, 0.0, 0.0, 0.0) == 0 for law in found.candidates)


def test_terms_loosen_unless_tightening_is_asked_for() -> None:
    library = read_library(column(lambda m: -(np.abs(m.v) ** 3), "-|v|^3"), "own", frozen(), signed=False)
    whole = library.integrals.sum()
    assert whole > 0  # a positive coefficient loosens
    assert library.scales[0] < 0


def test_of_our_own_families_only_those_named_are_searched() -> None:
    found = proposed(["velocity", "proportional to the tension"], ["FROLS"])
    assert {term.motion.text for law in found.candidates for term in law.terms} == {"abs(v) ** n"}
    assert {term.tension.text for law in found.candidates for term in law.terms} == {"max(T, 0)"}
    sources = {text for law in found.candidates for text in law.source.split("; ")}
    assert {text.rpartition("/")[2] for text in sources} <= {"single term", "FROLS"}
    scales = Scales.of(frozen())
    assert len(tension_factors(scales, names=["velocity"])) == len(tension_factors(scales))


def test_ours_and_one_s_own_are_ranked_together() -> None:
    found = proposed(["velocity", "proportional to the tension", rivals(), cube()], ["FROLS"], terms=1)
    sources = {law.name: law.source for law in found.candidates}
    assert "pysindy:CustomLibrary/single term" in sources["|v|^3 T"]  # a law of two libraries is there once
    assert "pysindy:ConcatLibrary/FROLS" in sources["|v|^3 T"]
    assert any("pysindy:grid/single term" in source for source in sources.values())
    laws = race(found.candidates[:3], frozen())
    named = next(law for law in laws if law.source.startswith("pysindy:"))
    assert named.name in {law.name for law in found.candidates} | {"|v|^3.00 T"}


@pytest.mark.parametrize(
    ("library", "said"),
    [
        (pysindy.CustomLibrary([abs_of]), "found the column 'f0(v)', expected"),
        (column(lambda m: np.sin(m.v), "sin(v)"), "may call exp, log, sqrt"),
        (column(lambda m: np.abs(m.v), "abs(w)"), "may use v, x, T, F, D, got 'w'"),
        (column(lambda m: np.abs(m.v), "abs(v"), "must be arithmetic"),
        (pysindy.ConcatLibrary([cube(), cube()]), "twice"),
    ],
)
def test_a_name_that_cannot_be_read_is_refused_before_a_campaign_is_identified(
    library: Any, said: str
) -> None:
    with pytest.raises(ValueError, match="library") as refused:
        discovery.discover(UNREAD, libraries=[library])
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("library", "said"),
    [
        (column(lambda m: np.abs(m.v) ** 2 * m.T, "|v|^3 T"), "as it is named: correct the name"),
        (column(lambda m: np.asarray(m.v) ** 1.5, "v^1.5"), "not numbers in the column 'v^1.5'"),
        (column(lambda m: m.T, "T"), "found no column that is zero while nothing moves"),
    ],
)
def test_a_name_that_does_not_give_the_values_is_one_clear_line(library: Any, said: str) -> None:
    with pytest.raises(ValueError, match="library own") as refused:
        read_library(library, "own", frozen(), signed=False)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("libraries", "optimizers", "said"),
    [
        (["velocitty"], None, "library: found 'velocitty', expected one of: polynomials; velocity;"),
        ([3.0], None, "library: found 3.0, expected a name or an object with fit, transform"),
        (None, ["lasso"], "optimizer: found 'lasso', expected one of: FROLS;"),
        (None, [pysindy.STLSQ], "optimizer: found the class STLSQ, expected a name or an object with fit"),
        ([], None, "expected a list of one or more"),
        (None, "STLSQ", "expected a list of one or more"),
    ],
)
def test_what_is_neither_a_name_nor_an_object_is_refused(libraries: Any, optimizers: Any, said: str) -> None:
    with pytest.raises(ValueError, match="expected") as refused:
        select(libraries, optimizers)
    assert said in str(refused.value)


def test_two_objects_of_one_class_have_names_of_their_own() -> None:
    chosen = select([cube(), cube()], ["STLSQ", pysindy.STLSQ(), pysindy.STLSQ(0.2)])
    assert list(chosen.own) == ["CustomLibrary", "CustomLibrary 2"]
    assert chosen.families == ()
    assert list(chosen.optimizers or ()) == ["STLSQ", "STLSQ 2", "STLSQ 3"]


def test_terms_are_one_or_more() -> None:
    with pytest.raises(ValueError, match="max_terms: found 0, expected 1 or more"):
        discovery.discover(UNREAD, max_terms=0)
