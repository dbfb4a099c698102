"""Curves over tension: known laws come back, limits hold them as often as they say, scatter is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from rom.identification.curve_fits import LawFit, excess_scatter, fit_law, gamma_curve, link_curve
from rom.model.laws import Law, constant_stiffness, logistic_damping, logistic_loosening, logistic_stiffness
from rom.parameters import he_2025

TENSION = np.geomspace(6.0, 3000.0, 20)
FILES = [f"coupled_{i}" for i in range(len(TENSION))]
STIFFNESS = logistic_stiffness(he_2025.K_I.value, he_2025.ALPHA.value, he_2025.BETA.value)
DAMPING = logistic_damping(he_2025.C_D.value, he_2025.C_I.value, he_2025.ETA.value)
LOOSENING = logistic_loosening(he_2025.GAMMA_D.value, he_2025.GAMMA_I.value, he_2025.RHO.value)
LAWS = {
    "Eq. 5": (STIFFNESS, ("k_i", "alpha", "beta"), link_curve),
    "Eq. 11": (DAMPING, ("c_d", "c_i", "eta"), link_curve),
    "Eq. 13": (LOOSENING, ("gamma_d", "gamma_i", "rho"), gamma_curve),
}
EACH_LAW = pytest.mark.parametrize("name", LAWS)


def starts(name: str) -> list[Law]:
    """Guesses well off the truth, over scales of tension, as an identification makes them."""
    scales = np.geomspace(10.0, 1000.0, 5)
    if name == "Eq. 5":
        return [logistic_stiffness(7e5, -1 / s, b * s) for s in scales for b in (0.0, 0.5)]
    if name == "Eq. 11":
        return [logistic_damping(1400.0, 1100.0, -1 / s) for s in scales]
    return [logistic_loosening(10.5, 6.0, -1 / s) for s in scales]


def refit(name: str, values: np.ndarray, deviation: float) -> LawFit:
    """Fit a law to values whose logarithms have independent errors of one deviation."""
    _, free, curve = LAWS[name]
    return fit_law(starts(name), free, TENSION, values, deviation**2 * np.eye(len(TENSION)), FILES, curve)


def truth(name: str) -> np.ndarray:
    """The law at every tension."""
    law, _, curve = LAWS[name]
    return curve(law, TENSION)


@EACH_LAW
def test_exact_values_give_back_the_law(name: str) -> None:
    law, free, _ = LAWS[name]
    fit = refit(name, truth(name), 1e-4)
    for parameter in free:
        assert fit.law.parameters[parameter].value == pytest.approx(law.parameters[parameter].value, rel=1e-5)
    assert fit.scatter == 0.0
    assert fit.r_squared == pytest.approx(1.0, abs=1e-9)
    assert fit.free == free
    assert fit.records == tuple(FILES)


@EACH_LAW
def test_limits_hold_the_truth_as_often_as_they_say(name: str) -> None:
    law, free, curve = LAWS[name]
    random = np.random.default_rng(5)
    width = stats.t.ppf(0.975, len(TENSION) - len(free))
    held: list[bool] = []
    for _ in range(30):
        fit = refit(name, truth(name) * np.exp(0.03 * random.standard_normal(len(TENSION))), 0.03)
        for parameter in free:
            limits = fit.law.parameters[parameter]
            assert limits.low is not None
            assert limits.high is not None
            held.append(limits.low <= law.parameters[parameter].value <= limits.high)
        miss = np.abs(np.log(curve(fit.law, TENSION) / truth(name)))
        held.extend(miss <= width * fit.log_error(TENSION))
    assert 0.90 <= np.mean(held) <= 0.995


def test_errors_scale_the_limits() -> None:
    """Ten times the noise, ten times the limits; an error that all records share is never averaged away."""
    values = truth("Eq. 5")
    narrow, wide = refit("Eq. 5", values, 0.01), refit("Eq. 5", values, 0.1)
    np.testing.assert_allclose(wide.log_error(TENSION), 10 * narrow.log_error(TENSION), rtol=1e-3)
    shared = fit_law(
        starts("Eq. 5"),
        LAWS["Eq. 5"][1],
        TENSION,
        values,
        0.01**2 + 1e-8 * np.eye(20),
        FILES,
    )
    assert shared.log_error(np.array([3000.0]))[0] == pytest.approx(0.01, rel=0.02)


def test_scatter_beyond_the_errors_is_estimated() -> None:
    random = np.random.default_rng(3)
    found = [
        refit("Eq. 13", truth("Eq. 13") * np.exp(0.3 * random.standard_normal(20)), 0.05).scatter
        for _ in range(20)
    ]
    assert np.median(found) == pytest.approx(np.sqrt(0.3**2 - 0.05**2), rel=0.15)
    assert min(found) > 0.1


def test_scatter_is_none_where_the_errors_suffice() -> None:
    residual = 0.1 * np.random.default_rng(0).standard_normal(300)
    assert excess_scatter(residual, 0.02 * np.eye(300), 3) == 0.0
    assert excess_scatter(residual, 0.0036 * np.eye(300), 3) == pytest.approx(0.08, rel=0.12)
    assert excess_scatter(residual[:3], 1e-6 * np.eye(3), 3) == 0.0


def test_weights_follow_the_errors() -> None:
    """A value ten times off with an error of a factor hardly moves the fit."""
    values = truth("Eq. 11").copy()
    values[4] *= 10
    deviation = np.full(20, 0.01)
    deviation[4] = 3.0
    fit = fit_law(starts("Eq. 11"), LAWS["Eq. 11"][1], TENSION, values, np.diag(deviation**2), FILES)
    np.testing.assert_allclose(fit.law(TENSION), truth("Eq. 11"), rtol=2e-3)


def test_parameters_stay_within_their_bounds() -> None:
    fit = fit_law([constant_stiffness(10.0)], ["k"], TENSION[:3], np.full(3, 1e-3), np.eye(3), FILES[:3])
    assert fit.law.parameters["k"].value == pytest.approx(1e-3, rel=1e-4)
    bounded = refit("Eq. 5", truth("Eq. 5"), 0.01).law.parameters["k_i"]
    assert bounded.bounds[0] == 0.0


def test_what_no_value_tells_has_no_narrow_limits() -> None:
    """Above 150 N stiffness sits on its plateau: nothing tells where it rises."""
    stiff = TENSION[TENSION > 150]
    files = FILES[: len(stiff)]
    free = ("k_i", "alpha", "beta")
    fit = fit_law(starts("Eq. 5"), free, stiff, STIFFNESS(stiff), 1e-4 * np.eye(len(stiff)), files)
    plateau, rise = fit.law.parameters["k_i"], fit.law.parameters["beta"]
    assert plateau.low is not None
    assert plateau.low == pytest.approx(0.99 * plateau.value, rel=0.01)
    assert rise.low is not None
    assert rise.high is not None
    assert rise.high - rise.low > 100.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 2.0], "3 parameters needs as many values, instead got 2"),
        ([1.0, 2.0, 0.0], "positive values, instead got 0"),
        ([1.0, -2.0, 3.0], "positive values, instead got -2"),
        ([1.0, np.nan, 3.0], "positive values, instead got nan"),
    ],
)
def test_values_that_cannot_be_are_refused(values: Sequence[float], message: str) -> None:
    n = len(values)
    with pytest.raises(ValueError, match=message):
        fit_law([STIFFNESS], ["k_i", "alpha", "beta"], TENSION[:n], np.array(values), np.eye(n), FILES[:n])
