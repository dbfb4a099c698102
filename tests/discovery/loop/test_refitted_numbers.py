"""Limits of refitted numbers hold the truth where records err as one, and are not told where nothing is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.loop.refitted_numbers import refitted_numbers, with_limits
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.output_error import WhitenedResidual
from rom.model.laws import constant_stiffness
from rom.model.model import Model

RECORDS, ROWS = 12, 200
NAMES = (
    "body.lo.mass", "flexure_lo.stiffness", "flexure_lo.stiffness.uncoupled", "flexure_lo.damping",
    "joint.stiffness:beta", "sensor.corner", "effect|joint|coulomb-friction|mu",
)  # fmt: skip
ALONE = 8148.7


def model(beta: float | None = None) -> Model:
    paper = rom.paper_model()
    if beta is not None:
        joint = paper.link_laws["joint"]
        number = replace(joint.stiffness.parameters["beta"], value=beta, bounds=(beta, 100.0))
        stiffness = replace(joint.stiffness, parameters={**joint.stiffness.parameters, "beta": number})
        paper = replace(paper, link_laws={**paper.link_laws, "joint": replace(joint, stiffness=stiffness)})
    lo = replace(paper.link_laws["flexure_lo"], stiffness=constant_stiffness(ALONE))
    return replace(paper, uncoupled_laws={"flexure_lo": lo})


def fitted(seed: int, between: float, *, of: Model | None = None) -> tuple[WhitenedResidual, np.ndarray]:
    """What is left of rows whose errors are noise and, beyond it, one number of each record; and by how much
    the fitted numbers are off, in their units.
    """
    rng = np.random.default_rng(seed)
    owner = np.repeat(np.arange(RECORDS), ROWS)
    slopes = rng.normal(size=(len(owner), len(NAMES))) + 0.5
    error = rng.normal(size=len(owner)) + between * rng.normal(size=RECORDS)[owner] * slopes.mean(axis=1)
    off = np.linalg.lstsq(slopes, error, rcond=None)[0]
    trace: Any = SimpleNamespace(settings=SimpleNamespace(hold_out=False, file="a"))
    left = WhitenedResidual(
        traces=(trace,) * RECORDS, baseline=FreeParameters(of or model(), {}), floors={}, parts=(),
        residual=error - slopes @ off, jacobian=slopes, names=NAMES, owner=owner,
    )  # fmt: skip
    return left, off


@pytest.mark.parametrize("between", [0.0, 1.0])
def test_limits_hold_the_truth(between: float) -> None:
    held = []
    for seed in range(300):
        left, off = fitted(seed, between)
        found = refitted_numbers(left)
        for path, place in (("body.lo.mass", 0), ("flexure_lo.stiffness.k", 1), ("joint.stiffness.beta", 4)):
            p = found[path]
            assert p.low is not None
            assert p.high is not None
            held.append(p.low <= p.value * (1 - off[place]) <= p.high)
    assert 0.91 < np.mean(held) < 0.98


def test_every_number_of_links_and_bodies_has_limits_where_it_stands() -> None:
    left, _ = fitted(0, 0.0)
    found = refitted_numbers(left)
    assert set(found) == {
        "body.lo.mass", "flexure_lo.stiffness.k", "flexure_lo.stiffness.uncoupled.k",
        "flexure_lo.damping.c", "joint.stiffness.beta",
    }  # fmt: skip
    limited = with_limits(left.baseline.model, found)
    alone, link = limited.uncoupled_laws["flexure_lo"], limited.link_laws["flexure_lo"]
    assert alone.stiffness.parameters["k"] == found["flexure_lo.stiffness.uncoupled.k"]
    assert link.stiffness.parameters["k"] == found["flexure_lo.stiffness.k"]
    assert alone.damping.parameters["c"] == link.damping.parameters["c"] == found["flexure_lo.damping.c"]
    assert limited.link_laws["joint"].stiffness.parameters["beta"].low is not None
    assert limited.link_laws["joint"].stiffness.parameters["k_i"].low is None  # was not fitted


def test_what_no_record_tells_has_no_limits_and_a_number_at_its_bound_one() -> None:
    left, _ = fitted(0, 0.0, of=model(beta=2.0))
    blind = left.jacobian.copy()
    blind[:, 1] = blind[:, 3]  # stiffness and damping do the same
    blind[:, 0] = 0.0  # a mass changes nothing
    found = refitted_numbers(replace(left, jacobian=blind))
    assert found["body.lo.mass"].limits == (None, None)
    assert found["flexure_lo.stiffness.k"].limits == found["flexure_lo.damping.c"].limits == (None, None)
    low, high = found["joint.stiffness.beta"].limits
    assert found["joint.stiffness.beta"].at_bound
    assert low is None
    assert high is not None
    assert high > 2.0
