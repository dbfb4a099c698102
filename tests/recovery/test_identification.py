"""Known truth through the whole chain: raw records of the virtual rig in, the rig's own numbers out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.identification import COVERAGE_TARGET, TARGETS, Trial, read_truth, score
from experiments.studies import rig
from rom.identification.identify import Identification
from tests.recovery.plants import plants
from tests.shared import Shared

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trials(shared: Shared, seeds: range) -> list[Trial]:
    """Of every seed."""
    return [plant.trial for plant in plants(shared, seeds)]


@pytest.mark.parametrize("name", TARGETS)
def test_the_median_error_is_within_its_target(name: str, trials: list[Trial]) -> None:
    assert np.median([abs(trial.errors[name]) for trial in trials]) <= TARGETS[name]


@pytest.mark.parametrize("name", TARGETS)
def test_no_seed_is_far_off(name: str, trials: list[Trial]) -> None:
    assert max(abs(trial.errors[name]) for trial in trials) <= 2 * TARGETS[name]


def test_limits_hold_the_truth_as_often_as_they_say(trials: list[Trial]) -> None:
    held = [hit for trial in trials for hits in trial.covered.values() for hit in hits]
    assert len(held) > 50 * len(trials)
    low, high = COVERAGE_TARGET
    assert low <= np.mean(held) <= high


@pytest.mark.parametrize("symbol", ["k_C", "c_C"])
def test_limits_of_every_joint_hold_the_truth(symbol: str, trials: list[Trial]) -> None:
    held = [hit for trial in trials for hit in trial.covered[f"{symbol} of every coupled record"]]
    assert len(held) == 20 * len(trials)
    assert COVERAGE_TARGET[0] <= np.mean(held)


def test_a_wrong_truth_is_not_recovered(
    rig_campaign: Path, rig_identified: Identification, tmp_path: Path
) -> None:
    """The score itself can fail: a campaign scored against another plant misses every target."""
    path = tmp_path / "truth.json"
    data = json.loads(rig.truth_path(rig_campaign).read_text(encoding="utf-8"))
    for name in ("stiffness_lo", "stiffness_so", "k_i", "c_d", "c_i"):
        data["plant"][name] *= 1.5
    data["plant"]["loosening"][0]["gamma_d"] += 0.2
    path.write_text(json.dumps(data), encoding="utf-8")
    trial = score(rig_identified, read_truth(path))
    missed = [name for name, target in TARGETS.items() if abs(trial.errors[name]) > target]
    assert missed == list(TARGETS)
    assert not any(trial.covered["k_LO"] + trial.covered["k_SO"] + trial.covered["gamma(T) on the grid"])
