"""A structure a million times heavier, larger or faster, or another bolt, has the same laws and verdicts."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import rom
from discovery.loop.close_loop import close_loop
from discovery.ranking.discover import discover
from experiments.rig.plant import Plant
from experiments.studies import rig
from rom.campaign.campaign import Campaign
from tests.discovery import driven_twins
from tests.discovery.small_searches import FEWER
from tests.rescaled import rescaled
from tests.shared import Shared

Scale = dict[str, float]
MILLION = 2.0**20
EACH = [{name: MILLION**power} for name in ("mass", "length") for power in (1, -1)]


def named(closure: rom.Closure) -> list[tuple[str, str]]:
    return [(one.effect.name, one.effect.enters) for one in closure.effects]


def strength(closure: rom.Closure, scale: Scale) -> float:
    """The cubic stiffness in the unit of the campaign that was rescaled: N/m3 is kg/(m2 s2)."""
    unit = scale.get("mass", 1.0) / (scale.get("length", 1.0) * scale.get("time", 1.0)) ** 2
    return float(closure.effects[0].effect.parameters["k3"].value / unit)


def driven(shared: Shared) -> Campaign:
    """A driven body on a cubic spring, made once."""

    def work() -> Path:
        folder = shared.new_folder() / "campaign"
        driven_twins.driven(folder, extra=lambda x, v: 4e8 * x**3 + 0.0 * v, seconds=2.0)
        return folder

    return rom.read_campaign(shared.once("any unit driven", work))


@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.parametrize("scale", [*EACH, {"time": 2.0**10}, {"time": 2.0**-10}], ids=str)
def test_a_driven_body(scale: Scale, tmp_path: Path, shared: Shared) -> None:
    campaign = driven(shared)
    usual = shared.once("any unit driven closed", lambda: close_loop(campaign, jobs=1))
    other = close_loop(rescaled(campaign, tmp_path / "s", **scale), jobs=1)
    assert other.verdict == usual.verdict == "closed"
    assert named(other) == named(usual) == [("cubic-stiffness", "guide")]
    assert strength(other, scale) == pytest.approx(strength(usual, {}), rel=1e-6)
    assert other.effects[0].share == pytest.approx(usual.effects[0].share, rel=1e-6)


def hammered(shared: Shared, *, cubic: bool, cases: int) -> Campaign:
    """A campaign of the rig, made once; the seed is one with which no two laws are as good."""

    def work() -> Path:
        hidden = (rig.undeclared_from_text("cubic-stiffness@joint"),) if cubic else ()
        folder = shared.new_folder() / "campaign"
        return rig.run(
            folder, cases, seed=7, duration_s=2.5, hold_out_every=5 * (not cubic), undeclared=hidden
        )

    return rom.read_campaign(shared.once(f"any unit {cubic} {cases}", work))


FAST = {"time": 2.0**-20}
SLOW = {"time": 8.0}
SLOWEST = {"time": 2.0**20}


MORE = [{"tension": MILLION}, {"tension": 1 / MILLION}, {"mass": 1 / MILLION}, {"length": 1 / MILLION}]
VARIANTS = [*MORE, {"length": MILLION}, {"time": 2.0**-5}, SLOW, SLOWEST]


@pytest.mark.slow
@pytest.mark.usefixtures("without_detection_limits")
@pytest.mark.parametrize(
    "scale",
    [{"mass": MILLION}, FAST, *(pytest.param(scale, marks=pytest.mark.variant) for scale in VARIANTS)],
    ids=str,
)
def test_a_hammered_joint(scale: Scale, tmp_path: Path, shared: Shared) -> None:
    """Times decide what a filter lets pass, so that strengths then differ by what noise leaves open."""
    closure = close_loop(rescaled(hammered(shared, cubic=True, cases=2), tmp_path / "s", **scale), jobs=1)
    assert closure.verdict == "closed"
    assert named(closure) == [("cubic-stiffness", "joint")]
    assert strength(closure, scale) == pytest.approx(4.5e12, rel=0.03)


@pytest.mark.parametrize("times", [1 / 32, 64.0, MILLION])
def test_a_fast_or_slow_joint_is_identified(times: float, tmp_path: Path, shared: Shared) -> None:
    """Times of a usual joint would hide the first mode, take it for drift, end the loss and bound gamma; its
    frequencies would leave out the mode in which a fast joint works.
    """
    other = rescaled(hammered(shared, cubic=False, cases=10), tmp_path / "s", time=times)
    model, plant = rom.identify(other, jobs=1), Plant()
    found = {path.rpartition(".")[2]: number.value for path, number in model.parameters.items()}
    assert found["k_i"] == pytest.approx(plant.k_i / times**2, rel=2e-4)
    assert found["alpha"] == pytest.approx(plant.alpha, rel=0.02)
    assert found["c_d"] == pytest.approx(plant.c_d / times, rel=2e-3)
    (loosening,) = plant.loosening
    assert found["gamma_d"] == pytest.approx(loosening.gamma_d + 3 * np.log10(times), abs=0.6)


@pytest.mark.parametrize(
    ("scale", "of"),
    [
        ({"tension": MILLION}, {"alpha": -1, "beta": 1, "eta": -1, "rho": -1}),
        ({"mass": MILLION}, {"k": 1, "c": 1, "mass": 1, "k_i": 1, "c_d": 1, "c_i": 1}),
        ({"length": MILLION}, {}),
    ],
    ids=str,
)
def test_numbers_of_a_joint_scale_exactly(
    scale: Scale, of: dict[str, int], tmp_path: Path, shared: Shared
) -> None:
    """A fit that ends by the size of its numbers left beta 0.9 % off where tensions are a million times, and
    gamma 0.02 % where lengths are.
    """
    campaign = hammered(shared, cubic=False, cases=10)
    usual = shared.once("any unit identified", lambda: rom.identify(campaign, jobs=1))
    other = rom.identify(rescaled(campaign, tmp_path / "s", **scale), jobs=1)
    for path, number in usual.parameters.items():
        expected = number.value * MILLION ** of.get(path.rpartition(".")[2], 0)
        if path.endswith("gamma_d"):  # the logarithm of a rate per (m/s)^4
            expected -= 4 * np.log10(scale.get("length", 1.0))
        assert other.parameter(path).value == pytest.approx(expected, rel=1e-6), path


@pytest.mark.slow
@pytest.mark.parametrize(
    "scale",
    [
        SLOWEST,
        *(pytest.param(s, marks=pytest.mark.variant) for s in (FAST, SLOW, {"mass": MILLION}, *MORE[:2])),
    ],
    ids=str,
)
def test_laws_of_the_tension(scale: Scale, tmp_path: Path, shared: Shared) -> None:
    campaign = hammered(shared, cubic=False, cases=10)
    laws = partial(discover, criteria=FEWER, libraries=["velocity"], max_terms=1, jobs=1)
    usual = shared.once("any unit laws", lambda: laws(campaign))
    other = laws(rescaled(campaign, tmp_path / "s", **scale))
    forms = [[tuple(law.parameters) for law in found.laws[:3]] for found in (usual, other)]
    assert forms[0] == forms[1]
    powers = [[law.parameters["n"].value for law in found.laws[:3]] for found in (usual, other)]
    np.testing.assert_allclose(*powers, rtol=0.02)
