"""Runs that would tell two forces apart which the driven records at hand cannot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from discovery.decide.acceptance import is_accepted, is_indistinguishable
from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import best_fit, explanation
from discovery.explain.force_balance_screen import screen, starts_of
from discovery.loop.balance_refits import BalanceRefits
from discovery.options import Options
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.separating_tests.driven_runs import separating_runs
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect
from tests.discovery import driven_twins as twins
from tests.shared import Shared, once_per_run

TRUE, RIVALS = "cubic-stiffness", ("quintic-stiffness", "two-sided-gap")
SMALL = 0.15  # of the usual force: a cubic spring of 2e7 N/m3 hardly shows
Fits = dict[str, tuple[Explanation, ForceBalanceResidual]]


def cubic(x: FloatArray, _v: FloatArray) -> FloatArray:
    return 2e7 * x**3


def fits_of(folder: Path, sizes: Sequence[float]) -> Fits:
    """Each effect fitted to a twin with a cubic spring beside all numbers of the model."""
    twin = twins.driven(folder, extra=cubic, sizes=sizes, seconds=8.0)
    declared = BalanceRefits.of(twin, Options()).start().residual
    assert isinstance(declared, ForceBalanceResidual)
    probes = {probed[0].effect.name: probed for probed in screen(declared, Options())}
    found: Fits = {}
    for name in (TRUE, *RIVALS):
        after, (effect,) = best_fit(starts_of(probes[name], declared))
        found[name] = explanation(effect, declared, after), after
    return found


@once_per_run
def at_hand() -> tuple[Fits, list[str]]:
    """Fits to small motions, and the runs that would tell the rivals from the true effect."""
    fits = fits_of(Shared.here.new_folder() / "small", (SMALL,) * 4)
    best, refined = fits[TRUE]
    return fits, separating_runs(best.effect, [fits[name][0].effect for name in RIVALS], refined)


def test_a_run_is_named_that_separates_two_forces_once_it_is_made(tmp_path: Path) -> None:
    fits, runs = at_hand()
    assert all(is_accepted(explained) for explained, _ in fits.values())
    assert all(is_indistinguishable(fits[name][0], fits[TRUE][0]) for name in RIVALS)
    assert runs == ["drive mass as in run_0.h5, with 2 times its motion"] * len(RIVALS)
    made = fits_of(tmp_path / "made", (2 * SMALL, SMALL, SMALL, SMALL))  # nearly linear: twice the force
    assert is_accepted(made[TRUE][0])
    for name in RIVALS:
        assert not is_indistinguishable(made[name][0], made[TRUE][0]), name


def test_no_run_separates_an_effect_from_itself_whatever_its_strength() -> None:
    fits, _ = at_hand()
    best, refined = fits[TRUE]
    weaker = best.effect.with_values(k3=0.5 * best.effect.parameters["k3"].value)
    assert separating_runs(best.effect, [best.effect, weaker], refined) == ["", ""]


def test_a_run_is_named_for_each_rival_by_itself() -> None:
    fits, runs = at_hand()
    best, refined = fits[TRUE]
    rivals = [best.effect, fits[RIVALS[0]][0].effect]
    assert separating_runs(best.effect, rivals, refined) == ["", runs[0]]


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_a_scaled_run_has_the_forces_of_its_motion(factor: float) -> None:
    balances = at_hand()[0][TRUE][1].balances
    spring = CATALOGUE[TRUE].at("guide", ground=True).with_values(k3=2e7)
    assert isinstance(spring, Effect)
    rows = balances.owner == 0
    scaled = balances.scaled(0, factor)
    assert len(scaled.records) == 1
    assert scaled.training.all()
    force, own = (of.of(spring, 0.0, 0.0) for of in (balances, scaled))
    np.testing.assert_allclose(own, factor**3 * force[rows], rtol=1e-9, atol=1e-12 * np.abs(force).max())
    offset = [name.endswith("F_0") for name in balances.names]
    expected = balances.columns[rows] * np.where(offset, 1.0, factor)
    np.testing.assert_allclose(scaled.columns, expected)
