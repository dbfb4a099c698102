"""The noise of every kind of test as it is before the hit, where no model can be wrong.

Noise of a channel has the spectrum S = G Q G^H + R per second of record: ambient forces Q(f) through the
structure's transfer G, and sensor noise R. Both come from what precedes the hits
(`rom.identification.ambient_noise`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.ambient_noise import ambient_forces, sensor_noise, share_left, whitener
from rom.identification.record_spectra import HIGHEST_HZ
from rom.identification.small_matrices import root_of
from rom.identification.spectral_model import (
    ComplexArray,
    FloatArray,
    Linearised,
    SpectralRecord,
    linearise,
    spectrum,
    transfer,
)
from rom.signals.processing import Measurement

Group = tuple[str, tuple[str, ...]]
_MARGIN_S: Numerical[float] = 0.02  # before a hit: what is later is not quiet
_MARGIN_SHARE: Numerical[float] = 0.1  # of the time before the hit, where that is brief
_SHORTEST_S: Numerical[float] = 0.2  # that tells a spectrum
_SHORTEST_PERIODS: Numerical[float] = 2.0  # of the strongest line, where that is brief


@dataclass(frozen=True)
class NoiseDensity:
    """Power densities of sensor noise R, (channels,), and of ambient forces Q, (lines, bodies, bodies)."""

    bodies: tuple[str, ...]
    sensor: FloatArray
    frequency: FloatArray
    ambient: ComplexArray

    def raised(self, factor: float) -> NoiseDensity:
        """Return the same with all powers so many times as large."""
        return replace(self, sensor=self.sensor * factor, ambient=self.ambient * factor)

    def whitener(self, record: SpectralRecord, values: Mapping[str, float], seconds: float) -> ComplexArray:
        """Return S^-1/2 at the lines of a record's spectra over so many seconds.

        Parameters
        ----------
        record : SpectralRecord
            The record.
        values : mapping of str to float
            Values by name.
        seconds : float
            Length of the record [s].

        Returns
        -------
        ndarray
            Shape (lines, channels, channels).
        """
        nearest = np.clip(np.searchsorted(self.frequency, record.frequency), 0, len(self.frequency) - 1)
        gain, root = transfer(record, values), self._root[nearest] * np.sqrt(seconds / 2)
        return whitener(gain, root, self.sensor * seconds / 2)

    @cached_property
    def _root(self) -> ComplexArray:
        return root_of(self.ambient)


@dataclass(frozen=True)
class Quiet:
    """What a record shows where nothing but noise is expected: its motion less any part that is explained.

    ``share`` of the noise is left at every line.
    """

    group: Group
    left_over: Linearised
    frequency: FloatArray
    seconds: float
    share: FloatArray

    def between(self, first: int, end: int) -> Quiet:
        """Return the same with some of its lines."""
        lines = slice(first, end)
        left_over = replace(
            self.left_over, unweighted=self.left_over.unweighted[lines], gain=self.left_over.gain[lines]
        )
        return replace(self, left_over=left_over, frequency=self.frequency[lines], share=self.share[lines])


def segment_before_hit(
    measurement: Measurement,
    bodies: Sequence[str],
    like: SpectralRecord,
    force: FloatArray,
    highest_hz: float = HIGHEST_HZ,
) -> SpectralRecord:
    """Return the spectra of a record's first samples, as many as ``force`` (samples, bodies) [N] has.

    The force acts all the time, such as that of a ground that moves; no hammer has struck yet.

    Parameters
    ----------
    measurement : Measurement
        The record as processed.
    bodies : sequence of str
        Bodies whose motion is used.
    like : SpectralRecord
        The record's spectra after the hit, whose terms are taken.
    force : ndarray, shape (samples, bodies)
        Force [N].
    highest_hz : float
        Highest frequency [Hz].

    Returns
    -------
    SpectralRecord
        Spectra of the first samples.

    Raises
    ------
    ValueError
        Where there are no such samples.
    """
    if not len(force):
        found = "no hit" if measurement.impact_s is None else f"a hit after {measurement.impact_s:.3g} s"
        raise ValueError(
            f"noise is told by at least {_SHORTEST_S + _MARGIN_S:g} s, or two periods of the strongest "
            "line, before the hit in every record that moves, found less "
            f"({measurement.file}: {found}): record a longer pre-trigger, or leave "
            "records that are hit sooner out of the campaign"
        )
    motion = np.stack([measurement.motion[body].samples[: len(force)] for body in bodies], axis=1)
    band = (measurement.chain.cutoff_hz, min(highest_hz, 0.4 * measurement.rate_hz))
    frequency, lines = spectrum(motion - motion.mean(axis=0), measurement.rate_hz, band)
    driving = spectrum(force, measurement.rate_hz, band)[1]
    return SpectralRecord(
        like.file, "before", frequency, driving, lines, like.orders, like.terms, like.local,
        samples=(0, len(force)), step_s=1 / measurement.rate_hz,
    )  # fmt: skip


def before_hit(
    measurement: Measurement,
    bodies: tuple[str, ...],
    like: SpectralRecord,
    values: Mapping[str, float],
    force: FloatArray,
    highest_hz: float = HIGHEST_HZ,
) -> Quiet:
    """Return the motion of a record's first samples less what a force makes of it, end states projected out.

    See `segment_before_hit`.

    Parameters
    ----------
    measurement : Measurement
        The record as processed.
    bodies : sequence of str
        Bodies whose motion is used.
    like : SpectralRecord
        The record's spectra after the hit, whose terms are taken.
    values : mapping of str to float
        Values by name.
    force : ndarray, shape (samples, bodies)
        Force [N].
    highest_hz : float
        Highest frequency [Hz].

    Returns
    -------
    Quiet
        What is left over, at the lines of its spectra.
    """
    segment = segment_before_hit(measurement, bodies, like, force, highest_hz)
    quiet = linearise(segment, values, _plain(segment.motion))
    return Quiet(
        (measurement.test, bodies),
        quiet,
        segment.frequency,
        len(force) / measurement.rate_hz,
        share_left(quiet),
    )


def quiet_seconds(measurements: Sequence[Measurement]) -> float:
    """Return how long all records of a kind are quiet before the hit [s]; zero where that is too short."""
    longest = min((before_margin(m.impact_s or 0.0) for m in measurements), default=0.0)
    return longest if all(is_quiet_enough(m.impact_s or 0.0, m.strongest_hz) for m in measurements) else 0.0


def before_margin(impact_s: float) -> float:
    """Return the time [s] up to which a record is quiet before its hit."""
    return impact_s - min(_MARGIN_S, _MARGIN_SHARE * impact_s)


def is_quiet_enough(impact_s: float, strongest_hz: float | None) -> bool:
    """Return whether the time before a hit tells the noise's spectrum."""
    fast = _SHORTEST_PERIODS / strongest_hz if strongest_hz else _SHORTEST_S
    return before_margin(impact_s) >= min(_SHORTEST_S, fast)


def noise_floors(quiet: Sequence[Quiet]) -> Mapping[Group, NoiseDensity]:
    """Return the floor of every group; ambient forces of a body come from a group of quiet sensors."""
    groups: dict[Group, list[Quiet]] = {}
    for one in quiet:
        groups.setdefault(one.group, []).append(one)
    members = {group: _alike(ones) for group, ones in groups.items()}
    sensors = {
        group: sensor_noise([one.left_over for one in ones]) / ones[0].seconds
        for group, ones in members.items()
    }
    found = {}
    for group in members:
        place, source = _source(group, sensors, {other: len(ones) for other, ones in members.items()})
        ones = members[source]
        ambient = ambient_forces(
            ones[0].frequency,
            [one.left_over for one in ones],
            sensors[source] * ones[0].seconds,
            [one.share for one in ones],
        )
        density = ambient[:, place][:, :, place] / ones[0].seconds
        found[group] = NoiseDensity(group[1], sensors[group], ones[0].frequency, density)
    return found


def _alike(quiet: Sequence[Quiet]) -> list[Quiet]:
    """Return the same with the lines that all of them have: each is filtered for its own first mode."""
    lowest = max(one.frequency[0] for one in quiet)
    first = [int(np.argmin(np.abs(one.frequency - lowest))) for one in quiet]
    count = min(len(one.frequency) - at for one, at in zip(quiet, first, strict=True))
    return [one.between(at, at + count) for one, at in zip(quiet, first, strict=True)]


def _source(
    group: Group, sensors: Mapping[Group, FloatArray], counts: Mapping[Group, int]
) -> tuple[list[int], Group]:
    """Return the group whose ambient forces serve, and the places of the bodies in it.

    Of those with nearly the quietest sensors the one of most records: a spectrum wants many means.
    """
    able = {other: float(np.max(sensors[other])) for other in sensors if set(group[1]) <= set(other[1])}
    quiet = [other for other, noise in able.items() if noise <= RULES.quiet_sensors * min(able.values())]
    best = max(quiet, key=lambda other: (counts[other], other == group))
    return [best[1].index(body) for body in group[1]], best


def _plain(lines: ComplexArray) -> ComplexArray:
    return np.tile(np.eye(lines.shape[1], dtype=np.complex128), (len(lines), 1, 1))
