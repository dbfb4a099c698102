"""Limits of records without noise rest on what samples and filters leave, and hold the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

import rom
from experiments.rig.plant import LooseningTerm, Plant
from experiments.studies import rig

OTHER = Plant(
    mass_lo=4.2, mass_so=1.7, stiffness_lo=21e3, stiffness_so=62e3, damping_lo=6.0, damping_so=3.5,
    k_i=6e5, alpha=-0.03, beta=10.0, c_d=900.0, c_i=820.0, eta=-0.006,
    loosening=(LooseningTerm(gamma_d=10.6, gamma_i=7.0, rho=-0.0045),),
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "seed"), [(Plant(), 1), (Plant(), 4), (OTHER, 0)])
def test_limits_hold_the_truth(plant: Plant, seed: int, tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    rig.run(folder, 10, noise=0.0, seed=seed, duration_s=2.5, scatter=0.0, hold_out_every=0, plant=plant)
    found = rom.identify(rom.read_campaign(folder), jobs=1).parameters
    (loosening,) = plant.loosening
    truth = {name: getattr(plant, name) for name in ("k_i", "alpha", "beta", "c_d", "c_i", "eta")}
    truth |= {name: getattr(loosening, name) for name in ("gamma_d", "gamma_i", "rho")}
    links = {
        "flexure_lo.stiffness.k": plant.stiffness_lo * plant.stiffening_lo,
        "flexure_so.stiffness.k": plant.stiffness_so * plant.stiffening_so,
        "flexure_lo.damping.c": plant.damping_lo,
        "flexure_so.damping.c": plant.damping_so,
    }
    numbers = {path.rpartition(".")[2]: number for path, number in found.items()}
    for name, value in (truth | links).items():
        number = found[name] if name in found else numbers[name]
        assert number.low is not None
        assert number.high is not None
        assert number.low <= value <= number.high
        assert number.high - number.low < 1.5e-2 * abs(value)
