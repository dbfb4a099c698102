from __future__ import annotations

import pickle
from itertools import permutations

import numpy as np
import pytest

from discovery.laws.candidate import (
    BASELINE,
    Candidate,
    Term,
    baseline,
    constant_power,
    no_loosening,
    rivals_always_in_the_race,
)
from discovery.laws.factors import (
    displacement_power,
    tension_exponential,
    tension_logistic,
    tension_power,
    velocity_power,
    velocity_threshold,
)
from rom.model.laws import logistic_loosening

THREE = (
    Term(velocity_power(3.0), tension_logistic()),
    Term(displacement_power(2.0), tension_power()),
    Term(velocity_threshold(0.01, 0.1), tension_exponential(), sign=0),
)
SUM = Candidate("sum", THREE, (2e9, 4e10, -3e6))
X, V, T = np.array([1e-4, 2e-4]), np.array([0.03, -0.05]), np.array([40.0, 800.0])


def test_the_law_is_the_sum_of_its_terms() -> None:
    expected = np.zeros(2)
    for term, coefficient in zip(SUM.terms, SUM.coefficients, strict=True):
        sign = term.sign or 1
        expected += sign * coefficient * term.motion.of_motion(X, V, V, V) * term.tension.of_tension(T)
    np.testing.assert_allclose(SUM.law().rate(T, X, V), expected, rtol=1e-12)


def test_the_baseline_is_the_papers_law() -> None:
    paper = logistic_loosening(11.79, 7.974, -0.00362).rate(T, X, V)
    ours = baseline().with_values({"gamma": 10**11.79, "gamma_i": 7.974, "rho": -0.00362})
    assert ours.name == BASELINE
    assert ours.free == ("gamma", "gamma_i", "rho")
    np.testing.assert_allclose(ours.law().rate(T, X, V), paper, rtol=1e-12)


def test_no_loosening_has_a_law_of_zero() -> None:
    nothing = no_loosening()
    assert nothing.equation == "0"
    assert nothing.free == ()
    np.testing.assert_array_equal(nothing.law().rate(T, X, V), 0.0)


def test_parameters_are_numbered_only_where_there_are_several_terms() -> None:
    assert set(baseline().parameters) == {"gamma", "n", "gamma_i", "rho"}
    assert set(SUM.parameters) == {
        "gamma_1", "n_1", "gamma_i_1", "rho_1", "gamma_2", "q_2", "gamma_3", "v_th_3", "n_3", "T_s_3",
    }  # fmt: skip


def test_values_go_to_the_term_that_is_named() -> None:
    moved = SUM.with_values({"n_1": 2.5, "gamma_3": 7.0, "T_s_3": 44.0})
    values = {name: parameter.value for name, parameter in moved.parameters.items()}
    assert (values["n_1"], values["n_3"], values["gamma_3"], values["T_s_3"]) == (2.5, 4.0, 7.0, 44.0)
    assert SUM.parameters["n_1"].value == 3.0


def test_the_canonical_form_knows_neither_order_nor_free_numbers() -> None:
    keys = {
        Candidate("other", order, (1.0, 2.0, 3.0)).with_values({"gamma_1": 9.0}).key
        for order in permutations(THREE)
    }
    assert keys == {SUM.key}


def test_a_held_number_is_part_of_the_form() -> None:
    assert constant_power(2.0, "a").key != constant_power(4.0, "a").key
    assert constant_power(4.0, "a").key == constant_power(4.0, "b").key


def test_units_of_coefficients_make_every_term_a_rate() -> None:
    parameters = SUM.parameters
    assert baseline().parameters["gamma"].unit == "s^3 m^-4"
    assert parameters["gamma_1"].unit == "s^2 m^-3"
    assert parameters["gamma_2"].unit == "s^-1 m^-2"
    assert parameters["n_1"].unit == "1"


def test_the_race_always_holds_four_laws_of_four_forms() -> None:
    rivals = rivals_always_in_the_race()
    assert [rival.name for rival in rivals] == [
        "gamma(T) baseline", "constant gamma, quadratic", "constant gamma, quartic", "no loosening",
    ]  # fmt: skip
    assert len({rival.key for rival in rivals}) == 4


def test_candidates_travel_between_processes() -> None:
    again = pickle.loads(pickle.dumps(SUM))
    assert again == SUM
    np.testing.assert_array_equal(again.law().rate(T, X, V), SUM.law().rate(T, X, V))


def test_every_term_needs_its_coefficient() -> None:
    with pytest.raises(ValueError, match="need 3 coefficients, got 1"):
        Candidate("sum", THREE, (1.0,))
