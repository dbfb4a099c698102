"""Curves that their cases cannot contradict have no limits and say so; one curve is written in one way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.identification.curve_fits import LawFit, fit_law, gamma_curve
from rom.identification.few_cases import few_cases
from rom.identification.gamma_law import loosening_law
from rom.model.laws import Law, logistic_damping, logistic_loosening, power_loosening
from tests.rom.identification.test_curve_fits import LAWS, starts
from tests.rom.identification.test_gamma import MODEL, WINDOW_S, with_true_losses


def fitted(name: str, tension: np.ndarray) -> LawFit:
    law, free, curve = LAWS[name]
    values, files = curve(law, tension), [f"{place}.h5" for place in range(len(tension))]
    return fit_law(starts(name), free, tension, values, 1e-6 * np.eye(len(tension)), files, curve)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(("cases", "limited"), [(3, False), (4, True)])
def test_as_many_numbers_as_cases_have_no_limits(name: str, cases: int, limited: bool) -> None:
    fit = fitted(name, np.geomspace(4.0, 1500.0, cases))
    assert {fit.law.parameters[number].low is not None for number in fit.free} == {limited}
    assert all(fit.law.parameters[number].source == "identified" for number in fit.free)


LEVELS = np.array([6.0, 120.0, 2400.0])


@pytest.mark.parametrize(
    ("tension", "line"),
    [
        (np.geomspace(6.0, 3000.0, 8), None),
        (LEVELS, "3 numbers from 3 records: it meets them whatever its form; no limits"),
        (np.repeat(LEVELS, 4), "3 numbers from 3 levels of tension: no level is left to test its form"),
        (
            np.array([600.0, 800.0, 1100.0, 1500.0]),
            "from 600 to 1500 N the records tell 3 numbers (logistic loosening)",
        ),
    ],
)
def test_what_a_curve_rests_on_is_told(tension: np.ndarray, line: str | None) -> None:
    fit = replace(fitted("Eq. 13", np.geomspace(6.0, 3000.0, 8)), records=("one.h5",) * len(tension))
    lines = few_cases("gamma(T)", fit, tension)
    assert len(lines) == (line is not None)
    assert line is None or line in lines[0]


def test_near_tensions_that_tell_no_change_are_told() -> None:
    near = np.array([600.0, 800.0, 1100.0])
    one = fit_law(
        [power_loosening(1e4)], ["gamma"], near, np.ones(3), np.eye(3), ["a", "b", "c"], gamma_curve
    )
    (line,) = few_cases("gamma(T)", one, near)
    assert "from 600 to 1100 N the records tell no change: a constant stands for it" in line
    (line,) = few_cases("gamma(T)", one, np.array([0.0, 0.0, 600.0]))
    assert "one tension above zero" in line


def test_three_tests_of_a_bolt_tell_no_limits_of_its_law() -> None:
    found = loosening_law(MODEL, with_true_losses(LEVELS, loss_error=0.03), WINDOW_S)
    assert found.fit is not None
    assert found.law is not None
    assert [found.law.parameters[number].high for number in found.fit.free] == [None] * 3
    assert found.rate_uncertainty is None
    assert "3 numbers from 3 records" in found.warnings[0]


@pytest.mark.parametrize(
    ("name", "mirrored"),
    [
        ("Eq. 11", logistic_damping(1853.0 - 1717.4, -1717.4, 0.01)),
        ("Eq. 13", logistic_loosening(11.79 - 7.974, -7.974, 0.004)),
    ],
)
def test_a_mirrored_curve_is_written_the_papers_way(name: str, mirrored: Law) -> None:
    """It starts from the same curve the other way round."""
    tension = np.geomspace(6.0, 3000.0, 12)
    law, free, curve = LAWS[name]
    values, files = curve(law, tension), ["one.h5"] * len(tension)
    fit = fit_law([mirrored], free, tension, values, 1e-4 * np.eye(len(tension)), files, curve)
    for number in free:
        assert fit.law.parameters[number].value == pytest.approx(law.parameters[number].value, rel=1e-4)
    np.testing.assert_allclose(fit.log_error(tension), fitted_error(name, tension), rtol=1e-3)


def fitted_error(name: str, tension: np.ndarray) -> np.ndarray:
    """Error of the curve as fitted from the paper's side, for values with errors of 1 %."""
    law, free, curve = LAWS[name]
    covariance, files = 1e-4 * np.eye(len(tension)), ["one.h5"] * len(tension)
    return fit_law([law], free, tension, curve(law, tension), covariance, files, curve).log_error(tension)
