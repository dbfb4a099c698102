"""The motion that was measured in every record, with the model's help, and the tension beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from scipy import fft, ndimage

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.criteria.motion import Motion
from discovery.residual.free_parameters import FreeParameters
from rom.campaign.campaign import Campaign, RecordSettings
from rom.campaign.channels import MOTIONS, FloatArray
from rom.campaign.settings import CampaignSettings
from rom.criteria.number import Numerical
from rom.effects import SensorFault
from rom.evaluation.replay import Replay, replay
from rom.identification.gamma_per_case import LooseningCase, matching_factors, matching_gammas, own_rate
from rom.identification.noise_spectrum import Group
from rom.identification.record_spectra import HIGHEST_HZ, STRIDES, spectral_records
from rom.identification.spectral_model import CORNER, ComplexArray, SpectralRecord
from rom.model.laws import QUARTIC, power_loosening
from rom.model.model import Model
from rom.progress import Progress, counted
from rom.signals.filters import ac_coupled
from rom.signals.frequency_band import in_band
from rom.signals.measured_records import measured_record
from rom.signals.per_record_parameters import per_record_names
from rom.signals.processing import Measurement
from rom.signals.sensor_correction import faults_of, without_faults

_SAMPLES: Numerical[float] = 4.0  # at a spectrum's highest line: what else folds back is below the noise
_AS_MEASURED: Numerical[float] = 1e-6  # of asinh(gamma): noise tells a loss less closely
_LINES: Numerical[int] = 9  # so many tell the power to a third
_MOTION_TESTS = ("uncoupled", "coupled", "loosening")
Measurements = Sequence[tuple[RecordSettings, Measurement]]
_SPECTRA: WeakKeyDictionary[Measurement, tuple[CampaignSettings, tuple[SpectralRecord, ...]]]
_SPECTRA = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class MeasuredTrajectory:
    """One record: its spectra, and the motion that was measured, integrated with the model's help.

    Attributes
    ----------
    measurement : Measurement
        In single precision, all that converters give: a campaign's are kept side by side. Traces along models
        that correct none of its channels share it.
    displacement, velocity : mapping of str to ndarray
        By body, shape (samples of the motion,) [m], [m/s]; every `stride`-th sample of the record, the first
        one that the spectra cover among them.
    tension : ndarray
        Of the bolted link, shape (samples of the motion,) [N].
    level : float
        Tension at which the linear part of the model is taken [N]: the last one.
    own : mapping of str to mapping of str to float
        Numbers of the model's effects that are this record's own, by path of the effect.
    """

    settings: RecordSettings
    measurement: Measurement
    parts: tuple[SpectralRecord, ...]
    displacement: Mapping[str, FloatArray]
    velocity: Mapping[str, FloatArray]
    tension: FloatArray
    level: float
    stride: int
    own: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    token: object = field(default_factory=object, init=False, repr=False)
    """What tells this record along this motion from all others."""

    def in_double_precision(self) -> Measurement:
        """The measurement in double precision, to calculate with."""
        return self.measurement.as_type(np.float64)

    @property
    def rate_hz(self) -> float:
        """Rate of the motion and of the tension."""
        return self.measurement.rate_hz / self.stride

    @property
    def bodies(self) -> tuple[str, ...]:
        """Moving bodies, in the order of the channels."""
        return tuple(self.displacement)

    @property
    def group(self) -> Group:
        """Kind of test and moving bodies."""
        return self.measurement.test, self.bodies

    def relative(self, ends: tuple[str, str]) -> tuple[FloatArray, FloatArray]:
        """Relative displacement and velocity of two ends; a body that rests counts as ground."""
        still = np.zeros_like(self.tension)
        x, v = (
            motion.get(ends[0], still) - motion.get(ends[1], still)
            for motion in (self.displacement, self.velocity)
        )
        return x, v

    def direction(self, ends: tuple[str, str]) -> FloatArray:
        """What a link's force does to the bodies, (bodies,): it pulls the first end back."""
        signs = dict(zip(reversed(ends), (1.0, -1.0), strict=True))
        return np.array([signs.get(body, 0.0) for body in self.bodies])

    def force_lines(self, forces: FloatArray, place: int) -> ComplexArray:
        """Spectra of forces along the motion, (forces, samples), at the lines of a part, (forces, lines).

        Lines of samples that end elsewhere than they began depend on the step: those of a ramp with the same
        ends are taken off, and added again with the record's own step, which the measured spectra have.
        """
        part, rate, stride = self.parts[place], self.measurement.rate_hz, self.stride
        first, last = (sample // stride for sample in part.samples)
        lines = _lines(forces[:, first:last], rate / stride, part)
        if stride > 1:
            after = min(last, forces.shape[1] - 1)
            end = forces[:, last] if last == after else 3 * forces[:, -1] - 3 * forces[:, -2] + forces[:, -3]
            lines += np.multiply.outer(end - forces[:, first], self._ramps[place])
        return lines

    @cached_property
    def _ramps(self) -> tuple[ComplexArray, ...]:
        """By part, what a ramp's lines differ by between the record's step and that of the motion."""
        rate, stride = self.measurement.rate_hz, self.stride
        return tuple(_ramp(p.frequency, stride / rate) - _ramp(p.frequency, 1 / rate) for p in self.parts)

    def lines(self, samples: FloatArray, part: SpectralRecord) -> ComplexArray:
        """Spectrum of samples of the record at the lines of a part."""
        first, last = part.samples
        return np.asarray(_lines(samples[None, first:last], self.measurement.rate_hz, part)[0])


def _lines(samples: FloatArray, rate_hz: float, part: SpectralRecord) -> ComplexArray:
    """Fourier integrals of rows of samples at the lines of a part."""
    lowest = round(float(part.frequency[0]) * samples.shape[1] / rate_hz)
    spectra = fft.rfft(samples, axis=1)[:, lowest : lowest + len(part.frequency)]
    return np.asarray(spectra / rate_hz, dtype=np.complex128)


def _ramp(frequency: FloatArray, step_s: float) -> ComplexArray:
    """Fourier sums of samples that fall evenly by one, at lines that are whole periods of them."""
    return np.asarray(step_s / (1 - np.exp(-2j * np.pi * frequency * step_s)))


def read_measurements(campaign: Campaign, set_aside: Collection[str] = ()) -> Measurements:
    """Read the uncoupled, coupled and loosening records, held-out ones too, without those set aside."""
    records = [settings for settings in campaign.select(_MOTION_TESTS) if settings.file not in set_aside]
    read = (measured_record(campaign, settings).measurement for settings in records)
    return [(s, replace(one.as_type(np.float32), link={})) for s, one in zip(records, read, strict=True)]


def trace_records(
    campaign: Campaign,
    baseline: FreeParameters,
    measurements: Measurements,
    progress: Progress | None = None,
    criteria: Criteria = CRITERIA,
) -> tuple[MeasuredTrajectory, ...]:
    """Run records again with the model, its tension falling as it was measured to fall.

    Parameters
    ----------
    campaign : Campaign
        Its settings.
    baseline : FreeParameters
        The model.
    measurements : sequence
        The records, as `read_measurements` has them.
    progress : callable
        Called as ``progress(done, total)``.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    tuple of MeasuredTrajectory
        Without the records that the model cannot simulate.
    """
    stored_ones = [stored for _, stored in measurements]
    own = own_models(baseline.model, stored_ones, campaign.settings.windows.final_s, criteria.motion)
    traces = []
    for settings, stored in counted(measurements, len(measurements), progress):
        given = stored.as_type(np.float64)
        run = replay(own.get(settings.file, baseline.model), given)
        if run.response.status == "ok":
            kept = stored if run.measurement is given else run.measurement.as_type(np.float32)
            traces.append(_traced(campaign, baseline, settings, run, kept, criteria))
    return tuple(traces)


def _traced(
    campaign: Campaign,
    baseline: FreeParameters,
    settings: RecordSettings,
    run: Replay,
    stored: Measurement,
    criteria: Criteria,
) -> MeasuredTrajectory:
    seen, response = run.measurement, run.response
    tension = np.asarray(response.tension) if isinstance(response.tension, np.ndarray) else np.zeros(0)
    tension = tension if tension.size else np.zeros(seen.samples)
    if seen.test == "loosening" and seen.tension is not None:
        tension = _ending_as_measured(tension, seen.tension.final, criteria.motion.final_share)
    parts = _spectra(campaign, seen, stored)
    level = float(tension[-1])
    values = baseline.values(parts[0], level)
    bodies = [body for body in campaign.settings.body_names if body in seen.motion]
    # motion and effects go beyond a declared band, and must not fold back into it
    highest = max(part.frequency[-1] for part in parts)
    highest = highest if campaign.settings.band is None else max(highest, HIGHEST_HZ)
    stride = _stride(parts, seen.rate_hz, highest)
    kept = slice(parts[0].samples[0] % stride, None, stride)
    displacement, velocity, fewest = {}, {}, criteria.motion.quiet_samples
    for body in bodies:
        moves = _motion_of(seen, run, body, values, fewest)
        displacement[body], velocity[body] = (m[kept].copy() for m in moves)
    return MeasuredTrajectory(
        settings, stored, parts, displacement, velocity, tension[kept].copy(), level, stride, _own(run.model)
    )


def _spectra(campaign: Campaign, seen: Measurement, stored: Measurement) -> tuple[SpectralRecord, ...]:
    """Spectra of a record, which are worked out once for all models that correct none of its channels."""
    settings, parts = _SPECTRA.get(stored, (None, ()))
    if settings is not campaign.settings:
        parts = spectral_records(seen, campaign.settings)
        _SPECTRA[stored] = campaign.settings, parts
    return parts


def _ending_as_measured(tension: FloatArray, final: float, least: float) -> FloatArray:
    """Stretch a course that ends at the least share of its start, as no rate is told, to its end."""
    fallen = tension[0] - tension[-1]
    if final >= least * tension[0] or fallen <= 0:
        return tension
    return np.asarray(tension[0] - (tension[0] - max(final, 0.0)) / fallen * (tension[0] - tension))


def _own(model: Model) -> dict[str, dict[str, float]]:
    """Numbers of a record's own in the model as it is in that record."""
    return {
        effect.path: {name: effect.parameters[name].value for name in per_record_names(effect)}
        for effect in model.effects
        if effect.kind == "force" and per_record_names(effect)
    }


def _stride(parts: Sequence[SpectralRecord], rate_hz: float, highest_hz: float) -> int:
    """Distance of the samples that forces need to be told at, for the spectra to have their lines."""
    most = rate_hz / (_SAMPLES * highest_hz)
    fits = [n for n in STRIDES if n <= most and all((b - a) % n == 0 for a, b in (p.samples for p in parts))]
    return max(fits, default=1)


def simulated_channel(run: Replay, body: str, values: Mapping[str, float]) -> FloatArray:
    """Return a body's simulated motion as its sensor shows it, AC coupled with the corner among ``values``.

    A simulation takes a force that is sharper than its samples, since it joins them by straight lines
    (`rom.signals.filters.for_straight_lines`). Of the acceleration at the samples that is taken off again.

    Parameters
    ----------
    run : Replay
        A record simulated again.
    body : str
        One of its moving bodies.
    values : mapping of str to float
        Values of the record's terms.

    Returns
    -------
    ndarray, shape (samples,)
        In the unit of the channel.
    """
    kind = run.measurement.motion[body].kind
    simulated = np.asarray(getattr(run.response, kind)[body])
    if kind != "acceleration":
        return simulated
    if body in run.measurement.force:
        sharper = run.measurement.applied_force[body] - run.measurement.force[body]
        simulated = simulated - sharper / next(b.mass for b in run.model.structure.bodies if b.name == body)
    corner = next((values[name] for name in values if name.startswith(CORNER)), 0.0)
    return ac_coupled(simulated, run.measurement.rate_hz, corner)


def _motion_of(
    seen: Measurement, run: Replay, body: str, corners: Mapping[str, float], fewest: float
) -> tuple[FloatArray, FloatArray]:
    """Displacement and velocity: the model's, and what the sensor shows beyond it, integrated."""
    motion, response = seen.motion[body], run.response
    simulated = simulated_channel(run, body, corners)
    beyond = in_band(motion.samples - simulated, seen.rate_hz, seen.chain.band_hz)
    quiet = beyond[: max(int((seen.impact_s or 0.0) * 0.8 * seen.rate_hz), 1)]
    beyond = quiet.mean() + _above_noise(beyond - quiet.mean(), quiet - quiet.mean(), fewest)
    x, v, rate = response.displacement[body], response.velocity[body], seen.rate_hz
    if motion.kind == "displacement":
        return x + beyond, v + np.gradient(beyond, 1 / rate)
    integral = seen.chain.integrated(beyond - quiet.mean(), rate, 1)
    if motion.kind == "velocity":
        return x + integral, v + beyond
    return x + seen.chain.once_more(integral, rate), v + integral


def _above_noise(samples: FloatArray, quiet: FloatArray, fewest: float) -> FloatArray:
    """What samples show beyond the noise that ``quiet`` has, by Wiener's filter max(0, 1 - 2 N / S).

    Forces of a stiff gap or a slider along a motion with all its noise would be mostly noise. N is white, the
    median line of what is quiet: neither the mains nor a mode that rings raise it. S is a mean of lines.
    """
    if len(quiet) < fewest:
        return samples
    noise = float(np.median(np.abs(fft.rfft(quiet)[1:]) ** 2)) / np.log(2) / len(quiet) * len(samples)
    lines = fft.rfft(samples)
    power = np.maximum(ndimage.uniform_filter1d(np.abs(lines) ** 2, _LINES, mode="nearest"), 1e-300)
    return np.asarray(fft.irfft(np.maximum(1 - 2 * noise / power, 0.0) * lines, len(samples)))


def falling_as(model: Model, other: Model) -> Model:
    """The model whose tension falls by the law of another, with that one's changes of it."""
    law = other.link_laws[other.structure.bolted_links[0]].tension_rate
    bare = model.without_effects_of("reading", "law change")
    falling = bare if law is None else bare.with_tension_law(law)
    return replace(falling, effects=(*falling.effects, *other.effects_of("law change")))


def own_models(
    model: Model, measurements: Sequence[Measurement], window_s: tuple[float, float], criteria: Motion
) -> dict[str, Model]:
    """Return a model for every loosening record whose own rate lets its tension fall as measured.

    By ``gamma |v|^4 T`` where little is lost; by a factor on its law where more is, where the law is another
    one, or a change of it was found.

    Parameters
    ----------
    model : Model
        Its effects among them.
    measurements : sequence of Measurement
        Records in single precision.
    window_s : tuple of float
        Window of the final tension [s].
    criteria : Motion
        The numbers that decide.

    Returns
    -------
    dict of str to Model
        By file.
    """
    if len(model.structure.bolted_links) != 1:
        return {}
    faults, cases = [fault for fault in faults_of(model) if _is_of_course(fault)], []
    for one in (without_faults(stored.as_type(np.float64), faults) for stored in measurements):
        tension = one.tension
        if one.test != "loosening" or tension is None or not one.force or tension.initial <= 0:
            continue  # a slack bolt stays slack
        body = max(one.force, key=lambda name: float(np.abs(one.force[name]).max()))
        final = max(tension.final, criteria.final_share * tension.initial)
        cases.append(
            LooseningCase(one.file, body, one.applied_force[body], one.rate_hz, tension.initial, final,
                          max(tension.final_error, 1e-3), one.given)
        )  # fmt: skip
    read = model.without_effects_of("reading")
    law = model.link_laws[model.structure.bolted_links[0]].tension_rate
    other = bool(read.effects_of("law change")) or (law is not None and law.name not in QUARTIC)
    own: dict[str, Model] = {}
    much: list[LooseningCase] = []
    little: list[LooseningCase] = []
    for case in cases:
        falls = other or case.final < (1 - criteria.small_loss) * case.initial
        (much if falls else little).append(case)
    if much:
        factors, failed = matching_factors(read, much, window_s, tolerance=_AS_MEASURED)
        rates = np.where(failed, 1.0, np.maximum(factors, 0.0))
        own |= {c.file: read.with_effect(own_rate(float(r))) for c, r in zip(much, rates, strict=True)}
    if little:
        gammas, _ = matching_gammas(read, little, window_s, tolerance=_AS_MEASURED)
        laws = (power_loosening(max(float(gamma), 0.0)) for gamma in gammas)
        own |= {c.file: read.with_tension_law(one) for c, one in zip(little, laws, strict=True)}
    return own


def _is_of_course(fault: SensorFault) -> bool:
    """Whether a fault, alike in all records, is of what the course of a tension is told by."""
    return not per_record_names(fault) and not fault.channel.startswith(MOTIONS)
