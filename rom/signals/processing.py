"""One raw record into what a model is compared with: clean force, motion, and the bolt's tension.

He et al. (2025), Sections 2.1, 2.3 and 2.4. Nothing here knows a model; a simulated response passes through
the same `FilterChain` and the same tension windows before any difference is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft, ndimage, signal

from rom.campaign.campaign import CampaignSettings, Record, WindowSettings
from rom.campaign.channels import BOLT_CHANNELS, Channel, FloatArray
from rom.campaign.channels import Motion as MotionKind
from rom.criteria.number import Numerical
from rom.signals.calibration import Calibration
from rom.signals.decimation import decimate
from rom.signals.filters import (
    FilterChain,
    displacement,
    find_impact,
    for_straight_lines,
    split_tension,
)
from rom.signals.motion import Motion, dominant_frequency

IMPACT_TESTS = ("uncoupled", "coupled", "loosening")
CUTOFF_HZ = {"uncoupled": 2.0}
COUPLED_CUTOFF_HZ: Numerical[float] = 5.0
_CUTOFF_BELOW_FIRST_MODE: Numerical[float] = 0.45
_FAST_HZ: Numerical[float] = 100.0
_CUTOFF_OF_FAST: Numerical[float] = 0.1
_BATCHES: Numerical[int] = 8
_OF_STROKE: Numerical[float] = 0.5  # in the first period: measured cycles ramped up 0.27, others 0.95
_FLANK_S: Numerical[float] = 5e-4
_FLANK_CONTACTS: Numerical[int] = 4  # of the longest contact: what half a millisecond is at a very high rate
_LEAST_PER_CUTOFF: Numerical[float] = 4.0  # samples in a period of the high-pass, where nothing moves
_FEWEST_BEFORE_HIT: Numerical[int] = 8


@dataclass(frozen=True, eq=False)
class TensionRecord:
    """The bolt's tension in one record [N].

    `initial` and `final` are means over the campaign's windows with standard errors from batch means; `slope`
    is dT/d(argument of the calibration), the factor from strain noise to tension noise.
    """

    samples: FloatArray
    non_oscillatory: FloatArray
    rate_hz: float
    initial: float
    final: float
    initial_error: float
    final_error: float
    slope: float
    warnings: tuple[str, ...] = ()
    windows: WindowSettings | None = None

    @property
    def loss(self) -> float:
        """Initial minus final tension [N]; negative where the bolt tightened."""
        return self.initial - self.final


@dataclass(frozen=True, eq=False)
class Measurement:
    """A processed record: forces and motion at one rate, times from the record's first sample.

    Of a hammer's force nothing is kept but its contacts; `still_force` is what its channel shows before the
    impact. `given` are masses and stiffnesses of this record alone, by path (``rom.effects.in_record``).
    """

    file: str
    test: str
    hold_out: bool
    preload_n: float | None
    rate_hz: float
    samples: int
    force: Mapping[str, FloatArray]
    force_noise: Mapping[str, float]
    strongest_hz: float | None
    motion: Mapping[str, Motion]
    impact_s: float | None
    chain: FilterChain
    tension: TensionRecord | None
    link: Mapping[str, Channel]
    still_force: Mapping[str, FloatArray] = field(default_factory=dict)
    given: Mapping[str, float] = field(default_factory=dict)
    _displacements: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def applied_force(self) -> Mapping[str, FloatArray]:
        """Force [N] by body as a simulation takes it, which joins samples by straight lines."""
        terms = 4 if self.test == "driven" else 2
        return {body: for_straight_lines(samples, terms) for body, samples in self.force.items()}

    def displacement(self, body: str) -> FloatArray:
        """Return the measured displacement [m] of a body after the filter chain, worked out once."""
        if body not in self._displacements:
            motion = self.motion[body]
            self._displacements[body] = displacement(motion.kind, motion.samples, self.rate_hz, self.chain)
        return self._displacements[body]

    def with_cutoff(self, cutoff_hz: Mapping[str, float]) -> Measurement:
        """The same behind the high-pass that a model was identified with, by kind of test [Hz], if any."""
        own = cutoff_hz.get(self.test)
        return replace(self, chain=replace(self.chain, cutoff_hz=own)) if own else self

    def as_type(self, kind: type[np.floating[Any]]) -> Measurement:
        """The same with samples of forces, motion and tension in another precision."""
        tension = self.tension
        if tension is not None:
            slow = tension.non_oscillatory.astype(kind)
            tension = replace(tension, samples=tension.samples.astype(kind), non_oscillatory=slow)
        return replace(
            self,
            force={body: samples.astype(kind) for body, samples in self.force.items()},
            still_force={body: samples.astype(kind) for body, samples in self.still_force.items()},
            motion={body: Motion(m.kind, m.samples.astype(kind)) for body, m in self.motion.items()},
            tension=tension,
        )

    def __getstate__(self) -> dict[str, object]:
        kept = {name: value for name, value in self.__dict__.items() if name != "applied_force"}
        return {**kept, "_displacements": {}}  # to be worked out again: they would double what is sent


def driven_displacement(motion: Channel) -> FloatArray:
    """Return the prescribed displacement [m] of a link fit to be differentiated: without the noise above it.

    Velocity is where noise would pass for damping. Lines ten times above the median tell what was driven;
    what lies above four times the highest of them is taken out, zero phase.
    """
    samples = motion.samples - motion.samples.mean()
    lines = np.abs(fft.rfft(samples * signal.windows.hann(len(samples))))
    strong = np.flatnonzero(lines > max(10 * float(np.median(lines)), 1e-3 * float(lines.max())))
    highest = 4 * max(float(strong[-1]) if len(strong) else 0.0, 4.0) * motion.rate_hz / len(samples)
    if highest >= 0.4 * motion.rate_hz:
        return motion.samples
    lowpass = signal.butter(4, highest, fs=motion.rate_hz, output="sos")
    padding = min(len(samples) - 1, int(2 * motion.rate_hz / highest))
    return np.asarray(signal.sosfiltfilt(lowpass, motion.samples, padlen=padding))


def grows_from_rest(displacement: FloatArray) -> bool:
    """Whether a cycled motion [m] goes over less than half of its stroke in the first period.

    It was ramped up from rest then, where sliders hold nothing, and not cut out of cycles that go on.
    """
    lines = np.abs(fft.rfft((displacement - displacement.mean()) * signal.windows.hann(len(displacement))))
    periods = 1 + int(np.argmax(lines[1:]))
    first = displacement[: len(displacement) // periods + 1]
    return bool(np.ptp(first) < _OF_STROKE * np.ptp(displacement))


def process(record: Record, settings: CampaignSettings) -> Measurement:
    """Process one raw record; the high-pass of its motion is that of `cutoff`.

    Raises
    ------
    ValueError
        Where a record lacks a channel that its kind of test needs.
    """
    test = record.test
    places = settings.body_names if settings.modes is None else record.driven
    force = {body: channel for body in places if (channel := record.force(body)) is not None}
    motion: dict[str, tuple[MotionKind, Channel]] = {body: record.motion(body) for body in record.bodies}
    rates = [c.rate_hz for c in force.values()] + [c.rate_hz for _, c in motion.values()]
    rate = min(rates, default=settings.sampling.motion_rate_hz)
    forces = {body: _at_rate(channel, rate) for body, channel in force.items()}
    motions = {body: Motion(kind, _at_rate(channel, rate)) for body, (kind, channel) in motion.items()}
    samples = min([len(f) for f in forces.values()] + [len(m.samples) for m in motions.values()], default=0)
    impact, noise, still = None, dict.fromkeys(forces, 0.0), dict[str, FloatArray]()
    if test in IMPACT_TESTS:
        impact = min((t for f in forces.values() if (t := find_impact(f, rate)) is not None), default=None)
        still = {body: f[: int((impact or 0.0) * rate)].copy() for body, f in forces.items()}
        gated = {body: gated_force(f, rate, settings.sampling.pretrigger_s) for body, f in forces.items()}
        forces, noise = {b: f for b, (f, _) in gated.items()}, {b: n for b, (_, n) in gated.items()}
    first_mode = dominant_frequency(motions, rate, impact, settings.band_hz)
    return Measurement(
        file=record.file,
        test=test,
        hold_out=record.hold_out,
        preload_n=record.preload_n,
        rate_hz=rate,
        samples=samples,
        force={body: f[:samples] for body, f in forces.items()},
        force_noise=noise,
        strongest_hz=first_mode,
        motion={body: Motion(m.kind, m.samples[:samples]) for body, m in motions.items()},
        impact_s=impact,
        chain=FilterChain(
            min(_cutoff(settings, test, first_mode), rate / _LEAST_PER_CUTOFF), band_hz=settings.band_hz
        ),
        tension=_tension(record, settings, impact, first_mode),
        link={name: c for name, c in record.channels.items() if name.startswith(("link_", "normal_force_"))},
        still_force=still,
        given=record.settings.given,
    )


def _cutoff(settings: CampaignSettings, test: str, first_mode_hz: float | None) -> float:
    """Return the high-pass cutoff [Hz]; of modes well below the band: the strongest may not be the first."""
    if settings.modes is None:
        return cutoff(test, first_mode_hz)
    low = settings.band.low_hz if settings.band is not None else 0.0
    usual = min(COUPLED_CUTOFF_HZ, _CUTOFF_BELOW_FIRST_MODE * (first_mode_hz or np.inf))
    return _CUTOFF_BELOW_FIRST_MODE * low if low > 0 else usual


def cutoff(test: str, first_mode_hz: float | None) -> float:
    """Return the high-pass cutoff [Hz]: the paper's 2 Hz uncoupled, 5 Hz coupled (2.3), lower for a lower
    first mode, and higher above 100 Hz, where noise integrated twice would outdo the motion.
    """
    usual = CUTOFF_HZ.get(test, COUPLED_CUTOFF_HZ)
    if first_mode_hz is None:
        return usual
    if first_mode_hz > _FAST_HZ:
        return _CUTOFF_OF_FAST * first_mode_hz
    return min(usual, _CUTOFF_BELOW_FIRST_MODE * first_mode_hz)


def gated_force(force: FloatArray, rate_hz: float, pretrigger_s: float) -> tuple[FloatArray, float]:
    """Return a hammer's force without offset and zero wherever it does not rise above its noise; and that
    noise [N].

    The usual force window of impact testing, for any number of contacts: a contact is where the force exceeds
    six times its noise, widened by half a millisecond so that the flanks stay whole.

    Parameters
    ----------
    force : ndarray, shape (samples,)
        Force [N].
    rate_hz, pretrigger_s : float
        Sampling rate [Hz]; time before the hit [s] that holds noise alone.

    Returns
    -------
    tuple
        Force [N], shape (samples,), and its noise [N].
    """
    quiet = force[: max(int(0.8 * pretrigger_s * rate_hz), 1)] if pretrigger_s > 0 else force
    offset = float(np.median(quiet))
    noise = 1.4826 * float(np.median(np.abs(force - offset)))
    contact = np.abs(force - offset) > max(6 * noise, 2e-3 * float(np.abs(force - offset).max()))
    shortest = min(3, max(1, int(_FLANK_S * rate_hz)))  # a lone spike is no contact, where pulses are longer
    contact = ndimage.binary_opening(contact, np.ones(shortest, bool))
    flank = min(max(1, int(_FLANK_S * rate_hz)), _FLANK_CONTACTS * _longest_run(contact))
    wide = ndimage.binary_dilation(contact, np.ones(2 * flank + 1, bool))
    return np.where(wide, force - offset, 0.0), noise


def _longest_run(marked: npt.NDArray[np.bool_]) -> int:
    """Return the number of samples of the longest run that is marked."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _at_rate(channel: Channel, rate_hz: float) -> FloatArray:
    return (
        channel.samples if channel.rate_hz == rate_hz else decimate(channel.samples, channel.rate_hz, rate_hz)
    )


def _tension(
    record: Record, settings: CampaignSettings, impact_s: float | None, first_mode_hz: float | None
) -> TensionRecord | None:
    if not set(BOLT_CHANNELS) & set(record.channels):
        return None
    channel = record.tension_channel()
    slope, tension = 1.0, channel.samples
    warnings: tuple[str, ...] = ()
    if channel.name == "strain":
        if settings.bolt is None or settings.bolt.calibration is None:
            raise ValueError(
                f"{record.file}: strain needs bolt.calibration in campaign.toml, instead found none"
            )
        calibration = Calibration(tuple(settings.bolt.calibration))
        tension = calibration.tension(channel.samples)
        slope = float(calibration.sensitivity(np.median(channel.samples)))
        message = calibration.warning(channel.samples)
        warnings = (f"{record.file}: {message}",) if message else ()
    first_mode = first_mode_hz if record.test != "hold" else None
    return tension_record(
        tension,
        channel.rate_hz,
        settings.windows,
        impact_s=impact_s,
        first_mode_hz=first_mode,
        slope=slope,
        warnings=warnings,
    )


def tension_record(
    tension: FloatArray,
    rate_hz: float,
    windows: WindowSettings,
    *,
    impact_s: float | None,
    first_mode_hz: float | None,
    slope: float = 1.0,
    warnings: tuple[str, ...] = (),
) -> TensionRecord:
    """Return a bolt's tension [N] with its non-oscillatory part, where there is a first mode to take out, and
    its means over the windows.

    Parameters
    ----------
    tension : ndarray, shape (samples,)
        Tension [N].
    windows : WindowSettings
        Windows of the initial and the final tension [s].
    rate_hz, impact_s, first_mode_hz : float
        Sampling rate [Hz], time of the impact [s], frequency of the first mode [Hz]; None where none is.
    slope : float
        Slope of the calibration [N per unit of the channel].
    warnings : tuple of str
        Warnings to be kept with it.

    Returns
    -------
    TensionRecord
        Tension, parts and means.
    """
    before = windows.initial_s
    if impact_s is not None and before[0] < impact_s - _FEWEST_BEFORE_HIT / rate_hz:
        before = (before[0], min(before[1], impact_s))  # a hit that comes early ends the initial window
    initial, initial_error = _window_mean(tension, rate_hz, before)
    final, final_error = _window_mean(tension, rate_hz, windows.final_s)
    return TensionRecord(
        tension,
        non_oscillatory(tension, rate_hz, impact_s, first_mode_hz),
        rate_hz,
        initial,
        final,
        initial_error,
        final_error,
        slope,
        warnings,
        windows,
    )


def non_oscillatory(
    tension: FloatArray, rate_hz: float, impact_s: float | None, first_mode_hz: float | None
) -> FloatArray:
    """Return a tension [N] without what oscillates with the first mode after the impact; itself without
    either.

    Parameters
    ----------
    tension, rate_hz, impact_s, first_mode_hz
        As for `tension_record`.

    Returns
    -------
    ndarray
        Tension [N], shape (samples,).
    """
    if impact_s is None or not first_mode_hz:
        return tension
    return split_tension(tension, rate_hz, 2 / first_mode_hz, impact_s, periods=2)[0]


def _window_mean(tension: FloatArray, rate_hz: float, window_s: tuple[float, float]) -> tuple[float, float]:
    """Return mean and its standard error from batch means, which hold for coloured noise too."""
    start = min(int(window_s[0] * rate_hz), len(tension) - 1)
    inside = tension[start : max(int(window_s[1] * rate_hz), start + 1)]  # one sample where the rate is low
    batches = np.array([part.mean() for part in np.array_split(inside, min(_BATCHES, len(inside)))])
    error = float(batches.std(ddof=1) / np.sqrt(len(batches))) if len(batches) > 1 else 0.0
    return float(inside.mean()), error
