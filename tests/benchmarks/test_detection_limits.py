"""The benchmark of detection limits: what is hidden, and how outcomes are counted."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.detection_limits import SHARES, Clean, Outcome, Trial, hidden_effect, table, trials
from benchmarks.drawn_campaigns import drawn
from discovery.detection.limit import DetectionLimit
from rom.campaign.record import read_channels


def limit(name: str, value: float | None = 1e-3, enters: str = "s0") -> DetectionLimit:
    shape = {"F_s": 3e-9, "mu": 0.0} if name == "jenkins-slip" else {}
    strength = {"jenkins-slip": "kappa", "cubic-stiffness": "k3"}.get(name, "c2")
    return DetectionLimit(name, enters, strength, "1", value, 0.1, 1.0, value, shape=shape)


def test_an_effect_is_hidden_at_a_share_of_its_limit_in_the_shape_that_the_limit_is_of() -> None:
    hidden = hidden_effect(limit("jenkins-slip"), 0.3)
    assert hidden.path == "s0.jenkins-slip"
    values = {name: number.value for name, number in hidden.parameters.items()}
    assert values == pytest.approx({"kappa": 3e-4, "F_s": 9e-10, "mu": 0.0})


def test_each_campaign_tries_the_effects_that_were_tried_least() -> None:
    names = ("jenkins-slip", "cubic-stiffness", "quadratic-damping")
    known = (*map(limit, names), limit("even-stiffness", None), limit("force-gain", enters="sensor:force_b"))
    found = list(trials([Clean(seed, (), known) for seed in range(6)], each=2))
    tried = Counter(one.limit.name for one in found)
    assert tried == dict.fromkeys(names, 2 * len(SHARES) * 2)


def test_the_table_counts_what_is_found_at_each_share() -> None:
    outcomes = ("found", "found", "other name", "nothing", "not drawn")
    rows = [Outcome(Trial(1, limit("cubic-stiffness"), 1.0, 1), one) for one in outcomes]
    rows += [Outcome(Trial(1, limit("cubic-stiffness"), 0.3, 1), "nothing")]
    shown = table(rows, "effect")
    assert [list(column.cells)[-1] for column in shown.columns] == ["all", "2, 1, 4", "0, 0, 1"]


def test_only_noise_differs_between_draws_of_a_campaign(tmp_path: Path) -> None:
    found = []
    for draw in (0, 1):
        drawn(7756, tmp_path / str(draw), (), noise_of=draw)
        (channel,) = read_channels(tmp_path / str(draw) / "records" / "0.h5", 1.0, 1.0).values()
        found.append(channel.samples)
    first, second = found
    assert 0 < abs(first - second).max() < 0.1 * abs(first).max()
