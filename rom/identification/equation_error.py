"""Equation error: what measured forces and the terms of a model leave unbalanced along a measured motion.

For a body with measured force F and displacement x, and for a link that is driven on its own,

    F = M x'' + sum of link forces,        F = k x + c x' + effects,

and every term, the force among them, passes through one filter h:
``h * F = M (h'' * x) + c (h' * x) + k (h * x) + h * f(x, x')`` holds exactly for a smooth h, here a Gaussian,
so that no term is favoured. Nothing is integrated: a mass that floats does not drift, and the state at a
record's start does not enter. (Equation error with all terms filtered alike is how robots are identified:
A. Janot, P. O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22, 132 (2014).)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import interpolate, ndimage, signal

from rom.campaign.campaign import CampaignSettings, Record, RecordSettings
from rom.campaign.channels import Channel, FloatArray
from rom.criteria.number import Numerical
from rom.effects import Effect
from rom.effects.free_form import FreeForm
from rom.model.link_force import force_along
from rom.model.units import parse_unit
from rom.signals.frequency_band import Band, edge_samples, in_band
from rom.signals.processing import grows_from_rest

TESTS = ("driven", "free", "cycled")
# widths on each side: beyond, a Gaussian is below the digits of a displacement
_REACH: Numerical[float] = 7.0
_NEAR: Numerical[float] = 4.0  # the same of a motion's
_STRIDE: Numerical[float] = 3.0  # widths from row to row: white noise is nearly independent there
_SMALLEST: Numerical[float] = 1.4  # samples: a Gaussian of less has no accurate derivatives
# of its power lies below the frequency at which the filter lets half the power pass
_OF_FORCE: Numerical[float] = 0.99
_OF_MOTION: Numerical[float] = 0.999  # of the velocity's power
_KEPT: Numerical[float] = 0.14  # its loss at that frequency is one per cent
_TOP: Numerical[float] = 0.8  # of half the rate: above, a sensor shows its noise
_SLOWEST_HZ: Numerical[float] = 20.0  # slower samples are taken as if they came at this rate


@dataclass(frozen=True)
class Smoothing:
    """A Gaussian of some width [s] and its derivatives, cut where it reaches over a record's ends.

    Where a band is declared its filter comes first, and what that spoils at the ends is cut too.
    """

    width_s: float
    band_hz: Band | None = None

    def rows(self, samples: FloatArray, rate_hz: float, derivative: int = 0) -> FloatArray:
        """Filtered samples, or their derivative [1/s^n], some widths apart.

        Parameters
        ----------
        samples : ndarray, shape (..., samples)
            Samples.
        rate_hz : float
            Sampling rate [Hz].
        derivative : int
            Order of the derivative; 0 for none.

        Returns
        -------
        ndarray
            Shape (rows,).
        """
        width = self.width_s * rate_hz
        found = ndimage.gaussian_filter1d(samples, width, order=derivative, truncate=_REACH)
        margin, stride = math.ceil(_REACH * width), max(1, round(_STRIDE * width))
        margin += edge_samples(samples.shape[-1], rate_hz, self.band_hz)
        return np.asarray(found[margin : len(samples) - margin : stride] * rate_hz**derivative)

    def rate_hz(self, rate_hz: float) -> float:
        """Rate of the rows."""
        return rate_hz / max(1, round(_STRIDE * self.width_s * rate_hz))

    def gain(self, terms: Sequence[float], rate_hz: float) -> float:
        """Root of the sum of squares of ``sum of terms[n] h^(n)``: what it makes of white noise."""
        width = self.width_s * rate_hz
        impulse = np.zeros(2 * math.ceil(_REACH * width) + 1)
        impulse[len(impulse) // 2] = 1.0
        made = sum(
            term * rate_hz**n * ndimage.gaussian_filter1d(impulse, width, order=n, truncate=_REACH)
            for n, term in enumerate(terms)
        )
        return float(np.linalg.norm(made))


@dataclass(frozen=True, eq=False)
class Balance:
    """One measured force of a record and what balances it, as rows of the filter.

    Attributes
    ----------
    channel : str
        The force, such as ``"force_lo"`` or ``"link_force_contact"``.
    place : str
        ``"body:<name>"``, or the link that is driven on its own.
    pulls : mapping of str to float
        Links that pull there, and the sign with which.
    terms : mapping of str to ndarray
        ``"force"`` [N], ``"acceleration"`` [m/s2] of a body, and ``"<link>.x"`` [m], ``"<link>.v"`` [m/s].
    force_noise, motion_noise : float
        Standard deviation of the channels' white noise [N], [m].
    """

    channel: str
    place: str
    pulls: Mapping[str, float]
    terms: Mapping[str, FloatArray]
    force_noise: float
    motion_noise: float


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """One record: its motion by place, (3, samples) of x, v and the normal force, and its balances."""

    settings: RecordSettings
    rate_hz: float
    motion: Mapping[str, FloatArray]
    balances: tuple[Balance, ...]
    smoothing: Smoothing

    @cached_property
    def going_on(self) -> frozenset[str]:
        """Links of a cycled record whose cycles do not grow from rest."""
        cycled = self.motion if self.settings.test == "cycled" else {}
        return frozenset(link for link, (x, *_) in cycled.items() if not grows_from_rest(x))

    def along(self, effect: Effect, stiffness: float, damping: float) -> FloatArray | None:
        """Rows of an effect's force [N] along the motion of its place; None where that does not move.

        In cycles that go on the states start as the same motion backwards leaves them, as in
        ``Model.link_force``; in other records, and in cycles that grow from rest, at zero.

        Parameters
        ----------
        effect : Effect
            The effect.
        stiffness : float
            Stiffness of the link [N/m].
        damping : float
            Damping of the link [N s/m].

        Returns
        -------
        FloatArray or None
            Shape (rows,) [N].
        """
        motion = self.motion.get(effect.enters)
        if motion is None:
            return None
        constants = np.broadcast_to([[stiffness], [damping]], (2, motion.shape[1]))
        settled = effect.enters in self.going_on
        force = _force(effect, np.concatenate([motion, constants]), self.rate_hz, settled=settled)
        if self.settings.test != "cycled":
            force = in_band(force, self.rate_hz, self.smoothing.band_hz)
        return self.smoothing.rows(force, self.rate_hz)


def _force(effect: Effect, motion: FloatArray, rate_hz: float, *, settled: bool) -> FloatArray:
    if isinstance(effect, FreeForm):
        return effect.along(motion)
    table, values, step_s = np.array([[effect.address, 0, 0]]), np.append(effect.values, 0.0), 1 / rate_hz
    if effect.states and rate_hz < _SLOWEST_HZ:
        values, motion, step_s = _in_unit_of_time(rate_hz / _SLOWEST_HZ, effect, motion, step_s)
    return force_along(table, values, motion, step_s, (effect,), settled=settled)


def _in_unit_of_time(
    times: float, effect: Effect, motion: FloatArray, step_s: float
) -> tuple[FloatArray, FloatArray, float]:
    """Numbers of an effect, its motion and the time from sample to sample in another unit of time.

    What has memory is followed in steps of a size that suits the motion: an effect with none of its own time
    stays the same in every unit.
    """
    powers = np.array([parse_unit(number.unit).powers[2] for number in effect.parameters.values()])
    scaled = motion * np.array([1.0, 1 / times, 1.0, 1.0, times])[:, None]
    return np.append(effect.values * times**powers, 0.0), scaled, step_s * times


def force_records(records: Sequence[Record], settings: CampaignSettings) -> tuple[ForceRecord, ...]:
    """Balance the forces of driven, free and cycled records; filters are chosen from those not held out.

    Raises
    ------
    ValueError
        Where a moving body has no displacement channel, or a record is shorter than the filter.
    """
    noise = [{name: noise_of(c) for name, c in record.channels.items()} for record in records]
    records = [_banded(record, settings.band_hz) for record in records]
    training = [record for record in records if not record.hold_out]
    smoothing, fine_s = _filter(training, "force"), _filter(training, "displacement").width_s
    smoothing = Smoothing(smoothing.width_s, settings.band_hz)
    made = (_force_record(*one, settings, smoothing, fine_s) for one in zip(records, noise, strict=True))
    return tuple(record for record in made if record.balances)


def _banded(record: Record, band_hz: Band | None) -> Record:
    """The record's motion and forces in a band; a link that is cycled on its own has no modes."""
    if band_hz is None or record.test == "cycled":
        return record
    channels = {n: Channel(n, in_band(c.samples, c.rate_hz, band_hz), c.rate_hz)
                for n, c in record.channels.items()}  # fmt: skip
    return Record(record.settings, channels, record.bodies, record.relative)


def _filter(records: Iterable[Record], quantity: str) -> Smoothing:
    """Wide enough for no noise, narrow enough for what the training records hold: power below a frequency.

    A force that is zero throughout, as in a ring-down, asks for nothing.
    """
    widths, shortest = [], 0.0
    for record in records:
        for channel in record.channels.values():
            shortest = max(shortest, _SMALLEST / channel.rate_hz)
            if not np.ptp(channel.samples):
                continue
            if quantity == "force" and channel.name.startswith(("force_", "link_force_")):
                highest = _below(channel, _OF_FORCE, derivative=0)
                widths.append(math.sqrt(math.log(2)) / (2 * math.pi * highest))
            elif quantity == "displacement" and quantity in channel.name:
                widths.append(_KEPT / (2 * math.pi * _below(channel, _OF_MOTION, derivative=1)))
    least = shortest if quantity == "force" else 0.0
    return Smoothing(max(min(widths, default=0.0), least))


def _below(channel: Channel, share: float, derivative: int) -> float:
    """Frequency [Hz] below which that share of a channel's power lies, or of its derivative's."""
    samples = channel.samples - channel.samples.mean()
    power = np.abs(np.fft.rfft(samples * signal.windows.hann(len(samples)))) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1 / channel.rate_hz)
    sums = np.cumsum(power * frequency ** (2 * derivative))
    if not sums[-1] > 0:
        return channel.rate_hz / 2
    return max(float(frequency[np.searchsorted(sums, share * sums[-1])]), float(frequency[1]))


def _force_record(
    record: Record,
    noise: Mapping[str, float],
    settings: CampaignSettings,
    smoothing: Smoothing,
    fine_s: float,
) -> ForceRecord:
    rates = {channel.rate_hz for channel in record.channels.values()}
    if len(rates) > 1:
        raise ValueError(f"{record.file}: found rates of {sorted(rates)} Hz, expected one for all channels")
    (rate,) = rates
    spoilt_s = 2 * edge_samples(int(record.duration_s * rate), rate, smoothing.band_hz) / rate
    shortest = 2 * _REACH * smoothing.width_s + 1.0 / smoothing.rate_hz(rate) + spoilt_s
    if record.duration_s < shortest:
        raise ValueError(f"{record.file}: found {record.duration_s:g} s, expected {shortest:.3g} s at least")
    made = _cycled if record.test == "cycled" else _driven
    motion, balances = made(record, noise, settings, smoothing, fine_s)
    return ForceRecord(record.settings, rate, motion, tuple(balances), smoothing)


def _cycled(
    record: Record,
    noise: Mapping[str, float],
    settings: CampaignSettings,
    smoothing: Smoothing,
    fine_s: float,
) -> tuple[dict[str, FloatArray], list[Balance]]:
    motions, balances = {}, []
    for link in settings.link:
        force = record.channels.get(f"link_force_{link.name}")
        motion = record.channels.get(f"link_displacement_{link.name}")
        if force is None or motion is None:
            continue
        normal = record.channels.get(f"normal_force_{link.name}")
        motions[link.name] = _motion(motion, normal, fine_s)
        terms = {"force": smoothing.rows(force.samples, force.rate_hz)} | _terms(link.name, motion, smoothing)
        levels = noise[force.name], noise[motion.name]
        balances.append(Balance(force.name, link.name, {link.name: 1.0}, terms, *levels))
    return motions, balances


def _driven(
    record: Record,
    noise: Mapping[str, float],
    settings: CampaignSettings,
    smoothing: Smoothing,
    fine_s: float,
) -> tuple[dict[str, FloatArray], list[Balance]]:
    shown = {}
    for body in record.bodies:
        kind, channel = record.motion(body)
        if kind != "displacement":
            raise ValueError(
                f'{record.file}: found "{channel.name}", expected "displacement_{body}": a {record.test} '
                "record without a bolt is told by its displacement"
            )
        shown[body] = channel
    first = next(iter(shown.values()))
    still = Channel("", np.zeros(len(first.samples)), first.rate_hz)
    relative = {
        link.name: Channel(link.name, shown.get(link.between[0], still).samples
                           - shown.get(link.between[1], still).samples, first.rate_hz)
        for link in settings.link if set(link.between) & set(shown)
    }  # fmt: skip
    motions = {name: _motion(channel, None, fine_s) for name, channel in relative.items()}
    balances = []
    for body, channel in shown.items():
        motions[f"body:{body}"] = _motion(channel, None, fine_s)
        pulls = {
            link.name: 1.0 if link.between[0] == body else -1.0
            for link in settings.link if body in link.between
        }  # fmt: skip
        force = record.force(body) or still
        terms = {
            "force": smoothing.rows(force.samples, force.rate_hz),
            "acceleration": smoothing.rows(channel.samples, channel.rate_hz, 2),
        }
        for name in pulls:
            terms |= _terms(name, relative[name], smoothing)
        levels = noise.get(force.name, 0.0), noise[channel.name]
        balances.append(Balance(f"force_{body}", f"body:{body}", pulls, terms, *levels))
    return motions, balances


def _terms(link: str, motion: Channel, smoothing: Smoothing) -> dict[str, FloatArray]:
    return {
        f"{link}.x": smoothing.rows(motion.samples, motion.rate_hz),
        f"{link}.v": smoothing.rows(motion.samples, motion.rate_hz, 1),
    }


def _motion(channel: Channel, normal: Channel | None, fine_s: float) -> FloatArray:
    """Displacement, velocity and normal force, along which effects act: (3, samples).

    Only as much is smoothed as leaves the motion alone; a motion up to near half the rate is not, and its
    velocity is that of a quintic spline. What a Gaussian takes away is filtered again and put back (twicing;
    J. W. Tukey, Exploratory Data Analysis, 1977, Sec. 16C): where it loses 1 % both together lose 0.01 %.
    """
    x, width = channel.samples, fine_s * channel.rate_hz
    if width >= _SMALLEST:
        x, slope = (_smoothed(channel.samples, width, order) for order in (0, 1))
        v = slope * channel.rate_hz
    else:
        v = interpolate.make_interp_spline(channel.time, x, k=5).derivative()(channel.time)
    held = np.zeros(len(x)) if normal is None else np.maximum(normal.samples[: len(x)], 0.0)
    return np.stack([x, v, held])


def _smoothed(samples: FloatArray, width: float, order: int) -> FloatArray:
    """Smoothed samples or their slope, those beyond an end the ones before it turned about it."""
    beyond = min(len(samples) - 1, math.ceil(2 * _NEAR * width))
    padded = np.pad(samples, beyond, mode="reflect", reflect_type="odd")
    lost = padded - ndimage.gaussian_filter1d(padded, width, truncate=_NEAR)
    found = ndimage.gaussian_filter1d(padded + lost, width, order=order, truncate=_NEAR)
    return np.asarray(found[beyond : beyond + len(samples)])


def noise_of(channel: Channel) -> float:
    """Standard deviation of a channel's white noise: what its spectrum shows in the top fifth of its band."""
    samples = channel.samples - channel.samples.mean()
    window = signal.windows.hann(len(samples))
    power = np.abs(np.fft.rfft(samples * window)) ** 2 / float(np.sum(window**2))
    return float(np.sqrt(np.mean(power[int(_TOP * len(power)) :])))


def noise_freedom(samples: int) -> float:
    """Degrees of freedom of the noise power that `noise_of` tells from so many samples.

    A Hann window makes neighbouring lines alike: (mean w^2)^2 / mean w^4 = 18 / 35 of them count.
    """
    return (1 - _TOP) * samples * 18 / 35


__all__ = ["TESTS", "Balance", "ForceRecord", "Smoothing", "force_records", "noise_freedom", "noise_of"]
