"""One equation under two names is found out, whatever its numbers are called and however it is written."""

from __future__ import annotations

import re

import numpy as np
import pytest

from discovery.laws import same_law as module
from discovery.laws.candidate import Candidate, rivals_always_in_the_race
from discovery.laws.given import given_law
from discovery.laws.same_law import same_law, states_of
from rom.model.laws import Parameter, free_form_law

STATES = states_of(np.array([[0.0, 1.0], [1e-5, -3e-5], [0.02, 0.06], [40.0, 10.0], [3.0, 1.0], [8.0, 3e3]]))


@pytest.mark.parametrize(
    ("rate", "fixed", "same"),
    [
        ("-a * v**4 * max(T, 0)", {}, "constant gamma, quartic"),
        ("-a * abs(v / 0.05)**n * T", {"n": 4.0}, "constant gamma, quartic"),
        ("-a * abs(v)**n * T", {}, ""),
        ("-a * v**2 * T", {}, "constant gamma, quadratic"),
        ("-a * abs(D * v) * T", {}, ""),  # along one motion it may be the quadratic law
        ("-a * abs(v)**3 * v * T", {}, ""),
        ("-a * v**4 * T * exp(b * tanh(r * T))", {}, "gamma(T) baseline"),  # another form of the logistic
        ("-a * v**4 * T * exp(b * tanh(r * T)**2)", {}, ""),
        ("-a * abs(v)**5 * T * 10**(-b / (1 + exp(r * T)))", {}, ""),
        ("0 * v * T", {}, "no loosening"),
    ],
)
def test_a_law_is_the_standing_one_of_its_equation(rate: str, fixed: dict[str, float], same: str) -> None:
    start = {"a": 1.0, "b": 1.0, "r": 1e-3, "n": 3.0} | fixed
    numbers = {name: Parameter(start[name], "1") for name in re.findall(r"\b[abrn]\b", rate)}
    law = given_law(free_form_law("own", rate, "tension rate", numbers), tuple(fixed))
    assert "".join(one.name for one in rivals_always_in_the_race() if same_law(law, one, STATES)) == same


def threshold(quantity: str, *, k: float, limit: float) -> Candidate:
    numbers = {"k": Parameter(k, "1"), "limit": Parameter(limit, "1")}
    rate = f"-k * max(abs({quantity}) - limit, 0) * T"
    return given_law(free_form_law(quantity, rate, "tension rate", numbers))


def test_laws_that_move_nothing_within_the_range_are_not_one() -> None:
    """Below their thresholds any rates agree; at a few states above it numbers may agree by chance."""
    for limit in (1.0, 0.055):
        assert not same_law(threshold("x", k=1.0, limit=1.0), threshold("v", k=1.0, limit=limit), STATES)
    assert same_law(threshold("v", k=3.0, limit=0.018), threshold("v", k=1.0, limit=0.02), STATES)


def test_a_search_that_fails_finds_no_identity(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(module, "least_squares", fails)
    standing = rivals_always_in_the_race()[0]
    assert not same_law(standing, standing, STATES)
