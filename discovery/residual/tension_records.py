"""What is kept of every record's tension: its history in bins after the hit, its samples, and its noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from discovery.courses.frozen_motion import FrozenMotion, freeze
from discovery.courses.motion_grid import times_of
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.criteria.tension import Tension
from rom.campaign.campaign import Campaign, RecordSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Motion
from rom.model.model import Model
from rom.signals.measured_records import measured_record
from rom.signals.motion import loss_factor
from rom.signals.per_record_parameters import own_numbers, per_record_names
from rom.signals.processing import Measurement, TensionRecord, tension_record
from rom.signals.sensor_correction import corrected
from rom.signals.tension_bins import (
    CourseNoise,
    TensionBins,
    TensionCourse,
    bins_after_hit,
    bins_before_hit,
    course_noise,
)

_EARLY_S: Numerical[float] = 0.06
_STILL: Numerical[float] = 1e-3  # of the largest velocity: what comes after loosens nothing
_STILL_STRIDE: Numerical[int] = 8
_MEDIAN_OF_EXPONENTIAL: Numerical[float] = 0.6931


@dataclass(frozen=True, eq=False)
class TensionObservation:
    """A record's tension without the faults and readings that the model knows, and the motion beside it."""

    settings: RecordSettings
    course: TensionCourse
    bins: TensionBins
    before: TensionBins | None
    tension: FloatArray
    rate_hz: float
    displacement: FloatArray
    link_force: FloatArray
    bodies: Mapping[str, FloatArray]
    white: float  # variance of a sample [N^2]
    times: float = 1.0  # factor on the times that are meant for a usual joint


def read_tensions(
    campaign: Campaign, model: Model, jobs: int = 1, criteria: Tension = CRITERIA.tension
) -> tuple[TensionObservation, ...]:
    """Return every coupled and loosening record, held out or not, that has a tension and a hit.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    model : Model
        Its readings and faults of the gauge are taken out.
    jobs : int
        Processes.
    criteria : Tension
        The band of the gauge's noise.

    Returns
    -------
    tuple of TensionObservation
        In the order of the campaign.
    """
    band_hz = criteria.noise_from_hz, criteria.noise_to_hz
    records = [r for r in campaign.settings.record if r.test in ("coupled", "loosening")]
    bare = replace(model, identification=None)
    found = Parallel(n_jobs=jobs)(delayed(_observed)(campaign, record, bare, band_hz) for record in records)
    return tuple(one for one in found if one is not None)


def _observed(
    campaign: Campaign, record: RecordSettings, model: Model, band_hz: tuple[float, float]
) -> TensionObservation | None:
    found = measured_record(campaign, record)
    if found.doubts:
        return None
    measurement = found.measurement.with_cutoff(model.filter_cutoff_hz)
    if measurement.tension is None or measurement.impact_s is None or not measurement.force:
        return None
    measurement, motion = _without_known(measurement, model)
    tension = measurement.tension
    assert tension is not None
    assert measurement.impact_s is not None
    bins = bins_after_hit(measurement, campaign.settings)
    if bins is None or tension.initial <= 0:
        return None
    struck = max(measurement.force, key=lambda body: float(np.abs(measurement.force[body]).max()))
    stop = int(campaign.settings.windows.final_s[1] * measurement.rate_hz)
    preload = tension.initial if record.preload_n is None else record.preload_n
    held = record.test == "coupled"
    course = TensionCourse(
        record.file, record.hold_out, preload, struck, measurement.applied_force[struck][:stop].copy(),
        measurement.rate_hz, measurement.impact_s, tension.initial, bins.edges_s, bins.change,
        np.zeros((0, 0)), tension.rate_hz, campaign.settings.windows.final_s,
        tension.initial if held else tension.final, tension.final_error, record.given,
    )  # fmt: skip
    return TensionObservation(
        record, course, bins, bins_before_hit(measurement), tension.samples, tension.rate_hz,
        motion.displacement, motion.link_force, motion.body_displacement,
        _white(measurement, tension, band_hz), max(loss_factor(measurement.strongest_hz), 1.0),
    )  # fmt: skip


def _without_known(measurement: Measurement, model: Model) -> tuple[Measurement, Motion]:
    """The record as its gauge would show it without what the model knows, and the measured motion."""
    gauge = model.without_effects_of("force")
    if any(per_record_names(effect) for effect in gauge.effects):
        gauge, _ = own_numbers(gauge, measurement, None)
    measurement = corrected(measurement, gauge)
    tension = measurement.tension
    assert tension is not None
    assert tension.windows is not None
    motion = _motion(measurement, tension, gauge)
    readings = gauge.effects_of("reading")
    if not readings:
        return measurement, motion
    samples = tension.samples
    for reading in readings:
        samples = reading.remove(samples, motion)
    cleaned = tension_record(
        samples, tension.rate_hz, tension.windows, impact_s=measurement.impact_s,
        first_mode_hz=measurement.strongest_hz, slope=tension.slope, warnings=tension.warnings,
    )  # fmt: skip
    return replace(measurement, tension=cleaned), motion


def _motion(measurement: Measurement, tension: TensionRecord, model: Model) -> Motion:
    """Measured motion at the samples of the tension; a body that is not measured rests."""
    time = np.arange(len(tension.samples)) / tension.rate_hz
    rate = measurement.rate_hz
    bodies, speeds = {}, {}
    for body in measurement.motion:
        x = measurement.displacement(body)
        at = np.arange(len(x)) / rate
        bodies[body] = np.interp(time, at, x)
        speeds[body] = np.interp(time, at, np.gradient(x, 1 / rate))
    link = next(link for link in model.structure.links if link.law == "bolted")
    still = np.zeros_like(time)
    x, v = (of.get(link.first, still) - of.get(link.second, still) for of in (bodies, speeds))
    laws, held = model.link_laws[link.name], np.maximum(tension.non_oscillatory, 0.0)
    force = laws.stiffness(held) * x + laws.damping(held) * v
    ordered = {body: bodies[body] for body in model.structure.body_names if body in bodies}
    return Motion(time, measurement.impact_s or 0.0, x, np.asarray(force), ordered)


def _white(measurement: Measurement, tension: TensionRecord, band_hz: tuple[float, float]) -> float:
    """Variance of white noise with the density that the tension has before the hit, lines left out."""
    quiet = tension.samples[: int(0.98 * (measurement.impact_s or 0.0) * tension.rate_hz)]
    if len(quiet) < 256:
        quiet = tension.samples[-(len(tension.samples) // 4) :]
    window = np.hanning(len(quiet))
    power = np.abs(np.fft.rfft((quiet - quiet.mean()) * window)) ** 2 / (window**2).sum()
    lines = np.fft.rfftfreq(len(quiet), 1 / tension.rate_hz)
    inside = (lines > band_hz[0]) & (lines < band_hz[1])
    inside = inside if np.any(inside) else lines > 0  # of a very fast or slow structure
    return max(float(np.median(power[inside])) / _MEDIAN_OF_EXPONENTIAL, 1e-18)


@dataclass(frozen=True)
class Drift:
    """A gauge's drift [N/s]: its mean over records, and by how much that of a record differs from it."""

    mean: float
    spread: float


NO_DRIFT = Drift(0.0, 0.0)


def noises(
    records: Sequence[TensionObservation], criteria: Tension = CRITERIA.tension
) -> tuple[CourseNoise, CourseNoise, Drift] | None:
    """Return the noise of courses with a drift that no gauge is free of, with the one that it has, and that.

    From training tests that leave the tension alone. What all of those share is no noise: it is taken out.
    None where there are none, and no time before a hit either.

    Parameters
    ----------
    records : sequence of TensionObservation
        All records.
    criteria : Tension
        Drift that is no finding, and how many tests tell the noise.
    """
    fewest, allowed = int(criteria.quiet_tests), criteria.drift_n_per_s
    quiet = [s for s in records if s.settings.test == "coupled" and not s.settings.hold_out]
    before = [s.before for s in records if s.before is not None and not s.settings.hold_out]
    count = min((len(s.bins.change) for s in quiet), default=0)
    if len(quiet) >= fewest and count:
        shared = np.mean([s.bins.change[:count] for s in quiet], axis=0)
        scale = np.sqrt(len(quiet) / (len(quiet) - 1))
        bins = [_truncated(s.bins, count, scale * (s.bins.change[:count] - shared)) for s in quiet]
    else:
        bins = before
    whole = course_noise(bins, [])
    if whole is None:
        return None
    mean = _shared_drift(before, [s.bins for s in quiet], _drifting(whole, records, allowed), criteria)
    if mean and bins is before:
        own = [replace(one, change=one.change - mean * one.lag_s) for one in before]
        whole = course_noise(own, []) or whole
    steady = _drifting(whole, records, allowed)
    drifting = replace(whole, drift=max(whole.drift, steady.drift))
    return steady, drifting, Drift(mean, allowed * float(np.sqrt(drifting.drift / steady.drift)))


def _drifting(noise: CourseNoise, records: Sequence[TensionObservation], drift: float) -> CourseNoise:
    """The same noise with another drift [N/s]."""
    slope = 1.0 if noise.of_tension else float(np.median([s.bins.slope for s in records]))
    return replace(noise, drift=(drift / slope) ** 2)


def _shared_drift(
    before: Sequence[TensionBins], after: Sequence[TensionBins], noise: CourseNoise, criteria: Tension
) -> float:
    """Drift [N/s] that all records share, drawn towards none as far as chance may have made it.

    Seconds after hits that leave the tension alone tell it far better than what precedes them. But what
    begins with the hit is no drift: where the two differ the time before the hits counts.
    """
    (mean, error), (finer, finer_error) = (
        _mean_slope(bins, noise, int(criteria.quiet_tests)) for bins in (before, after)
    )
    if finer_error < error and abs(finer - mean) <= criteria.agreeing_drifts * np.hypot(error, finer_error):
        mean, error = finer, finer_error
    return mean * max(0.0, 1 - (error / mean) ** 2) if mean else 0.0


def _mean_slope(bins: Sequence[TensionBins], noise: CourseNoise, fewest: int) -> tuple[float, float]:
    """Mean change a second [N/s], weighted by its noise, and its standard error as records scatter."""
    if len(bins) < fewest:
        return 0.0, np.inf
    along = [np.linalg.solve(noise.covariance(one), one.lag_s) for one in bins]
    weights = np.array([float(of @ one.lag_s) for of, one in zip(along, bins, strict=True)])
    slopes = np.array([float(of @ one.change) for of, one in zip(along, bins, strict=True)]) / weights
    mean = float(np.average(slopes, weights=weights))
    count = weights.sum() ** 2 / (weights**2).sum()  # as many of one weight scatter alike
    scatter = float(np.average((slopes - mean) ** 2, weights=weights) / max(count - 1, 1))
    return mean, float(np.sqrt(max(scatter, 1 / weights.sum())))


def _truncated(bins: TensionBins, count: int, change: FloatArray) -> TensionBins:
    edges = bins.edges_s[: count + 1]
    return replace(bins, edges_s=edges, change=change, counts=bins.counts[:count], lag_s=bins.lag_s[:count])


def frozen_of(
    records: Sequence[TensionObservation], noise: CourseNoise, model: Model, criteria: Criteria = CRITERIA
) -> FrozenMotion:
    """Return the motion of all records, frozen, thinned to what a law's course needs.

    Parameters
    ----------
    records : sequence of TensionObservation
        All records.
    noise : CourseNoise
        Noise of their courses.
    model : Model
        Its forces act; changes of the law, readings and faults of the gauge are left out.
    criteria : Criteria
        The numbers that decide; they travel with the motion.

    Returns
    -------
    FrozenMotion
        A case for each record.
    """
    courses = [replace(s.course, covariance=noise.covariance(s.bins)) for s in records]
    moving = model.without_effects_of("law change", "reading", "sensor fault")
    frozen = freeze(replace(moving, identification=None), courses, criteria=criteria)
    return thinned(frozen, [s.settings.test == "coupled" for s in records])


def thinned(frozen: FrozenMotion, small: Sequence[bool]) -> FrozenMotion:
    """Frozen motion with fewer nodes, fewest for small hits, up to the end of the last bin."""
    offsets = frozen.courses[0].edges_s - frozen.courses[0].impact_s
    parts = [_thinned(frozen.of_case(i), offsets, few) for i, few in enumerate(small)]
    starts = np.cumsum([0, *(part.shape[1] for part in parts)])
    apart = frozen.without_cache()  # exposures are integrals between nodes
    return replace(apart, nodes=np.concatenate(parts, axis=1), starts=starts)


def coarse(frozen: FrozenMotion, stride: int) -> FrozenMotion:
    """Frozen motion with one of so many nodes of a case, and its last: enough to compare starts of a fit."""
    parts = [
        part[:, sorted({*range(0, part.shape[1], stride), part.shape[1] - 1})]
        for part in (frozen.of_case(i) for i in range(len(frozen)))
    ]
    starts = np.cumsum([0, *(part.shape[1] for part in parts)])
    return replace(frozen.without_cache(), nodes=np.concatenate(parts, axis=1), starts=starts)


def _thinned(nodes: FloatArray, offsets: FloatArray, small: bool) -> FloatArray:
    """Fewer nodes, fewest for a small hit and at rest; the last one where the last bin ends."""
    index, times, end_s = np.arange(nodes.shape[1]), times_of(offsets), float(offsets[-1])
    time, velocity = nodes[0] / times, np.abs(nodes[2])
    stride = np.where(time < 0.015, 2, np.where(time < _EARLY_S, 4, np.where(time < 0.5, 1, 2)))
    still = np.maximum.accumulate(velocity[::-1])[::-1] < _STILL * velocity.max()
    stride[still] = _STILL_STRIDE
    kept = nodes[:, (index % (stride * (3 if small else 1)) == 0) & (nodes[0] < end_s)]
    return np.concatenate([kept, [[end_s + 1e-3 * times], *kept[1:, -1:]]], axis=1)


def drifted(
    frozen: FrozenMotion,
    records: Sequence[TensionObservation],
    old: CourseNoise,
    new: CourseNoise,
    drift: float,
) -> FrozenMotion:
    """Return the same motion with another noise of the courses, less a drift that all have.

    Parameters
    ----------
    frozen : FrozenMotion
        Motion of all records, with the old noise.
    records : sequence of TensionObservation
        The same records.
    old, new : CourseNoise
        Noise of the courses.
    drift : float
        Of the gauge [N/s].

    Returns
    -------
    FrozenMotion
        With other changes [N] and covariances [N^2].
    """
    bins = frozen.change.shape[1]
    more = [(new.covariance(s.bins) - old.covariance(s.bins))[:bins, :bins] for s in records]
    change = frozen.change - drift * np.stack([s.bins.lag_s[:bins] for s in records])
    return replace(frozen, change=change, covariance=frozen.covariance + np.stack(more))
