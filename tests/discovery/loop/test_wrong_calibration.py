"""A gauge with a wrong calibration: all that rests on the tension is identified anew beside it."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import rom
from discovery.loop.history import LoopHistory
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.rest_stage import gauged
from discovery.options import Options
from discovery.residual.output_error import WhitenedResidual
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.identification.identify import Identification, identify_campaign
from tests.shared import once_per_run

pytestmark = pytest.mark.slow

WRONG = Undeclared("calibration-error", "sensor:tension", {"T_0": -10.0, "c_1": 0.1, "c_2": 0.0})


def campaign(folder: Path, *undeclared: Undeclared) -> rom.Campaign:
    rig.run(folder, 12, 1.0, 2, 1, duration_s=2.5, hold_out_every=4, undeclared=undeclared)
    return rom.read_campaign(folder)


@once_per_run
def of_right_gauge() -> Identification:
    """What is identified where nothing is wrong."""
    with TemporaryDirectory() as scratch:
        return identify_campaign(campaign(Path(scratch) / "c"))


@once_per_run
def examined() -> tuple[ImpactRefits, LoopHistory]:
    """After what the declared preloads show of the gauge."""
    with TemporaryDirectory() as scratch:
        declared = ImpactRefits.of(campaign(Path(scratch) / "c", WRONG), Options())
        refits, history = gauged(declared, LoopHistory((declared.start(),)))
        assert isinstance(refits, ImpactRefits)
        return refits, history


def test_a_wrong_zero_is_named_and_the_motion_explained() -> None:
    _, path = examined()
    (found,) = path.last.model.effects
    assert found.path == "sensor:tension.calibration-error"
    assert found.parameters["T_0"].value == pytest.approx(-10.0, abs=0.1)
    assert found.parameters["c_1"].value == pytest.approx(0.1, abs=0.01)
    before, after = (state.level for state in path.states)
    assert after < min(before, 1.1)


def test_laws_are_those_of_a_gauge_that_is_right() -> None:
    refits, path = examined()
    right = of_right_gauge()
    ours, theirs = path.last.model.link_laws["joint"], right.model.link_laws["joint"]
    tensions = np.array([6.0, 30.0, 200.0, 1000.0])
    np.testing.assert_allclose(ours.stiffness(tensions), theirs.stiffness(tensions), rtol=0.02)
    assert ours.tension_rate is not None
    assert theirs.tension_rate is not None
    assert len(refits.identification.courses) == len(right.courses)  # none is taken for slack
    for course, other in zip(refits.identification.courses, right.courses, strict=True):
        assert course.initial == pytest.approx(other.initial, rel=0.02, abs=0.1)


def test_records_are_traced_along_tensions_that_fall_as_the_right_gauge_shows() -> None:
    _, path = examined()
    finals = {course.file: course.final for course in of_right_gauge().courses}
    residual = path.last.residual
    assert isinstance(residual, WhitenedResidual)
    for trace in residual.traces:
        if trace.settings.file in finals:
            assert trace.level == pytest.approx(finals[trace.settings.file], rel=0.02, abs=0.2)
