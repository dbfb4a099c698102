"""A joint that tests loosen so far that any large rate would do for its losses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rom
from discovery import close_loop
from discovery.criteria.criteria import CRITERIA
from discovery.loop.impact_refits import ImpactRefits
from discovery.options import Options, no_progress
from discovery.residual.base import level
from experiments.rig.plant import Plant
from experiments.studies import rig

PLANT = Plant(
    mass_lo=4.2, mass_so=1.7, damping_lo=5.1, damping_so=3.3, stiffness_lo=2.1e4, stiffness_so=6.2e4,
    stiffening_lo=1.05, stiffening_so=1.1, k_i=1.6e6, alpha=-0.031, beta=8.0, c_d=1300.0, c_i=1150.0,
    eta=-0.0061,
)  # fmt: skip


@pytest.mark.parametrize(
    ("noise", "seed", "not_followed"),
    [
        pytest.param(1.0, 103, ["003", "004"], marks=pytest.mark.variant),  # of the next one
        (1.0, 105, ["003", "004"]),  # 249 N fall to 3 within the hit, and losses alone let gamma(T) run away
        (0.3, 202, ["003"]),  # 250 N fall to 182, along gamma(T)
    ],
)
def test_the_loop_starts_at_the_noise_where_nothing_is_missing(
    tmp_path: Path, noise: float, seed: int, not_followed: list[str]
) -> None:
    rig.run(tmp_path / "c", cases=6, noise=noise, seed=seed, duration_s=2.5, plant=PLANT)
    refits = ImpactRefits.of(rom.read_campaign(tmp_path / "c"), Options(1, no_progress, 0, CRITERIA))
    state = refits.start()
    assert level(state.residual) < CRITERIA.acceptance.noise_level
    law = state.model.link_laws["joint"].stiffness
    assert law.parameters["beta"].value == pytest.approx(PLANT.beta, rel=0.02)
    aside = [f"records/loosening_{number}.h5" for number in not_followed]
    told = [line for line in refits.warnings if "no model can follow" in line]
    assert [line.partition(": ")[0] for line in told] == [", ".join(aside)]
    assert not {trace.settings.file for trace in state.residual.traces} & set(aside)
    tension = refits.identification.model.link_laws["joint"].tension_rate
    assert tension is not None
    assert np.log10(-tension.rate(6.0, 0.0, 1.0) / 6.0) < 9  # of gamma, 8 in truth


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing(tmp_path: Path) -> None:
    rig.run(tmp_path / "c", cases=6, noise=1.0, seed=106, duration_s=2.5, plant=PLANT)
    assert close_loop(rom.read_campaign(tmp_path / "c")).verdict == "no-effect"
