"""Links have no limits where a fit that leaves some of them open holds the others for well known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rom.identification.output_error import OutputErrorFit
from rom.identification.priors import PriorConstraint
from rom.identification.undetermined import of_links, without_conditional_limits
from rom.model.laws import Law
from rom.parameters import he_2025

NAMES = (
    "flexure_lo.stiffness",
    "flexure_so.stiffness",
    "flexure_so.damping",
    "joint.stiffness@a",
    "sensor.corner",
)
TIE = PriorConstraint({"flexure_lo.stiffness": 1.0}, 9.0, 0.02, ("flexure_lo.stiffness",), "flexure_lo alone")


def limited(law: Law) -> Law:
    return replace(law, parameters={n: replace(p, low=0.0, high=1e9) for n, p in law.parameters.items()})


PAPER = he_2025.paper_model()
MODEL = replace(
    PAPER,
    link_laws={
        link: replace(laws, stiffness=limited(laws.stiffness), damping=limited(laws.damping))
        for link, laws in PAPER.link_laws.items()
    },
)


def fit(
    error: tuple[float, ...], converged: bool = True, ties: tuple[PriorConstraint, ...] = ()
) -> OutputErrorFit:
    return OutputErrorFit(NAMES, np.zeros(5), np.diag(np.square(error)), 1.0, converged, (), ties)


TOLD = (0.001, 0.001, 0.1, 0.01, 50.0)


@pytest.mark.parametrize(
    ("linear", "far_off", "limits"),
    [
        (fit(TOLD), False, True),
        (fit((0.001, 0.001, 7e3, 0.01, 0.1)), False, False),
        (fit((0.001, 0.001, 0.1, 2e5, 0.1)), False, False),
        (fit(TOLD, converged=False), False, False),
        (fit(TOLD), True, False),
        (fit((0.001, 0.001, 7e3, 0.01, 0.1), ties=(TIE,)), True, True),
    ],
)
def test_what_a_fit_leaves_open_takes_the_limits_of_all(
    linear: OutputErrorFit, far_off: bool, limits: bool
) -> None:
    found, lines = without_conditional_limits(MODEL, linear, far_off)
    numbers = [
        number
        for laws in found.link_laws.values()
        for law in (laws.stiffness, laws.damping)
        for number in law.parameters.values()
    ]
    assert {number.high is not None for number in numbers} == {limits}
    assert bool(lines) is not limits


def test_a_spring_beside_the_joint_is_known_without_the_bolt() -> None:
    """Of a block on a spring and a bolt to the ground the two springs act as one with the bolt in."""
    names = ("flexure.stiffness", "flexure.stiffness.uncoupled", "joint.stiffness@a")
    found = OutputErrorFit(names, np.log([61e3, 6e4, 4e5]), np.diag([400.0, 1e-12, 10.0]), 1.0, True, (), ())
    settings: Any = SimpleNamespace(link=(), body=())
    (line,) = of_links(found, settings)
    assert line.startswith("flexure.stiffness: these records do not separate it from the links beside it")
    assert line.endswith("; without the bolt it is 60000 N/m")
