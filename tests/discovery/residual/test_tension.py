"""A gauge's drift: what all records share of it, before their hits as after, and how they differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery import close_loop
from discovery.residual.tension_records import Drift, noises
from experiments.studies import rig
from rom.campaign.campaign import read_campaign, write_campaign
from rom.signals.tension_bins import bins_after_hit, bins_before_hit

RATE_HZ, PRETRIGGER_S, DURATION_S, TESTS = 4800.0, 0.5, 2.5, 16
SETTINGS: Any = SimpleNamespace(
    windows=SimpleNamespace(initial_s=(0.0, 0.4), final_s=(2.0, 2.5)),
    sampling=SimpleNamespace(pretrigger_s=PRETRIGGER_S),
)


def found(
    seed: int,
    mean: float = 0.0,
    spread: float = 0.0,
    after: float = 0.0,
    tests: int = TESTS,
    loosening: int = 0,
) -> Drift:
    """The drift of a gauge with white noise of 1 N in small hits and, further, others that loosen.

    ``after`` [N/s] begins with the hit.
    """
    rng, time = np.random.default_rng(seed), np.arange(int(DURATION_S * RATE_HZ)) / RATE_HZ
    seen: list[Any] = []
    for kind in ["coupled"] * tests + ["loosening"] * loosening:
        drift = mean + spread * rng.standard_normal()
        samples = (
            100 + drift * time + after * np.maximum(time - PRETRIGGER_S, 0) + rng.standard_normal(len(time))
        )
        tension = SimpleNamespace(samples=samples, rate_hz=RATE_HZ, slope=1.0)
        one: Any = SimpleNamespace(tension=tension, impact_s=PRETRIGGER_S)
        settings = SimpleNamespace(test=kind, hold_out=False)
        bins, before = bins_after_hit(one, SETTINGS), bins_before_hit(one)
        seen.append(SimpleNamespace(settings=settings, bins=bins, before=before))
    told = noises(seen)
    assert told is not None
    return told[2]


@pytest.mark.parametrize("mean", [0.05, -0.2])
def test_a_drift_that_all_records_share(mean: float) -> None:
    drifts = [found(seed, mean) for seed in range(10)]
    assert [one.mean for one in drifts] == pytest.approx([mean] * 10, abs=0.02)
    assert np.median([one.spread for one in drifts]) < 0.02


def test_a_drift_of_each_record_s_own() -> None:
    drifts = [found(seed, spread=0.1) for seed in range(10)]
    assert np.median([abs(one.mean) for one in drifts]) < 0.1 / np.sqrt(TESTS)
    assert np.median([one.spread for one in drifts]) == pytest.approx(0.1, rel=0.3)


def test_where_nothing_drifts_hardly_any_is_shared() -> None:
    assert max(abs(found(seed).mean) for seed in range(20)) < 0.02


def test_what_begins_with_the_hit_is_no_drift() -> None:
    assert max(abs(found(seed, after=0.5).mean) for seed in range(10)) < 0.15


def test_few_hits_that_leave_the_tension_alone_tell_it_by_the_time_before_all() -> None:
    """Four small hits are too few, eight records before their hits are not: what they share is no spread."""
    drifts = [found(seed, mean=0.5, spread=0.1, tests=4, loosening=6) for seed in range(10)]
    assert np.median([one.mean for one in drifts]) == pytest.approx(0.5, abs=0.05)
    assert np.median([one.spread for one in drifts]) < 0.25


@pytest.mark.variant
def test_a_drift_of_all_records_is_named_with_its_size(tmp_path: Path) -> None:
    """A slow bolt of 0.15 N/s in every record: a free form of the loosening's rate imitates it as well."""
    plain = read_campaign(
        rig.run(tmp_path / "plain", cases=10, seed=3, jobs=1, duration_s=DURATION_S, hold_out_every=5)
    )
    assert plain.settings.bolt is not None
    assert plain.settings.bolt.calibration is not None
    first, second, third = plain.settings.bolt.calibration
    records = []
    for settings in plain.settings.record:
        channels = dict(plain.load(settings).channels)
        if "strain" in channels:
            strain = channels["strain"]
            slope = first + strain.samples * (2 * second + 3 * third * strain.samples)
            drift = 0.15 * np.arange(len(strain.samples)) / strain.rate_hz
            channels["strain"] = replace(strain, samples=strain.samples + drift / slope)
        records.append((settings.file, channels))
    write_campaign(tmp_path / "drifting", plain.settings, records)
    closure = close_loop(read_campaign(tmp_path / "drifting"))
    assert [one.effect.name for one in closure.effects] == ["tension-drift"]
    number = closure.effects[0].effect.parameters["d"]
    assert number.value == pytest.approx(0.15, rel=0.1)
    assert closure.verdict == "closed"
