"""Forces that act all the time, found on campaigns of the virtual rig from what precedes the hits."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import rom
from discovery.decide.acceptance import is_accepted
from discovery.explain.ground_motion import explain
from discovery.explain.motion_fit import refit
from discovery.loop.close_loop import close_loop
from discovery.options import Options
from discovery.residual.effect_forces import lasting_force
from discovery.residual.output_error import WhitenedResidual, starting, whitened_residual_of
from discovery.residual.trajectory import read_measurements
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.effects import CATALOGUE
from rom.identification.identify import identify_campaign
from tests.shared import once_per_run

SHAKEN = Undeclared("ground-motion", "body:lo", {"F_a": 0.02, "F_b": 0.0, "f": 11.3})


@once_per_run
def evidence(*undeclared: Undeclared) -> WhitenedResidual:
    with TemporaryDirectory() as scratch:
        rig.run(Path(scratch) / "c", 4, 1.0, 4, 1, duration_s=2.5, hold_out_every=4, undeclared=undeclared)
        campaign = rom.read_campaign(Path(scratch) / "c")
        found = identify_campaign(campaign)
        return refit(
            whitened_residual_of(campaign, starting(found, found.model), read_measurements(campaign))
        )


def test_a_ground_that_moves_is_found_with_its_frequency() -> None:
    sure = [one for one in explain(evidence(SHAKEN), Options()) if is_accepted(one)]
    best = max(sure, key=lambda one: float(one.gains(hold_out=False).sum()))
    assert best.effect.path == "body:lo.ground-motion"
    assert best.effect.parameters["f"].value == pytest.approx(11.3, abs=0.02)
    assert best.gains(hold_out=True).sum() > 0


@pytest.mark.variant
def test_a_ground_that_moves_is_found_behind_what_the_hits_show(tmp_path: Path) -> None:
    cubic = Undeclared("cubic-stiffness", "flexure_lo", {"k3": 1e10})
    rig.run(tmp_path / "c", 5, 1.0, 4, 1, duration_s=2.5, hold_out_every=4, undeclared=(cubic, SHAKEN))
    closure = close_loop(rom.read_campaign(tmp_path / "c"))
    assert [one.effect.path for one in closure.effects] == [
        "flexure_lo.cubic-stiffness",
        "body:lo.ground-motion",
    ]
    without, both = (step.errors["hold_out"]["motion_nrmse"] for step in closure.steps[1:])
    assert without is not None
    assert both is not None
    assert both < 0.75 * without


def test_what_is_told_does_not_depend_on_the_number_of_jobs() -> None:
    alone, together = (explain(evidence(SHAKEN), Options(jobs)) for jobs in (1, 2))
    assert [(one.effect, one.after) for one in alone] == [(one.effect, one.after) for one in together]
    assert alone


def test_noise_alone_has_none() -> None:
    assert not [one for one in explain(evidence(), Options()) if is_accepted(one)]


def test_a_record_s_own_numbers_drive_its_bodies() -> None:
    shaken = CATALOGUE["ground-motion"].at("body:lo").with_values(F_a=0.0, F_b=0.0, f=10.0)
    found = evidence()
    file = next(t.settings.file for t in found.traces if set(t.bodies) == {"lo", "so"})
    own = found.with_own(shaken.path, {file: {"F_a": 0.5, "F_b": 0.0}})
    for trace in own.traces:
        force = lasting_force(trace, [shaken], 100)
        assert force.any() == (trace.settings.file == file)
    (mine,) = [t for t in own.traces if t.settings.file == file]
    time = np.arange(100) / mine.measurement.rate_hz
    of_lo = lasting_force(mine, [shaken], 100)[:, mine.bodies.index("lo")]
    np.testing.assert_allclose(of_lo, 0.5 * np.cos(2 * np.pi * 10.0 * time), atol=1e-12)
