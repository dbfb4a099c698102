"""Doubts about a record, found without any model: clipped channels, hits the force misses, flipped signs.

Each test is made to keep silent unless the evidence is strong: a good record set aside is a loss as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import integrate, optimize, signal

from rom.campaign import CampaignSettings, Record
from rom.channels import BOLT_CHANNELS, Channel, FloatArray
from rom.signals import find_impact

Kind: TypeAlias = Literal["clipped", "second-hit", "polarity"]

HIT_TESTS = ("uncoupled", "coupled", "loosening")
QUIET_SAMPLES = 20_000  # enough of a record's begin to tell noise and quantisation of a channel

FLAT_SAMPLES = 3  # fewer at the top may be chance
FLAT_NOISE, FLAT_STEPS = 8.0, 2.5  # width of a flat top in noise and quantisation steps
FLAT_EXCESS, FLAT_SHARE = 4.0, 0.02  # what was cut off, in widths of the flat top and in shares of the peak

CONTACT_SHARE = 0.02  # of the peak force: below it the contact is over
MOMENTUM_WINDOW_S = 0.25  # after the hit: the masses are found from this stretch
GUARD_S = 0.005  # after the hit: belongs to it still
HIT_SHARE, HIT_NOISE = 0.03, 8.0  # smallest second hit, in shares of the first and in noise of its estimate
HIT_LIKENESS = 0.8  # correlation of its shape with the first
HIT_ALONE = 3.0  # it stands out so much above what recurs: contacts within the structure come in numbers

OPPOSED = -0.7  # correlation from which motion opposes the force, or two bodies oppose each other


@dataclass(frozen=True)
class Doubt:
    """Why a record is set aside: its file, the channel, the kind of doubt, and a line for people."""

    file: str
    channel: str
    kind: Kind
    message: str


@dataclass(frozen=True)
class _Hit:
    """The first blow of a record: on which body, and the samples [start, stop) of the contact."""

    body: str
    force: Channel
    start: int
    stop: int

    @property
    def pulse(self) -> FloatArray:
        return self.force.samples[self.start : self.stop]


def assess(record: Record, settings: CampaignSettings) -> tuple[Doubt, ...]:
    """Name every reason to doubt a record; none for a good one.

    Clipped: the channel's extreme is a flat top whose flanks point well above it. Polarity: the struck body
    accelerates against the force during the contact, or two bodies move against each other across a bolted
    link in their lowest mode. Second hit: ``F - sum m_i a_i``, in which all forces within the structure
    cancel, shows one more pulse like the first where the force shows nothing.

    Parameters
    ----------
    record
        The record; of `cycled` and `hold` records none is doubted, of `driven` and `free` ones clipping only.
    settings
        The campaign's, for its links.
    """
    clipped = tuple(_clipped(record))
    hit = _first_hit(record) if record.test in HIT_TESTS and not clipped else None
    if hit is None:
        return clipped
    flipped = tuple(_flipped(record, settings, hit))
    return flipped or tuple(_second_hit(record, hit))


def _clipped(record: Record) -> Iterator[Doubt]:
    if record.test in ("cycled", "hold"):
        return  # a prescribed motion may rest, friction has flat tops
    for name, channel in record.channels.items():
        if record.test == "driven" and name.startswith("force_"):
            continue  # a command may be a square wave
        sides = (1.0,) if name in BOLT_CHANNELS else (1.0, -1.0)  # a loose bolt rests at zero tension
        for side in sides:
            if cut := _flat_top(side * channel.samples):
                count, level = cut
                message = f"{name} is clipped: flat for {count} samples at its extreme of {side * level:.6g}"
                yield Doubt(record.file, name, "clipped", message)
                break


def _flat_top(samples: FloatArray) -> tuple[int, float] | None:
    """Return samples and level of a flat top whose flanks point well above it, None where there is none.

    A parabola that stays within a band b of its top for n samples falls by 3 b over the next n / 2 on either
    side, which points to 1.5 b above the band; a clipped signal falls faster.
    """
    top = float(samples.max())
    peak = top - float(np.median(samples))
    band = _resolution(samples)
    if peak <= 5 * band or (band == 0 and peak == 0):
        return None
    inside = samples >= top - max(band, 1e-9 * peak)
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    start, stop = int(starts[longest]), int(stops[longest])
    count = stop - start
    reach = -(-count // 2)
    if count < FLAT_SAMPLES or start - reach < 0 or stop + reach > len(samples):
        return None
    fall = top - max(samples[start - reach], samples[stop - 1 + reach])
    excess = fall / reach * count / 4
    return (count, top) if excess > max(FLAT_EXCESS * band, FLAT_SHARE * peak) else None


def _resolution(samples: FloatArray) -> float:
    """Width within which readings of one value scatter: by noise or, where coarser, by quantisation."""
    quiet = samples[:QUIET_SAMPLES]
    noise = 1.4826 * np.median(np.abs(np.diff(quiet))) / np.sqrt(2)
    steps = np.diff(np.unique(quiet))
    step = float(steps.min()) if steps.size else 0.0
    return max(FLAT_NOISE * float(noise), FLAT_STEPS * step)


def _first_hit(record: Record) -> _Hit | None:
    """Return the hit with the highest force, None where no force channel shows one."""
    hits = []
    for body in record.bodies:
        force = record.force(body)
        impact_s = None if force is None else find_impact(force.samples, force.rate_hz)
        if force is None or impact_s is None:
            continue
        start = round(impact_s * force.rate_hz)
        span = np.abs(force.samples[start : start + round(0.02 * force.rate_hz)])
        over = np.flatnonzero(span[np.argmax(span) :] < CONTACT_SHARE * span.max())
        if over.size and span.size > 3:
            hits.append((span.max(), _Hit(body, force, start, start + int(np.argmax(span)) + int(over[0]))))
    return max(hits, key=lambda hit: hit[0])[1] if hits else None


def _acceleration(record: Record, body: str, rate_hz: float) -> FloatArray | None:
    """Return the acceleration of a body, differentiated if need be, None where it has another rate."""
    kind, channel = record.motion(body)
    if channel.rate_hz != rate_hz:
        return None
    samples = channel.samples
    for _ in range(("acceleration", "velocity", "displacement").index(kind)):
        samples = np.gradient(samples, 1 / rate_hz)
    return samples


def _correlation(first: FloatArray, second: FloatArray) -> float:
    scale = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / scale if scale > 0 else 0.0


def _flipped(record: Record, settings: CampaignSettings, hit: _Hit) -> Iterator[Doubt]:
    """Follow the sign from the force to the struck body and on across the bolted links."""
    signs = {hit.body: _struck_sign(record, hit) or 1}
    for _ in record.bodies:
        for link in settings.link:
            known = [body for body in link.between if body in signs]
            other = [body for body in link.between if body not in signs and body in record.bodies]
            if link.law == "bolted" and known and other:
                signs[other[0]] = signs[known[0]] * (_neighbour_sign(record, hit, known[0], other[0]) or 1)
    if len(signs) > 1 and max(signs.values()) < 0:
        message = f"{hit.force.name} opposes the motion of every body: its sign seems flipped"
        yield Doubt(record.file, hit.force.name, "polarity", message)
        return
    for body, sign in signs.items():
        name = record.motion(body)[1].name
        if sign < 0:
            against = hit.force.name if body == hit.body else "the bodies beside it in their lowest mode"
            message = f"{name} opposes {against}: its sign seems flipped"
            yield Doubt(record.file, name, "polarity", message)


def _struck_sign(record: Record, hit: _Hit) -> int:
    """Return 1 where the struck body moves with the force during the contact, -1 against it, 0 if unclear."""
    kind, channel = record.motion(hit.body)
    order = ("acceleration", "velocity", "displacement").index(kind)
    contact = hit.stop - hit.start
    span = slice(hit.start, hit.stop + (contact if order else 0))
    if channel.rate_hz != hit.force.rate_hz or hit.start < contact:
        return 0
    expected = hit.force.samples[span]
    for _ in range(order):
        expected = np.cumsum(expected)
    found = channel.samples[span] - channel.samples[hit.start - contact : hit.start].mean()
    if np.sqrt(np.mean(found**2)) < _resolution(channel.samples) / 2:
        return 0
    return _sign(_correlation(expected, found))


def _sign(correlation: float) -> int:
    return 0 if abs(correlation) < -OPPOSED else int(np.sign(correlation))


def _neighbour_sign(record: Record, hit: _Hit, known: str, other: str) -> int:
    """Return 1 where two joined bodies move together in their lowest mode, -1 if opposed, 0 if unclear.

    The lowest mode of masses tied by springs has one sign throughout; it dominates the displacements. Where
    the balance of momentum denies that a sign is flipped, the peak was another mode's.
    """
    rate = hit.force.rate_hz
    first, second = (_acceleration(record, body, rate) for body in (known, other))
    if first is None or second is None:
        return 0
    after = slice(hit.stop, hit.stop + round(3 * rate))
    pair = np.stack([first[after], second[after]])
    frequency, spectra = signal.csd(pair[:, None], pair[None], rate, nperseg=min(round(rate), pair.shape[1]))
    cross, level = spectra[0, 1], np.sqrt(spectra[0, 0].real * spectra[1, 1].real)
    low = frequency >= 2.0
    peak = frequency[low][np.argmax(level[low] / frequency[low] ** 4)]
    band = np.abs(frequency - peak) <= max(0.2 * peak, 2 * frequency[1])
    sign = _sign(float(cross.real[band].sum() / max(level[band].sum(), np.finfo(float).tiny)))
    if sign < 0 and _misfit(record, hit, {}) < 0.7 * _misfit(record, hit, {other: -1.0}):
        return 0
    return sign


def _balance(record: Record, hit: _Hit, window_s: float) -> tuple[slice, FloatArray, FloatArray, FloatArray]:
    """Return a window, its force and what adds up to it: accelerations; velocities, displacements, trend.

    ``F = sum m_i a_i + c_i v_i + k_i x_i`` over all bodies: forces within the structure cancel.
    """
    rate = hit.force.rate_hz
    span = slice(max(hit.start - round(GUARD_S * rate), 0), hit.stop + round(window_s * rate))
    inertia = [_acceleration(record, body, rate) for body in record.bodies]
    accelerations = np.stack([samples[span] for samples in inertia if samples is not None], axis=1)
    time = np.linspace(-1, 1, len(accelerations))
    velocities = integrate.cumulative_trapezoid(accelerations, dx=1 / rate, axis=0, initial=0)
    displacements = integrate.cumulative_trapezoid(velocities, dx=1 / rate, axis=0, initial=0)
    trend = np.polynomial.polynomial.polyvander(time, 3)
    return span, hit.force.samples[span], accelerations, np.hstack([velocities, displacements, trend])


def _misfit(record: Record, hit: _Hit, signs: dict[str, float]) -> float:
    """Return the misfit of the momentum balance with masses above zero and some channels turned round."""
    _, force, accelerations, others = _balance(record, hit, 0.05)
    turned = accelerations * [signs.get(body, 1.0) for body in record.bodies]
    columns = np.hstack([turned, others, -others])
    return float(optimize.nnls(columns / _norms(columns), force)[1])


def _norms(columns: FloatArray) -> FloatArray:
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > 0, norms, 1.0)


def _second_hit(record: Record, hit: _Hit) -> Iterator[Doubt]:
    rate = hit.force.rate_hz
    inertia = [_acceleration(record, body, rate) for body in record.bodies]
    if any(samples is None or len(samples) != len(hit.force.samples) for samples in inertia):
        return
    _, force, accelerations, others = _balance(record, hit, MOMENTUM_WINDOW_S)
    columns = np.hstack([accelerations, others])
    masses = np.linalg.lstsq(columns / _norms(columns), force)[0] / _norms(columns)
    missed = -hit.force.samples.copy()
    for mass, samples in zip(masses, inertia, strict=False):
        missed += mass * samples
    share = _shares(missed, hit.pulse)
    if (found := _lonely_peak(share, missed, hit)) is not None:
        at, size = found
        message = (
            f"{hit.force.name} shows nothing at {at / rate:.4f} s, "
            f"where the bodies move as after a second hit of {100 * size:.0f} % of the first"
        )
        yield Doubt(record.file, hit.force.name, "second-hit", message)


def _kernel(pulse: FloatArray) -> tuple[FloatArray, int]:
    """Return the pulse with margins, all that a parabola explains taken out, and the width of a margin."""
    margin = len(pulse) + len(pulse) // 2
    padded = np.pad(pulse, margin)
    smooth = np.polynomial.polynomial.polyvander(np.linspace(-1, 1, len(padded)), 2)
    return padded - smooth @ np.linalg.lstsq(smooth, padded)[0], margin


def _shares(missed: FloatArray, pulse: FloatArray) -> FloatArray:
    """Return the size of a pulse like the first that begins at each sample, in shares of the first."""
    kernel, margin = _kernel(pulse)
    fitted = signal.oaconvolve(missed, kernel[::-1], mode="full") / (kernel @ kernel)
    begins = len(kernel) - 1 - margin
    return np.asarray(fitted[begins : begins + len(missed)])


def _lonely_peak(share: FloatArray, missed: FloatArray, hit: _Hit) -> tuple[int, float] | None:
    """Return sample and size of a second pulse that is like the first and does not recur."""
    size = np.abs(share)
    width = len(hit.pulse)
    size[: max(hit.start - 4 * width, 0) + 4 * width] = 0  # before the hit there is no second
    size[: hit.start + round(GUARD_S * hit.force.rate_hz)] = 0
    size[-4 * width :] = 0
    tops = []
    for _ in range(3):
        at = int(np.argmax(size))
        tops.append((at, float(size[at])))
        size[max(at - 4 * width, 0) : at + 4 * width] = 0
    noise = 1.4826 * float(np.median(np.abs(share[hit.stop :])))
    at, top = tops[0]
    if share[at] < max(HIT_SHARE, HIT_NOISE * noise) or top < HIT_ALONE * tops[2][1]:
        return None
    kernel, margin = _kernel(hit.pulse)
    around = missed[at - margin : at - margin + len(kernel)]
    smooth = np.polynomial.polynomial.polyvander(np.linspace(-1, 1, len(kernel)), 2)
    around = around - smooth @ np.linalg.lstsq(smooth, around)[0]
    return (at, top) if _correlation(around, kernel) > HIT_LIKENESS else None
