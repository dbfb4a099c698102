"""Spectra of records, with the terms of the linear part of a structure that act in them.

Every link's stiffness and damping (and every mass that is not given) is one shared term; a bolted link has a
stiffness and damping of its own in every record, for the tension differs. In a campaign with a bolt, links
have one stiffness with the bolt in and another without (He et al. (2025), Section 3.2, suspects that the
flexures stiffen); dampings and masses stay. Both come out of the same fit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.spectral_model import (
    CORNER,
    DERIVATIVE_ORDER,
    ComplexArray,
    SpectralRecord,
    Term,
    spectrum,
)
from rom.signals.motion import time_factor
from rom.signals.processing import Measurement

LINEAR_TESTS = ("uncoupled", "coupled", "free", "driven")
UNCOUPLED = "uncoupled"
_FIRST_CORNER: Numerical[float] = 0.5  # [rad/s]: a time constant of 2 s
HIGHEST_HZ: Numerical[float] = 1000.0
"""No line of an impact or a driven force is looked at above, if the strongest frequency is far below."""
_HIGHEST_OF_STRONGEST: Numerical[float] = 8.0
_HIGHEST_AFTER_HIT: Numerical[float] = 62.5  # a stiff joint's own mode lies at ten times and more
_LENGTH_S: Numerical[float] = 8.0
_FEWEST_PERIODS: Numerical[float] = 32.0  # in those seconds, of which half a per cent of damping leaves 0.37
_BEFORE_IMPACT_S: Numerical[float] = 0.1
_LOWEST_LINES: Numerical[float] = 1.5
STRIDES: Numerical[tuple[int, ...]] = (1, 2, 4, 8)
"""The samples that spectra cover can be counted in these: every such sample alone has the same lines."""
_SPLIT: Numerical[float] = 4.0  # above this multiple of the strongest frequency the first second says all
_BRIEF_S: Numerical[float] = 0.5
_BRIEF_PERIODS: Numerical[int] = 16
_NEAR_HALF_RATE: Numerical[float] = 0.7
_SHAPES_MORE: Numerical[int] = 3  # of a hammer's noise than its band and contact ask for
# lines weaker than this share of the strongest force line say nothing of the structure
_FORCE_BAND: Numerical[float] = 1e-2


@dataclass(frozen=True)
class LinearNames:
    """How the terms of a link or body are named in a fit."""

    @staticmethod
    def mass(body: str) -> str:
        """Return the name of a body's mass."""
        return f"body.{body}.mass"

    @staticmethod
    def stiffness(link: str, *, bolted_in: bool = True) -> str:
        """Return the name of a link's stiffness, with the bolt in or without."""
        return f"{link}.stiffness" if bolted_in else f"{link}.stiffness.{UNCOUPLED}"

    @staticmethod
    def damping(link: str) -> str:
        """Return the name of a link's damping."""
        return f"{link}.damping"


def spectral_records(
    measurement: Measurement, settings: CampaignSettings, *, start_s: float | None = None
) -> tuple[SpectralRecord, ...]:
    """Return the spectra of one record with all terms that act on its moving bodies.

    An impact record is cut after 8 s, or 32 periods of the strongest frequency. Its part above four times
    that frequency is taken from the first second alone, where fast modes ring: the end states make any cut
    exact, and later samples would add noise and work. `start_s` leaves out what comes before that time [s],
    the hit with it.

    Parameters
    ----------
    measurement : Measurement
        The record as processed.
    settings : CampaignSettings
        Settings of the campaign.
    start_s : float
        Where to start [s].

    Returns
    -------
    tuple
        The parts of the record that hold a line.
    """
    bodies = tuple(body for body in settings.body_names if body in measurement.motion)
    rate, start, stop = measurement.rate_hz, 0, measurement.samples
    force = np.stack([measurement.force.get(body, np.zeros(stop)) for body in bodies], axis=1)
    ratio = _HIGHEST_OF_STRONGEST if measurement.impact_s is None else _HIGHEST_AFTER_HIT
    within = _lowest(measurement), max(HIGHEST_HZ, ratio * (measurement.strongest_hz or 0.0))
    low, high = _band(force, rate, within)
    parts = [(stop, (low, high))]
    if measurement.impact_s is not None:
        times = max(time_factor(measurement.strongest_hz), 1.0)
        start = max(0, int((measurement.impact_s - times * _BEFORE_IMPACT_S) * rate))
        if start_s is not None:
            start = min(int(start_s * rate), stop - 16)
            low, high = _band(np.zeros_like(force), rate, within)
        strongest = measurement.strongest_hz
        length_s = max(times * _LENGTH_S, _FEWEST_PERIODS / (strongest or np.inf))
        parts = [(start + _fast(min(stop - start, int(length_s * rate))), (low, high))]
        if strongest is not None and _SPLIT * strongest < high:
            split, brief = _SPLIT * strongest, max(_BRIEF_S, _BRIEF_PERIODS / strongest)
            parts = [
                (parts[0][0], (low, split)),
                (start + _fast(min(stop - start, int(brief * rate))), (split, high)),
            ]
    if settings.band is not None:
        parts = list(_within(parts, settings.band.low_hz, settings.band.high_hz))
    found = (_part(measurement, settings, bodies, force, start, end, band) for end, band in parts)
    return tuple(part for part in found if len(part.frequency))


def _within(
    parts: Iterable[tuple[int, tuple[float, float]]], low_hz: float, high_hz: float
) -> Iterator[tuple[int, tuple[float, float]]]:
    """Cut the bands of parts to the declared one; parts that lie outside are left out."""
    for end, (low, high) in parts:
        if max(low, low_hz) < min(high, high_hz):
            yield end, (max(low, low_hz), min(high, high_hz))


def _lowest(measurement: Measurement) -> float:
    """Return the lower end of the band [Hz]: the filter's cutoff, lower where nothing needs integration."""
    cutoff, strongest = measurement.chain.cutoff_hz, measurement.strongest_hz
    if strongest is None or any(m.kind == "acceleration" for m in measurement.motion.values()):
        return cutoff
    return min(cutoff, max(_LOWEST_LINES * measurement.rate_hz / measurement.samples, 0.1 * strongest))


def _fast(length: int) -> int:
    """Return the longest length up to `length` whose Fourier transform is fast, at every one of `STRIDES`."""
    return STRIDES[-1] * int(fft.prev_fast_len(length // STRIDES[-1], real=True))


def _part(
    measurement: Measurement,
    settings: CampaignSettings,
    bodies: tuple[str, ...],
    force: FloatArray,
    start: int,
    stop: int,
    band: tuple[float, float],
) -> SpectralRecord:
    motion = np.stack([measurement.motion[body].samples[start:stop] for body in bodies], axis=1)
    frequency, force_spectrum = spectrum(force[start:stop], measurement.rate_hz, band)
    _, motion_spectrum = spectrum(motion - motion.mean(axis=0), measurement.rate_hz, band)
    kinds = {m.kind for m in measurement.motion.values()}
    corner = _FIRST_CORNER / max(time_factor(measurement.strongest_hz), 1.0)
    terms, local = _terms(settings, bodies, measurement.test, kinds, corner)
    terms = tuple(_as_given(term, measurement.given) for term in terms)
    orders = tuple(DERIVATIVE_ORDER[measurement.motion[body].kind] for body in bodies)
    group = f"{measurement.test}:{','.join(bodies)}:{stop - start}"
    noise = [measurement.force_noise.get(body, 0.0) for body in bodies]
    return SpectralRecord(
        measurement.file, group, frequency, force_spectrum, motion_spectrum, orders, terms, local,
        _force_errors(force[start:stop], noise, measurement.rate_hz, frequency),
        _sampling_errors(measurement) if np.any(force[start:stop]) else (0.0, 0.0),
        samples=(start, stop), step_s=1 / measurement.rate_hz,
    )  # fmt: skip


def _force_errors(
    force: FloatArray, noise: Sequence[float], rate_hz: float, frequency: FloatArray
) -> ComplexArray:
    """Return spectra of what a hammer's noise leaves in its force, each one standard error large: (lines,
    bodies, shapes).

    White noise in the n samples of a contact is that in n orthonormal polynomials of time. The first changes
    the impulse, the second its instant; a band of B over a contact of D tells little more than 2 B D apart.
    """
    shapes = [np.zeros((len(frequency), len(noise), 0), dtype=np.complex128)]
    for body in np.flatnonzero(np.asarray(noise)).tolist():
        inside = np.flatnonzero(force[:, body])
        for contact in np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1) if inside.size else ():
            count = min(len(contact), int(2 * frequency[-1] * len(contact) / rate_hz) + _SHAPES_MORE)
            powers = np.polynomial.legendre.legvander(np.linspace(-1, 1, len(contact)), count - 1)
            turned = np.exp(-2j * np.pi * np.outer(frequency, contact) / rate_hz)
            found = np.zeros((len(frequency), len(noise), count), dtype=np.complex128)
            found[:, body] = noise[body] / rate_hz * (turned @ np.linalg.qr(powers)[0])
            shapes.append(found)
    return np.concatenate(shapes, axis=2)


def _sampling_errors(measurement: Measurement) -> tuple[float, float]:
    """Return the standard errors of an impulse (relative) and of its instant [s] from the samples' spacing.

    A spectrum that falls with 1/f^2 or faster is a quarter at the sampling rate of what it is at half of it,
    and there it folds onto the lowest lines, with a slope of one part in half the rate.
    """
    if measurement.impact_s is None:
        return (0.0, 0.0)
    lines = np.abs(np.fft.rfft(max(measurement.force.values(), key=lambda f: float(np.abs(f).max()))))
    folded = float(lines[int(_NEAR_HALF_RATE * len(lines)) :].max() / lines.max()) / 4
    return folded, folded / (np.pi * measurement.rate_hz)


def _band(force: FloatArray, rate_hz: float, within_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the band [Hz] within another in which the force says something of the structure."""
    lowest_hz, highest = within_hz[0], min(within_hz[1], 0.4 * rate_hz)
    if not np.any(force):
        return lowest_hz, highest
    frequency, lines = spectrum(force, rate_hz, (lowest_hz, highest))
    power = np.sum(np.abs(lines) ** 2, axis=1)
    width = max(1, len(power) // 50)
    smooth = np.convolve(power, np.ones(width) / width, mode="same")
    strong = np.flatnonzero(smooth > _FORCE_BAND * smooth.max())
    return lowest_hz, float(frequency[strong[-1]])


def _terms(
    settings: CampaignSettings,
    bodies: Sequence[str],
    test: str,
    kinds: Collection[str],
    first_corner: float = _FIRST_CORNER,
) -> tuple[tuple[Term, ...], frozenset[str]]:
    bolted_in = test != UNCOUPLED or settings.bolt is None
    terms: list[Term] = []
    local: set[str] = set()
    for body in settings.body:
        if body.name in bodies:
            direction = _direction([body.name], bodies)
            name = LinearNames.mass(body.name)
            terms.append(Term(name, "mass", direction, body.mass_kg or 1.0, free=body.mass_kg is None))
    for link in settings.link:
        direction = _direction(link.between, bodies)
        if not np.any(direction) or (link.law == "bolted" and not bolted_in):
            continue
        if link.law != "dashpot":
            name = LinearNames.stiffness(link.name, bolted_in=bolted_in)
            terms.append(Term(name, "stiffness", direction, link.stiffness_n_per_m or 0.0))
        terms.append(Term(LinearNames.damping(link.name), "damping", direction, link.damping_ns_per_m or 0.0))
        if link.law == "bolted":
            local |= {LinearNames.stiffness(link.name), LinearNames.damping(link.name)}
    if "acceleration" in kinds:
        name = f"{CORNER}.{test}" if test == "loosening" else CORNER  # large hits want sensors of their own
        terms.append(Term(name, "corner", np.zeros(len(bodies)), first_corner))
    return tuple(terms), frozenset(local)


def _as_given(term: Term, given: Mapping[str, float]) -> Term:
    value = given_value(given, term.name)
    return term if value is None else replace(term, value=value, free=False, given=True)


def given_value(given: Mapping[str, float], name: str) -> float | None:
    """Return what a record gives for the term of a name, in its ``given``; None where it gives nothing."""
    return given.get(name, given.get(f"{name.removesuffix(f'.{UNCOUPLED}')}.k"))


def _direction(between: Sequence[str], bodies: Sequence[str]) -> FloatArray:
    """Return a link's row of the incidence matrix over the moving bodies; a body at rest is ground."""
    direction = np.zeros(len(bodies))
    for sign, end in zip((1.0, -1.0), between, strict=False):
        if end in bodies:
            direction[bodies.index(end)] = sign
    return direction
