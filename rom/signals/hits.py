"""The hammer's hits in a record: the first, the signs of what it sets in motion, and a second one unrecorded.

All of it rests on the balance of momentum, ``F = sum m_i a_i + c_i v_i + k_i x_i`` over all bodies, in which
the forces within the structure cancel, whatever the joint does; c_i and k_i tie the bodies to the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import integrate, optimize, signal

from rom.campaign.campaign import Record
from rom.campaign.channels import MOTIONS, Channel, FloatArray
from rom.campaign.settings import LinkSettings
from rom.criteria.records import Records
from rom.signals.clipping import resolution
from rom.signals.filters import find_impact, longest_pulse
from rom.signals.motion import Motion, dominant_frequency


@dataclass(frozen=True)
class Hit:
    """The first blow of a record: on which body, the samples [start, stop) of the contact, by which rules."""

    body: str
    force: Channel
    start: int
    stop: int
    rules: Records

    @property
    def pulse(self) -> FloatArray:
        """Force during the contact [N]."""
        return self.force.samples[self.start : self.stop]


def first_hit(record: Record, rules: Records) -> Hit | None:
    """Return the hit with the highest force, None where no force channel shows one.

    The rules it goes with have the times of a structure as slow as this one.
    """
    hits = []
    for body in record.bodies:
        force = record.force(body)
        impact_s = None if force is None else find_impact(force.samples, force.rate_hz)
        if force is None or impact_s is None:
            continue
        start = round(impact_s * force.rate_hz)
        span = np.abs(force.samples[start : start + longest_pulse(force.rate_hz)])
        over = np.flatnonzero(span[np.argmax(span) :] < rules.contact_share * span.max())
        if over.size and span.size > 3:
            hits.append(
                (span.max(), Hit(body, force, start, start + int(np.argmax(span)) + int(over[0]), rules))
            )
    if not hits:
        return None
    first = max(hits, key=lambda hit: hit[0])[1]
    return replace(first, rules=rules.slower(_slowness(record, first)))


def _slowness(record: Record, hit: Hit) -> float:
    """Return how many times slower a structure is than those that the rules' times are for, at least 1."""
    rate = hit.force.rate_hz
    seen = {body: record.motion(body) for body in record.bodies}
    motions = {body: Motion(kind, m.samples) for body, (kind, m) in seen.items() if m.rate_hz == rate}
    strongest = dominant_frequency(motions, rate, hit.start / rate)
    return max(hit.rules.usual_hz / strongest, 1.0) if strongest else 1.0


def _acceleration(record: Record, body: str, rate_hz: float) -> FloatArray | None:
    """Return the acceleration of a body, differentiated if need be, None where it has another rate."""
    kind, channel = record.motion(body)
    if channel.rate_hz != rate_hz:
        return None
    samples = channel.samples
    for _ in range(MOTIONS.index(kind)):
        samples = np.gradient(samples, 1 / rate_hz)
    return samples


def _correlation(first: FloatArray, second: FloatArray) -> float:
    scale = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / scale if scale > 0 else 0.0


def signs(record: Record, links: tuple[LinkSettings, ...], hit: Hit) -> dict[str, int]:
    """Follow the sign from the force to the struck body and across the bolted links: -1 is against it.

    Parameters
    ----------
    record : Record
        The record.
    links : tuple of LinkSettings
        Links of the structure.
    hit : Hit
        The hit.

    Returns
    -------
    dict
        Sign by channel.
    """
    found = {hit.body: _struck_sign(record, hit) or 1}
    for _ in record.bodies:
        for link in links:
            known = [body for body in link.between if body in found]
            other = [body for body in link.between if body not in found and body in record.bodies]
            if link.law == "bolted" and known and other:
                found[other[0]] = found[known[0]] * (_neighbour_sign(record, hit, known[0], other[0]) or 1)
    return found


def _struck_sign(record: Record, hit: Hit) -> int:
    """Return 1 where the struck body moves with the force during the contact, -1 against it, 0 if unclear."""
    kind, channel = record.motion(hit.body)
    order = MOTIONS.index(kind)
    contact = hit.stop - hit.start
    span = slice(hit.start, hit.stop + (contact if order else 0))
    if channel.rate_hz != hit.force.rate_hz or hit.start < contact:
        return 0
    expected = hit.force.samples[span]
    for _ in range(order):
        expected = np.cumsum(expected)
    found = channel.samples[span] - channel.samples[hit.start - contact : hit.start].mean()
    if np.sqrt(np.mean(found**2)) < hit.rules.moved * max(resolution(channel.samples)):
        return 0
    return _sign(_correlation(expected, found), hit)


def _sign(correlation: float, hit: Hit) -> int:
    return 0 if abs(correlation) < hit.rules.opposed else int(np.sign(correlation))


def _neighbour_sign(record: Record, hit: Hit, known: str, other: str) -> int:
    """Return 1 where two joined bodies move together in their lowest mode, -1 if opposed, 0 if unclear.

    The lowest mode of masses tied by springs has one sign throughout; it dominates the displacements. Where
    the balance of momentum denies that a sign is flipped, the peak was another mode's.
    """
    rate = hit.force.rate_hz
    accelerations = _accelerations(record, hit)
    if accelerations is None or len(accelerations) - hit.stop < hit.rules.shortest_ringing_s * rate:
        return 0
    columns = [record.bodies.index(known), record.bodies.index(other)]
    pair = accelerations[hit.stop : hit.stop + round(hit.rules.longest_ringing_s * rate), columns].T
    # Without taking out the mean, which is that of the ringing: the pre-trigger tells the sensors' offset.
    offset = accelerations[: hit.start, columns].mean(axis=0) if hit.start else np.zeros(2)
    spectra = np.fft.rfft((pair - offset[:, None]) * signal.windows.hann(pair.shape[1]))
    frequency = np.fft.rfftfreq(pair.shape[1], 1 / rate)
    cross, level = (spectra[0] * spectra[1].conj()).real, np.abs(spectra[0] * spectra[1])
    heard = frequency >= max(hit.rules.lowest_hz, 3 * frequency[1])
    peak = frequency[heard][np.argmax(level[heard] / frequency[heard] ** 4)]
    band = np.abs(frequency - peak) <= max(0.2 * peak, 2 * frequency[1])
    sign = _sign(float(cross[band].sum() / max(level[band].sum(), np.finfo(float).tiny)), hit)
    turned = np.where(np.arange(len(record.bodies)) == columns[1], -1.0, 1.0)
    as_is, if_turned = (
        _balance(accelerations * signs, hit, hit.rules.joint_window_s, flexures=False)[1]
        for signs in (1.0, turned)
    )
    return 0 if sign < 0 and as_is < hit.rules.unturned * if_turned else sign


def _accelerations(record: Record, hit: Hit) -> FloatArray | None:
    """Return the accelerations (samples, bodies), None unless all are sampled together with the force."""
    found = [_acceleration(record, body, hit.force.rate_hz) for body in record.bodies]
    sound = [samples for samples in found if samples is not None and len(samples) == len(hit.force.samples)]
    return np.stack(sound, axis=1) if len(sound) == len(found) else None


def _balance(
    accelerations: FloatArray, hit: Hit, window_s: float, suspect: int | None = None, flexures: bool = True
) -> tuple[FloatArray, float]:
    """Return the mass of each body, none below zero, and the misfit [N] that balance the momentum best.

    A trend is fitted as well, and with `flexures` velocities and displacements (integrated) with either sign,
    which could stand for a joint too and then tell nothing about signs. What is around the sample `suspect`
    is left out.
    """
    rate = hit.force.rate_hz
    span = slice(max(hit.start - round(hit.rules.guard_s * rate), 0), hit.stop + round(window_s * rate))
    inertia, force = accelerations[span], hit.force.samples[span]
    velocities = integrate.cumulative_trapezoid(inertia, dx=1 / rate, axis=0, initial=0)
    displacements = integrate.cumulative_trapezoid(velocities, dx=1 / rate, axis=0, initial=0)
    trend = np.polynomial.polynomial.polyvander(np.linspace(-1, 1, len(force)), 3)
    others = np.hstack([velocities, displacements, trend]) if flexures else trend
    if suspect is not None:
        width = 2 * len(hit.pulse)
        around = np.abs(np.arange(len(force)) - (suspect + width // 4 - span.start)) <= width
        inertia, force, others = inertia[~around], force[~around], others[~around]
    basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), 1e-300))[0]
    left, rest = inertia - basis @ (basis.T @ inertia), force - basis @ (basis.T @ force)
    masses, misfit = optimize.nnls(left, rest)
    return np.asarray(masses), float(misfit)


def second_hit(record: Record, hit: Hit) -> tuple[float, float] | None:
    """Return time [s] and size (share of the first) of one more hit that the force channel does not show."""
    accelerations = _accelerations(record, hit)
    if accelerations is None or len(hit.pulse) < hit.rules.shortest_pulse:
        return None
    missed = accelerations @ _balance(accelerations, hit, hit.rules.momentum_window_s)[0] - hit.force.samples
    suspect = int(np.argmax(np.abs(_outside(_shares(missed, hit.pulse), hit))))
    missed = (
        accelerations @ _balance(accelerations, hit, hit.rules.momentum_window_s, suspect)[0]
        - hit.force.samples
    )
    found = _lonely_peak(missed, hit)
    return None if found is None else (found[0] / hit.force.rate_hz, found[1])


def _kernel(pulse: FloatArray) -> tuple[FloatArray, int]:
    """Return the pulse with margins, all that a parabola explains taken out, and the width of a margin."""
    margin = len(pulse) + len(pulse) // 2
    return _without_parabola(np.pad(pulse, margin)), margin


def _shares(missed: FloatArray, pulse: FloatArray) -> FloatArray:
    """Return the size of a pulse like the first that begins at each sample, in shares of the first."""
    kernel, margin = _kernel(pulse)
    fitted = signal.oaconvolve(missed, kernel[::-1], mode="full") / (kernel @ kernel)
    begins = len(kernel) - 1 - margin
    return np.asarray(fitted[begins : begins + len(missed)])


def _outside(share: FloatArray, hit: Hit) -> FloatArray:
    """Return shares with zero where no second hit can be: before and during the first, and at the end."""
    width = len(hit.pulse)
    first = hit.start + max(round(hit.rules.guard_s * hit.force.rate_hz), 4 * width)
    outside = np.zeros_like(share)
    outside[first : -4 * width] = share[first : -4 * width]
    return outside


def _lonely_peak(missed: FloatArray, hit: Hit) -> tuple[int, float] | None:
    """Return sample and size of a second pulse that is like the first and does not recur."""
    share = _shares(missed, hit.pulse)
    noise = 1.4826 * float(np.median(np.abs(share[hit.stop :])))
    share = _outside(share, hit)
    width = 4 * len(hit.pulse)
    size = np.abs(share)
    tops = []
    for _ in range(3):
        tops.append(int(np.argmax(size)))
        size[max(tops[-1] - width, 0) : tops[-1] + width] = 0
    at = tops[0]
    if share[at] < max(
        hit.rules.hit_share, hit.rules.hit_noise * noise, hit.rules.hit_alone * abs(share[tops[2]])
    ):
        return None
    kernel, margin = _kernel(hit.pulse)
    around = missed[at - margin : at - margin + len(kernel)]
    return (
        (at, float(share[at]))
        if _correlation(_without_parabola(around), kernel) > hit.rules.hit_likeness
        else None
    )


def _without_parabola(samples: FloatArray) -> FloatArray:
    smooth = np.polynomial.polynomial.polyvander(np.linspace(-1, 1, len(samples)), 2)
    return np.asarray(samples - smooth @ np.linalg.lstsq(smooth, samples)[0])
