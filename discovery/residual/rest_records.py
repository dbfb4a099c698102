"""Tensions of bolts at rest as lines: half-waves over each record, slow ones and those that tell noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from discovery.criteria.at_rest import AtRest
from discovery.criteria.criteria import CRITERIA
from rom.campaign.campaign import RecordSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection, Reading

_MOST: Numerical[int] = 4096  # means of a record; its lines are far fewer
_ROUNDING: Numerical[float] = 1e-9  # of a tension
_LEAST: Numerical[float] = 1e-18  # [N^2], of a tension of zero


@dataclass(frozen=True, eq=False)
class RestRecord:
    """One record of a bolt at rest.

    Attributes
    ----------
    settings : RecordSettings
        Of the record.
    time : ndarray, shape (means,)
        Middles of the parts that were averaged [s] from the first sample.
    measured : ndarray, shape (lines,)
        Lines of the tension [N], from the first half-wave on: the level is not among them.
    slow : int
        Number of those that tell of effects.
    floor : float
        Least noise of a line [N^2]: what steps of quantisation leave of it.
    tension, duration_s, step_s : float
        Median tension [N], length of the record and interval between its samples [s].
    """

    settings: RecordSettings
    time: FloatArray
    measured: FloatArray
    slow: int
    floor: float
    tension: float
    duration_s: float
    step_s: float

    def lines(self, values: FloatArray) -> FloatArray:
        """Lines of values at the record's times, (lines,)."""
        return _lines(values, len(self.measured))

    def of(self, reading: ModelCorrection) -> FloatArray:
        """Lines of what a reading adds to the tension [N]."""
        assert isinstance(reading, Reading)
        return self.lines(reading.at_rest(self.time))

    @property
    def wander(self) -> FloatArray:
        """Lines' power of a tension that walks at random by 1 N^2/s, (lines,)."""
        means, halves = len(self.time), np.arange(1.0, len(self.measured) + 1)
        return np.asarray(self.duration_s / means * (means / (np.pi * halves)) ** 2)


def _lines(values: FloatArray, count: int) -> FloatArray:
    return np.asarray(fft.dct(values - values.mean(), norm="ortho")[1 : count + 1])


def rest_record(
    settings: RecordSettings, samples: FloatArray, rate_hz: float, rules: AtRest = CRITERIA.at_rest
) -> RestRecord:
    """Return a record's tension as lines.

    Parameters
    ----------
    settings : RecordSettings
        Of the record.
    samples : ndarray, shape (samples,)
        Tension [N].
    rate_hz : float
        Sampling rate [Hz].
    rules : AtRest
        Which lines tell of what.

    Returns
    -------
    RestRecord
        With the lines that are needed.
    """
    each = max(-(-len(samples) // _MOST), 1)
    means = samples[: len(samples) // each * each].reshape(-1, each).mean(axis=1)
    slow = max(min(int(rules.slow_lines), (len(means) - 1) // int(rules.lines_of_record)), 1)
    count = min(len(means) - 1, int(rules.noise_span) * slow)
    return RestRecord(
        settings,
        np.asarray((np.arange(len(means)) * each + 0.5 * (each - 1)) / rate_hz, dtype=np.float64),
        _lines(means, count),
        slow,
        max(_of_steps(samples, slow) / each, (_ROUNDING * float(np.abs(samples).max())) ** 2, _LEAST),
        float(np.median(samples)),
        len(samples) / rate_hz,
        1 / rate_hz,
    )


def _of_steps(samples: FloatArray, slow: int) -> float:
    """Noise [N^2] by steps of quantisation: an error lasts as long as a value does, a slow line at most."""
    steps = np.abs(np.diff(samples))
    changes = int(np.count_nonzero(steps))
    if not changes:
        return 0.0
    smallest = float(steps[steps > 0].min())
    return smallest**2 / 12 * min(len(samples) / changes, len(samples) / slow)
