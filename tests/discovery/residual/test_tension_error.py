"""The error of a record's tension: what it changes of the motion is nothing that is missing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.tension_error import beside_tension_error
from rom.identification.spectral_model import Linearised
from tests.discovery import synthetic_lines as lines

TENSION, ERROR = 20.0, 0.1


def trace(test: str = "loosening", error: float = ERROR) -> Any:
    tension = SimpleNamespace(initial_error=2 * error, final_error=error)
    return SimpleNamespace(level=TENSION, measurement=SimpleNamespace(test=test, tension=tension))


@pytest.fixture(scope="module")
def linear() -> Linearised:
    """Noise, and slopes by the stiffness and damping of a record's joint."""
    rng = np.random.default_rng(5)
    found = lines.record(lines.silence).linear
    rows = len(found.ends)
    names = ("flexure_lo.stiffness", "joint.stiffness@a", "joint.damping@a")
    slopes = 2e4 * rng.normal(size=(rows, 3))
    return replace(found, residual=rng.normal(size=rows), jacobian=slopes, columns=names)


def test_an_error_of_the_tension_leaves_noise(linear: Linearised) -> None:
    model = rom.paper_model()
    laws, near = model.link_laws["joint"], TENSION + 3 * ERROR
    off = np.zeros(len(linear.residual))
    for column, law in ((1, laws.stiffness), (2, laws.damping)):
        off += linear.jacobian[:, column] * (float(law(near)) / float(law(TENSION)) - 1)
    wrong = replace(linear, residual=linear.residual + off)
    beside = beside_tension_error(wrong, trace(), FreeParameters(model, {}))
    assert np.mean(wrong.residual**2) > 3
    assert np.mean(beside.residual**2) == pytest.approx(1.0, abs=0.15)


def test_rows_are_as_many_whatever_the_error_and_none_more_without_a_joint(linear: Linearised) -> None:
    baseline = FreeParameters(rom.paper_model(), {})
    rows = [len(beside_tension_error(linear, trace(error=e), baseline).residual) for e in (0.0, 0.1, 50.0)]
    assert rows == [len(linear.residual) + 1] * 3
    bare = replace(linear, columns=("flexure_lo.stiffness", "flexure_so.stiffness", "flexure_lo.damping"))
    assert beside_tension_error(bare, trace(), baseline) is bare
    silent: Any = SimpleNamespace(level=TENSION, measurement=SimpleNamespace(test="coupled", tension=None))
    assert beside_tension_error(linear, silent, baseline) is linear
