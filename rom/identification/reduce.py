"""What an identification keeps of a raw record: spectra, modal estimates, tensions; one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from scipy import ndimage

from rom.campaign.campaign import Campaign, CampaignSettings, Record, RecordSettings
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.frequency_response import (
    Estimate,
    FrequencyResponse,
    Mode,
    fit_modes,
    frequency_response,
)
from rom.identification.gamma_per_case import LooseningCase
from rom.identification.modal import average_period_frequency, logarithmic_decrement
from rom.identification.record_spectra import LINEAR_TESTS, spectral_records
from rom.identification.spectral_model import SpectralRecord
from rom.model.effect import SensorFault
from rom.progress import Progress, counted
from rom.signals.measured_records import MeasuredRecord, measured_record
from rom.signals.motion import loss_factor
from rom.signals.processing import Measurement, TensionRecord, driven_displacement
from rom.signals.quality import Doubt
from rom.signals.sensor_correction import without_faults
from rom.signals.tension_bins import CourseNoise, TensionBins, TensionCourse, bins_after_hit, bins_before_hit

_PERIOD_MARGIN: Numerical[float] = (
    17.0 / 15.78
)  # the paper drops what lies above 17 Hz, its first mode being at most 15.78 Hz
_LONGEST_PERIOD: Numerical[float] = 1.5  # of that of the strongest line: half-way to a peak that is missing
_SMOOTH_S: Numerical[float] = 0.01
_SHORTEST_LOSS_S: Numerical[float] = 0.02
_LONGEST_LOSS_S: Numerical[float] = 1.0


@dataclass(frozen=True)
class FirstMode:
    """First mode of a coupled record: average period and logarithmic decrement (Section 3.2)."""

    frequency: Estimate
    damping_ratio: Estimate


@dataclass(frozen=True, eq=False)
class UncoupledTest:
    """One body without the bolt: measured frequency response and its rational-fraction fit (Section 3.1)."""

    file: str
    body: str
    response: FrequencyResponse
    mode: Mode


@dataclass(frozen=True)
class Tensions:
    """Initial and final tension of a record [N] with standard errors, and the calibration's slope there."""

    initial: float
    final: float
    initial_error: float
    final_error: float
    slope: float


@dataclass(frozen=True, eq=False)
class ReducedRecord:
    """What is kept of one record.

    `force` runs from the record's start to the end of the final window: what a re-simulation needs.
    """

    settings: RecordSettings
    doubts: tuple[Doubt, ...] = ()
    warnings: tuple[str, ...] = ()
    cutoff_hz: float | None = None
    spectra: tuple[SpectralRecord, ...] = ()
    first_mode: FirstMode | None = None
    uncoupled: UncoupledTest | None = None
    tensions: Tensions | None = None
    impact_s: float | None = None
    bins: TensionBins | None = None
    bins_before: TensionBins | None = None
    struck: str = ""
    force: FloatArray | None = None
    rate_hz: float = 0.0
    link: tuple[tuple[str, float, float], ...] = ()


def reduce_records(
    campaign: Campaign,
    records: Sequence[RecordSettings],
    jobs: int = 1,
    progress: Progress | None = None,
    faults: Sequence[SensorFault] = (),
) -> Iterator[ReducedRecord]:
    """Reduce records one by one, in order, over `jobs` processes; the numbers do not depend on `jobs`.

    Faults of sensors that are known are taken out.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    records : sequence of RecordSettings
        Settings of the records.
    jobs : int
        Number of processes; numbers do not depend on it.
    progress : callable
        Called with the number of records done and their total.
    faults : sequence of SensorFault
        Faults of sensors that are known and taken out.

    Returns
    -------
    Iterator
        In the order of the records.
    """
    tasks = (delayed(reduce_record)(campaign, record, faults) for record in records)
    results = Parallel(n_jobs=jobs, return_as="generator", pre_dispatch="2*n_jobs")(tasks)
    yield from counted(results, len(records), progress)


def reduce_record(
    campaign: Campaign, record_settings: RecordSettings, faults: Sequence[SensorFault] = ()
) -> ReducedRecord:
    """Read one record and keep what an identification needs.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    record_settings : RecordSettings
        The record's settings.
    faults : sequence of SensorFault
        Faults of sensors that are known and taken out.

    Returns
    -------
    ReducedRecord
        The reduced record.
    """
    found = measured_record(campaign, record_settings)
    if found.doubts:
        return ReducedRecord(record_settings, found.doubts)
    return reduce_sound(found, campaign, faults)


def reduce_sound(
    found: MeasuredRecord, campaign: Campaign, faults: Sequence[SensorFault] = ()
) -> ReducedRecord:
    """Keep what an identification needs of one record without a doubt.

    Parameters
    ----------
    found : MeasuredRecord
        The record, processed and assessed.
    campaign : Campaign
        The campaign.
    faults : sequence of SensorFault
        Faults of sensors that are known and taken out.
    """
    settings = campaign.settings
    measurement = without_faults(found.measurement, faults)
    tension = measurement.tension
    struck = max(measurement.force, key=lambda body: float(np.abs(measurement.force[body]).max()), default="")
    linear = measurement.test in LINEAR_TESTS or (
        measurement.test == "loosening" and not _has_linear(campaign)
    )
    return ReducedRecord(
        found.settings,
        warnings=() if tension is None else (*tension.warnings, *_slack(measurement, tension)),
        cutoff_hz=measurement.chain.cutoff_hz if measurement.motion else None,
        spectra=_spectra(measurement, settings) if linear and measurement.motion else (),
        first_mode=_first_mode(measurement) if measurement.test == "coupled" else None,
        uncoupled=_uncoupled(measurement, found.raw) if measurement.test == "uncoupled" else None,
        tensions=None if tension is None else _tensions(tension),
        impact_s=measurement.impact_s,
        bins=bins_after_hit(measurement, settings),
        bins_before=bins_before_hit(measurement),
        struck=struck,
        force=_force(measurement, settings, struck) if measurement.test == "loosening" else None,
        rate_hz=measurement.rate_hz,
        link=_link_constants(measurement, settings) if measurement.test == "cycled" else (),
    )


def _slack(measurement: Measurement, tension: TensionRecord) -> Iterator[str]:
    """Yield a line for a loosening test whose bolt is slack before the hit, if its gauge is right."""
    if measurement.test == "loosening" and tension.initial <= 0:
        yield (
            f"{measurement.file}: the gauge shows {tension.initial:.3g} N before the hit: a slack bolt "
            "tells of no loosening, and a gauge that shows one may have a wrong zero"
        )


def loosening_cases(records: Sequence[ReducedRecord]) -> tuple[LooseningCase, ...]:
    """Return the cases for gamma with the standard error of their losses."""
    with_tension = [r for r in records if r.tensions is not None and r.settings.test != "hold"]
    noise = _loss_noise(with_tension)
    return tuple(
        LooseningCase(r.settings.file, r.struck, r.force, r.rate_hz, r.tensions.initial,
                      max(r.tensions.final, noise * r.tensions.slope), noise * r.tensions.slope,
                      r.settings.given)
        for r in with_tension
        if r.tensions is not None and r.force is not None and r.struck and r.tensions.initial > 0
    )  # fmt: skip


def _loss_noise(records: Sequence[ReducedRecord]) -> float:
    """Return the standard error of a measured loss in the unit of the strain, drift included.

    Coupled tests leave the tension alone, so what they seem to lose is that error; where they are few, batch
    means of the windows stand in, which do not see the drift between them.
    """
    scale = [(r.tensions, r.settings.test) for r in records if r.tensions is not None]
    quiet = np.array([(t.initial - t.final) / t.slope for t, test in scale if test == "coupled"])
    if len(quiet) >= RULES.quiet_cases:
        return float(np.sqrt(np.mean(quiet**2)))
    batch = [np.hypot(t.initial_error, t.final_error) / t.slope for t, _ in scale]
    return float(np.median(batch)) if batch else 0.0


def tension_courses(
    records: Sequence[ReducedRecord], noise: CourseNoise | None, settings: CampaignSettings
) -> tuple[TensionCourse, ...]:
    """Return the course of the tension of every loosening record that holds one, with its covariance.

    Not of a bolt that its gauge shows slack before the hit: that has nothing to lose.

    Parameters
    ----------
    records : sequence of ReducedRecord
        The records.
    noise : CourseNoise
        Noise of the tension; None where it is not known.
    settings : CampaignSettings
        Settings of the campaign.

    Returns
    -------
    tuple
        One for each loosening record.
    """
    found = []
    for record in records:
        bins, tensions, force, impact_s = record.bins, record.tensions, record.force, record.impact_s
        if noise is None or bins is None or tensions is None or force is None or impact_s is None:
            continue
        if tensions.initial <= 0:
            continue
        covariance = noise.covariance(bins)
        preload = record.settings.preload_n
        found.append(
            TensionCourse(
                file=record.settings.file,
                hold_out=record.settings.hold_out,
                preload=tensions.initial if preload is None else preload,
                body=record.struck,
                force=force,
                rate_hz=record.rate_hz,
                impact_s=impact_s,
                initial=tensions.initial,
                edges_s=bins.edges_s,
                change=bins.change,
                covariance=covariance,
                tension_rate_hz=bins.rate_hz,
                final_window=settings.windows.final_s,
                final=tensions.final,
                final_error=float(np.sqrt(covariance[-1, -1])),
                given=record.settings.given,
            )
        )
    return tuple(found)


def _spectra(measurement: Measurement, settings: CampaignSettings) -> tuple[SpectralRecord, ...]:
    """Return the spectra; of a bolt that loosens, from the ringing after its loss if all masses are known."""
    tension, start = measurement.tension, None
    loosens = measurement.test == "loosening" and all(body.mass_kg is not None for body in settings.body)
    if loosens and tension is not None and abs(tension.loss) > RULES.small_loss * abs(tension.initial):
        start = _settled(tension, measurement.impact_s or 0.0, loss_factor(measurement.strongest_hz))
    return spectral_records(measurement, settings, start_s=start)


def _settled(tension: TensionRecord, impact_s: float, times: float) -> float:
    """Return when [s] the tension after a hit has come within 1 % of the final one, or within its noise."""
    rate = times * tension.rate_hz
    smooth = ndimage.uniform_filter1d(tension.samples, max(1, int(_SMOOTH_S * rate)))
    first = int(impact_s * tension.rate_hz + _SHORTEST_LOSS_S * rate)
    noise = float(np.std(smooth[-(len(smooth) // 4) :]))
    window = smooth[first : first + int(_LONGEST_LOSS_S * rate)]
    off = np.flatnonzero(
        np.abs(window - tension.final) > max(RULES.small_loss * abs(tension.final), 4 * noise)
    )
    return (first + (int(off[-1]) + 1 if len(off) else 0)) / tension.rate_hz


def _has_linear(campaign: Campaign) -> bool:
    """Return whether records other than loosening ones tell the joint's curves."""
    return len(campaign.select(("coupled", "free", "driven"), hold_out=False)) >= RULES.enough_linear


def _tensions(tension: TensionRecord) -> Tensions:
    return Tensions(tension.initial, tension.final, tension.initial_error, tension.final_error, tension.slope)


def _force(measurement: Measurement, settings: CampaignSettings, struck: str) -> FloatArray | None:
    if not struck:
        return None
    force = measurement.applied_force[struck]
    return force[: int(min(settings.windows.final_s[1] * measurement.rate_hz, len(force)))].copy()


def _first_mode(measurement: Measurement) -> FirstMode | None:
    """Return average-period frequency and decrement of the struck body's motion, None where there are too few
    peaks.
    """
    strongest = measurement.strongest_hz
    if strongest is None or measurement.impact_s is None or not measurement.force:
        return None
    body = max(measurement.force, key=lambda name: float(np.abs(measurement.force[name]).max()))
    if body not in measurement.motion:
        return None
    displacement = measurement.displacement(body)
    highest, lowest = _PERIOD_MARGIN * strongest, strongest / _LONGEST_PERIOD
    start = measurement.impact_s
    try:
        return FirstMode(
            average_period_frequency(
                displacement, measurement.rate_hz, max_hz=highest, start_s=start, min_hz=lowest
            ),
            logarithmic_decrement(
                displacement,
                measurement.rate_hz,
                max_hz=highest,
                start_s=start + 1 / measurement.chain.cutoff_hz,  # as far as the high-pass reaches
                first_peak=1,
                min_hz=lowest,
            ),
        )
    except ValueError:
        return None


def _uncoupled(measurement: Measurement, raw: Record | None) -> UncoupledTest | None:
    """Return the frequency response of a body alone and its single mode; None where body, force or peak is
    missing.
    """
    bodies = [body for body in measurement.motion if body in measurement.force]
    strongest = measurement.strongest_hz
    if len(bodies) != 1 or strongest is None or raw is None:
        return None
    body = bodies[0]
    motion = measurement.motion[body]
    force = raw.force(body)
    if force is None or len(force.samples) != len(motion.samples):
        return None
    try:
        response = frequency_response(force.samples, motion.samples, measurement.rate_hz, motion.kind)
        mode = fit_modes(response, 1, (0.7 * strongest, 1.4 * strongest))[0]
    except ValueError:
        return None
    return UncoupledTest(measurement.file, body, response, mode)


def _link_constants(
    measurement: Measurement, settings: CampaignSettings
) -> tuple[tuple[str, float, float], ...]:
    """Return (link, k, c) of F = k x + c v by least squares for every link driven on its own."""
    out = []
    for link in settings.link:
        force = measurement.link.get(f"link_force_{link.name}")
        motion = measurement.link.get(f"link_displacement_{link.name}")
        if force is None or motion is None:
            continue
        displacement = driven_displacement(motion)
        velocity = np.gradient(displacement, 1 / motion.rate_hz)
        columns = [velocity] if link.law == "dashpot" else [displacement, velocity]
        values = np.linalg.lstsq(np.stack(columns, axis=1), force.samples, rcond=None)[0]
        out.append((link.name, 0.0 if link.law == "dashpot" else float(values[0]), float(values[-1])))
    return tuple(out)


def common_cutoffs(records: Sequence[ReducedRecord]) -> dict[str, float]:
    """Return the lowest cutoff [Hz] of every kind of test: what every record of that kind can pass."""
    found: dict[str, float] = {}
    for record in (one for one in records if one.cutoff_hz is not None):
        test = str(record.settings.test)
        found[test] = min(record.cutoff_hz or np.inf, found.get(test, np.inf))
    return found
