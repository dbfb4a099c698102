"""What effects explain of the forces that a driven twin leaves unbalanced, and what they do by chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rom
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.acceptance import is_accepted
from discovery.decide.chance import p_value
from discovery.explain.force_balance import _slope, best_fit, explain, fitted
from discovery.explain.force_balance_screen import candidates_in_balances, screen, starts_of
from discovery.explain.probes import by_chance, probed_in_pieces
from discovery.loop.balance_refits import BalanceRefits
from discovery.options import Options
from discovery.residual.base import cost
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE
from tests.discovery import driven_twins as twins
from tests.discovery import slip_twins
from tests.shared import Shared, once_per_run

DRAWS = 20


def cubic(x: FloatArray, _v: FloatArray) -> FloatArray:
    return 2e7 * x**3


def campaign_of(kind: str) -> rom.Campaign:
    folder = Shared.here.new_folder() / "twin"
    if kind == "clean":
        return twins.driven(folder)
    return twins.driven(folder, extra=cubic, sizes=(0.3,) * 4)


@once_per_run
def residual_of(kind: str) -> ForceBalanceResidual:
    residual = BalanceRefits.of(campaign_of(kind), Options()).start().residual
    assert isinstance(residual, ForceBalanceResidual)
    return residual


def with_noise(residual: ForceBalanceResidual, seed: int) -> ForceBalanceResidual:
    """The same motion under a model that lacks nothing, forces with noise drawn anew."""
    balances = residual.balances
    numbers = np.array([residual.values[name] for name in balances.names])
    noise = balances.noise * np.random.default_rng(seed).normal(size=len(balances.noise))
    drawn = replace(balances, force=balances.columns @ numbers + noise)
    return replace(residual, balances=drawn).with_numbers()


def test_blocks_are_runs_of_rows_of_one_record_each() -> None:
    residual = residual_of("clean")
    pieces, records = residual.pieces, residual.owner[residual.training]
    assert len(np.unique(pieces)) == CRITERIA.chance.blocks * len(np.unique(records))
    for piece in np.unique(pieces):
        mine = np.flatnonzero(pieces == piece)
        assert np.array_equal(mine, np.arange(mine[0], mine[-1] + 1))
        assert len(np.unique(records[mine])) == 1
    sizes = np.bincount(pieces)
    assert sizes.max() - sizes.min() <= 1
    four = replace(residual, criteria=Criteria().changed(chance={"blocks": 4}))
    assert len(np.unique(four.pieces)) == 4 * len(np.unique(records))


def test_an_output_whose_square_is_no_number_is_no_probe() -> None:
    """Forces and displacements exchanged make outputs of 1e200 times noise: warnings are errors here."""
    residual = residual_of("cubic")
    first = screen(residual, Options())[0][0]
    rows = np.cos(np.arange(len(residual.owner)))
    left = rows[residual.training]
    assert probed_in_pieces(first.member, first.effect, rows, residual, left) is not None
    assert probed_in_pieces(first.member, first.effect, 1e200 * rows, residual, left) is None


def test_scores_of_blocks_add_up_to_what_a_probe_explains() -> None:
    residual = residual_of("cubic")
    best = next(
        probes[0] for probes in screen(residual, Options()) if probes[0].effect.name == "cubic-stiffness"
    )
    assert best.scores is not None
    assert len(best.scores) == 3 * CRITERIA.chance.blocks
    assert float(best.scores.sum()) ** 2 == pytest.approx(best.gain, rel=1e-6)


def test_chance_is_drawn_from_blocks_where_there_are_enough() -> None:
    found = {one.effect.name: one for one in explain(residual_of("cubic"), Options())}
    assert found["cubic-stiffness"].p_value == 0.001
    assert is_accepted(found["cubic-stiffness"])


@pytest.mark.parametrize("changed", [{"blocks": 2}, {"fewest_pieces": 49}])
def test_chance_is_that_of_the_likelihood_ratio_where_there_are_fewer(changed: dict[str, float]) -> None:
    criteria = Criteria().changed(chance=changed)
    residual = replace(residual_of("cubic"), criteria=criteria)
    found = explain(residual, Options(criteria=criteria))
    assert found
    assert [one.p_value for one in found] == [None] * len(found)


def test_false_alarms_of_the_whole_catalogue_in_noise_are_as_many_as_are_asked() -> None:
    alarms = 0
    for seed in range(DRAWS):
        probes = screen(with_noise(residual_of("clean"), seed), Options())
        largest = by_chance(probes)
        assert largest is not None
        alarms += p_value(probes[0][0].gain, largest) <= CRITERIA.chance.false_alarms
    assert alarms <= 4  # binomial: more come with a chance below 1 %


def test_hysteresis_stiffer_on_every_way_out_is_fitted_as_such() -> None:
    """A cycled contact whose hysteresis is stepped here: where slip must soften, no share of it explains."""
    rng, (kappa, x_y, beta), k, records = np.random.default_rng(3), (0.4, 1e-4, 2.6), 3e4, {}
    for file, held in (("first.h5", False), ("second.h5", True)):
        time = np.arange(int(6 * twins.CYCLED_HZ)) / twins.CYCLED_HZ
        x = 1e-4 * (0.2 + time / 6) * np.sin(2 * np.pi * 5.0 * time + (0.3 if held else 0.0))
        z, spring = 0.0, np.empty_like(x)
        for at, step in enumerate(np.diff(x, prepend=0.0)):
            for _ in range(10):
                out = z * step > 0
                z += step / 10 * (1 + (beta - 2 if out else beta) * abs(z) / x_y)
            spring[at] = (1 - kappa) * k * x[at] + kappa * k * z
        noisy = spring + 50.0 * np.gradient(x, 1 / twins.CYCLED_HZ) + 2e-3 * rng.normal(size=len(x))
        shown = {"link_displacement_contact": x, "link_force_contact": noisy}
        records[file] = ("cycled", held, shown, twins.CYCLED_HZ)
    campaign = twins.campaign_of(Shared.here.new_folder() / "twin", "slider", "contact", "linear", records)
    residual = BalanceRefits.of(campaign, Options()).start().residual
    assert isinstance(residual, ForceBalanceResidual)
    probes = next(ones for ones in screen(residual, Options()) if ones[0].member.name == "bouc-wen")
    after, (found,) = best_fit(starts_of(probes, residual))
    numbers = {name: number.value for name, number in found.parameters.items()}
    assert numbers["beta"] == pytest.approx(beta, rel=0.05)
    assert numbers["kappa"] / numbers["x_y"] == pytest.approx(kappa / x_y, rel=0.1)  # that, not either alone
    assert cost(after) < 0.01 * cost(residual)


def test_a_number_far_below_what_it_is_added_to_is_stepped_by_what_is_seen() -> None:
    """A limit of friction of 1 mN + 0.4 N, told to 0.1 mN: a step of a thousandth of 1 mN tells nothing."""
    normal = np.linspace(1.0, 5.0, 50)

    def left(x: FloatArray) -> FloatArray:
        return np.round(x[0] + x[1] * normal, 4)

    at, ends = np.array([1e-3, 0.4]), (np.zeros(2), np.full(2, np.inf))
    here = left(at)
    slopes = [_slope(left, here, at, place, ends, float(np.linalg.norm(here))) for place in range(2)]
    np.testing.assert_allclose(slopes[0], 1.0, rtol=0.01)
    np.testing.assert_allclose(slopes[1], normal, rtol=0.3)  # by a step of a thousandth, as ever


def test_a_stiffness_that_is_cut_off_in_a_link_without_a_spring_gains_nothing() -> None:
    """Below zero it would take a share of a spring that is not there: no number of it shows."""
    campaign = twins.driven(Shared.here.new_folder() / "free", stiffness=0.0, sizes=(1.0,) * 3, seconds=3.0)
    residual = BalanceRefits.of(campaign, Options()).start().residual
    assert isinstance(residual, ForceBalanceResidual)
    negative = CATALOGUE["quintic-stiffness"].at("guide", ground=True).with_values(k5=-1e14)
    after, effects = fitted(residual, (negative,))
    assert effects == (negative,)
    assert cost(after) == pytest.approx(cost(residual))


@pytest.mark.parametrize("name", ["iwan-slip", "bouc-wen", "maxwell-viscoelastic", "coulomb-friction"])
def test_an_effect_beside_a_slider_leaves_no_more_than_the_slider_alone(name: str) -> None:
    """The slider's force goes with the link's stiffness, which is refitted beside the effect."""
    campaign = slip_twins.cycled(Shared.here.new_folder() / "backlash", "backlash")
    residual = BalanceRefits.of(campaign, Options()).start().residual
    assert isinstance(residual, ForceBalanceResidual)
    there = {effect.name: effect for _, effect in candidates_in_balances(residual)}
    slider, _ = fitted(residual, (there["jenkins-slip"].with_values(kappa=0.3),))
    beside, _ = fitted(slider, (there[name],))
    assert cost(slider) < 0.1 * cost(residual)
    assert cost(beside) < 1.001 * cost(slider)
