"""What of a measured motion forces are evaluated along: what it shows beyond its noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discovery.criteria.criteria import CRITERIA
from discovery.residual.trajectory import MeasuredTrajectory, _above_noise, simulated_channel
from rom.identification.spectral_model import spectrum
from rom.parameters.he_2025 import paper_model
from rom.signals.filters import for_straight_lines

_RATE_HZ, _QUIET, _ALL = 4800.0, 2000, 12000
_FEWEST = CRITERIA.motion.quiet_samples


def _noisy(amplitude: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    noise = 0.05 * np.random.default_rng(seed).standard_normal(_ALL)
    time = np.arange(_ALL - _QUIET) / _RATE_HZ
    ringing = np.zeros(_ALL)
    ringing[_QUIET:] = amplitude * np.exp(-time / 0.3) * np.sin(2 * np.pi * 16 * time)
    return ringing, ringing + noise


def test_noise_alone_is_hardly_let_through() -> None:
    _, seen = _noisy(0.0)
    assert np.mean(_above_noise(seen, seen[:_QUIET], _FEWEST) ** 2) < 0.02 * np.mean(seen**2)


def test_what_is_far_above_the_noise_passes_and_most_noise_does_not() -> None:
    ringing, seen = _noisy(2.0)
    found = _above_noise(seen, seen[:_QUIET], _FEWEST)
    assert np.std(found - ringing) < 0.4 * np.std(seen - ringing)


def test_the_mains_before_the_hit_do_not_raise_the_noise() -> None:
    ringing, seen = _noisy(2.0)
    mains = 0.5 * np.sin(2 * np.pi * 50 * np.arange(_ALL) / _RATE_HZ)
    found = _above_noise(seen + mains, (seen + mains)[:_QUIET], _FEWEST)
    assert np.std(found - ringing - mains) < 0.5 * np.std(seen - ringing)


def test_nothing_is_taken_off_where_nothing_precedes_the_hit() -> None:
    _, seen = _noisy(1.0)
    np.testing.assert_array_equal(_above_noise(seen, seen[:10], _FEWEST), seen)


@pytest.mark.parametrize("frequency_hz", [28.4, 5.3])
@pytest.mark.parametrize("whole", [True, False])
def test_every_eighth_sample_of_a_force_that_does_not_end_as_it_began_has_the_lines_of_all(
    frequency_hz: float, whole: bool
) -> None:
    first, last, rate, stride = 80, 4080, 19200.0, 8
    count = last if whole else last + 800
    force = np.cos(2 * np.pi * frequency_hz * np.arange(count) / rate)
    part: Any = SimpleNamespace(samples=(first, last), frequency=rate / (last - first) * np.arange(2, 200))
    seen: Any = SimpleNamespace(rate_hz=rate)
    nothing: Any = None
    traced = MeasuredTrajectory(nothing, seen, (part,), {}, {}, np.zeros(0), 0.0, stride)
    every, eighth = traced.lines(force, part), traced.force_lines(force[None, ::stride], 0)[0]
    band = (part.frequency[0] - 1e-6, part.frequency[-1] + 1e-6)
    plain = spectrum(force[first:last:stride], rate / stride, band)[1]
    assert np.abs(eighth - every).max() < 0.05 * np.abs(plain - every).max()


def test_a_simulated_acceleration_has_the_lines_of_the_force_that_was_sampled() -> None:
    rate, count = 19200.0, 19200
    time = np.arange(count) / rate
    pulse = np.where(time < 2e-3, 1000 * np.sin(np.pi * time / 2e-3) ** 2, 0.0)
    sampled = np.roll(pulse, 100)
    model = paper_model().without_bolt()
    given = for_straight_lines(sampled)
    response = model.simulate({"lo": given}, rate)
    motion = {"lo": SimpleNamespace(kind="acceleration")}
    seen = SimpleNamespace(force={"lo": sampled}, applied_force={"lo": given}, motion=motion, rate_hz=rate)
    run: Any = SimpleNamespace(model=model, measurement=seen, response=response)
    short = slice(0, 400)  # the hit, as free as a body is within 20 ms but for its flexure
    mass = next(body.mass for body in model.structure.bodies if body.name == "lo")

    def error(acceleration: np.ndarray) -> float:
        lines = spectrum(np.diff(acceleration[short], append=acceleration[400]), rate, (300, 1500))[1]
        expected = spectrum(np.diff(sampled[short], append=sampled[400]), rate, (300, 1500))[1] / mass
        return float(np.linalg.norm(lines - expected) / np.linalg.norm(expected))

    assert error(np.asarray(response.acceleration["lo"])) > 5 * error(simulated_channel(run, "lo", {}))
    assert error(simulated_channel(run, "lo", {})) < 1e-3
