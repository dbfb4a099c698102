"""The filter of a declared band: what it keeps, what it takes out, and where it may be trusted."""

from __future__ import annotations

import numpy as np
import pytest

from rom.signals.filters import FilterChain, displacement
from rom.signals.frequency_band import edge_samples, in_band
from rom.signals.motion import Motion, dominant_frequency

RATE_HZ, BAND_HZ = 1000.0, (2.0, 40.0)
TIME = np.arange(8000) / RATE_HZ


def wave(frequency_hz: float) -> np.ndarray:
    return np.sin(2 * np.pi * frequency_hz * TIME)


@pytest.mark.parametrize(("frequency_hz", "share"), [(0.3, 0.0), (4.0, 1.0), (25.0, 1.0), (90.0, 0.0)])
def test_what_lies_in_the_band_passes_without_delay(frequency_hz: float, share: float) -> None:
    found = in_band(np.stack([wave(frequency_hz), 3 * wave(frequency_hz)]), RATE_HZ, BAND_HZ)
    inner = slice(edge_samples(len(TIME), RATE_HZ, BAND_HZ), -edge_samples(len(TIME), RATE_HZ, BAND_HZ))
    np.testing.assert_allclose(found[0, inner], share * wave(frequency_hz)[inner], atol=0.02)
    np.testing.assert_allclose(found[1], 3 * found[0], atol=1e-12)


def test_without_a_band_nothing_is_touched_or_cut() -> None:
    samples = wave(4.0)
    assert in_band(samples, RATE_HZ, None) is samples
    assert edge_samples(len(samples), RATE_HZ, None) == 0


def test_an_end_beyond_half_the_rate_or_at_zero_filters_nothing() -> None:
    samples = wave(4.0) + wave(90.0)
    np.testing.assert_array_equal(in_band(samples, RATE_HZ, (0.0, 600.0)), samples)


def test_displacements_are_compared_in_the_band_whatever_was_measured() -> None:
    chain = FilterChain(1.0, band_hz=BAND_HZ)
    for kind, factor in (("displacement", 1.0), ("velocity", 2 * np.pi * 4.0)):
        samples = factor * np.cos(2 * np.pi * 4.0 * TIME) + 5 * factor * wave(90.0)
        expected = np.cos(2 * np.pi * 4.0 * TIME) if kind == "displacement" else wave(4.0)
        found = displacement(kind, samples, RATE_HZ, chain)
        np.testing.assert_allclose(found[2000:-2000], expected[2000:-2000], atol=0.02)


def test_the_dominant_frequency_is_looked_for_in_the_band() -> None:
    motion = {"m": Motion("acceleration", wave(4.0) + 60 * wave(90.0))}
    assert dominant_frequency(motion, RATE_HZ, None) == pytest.approx(90.0, abs=0.2)
    assert dominant_frequency(motion, RATE_HZ, None, BAND_HZ) == pytest.approx(4.0, abs=0.2)
