import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rom.model.laws import (
    Parameter,
    constant_damping,
    constant_stiffness,
    free_form_law,
    logistic_damping,
    logistic_loosening,
    logistic_stiffness,
    no_loosening,
    power_loosening,
)
from rom.model.power_of_tension import power_damping, power_stiffness

LINK_LAWS = [
    constant_stiffness(8963.6),
    constant_damping(8.2),
    logistic_stiffness(9.763e5, -0.0608, 2.003),
    logistic_damping(1853.0, 1717.4, -0.00922),
    power_stiffness(9.763e5, 0.5, 950.0),
    power_damping(140.0, -0.3, 950.0),
]
TENSION_LAWS = [
    no_loosening(),
    power_loosening(1e8),
    power_loosening(-1e6, 2.5),
    logistic_loosening(11.79, 7.974, -0.00362),
    logistic_loosening(11.79, 7.974, -0.00362, 3.0),
]
TENSIONS = np.array([-5.0, 0.0, 1e-9, 6.4, 152.7, 3000.0])


@pytest.mark.parametrize("law", LINK_LAWS, ids=lambda law: law.name)
def test_equation_and_function_of_a_link_law_agree(law):
    twin = free_form_law("twin", law.equation, law.enters, law.parameters)
    assert law(TENSIONS) == pytest.approx(twin(TENSIONS), rel=1e-13)


@pytest.mark.parametrize("law", TENSION_LAWS, ids=lambda law: law.name)
def test_equation_and_function_of_a_tension_law_agree(law):
    twin = free_form_law("twin", law.equation, law.enters, law.parameters)
    rng = np.random.default_rng(1)
    motion = rng.normal(size=(2, 6)) * [[1e-4], [0.1]]
    assert law.rate(TENSIONS, *motion) == pytest.approx(twin.rate(TENSIONS, *motion), rel=1e-12)


def test_printed_laws_have_their_printed_plateaus():
    stiffness, damping = LINK_LAWS[2], LINK_LAWS[3]
    assert stiffness(3000.0) == pytest.approx(9.763e5)
    assert stiffness(2.003) == pytest.approx(9.763e5 / 2)
    assert damping(0.0) == pytest.approx(1853.0 - 1717.4 / 2)
    assert damping(3000.0) == pytest.approx(1853.0 - 1717.4)
    assert TENSION_LAWS[3].rate(3000.0, 0.0, 0.1) == pytest.approx(
        -(10 ** (11.79 - 7.974)) * 0.1**4 * 3000.0, rel=1e-3
    )


@settings(max_examples=50, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(-10, 10))
def test_laws_are_finite_and_a_loose_bolt_stays_loose(tension, velocity):
    assert all(np.isfinite(law(tension)) for law in LINK_LAWS)
    rates = [law.rate(tension, 0.0, velocity) for law in TENSION_LAWS]
    assert np.isfinite(rates).all()
    if tension <= 0:
        assert not np.any(rates)


def test_new_values_need_no_new_compilation_and_leave_the_old_law_alone():
    law = power_loosening(1e8)
    other = law.with_values(gamma=-2e8)
    assert (law.values[0], other.values[0]) == (1e8, -2e8)
    assert other.address == law.address


def test_a_law_survives_pickling():
    for law in (
        *LINK_LAWS,
        *TENSION_LAWS,
        free_form_law("mine", "-g * v * v * T", "tension rate", {"g": Parameter(2.0, "1/m")}),
    ):
        assert pickle.loads(pickle.dumps(law)) == law


@pytest.mark.parametrize(
    ("equation", "message"),
    [
        ("__import__('os')", "may call exp"),
        ("T.real", "must be arithmetic"),
        ("g * y", "may use T, x, v, F, D, g, got 'y'"),
        ("exp(T, T)", "may call exp"),
        ("T if T else 0", "must be arithmetic"),
        ("T +", "must be arithmetic"),
        ("'a' * 3", "must be arithmetic"),
        ("[v for v in x]", "must be arithmetic"),
    ],
)
def test_only_arithmetic_becomes_a_law(equation, message):
    with pytest.raises(ValueError, match=message):
        free_form_law("bad", equation, "tension rate", {"g": Parameter(1.0, "1")})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: power_loosening(float("nan")), "must lie within"),
        (lambda: power_loosening(1.0, -2.0), "must lie within"),
        (lambda: power_loosening(1.0).with_values(rho=1.0), "has the parameters gamma, exponent, got rho"),
        (lambda: power_loosening(1.0)(3.0), "needs the motion too"),
        (lambda: constant_stiffness(1.0).rate(3.0, 0.0, 0.0), "enters as stiffness"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(("value", "limits"), [(0.0, (None, 2.0)), (10.0, (-1.0, None)), (5.0, (-1.0, 2.0))])
def test_a_number_that_ended_at_a_bound_has_no_limit_on_that_side(
    value: float, limits: tuple[float | None, float | None]
) -> None:
    number = Parameter(value, "N", low=-1.0, high=2.0, bounds=(0.0, 10.0))
    assert number.limits == limits
    assert number.at_bound == (None in limits)
    assert not Parameter(value, "N", bounds=(0.0, 10.0)).at_bound  # held, not fitted
