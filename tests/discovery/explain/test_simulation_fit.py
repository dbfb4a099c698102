"""Fits of simulated records: where they end, and standard errors there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rom
from benchmarks import drawn_beams
from discovery.explain.simulation_fit import _errors_of, together
from discovery.loop.free_refits import FreeRefits
from discovery.options import Options
from discovery.residual.simulation import Fit

SLIDER = 313  # seed: a Jenkins slider in the fifth of six modes


@pytest.mark.slow
def test_a_slider_is_fitted_from_beside_its_numbers_and_its_limits_hold_them(tmp_path: Path) -> None:
    """By steps of 3e-4 of the motion a fit ended 0.6 % off, where it began, with limits of 0.03 %."""
    _, hidden, _ = drawn_beams.drawn(SLIDER, tmp_path / "campaign")
    assert hidden is not None
    refits = FreeRefits.of_modes(rom.read_campaign(tmp_path / "campaign"), Options(jobs=1))
    linear = refits.own(refits.start().residual)
    near = hidden.with_values(**{n: 0.994 * hidden.parameters[n].value for n in ("kappa", "F_s")})
    begun = linear.of_model(linear.model.with_effect(near))
    (found,) = together(replace(begun, thorough=True)).model.effects
    for name in ("kappa", "F_s"):
        number, true = found.parameters[name], hidden.parameters[name].value
        assert number.low is not None
        assert number.high is not None
        assert number.low < true < number.high
        assert number.high - number.low < 0.01 * true


def test_errors_of_a_number_next_to_zero_do_not_overflow() -> None:
    """Its slopes, in its own unit, are so large that their squares are not finite."""
    rng = np.random.default_rng(0)
    slopes, rows = rng.normal(size=(200, 2)), rng.normal(size=200)
    residual = SimpleNamespace(pieces=np.arange(200) // 20)
    usual, far = (
        _errors_of(Fit(residual, ["a", "b"], slopes * [1.0, unit], rows), np.arange(2))  # type: ignore[arg-type]
        for unit in (1.0, 1e200)
    )
    assert far * [1.0, 1e200] == pytest.approx(usual)
