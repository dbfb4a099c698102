"""A declared tension law on cases that loosened by it: what scales it is refitted, what shapes it stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rom.identification.gamma_law import fitted_numbers, loosening_law
from rom.identification.gamma_per_case import LooseningCase, final_tensions
from rom.model.laws import Law, Parameter, free_form_law, logistic_loosening
from tests.rom.identification.test_gamma import MODEL, TRUE, WINDOW_S, case, with_true_losses

TENSIONS = np.geomspace(10.0, 1000.0, 8)


def quadratic(gamma: float = 20.0) -> Law:
    """Return a law as `discover` leaves it: limits on what was fitted, none on what was held."""
    numbers = {
        "gamma": Parameter(gamma, "s/m^2", 0.5 * gamma, 2 * gamma),
        "n": Parameter(2.0, "1", bounds=(0.25, 8.0)),
        "T_s": Parameter(300.0, "N", 200.0, 400.0, (1.0, 1e5)),
    }
    return free_form_law(
        "quadratic", "-gamma * abs(v) ** n * max(T, 0) * exp(-max(T, 0) / T_s)", "tension rate", numbers
    )


def cases_of(law: Law, loss_error: float = 1e-4) -> list[LooseningCase]:
    blank = [case(t, t, strength=s) for t, s in zip(TENSIONS, [1.0, 0.9] * 4, strict=True)]
    final = final_tensions(MODEL.with_tension_law(law), blank, WINDOW_S)
    return [replace(c, final=float(f), loss_error=loss_error) for c, f in zip(blank, final, strict=True)]


@pytest.mark.parametrize("start", [20.0, 1.0, 300.0])
def test_what_scales_a_declared_law_is_refitted_from_afar(start: float) -> None:
    found = loosening_law(MODEL, cases_of(quadratic()), WINDOW_S, declared=quadratic(start))
    assert found.law is not None
    assert found.fit is not None
    assert found.law.equation == quadratic().equation
    assert found.law.parameters["gamma"].value == pytest.approx(20.0, rel=1e-3)
    assert (found.law.parameters["n"].value, found.law.parameters["T_s"].value) == (2.0, 300.0)
    assert found.fit.free == ("gamma",)
    assert len(found.gamma) == len(TENSIONS)
    assert found.warnings == ()


def test_a_declared_law_without_a_scale_is_refitted_whole() -> None:
    assert TRUE is not None
    start = logistic_loosening(11.5, 7.5, -0.004)
    limited = {n: replace(p, low=p.value - 1, high=p.value + 1) for n, p in start.parameters.items()}
    limited["exponent"] = start.parameters["exponent"]
    found = loosening_law(
        MODEL, with_true_losses(TENSIONS, 1e-4), WINDOW_S, declared=replace(start, parameters=limited)
    )
    assert found.fit is not None
    assert found.fit.free == ("gamma_d", "gamma_i", "rho")
    for name in found.fit.free:
        assert found.fit.law.parameters[name].value == pytest.approx(TRUE.parameters[name].value, rel=1e-3)


def test_numbers_with_limits_were_fitted() -> None:
    assert fitted_numbers(quadratic()) == ("gamma", "T_s")
    assert fitted_numbers(logistic_loosening(11.0, 7.0, -0.01)) == ("gamma_d", "gamma_i", "rho", "exponent")


def test_where_no_case_loosened_a_declared_law_says_nothing() -> None:
    held = [replace(c, final=c.initial + 0.1) for c in cases_of(quadratic())]
    found = loosening_law(MODEL, held, WINDOW_S, declared=quadratic())
    assert found.law is None
    assert found.warnings == ("no case loosened: the tension law stays dT/dt = 0",)
