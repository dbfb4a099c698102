"""Numbers of a model fitted by simulation, where forces along the measured motion mislead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import optimize

import rom
from discovery.criteria.criteria import CRITERIA
from discovery.explain.motion_fit import with_effects
from discovery.explain.simulated_fit import SimulatedFit
from discovery.loop.impact_refits import ImpactRefits
from discovery.loop.refitted_numbers import effect_with_limits
from discovery.options import Options, no_progress
from discovery.residual.base import level
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.output_error import WhitenedResidual
from experiments.rig.plant import Plant
from experiments.studies import rig
from experiments.studies.rig import Undeclared
from rom.campaign.channels import FloatArray

K3 = 8e9  # the flexure is twice as stiff at the largest deflection


def damping(residual: WhitenedResidual) -> float:
    """Of the flexure, which the ring-down of a strongly nonlinear mode tells."""
    return residual.baseline.model.parameter("flexure_lo.damping.c").value


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.variant)])
def test_a_strongly_nonlinear_mode_no_longer_biases_the_damping(tmp_path: Path, seed: int) -> None:
    hidden = Undeclared("cubic-stiffness", "flexure_lo", {"k3": K3})
    rig.run(tmp_path / "c", cases=4, noise=0.3, seed=seed, jobs=1, duration_s=2.5, undeclared=(hidden,))
    refits = ImpactRefits.of(rom.read_campaign(tmp_path / "c"), Options(1, no_progress, 0, CRITERIA))
    state = refits.start()
    explained = refits.explain(refits.screen(state.residual), state.residual)
    cubic = next(one for one in explained if one.effect.path == "flexure_lo.cubic-stiffness")
    along_measured = refits.own(refits.refit_with(state, cubic))
    settled = refits.own(refits.settled(along_measured))
    by_simulation = settled.stated
    assert by_simulation is settled.simulated
    assert level(by_simulation) <= CRITERIA.acceptance.noise_level
    truth = Plant().damping_lo
    assert damping(along_measured) < 0.998 * truth
    assert damping(by_simulation) == pytest.approx(truth, rel=5e-4)
    (effect,) = by_simulation.baseline.model.effects
    assert effect.parameters["k3"].value == pytest.approx(K3, rel=5e-4)
    k3 = effect_with_limits(effect, by_simulation).parameters["k3"]
    assert k3.low is not None
    assert k3.high is not None
    assert k3.high - k3.low < 5e-3 * K3
    assert k3.low < K3 < k3.high
    assert refits.settled(settled) is settled  # once is enough
    assert settled.searched is by_simulation
    astray = replace(by_simulation, residual=2 * by_simulation.residual)
    loud = replace(settled, simulated=astray)
    assert loud.stated is loud  # what drifts out of phase states nothing
    louder = replace(loud, residual=3 * settled.residual)
    assert louder.stated is astray
    assert louder.searched is louder  # more than noise is left: outputs are those along the measured motion
    again = with_effects(settled)
    assert again.names == settled.names
    assert len(set(again.names)) == again.jacobian.shape[1]  # each number has one slope


class _Decay(SimulatedFit):
    """Two numbers of a decay in unit noise, in place of simulations of records."""

    def __init__(self, seed: int) -> None:
        self.time = np.linspace(0, 1, 40_000)
        self.seen = self.shown(np.ones(2)) + np.random.default_rng(seed).standard_normal(len(self.time))
        self.enough, self.asked = np.inf, 0
        self.start = cast(
            "WhitenedResidual",
            SimpleNamespace(names=("a", "b"), training=np.ones(len(self.time), dtype=bool)),
        )

    def shown(self, numbers: FloatArray) -> FloatArray:
        """Amplitude and rate; the size is such that noise alone moves either by some parts in a hundred."""
        return np.asarray(numbers[0] * np.sin(60 * numbers[1] * self.time) * np.exp(-3 * self.time))

    def rows(
        self, baseline: FreeParameters, *, hold_out: bool = False, before: FloatArray | None = None
    ) -> FloatArray:
        assert not hold_out
        assert before is None or before.shape == self.time.shape
        self.asked += 1
        return np.asarray(self.seen - self.shown(cast("_Numbers", baseline).numbers))

    def ended(self, numbers: FloatArray) -> FloatArray:
        """Where steps end along slopes at a start, which they mend."""
        start, small = _Numbers(numbers), 1e-6
        slopes = [(self.shown(numbers + small * one) - self.shown(numbers)) / small for one in np.eye(2)]
        at = cast("FreeParameters", start)
        return cast("_Numbers", self._lowered(at, self.rows(at), np.stack(slopes, axis=1))[0]).numbers


@dataclass(frozen=True)
class _Numbers:
    numbers: FloatArray

    def stepped(self, steps: Mapping[str, float]) -> _Numbers:
        return _Numbers(self.numbers + np.array([steps["a"], steps["b"]]))


@pytest.mark.parametrize("seed", range(3))
def test_steps_end_where_noise_would_not_tell_the_numbers_from_the_best(seed: int) -> None:
    """Steps that ended at a thousandth of the cost, 40 squares of noise, were two standard errors off."""
    fit = _Decay(seed)

    def left(numbers: FloatArray) -> FloatArray:
        return np.asarray(fit.seen - fit.shown(numbers))

    best = optimize.least_squares(left, np.ones(2), xtol=1e-12)
    found = fit.ended(np.array([1.5, 1.02]))
    assert 2 * best.cost < np.sum(left(found) ** 2) < 2 * best.cost + 0.1


def test_a_fit_that_would_state_nothing_ends_sooner() -> None:
    asked = []
    for enough in (np.inf, 0.0):
        fit = _Decay(0)
        fit.enough = enough
        fit.ended(np.array([1.5, 1.02]))
        asked.append(fit.asked)
    assert asked[1] < asked[0]


class _Records(SimulatedFit):
    """Three records of two rows each, the last one held out; a candidate leaves what it says."""

    def __init__(self) -> None:
        trace = [SimpleNamespace(settings=SimpleNamespace(hold_out=k == 2, file=k)) for k in range(3)]
        stored = SimpleNamespace(as_type=lambda _: None)
        self.records = cast("list", [(t, stored, slice(2 * k, 2 * k + 2)) for k, t in enumerate(trace)])
        self.start = cast("WhitenedResidual", SimpleNamespace(residual=np.zeros(6)))
        self.seen: list[int] = []

    def _rows_of(self, trace: Any, _measurement: object, baseline: Any) -> FloatArray:
        self.seen.append(trace.settings.file)
        return np.asarray(baseline[trace.settings.file])


@pytest.mark.parametrize(
    ("left", "seen", "found"),
    [
        ([[1, 1], [2, 2], [9, 9]], [1, 0], [1, 1, 2, 2, 0, 0]),
        ([[1, 1], [4, 4], [9, 9]], [1], [0, 0, 4, 4, 0, 0]),
        ([[1, 1], [np.inf, 0], [9, 9]], [1], [0, 0, np.inf, 0, 0, 0]),
    ],
)
def test_a_step_too_far_is_given_up_after_the_record_that_most_was_left_of(
    left: list[list[float]], seen: list[int], found: list[float]
) -> None:
    fit, before = _Records(), np.array([1.0, 1.0, 3.0, 3.0, 0.0, 0.0])
    rows = fit.rows(cast("FreeParameters", left), before=before)
    assert fit.seen == seen
    np.testing.assert_array_equal(rows, found)
