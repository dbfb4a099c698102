"""Faults of sensors that show before the hits, found in records of noise alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rom
from discovery.decide.acceptance import is_accepted
from discovery.decide.explanation import Explanation
from discovery.explain.at_rest import explain
from discovery.options import Options
from rom.campaign.channels import FloatArray

_RATE_HZ, _HIT_S, _RECORDS = 4800.0, 0.5, 10


def still(
    added: FloatArray | float = 0.0, *, seed: int = 0, scatter: float = 0.0, hit_s: float = _HIT_S
) -> Any:
    """Residual of records that hold an accelerometer's noise, and what is added to it in every record."""
    generator = np.random.default_rng(seed)
    samples = 0.01 * generator.standard_normal((_RECORDS, round(2 * hit_s * _RATE_HZ)))
    samples += added + scatter * generator.standard_normal((_RECORDS, 1))
    traces = [
        SimpleNamespace(
            settings=SimpleNamespace(file=f"{k}.h5", hold_out=k >= 8),
            measurement=SimpleNamespace(
                motion={"so": SimpleNamespace(kind="acceleration", samples=rows)}, force={}, still_force={},
                impact_s=hit_s, rate_hz=_RATE_HZ,
            ),
        )
        for k, rows in enumerate(samples)
    ]  # fmt: skip
    return SimpleNamespace(traces=traces, baseline=SimpleNamespace(model=rom.paper_model()))


def sure(evidence: Any) -> list[Explanation]:
    return [one for one in explain(evidence, Options()) if is_accepted(one)]


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_has_no_fault(seed: int) -> None:
    assert not sure(still(seed=seed))


@pytest.mark.parametrize("size", [0.03, 9.80665, -98.0])
def test_an_offset_that_all_records_share_is_found_with_its_limits(size: float) -> None:
    """Also gravity at rest, which is beyond what amplifiers have."""
    (found,) = sure(still(size))
    offset = found.effect.parameters["b"]
    assert (found.effect.name, found.effect.enters) == ("acceleration-bias", "sensor:acceleration_so")
    assert offset.low is not None
    assert offset.high is not None
    assert offset.low < size < offset.high
    assert not offset.at_bound
    assert found.gains(hold_out=True).min() > 0


def test_offsets_of_every_record_s_own_are_none() -> None:
    assert not sure(still(scatter=0.05))


def test_an_offset_that_no_amplifier_is_free_of_is_none() -> None:
    assert not sure(still(0.001, seed=3))


@pytest.mark.parametrize("amplitude", [0.03, 3e4])
def test_the_mains_are_found_whatever_their_size_and_phase_and_their_frequency_to_a_mhz(
    amplitude: float,
) -> None:
    time = np.arange(round(2 * _HIT_S * _RATE_HZ)) / _RATE_HZ
    phase = np.random.default_rng(1).uniform(0, 2 * np.pi, (_RECORDS, 1))
    (found,) = sure(still(amplitude * np.sin(2 * np.pi * 59.93 * time + phase)))
    assert found.effect.name == "hum"
    assert found.effect.parameters["f"].value == pytest.approx(59.93, abs=5e-3)
    size = np.hypot(found.effect.parameters["A"].value, found.effect.parameters["B"].value)
    assert size == pytest.approx(amplitude, rel=0.05)


def test_the_mains_in_a_hammer_are_found_where_nothing_but_contacts_is_kept_of_its_force() -> None:
    quiet, shown = still(), still(0.03 * np.sin(2 * np.pi * 50.04 * np.arange(4800) / _RATE_HZ))
    for one, other in zip(quiet.traces, shown.traces, strict=True):
        one.measurement.force["lo"] = np.zeros(4800)
        one.measurement.still_force["lo"] = other.measurement.motion["so"].samples[:2400]
    (found,) = sure(quiet)
    assert (found.effect.name, found.effect.enters) == ("hum", "sensor:force_lo")
    quiet.traces[0].measurement.force["lo"][2500] = 100.0  # of which 0.03 N are nothing
    assert not sure(quiet)
    quiet.traces[1].measurement.force["lo"][2500] = 10.0
    assert sure(quiet)
    assert found.effect.parameters["f"].value == pytest.approx(50.04, abs=0.015)


def test_a_hammer_whose_channel_is_silent_until_it_strikes_tells_nothing() -> None:
    evidence = still()
    for trace in evidence.traces:
        trace.measurement.force["lo"] = trace.measurement.still_force["lo"] = np.zeros(2400)
    assert not sure(evidence)


def test_records_that_are_hit_at_once_tell_nothing() -> None:
    assert not explain(still(0.03, hit_s=0.1), Options())
