"""The whitened residual along time, harmonics and places, and from hit to hit.

Lines r of a record whitened by the noise before the hits, its end states projected out
(`rom.identification.spectral_model`), are
by themselves not white: of every real number of them noise leaves 1 - a (A^T A)^-1 a^T, with a the row of
the projected columns A that belongs to it. That counts where few numbers make a class, as just after a hit,
which the end states explain best. So every mean square here is over what noise leaves there: 1 is noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import fft, stats

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.criteria.localisation import Localising
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.identification.spectral_model import ComplexArray, Linearised, SpectralRecord

if TYPE_CHECKING:
    from discovery.residual.output_error import WhitenedResidual
    from discovery.residual.trajectory import MeasuredTrajectory

Profile = tuple[tuple[str, float], ...]  # label and residual's mean square over that of the noise floor
_SECONDS: Numerical[tuple[float, ...]] = (0.0, 0.1, 0.35, 1.0, 3.0, np.inf)
_HARMONICS = ("1st harmonic", "2nd harmonic", "3rd harmonic")
_ELSEWHERE = "other lines"
_GROUND = "ground"


@dataclass(frozen=True, eq=False)
class Lines:
    """Whitened lines of a part of a record.

    Attributes
    ----------
    trace : MeasuredTrajectory
        The record.
    part : SpectralRecord
        Its spectra; the force holds forces of the model that are not linear.
    linear : Linearised
        The model's transfer function and whitener at these lines, and what was projected out.
    rows : ndarray, shape (2, lines, channels)
        Real and imaginary part of the whitened residual, each of variance 1 where noise is left.
    """

    trace: MeasuredTrajectory
    part: SpectralRecord
    linear: Linearised
    rows: FloatArray

    @property
    def white(self) -> ComplexArray:
        """Complex lines, (lines, channels)."""
        return np.asarray(self.rows[0] + 1j * self.rows[1])

    @cached_property
    def projected(self) -> ComplexArray:
        """Whitened columns of what was projected out, (lines, channels, columns)."""
        count = self.rows.size
        pair = self.linear.ends[:count].reshape(*self.rows.shape, -1)
        return np.asarray(pair[0] + 1j * pair[1])

    def projected_variance(self, columns: npt.NDArray[np.inexact]) -> FloatArray:
        """Variance that the projection took from numbers with these columns (..., columns)."""
        along = columns @ self.linear.inverse
        return np.asarray(np.sum((np.conj(columns) * along).real, axis=-1))

    @property
    def span_s(self) -> tuple[float, float]:
        """Where the spectra begin, after the hit, and how long they last [s]."""
        (first, last), seen = self.part.samples, self.trace.measurement
        return first / seen.rate_hz - (seen.impact_s or 0.0), (last - first) / seen.rate_hz

    def response_to(self, place: Place) -> ComplexArray | None:
        """Whitened lines that a unit force at a place would leave, (lines, channels); None: it shows nothing.

        b = W G d, with W the whitener, G the transfer and d the direction of the force among the bodies.
        """
        direction = place.direction(self.trace)
        if direction is None:
            return None
        return np.asarray((self.linear.whitener @ (self.linear.gain @ direction)[:, :, None])[:, :, 0])


@dataclass(frozen=True)
class Place:
    """Where a force may be missing: between the ends of a bolted link, or on a body."""

    name: str
    ends: tuple[str, str]
    bolted: bool

    def direction(self, trace: MeasuredTrajectory) -> FloatArray | None:
        """What a unit force that pushes the first end pushes, (bodies,); None where it does not act."""
        needed = [end for end in self.ends if end != _GROUND]
        if not set(needed) <= set(trace.bodies) or (self.bolted and trace.measurement.test == "uncoupled"):
            return None
        out = np.zeros(len(trace.bodies))
        for end, sign in zip(self.ends, (1.0, -1.0), strict=True):
            if end != _GROUND:
                out[trace.bodies.index(end)] = sign
        return out


def training_lines(residual: WhitenedResidual) -> tuple[Lines, ...]:
    """Return the whitened lines of all parts of the training records."""
    found, first = [], 0
    for trace, part, linear in residual.parts:
        count = 2 * part.motion.size
        rows = residual.residual[first : first + count].reshape(2, *part.motion.shape)
        first += len(linear.residual)
        if not trace.settings.hold_out:
            found.append(Lines(trace, part, linear, rows))
    return tuple(found)


def places(residual: WhitenedResidual) -> tuple[Place, ...]:
    """Return the places that a missing force may have: bolted links, then bodies."""
    model = residual.baseline.model
    links = [
        Place(link.name, (link.first, link.second), bolted=True)
        for link in model.structure.links
        if link.law == "bolted"
    ]
    bodies = dict.fromkeys(body for trace in residual.traces for body in trace.bodies)
    return (*links, *(Place(f"body {body}", (body, _GROUND), bolted=False) for body in bodies))


def by_time(parts: Iterable[Lines], criteria: Criteria = CRITERIA) -> Profile:
    """Return the mean square by time since the impact.

    The inverse Fourier transform of K lines side by side is K complex numbers, D/K apart for spectra over D
    seconds, as white as the lines are: it is unitary. But a whitener has no direction in time: what happens
    at a hit smears to before it, and so to the end of the spectra, which is left out.
    """
    classes = [_seconds(low, high) for low, high in itertools.pairwise(_SECONDS)]
    tally = _MeanSquares(classes)
    for one in parts:
        if one.trace.measurement.impact_s is None:
            continue
        samples = fft.ifft(one.white, axis=0, norm="ortho")
        noise = 2.0 - one.projected_variance(fft.ifft(one.projected, axis=0, norm="ortho"))
        start, length = one.span_s
        along = np.arange(len(samples)) / len(samples)
        place = np.searchsorted(_SECONDS, start + length * along, "right")
        place[along > 1 - criteria.localisation.wrapped] = 0
        for number, label in enumerate(classes, 1):
            tally.add(label, samples[place == number], noise[place == number])
    return tally.profile()


def by_harmonic(parts: Iterable[Lines], criteria: Criteria = CRITERIA) -> Profile:
    """Return the mean square of lines at the record's dominant frequency, its harmonics, and elsewhere."""
    tally = _MeanSquares((*_HARMONICS, _ELSEWHERE))
    for one in parts:
        strongest = one.trace.measurement.strongest_hz
        if not strongest:
            continue
        order = one.part.frequency / strongest
        near = np.abs(order - np.rint(order)) < criteria.localisation.harmonic_width
        number = np.where(near & (np.rint(order) <= len(_HARMONICS)), np.rint(order), 0).astype(np.intp)
        noise = 2.0 - one.projected_variance(one.projected)
        for harmonic, label in enumerate((_ELSEWHERE, *_HARMONICS)):
            tally.add(label, one.white[number == harmonic], noise[number == harmonic])
    return tally.profile()


def by_place(parts: Sequence[Lines], where: Iterable[Place]) -> Profile:
    """Return the mean square of the equation error of every body, and in the link.

    What a force f at a place would leave is b f (`Lines.response_to`). The part b^H r / |b| of the lines r
    that points there is white, and largest where the force is that is missing.
    """
    where = tuple(where)
    tally = _MeanSquares([place.name for place in where])
    for place, one in itertools.product(where, parts):
        shown = one.response_to(place)
        if shown is not None:
            along = np.conj(shown) / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), 1e-300)
            noise = 2.0 - one.projected_variance((along[:, None] @ one.projected)[:, 0])
            tally.add(place.name, np.sum(along * one.white, axis=1), noise)
    return tally.profile()


def repeatability(parts: Sequence[Lines], criteria: Criteria = CRITERIA) -> Profile:
    """Return how alike the residuals of tests are that repeat each other; nothing where none does.

    ``repeatability`` is the correlation of their lines, of all pairs together: 0 for noise, and (m - 1) / m
    where all that a mean square m has beyond noise comes again; ``repeatability_chance`` is what noise alone
    exceeds in one case of twenty. ``repeatability_noise`` is half the mean square of their differences, the
    noise as repeated tests tell it over that from before the hits: 1 where both are the same, and
    ``repeatability_noise_<body>`` that of one sensor. Tests repeat each other if the same body was hit, the
    tension differs by 10 % at most, the hit by 20 %. They are set side by side by the phase of their hits.
    """
    product = size = 0.0
    apart: dict[str, list[float]] = {}
    pairs = set()
    hits = {id(one.trace): _hit(one.trace) for one in parts}
    for first, second in itertools.combinations(parts, 2):
        at = hits[id(first.trace)], hits[id(second.trace)]
        if (
            first.trace is not second.trace
            and at[0].repeats(at[1], criteria.localisation)
            and _side_by_side(first, second)
        ):
            a, b = _from_hit(first, at[0].body), _from_hit(second, at[1].body)
            product += float(np.sum(np.conj(a) * b).real)
            size += float(np.linalg.norm(a) * np.linalg.norm(b))
            for body, new in zip(first.trace.bodies, 0.5 * np.sum(np.abs(a - b) ** 2, axis=0), strict=True):
                sums = apart.setdefault(body, [0.0, 0.0])
                sums[0] += float(new)
                sums[1] += 2 * len(a)
            pairs.add((id(first.trace), id(second.trace)))
    if not size:
        return ()
    noise, count = np.sum(list(apart.values()), axis=0)
    return (
        ("repeatability", product / size),
        ("repeatability_chance", criteria.chance.normal_quantile / float(np.sqrt(count))),
        ("repeatability_noise", float(noise / count)),
        *((f"repeatability_noise_{body}", square / n) for body, (square, n) in apart.items()),
        ("repeatability_pairs", float(len(pairs))),
    )


def line_correlation(parts: Sequence[Lines], criteria: Criteria = CRITERIA) -> Profile:
    """Return how alike lines side by side are, by kind of test: a test of whiteness.

    rho^2 = sum |sum_k conj(r_k) r_(k+1)|^2 / sum (sum_k |r_k|^2)^2 over records and channels. White lines
    are independent; what lives at some time, as after a hit, is alike from line to line. ``_chance`` is what
    white noise exceeds in one case of twenty: there each square over n lines is exponential with mean
    4 (n - 1), and their sum is taken to have a gamma distribution.
    """
    found: list[tuple[str, float]] = []
    for test in dict.fromkeys(one.trace.measurement.test for one in parts):
        white = [one.white for one in parts if one.trace.measurement.test == test]
        alike = sum(float(np.sum(np.abs(np.sum(np.conj(r[:-1]) * r[1:], axis=0)) ** 2)) for r in white)
        whole = sum(float(np.sum(np.sum(np.abs(r) ** 2, axis=0) ** 2)) for r in white)
        count = np.concatenate([np.full(r.shape[1], float(len(r))) for r in white])
        mean, size = 4 * (count - 1), 4 * count**2
        scale = float(np.sum(mean**2) / np.sum(mean))
        largest = float(stats.gamma.isf(criteria.localisation.chance, np.sum(mean) / scale, scale=scale))
        found += [
            (f"line_correlation_{test}", float(np.sqrt(alike / whole)) if whole > 0 else 0.0),
            (f"line_correlation_{test}_chance", float(np.sqrt(largest / np.sum(size)))),
        ]
    return tuple(found)


@dataclass(frozen=True)
class _Hit:
    """Kind of test with its bodies, body that was struck, largest force [N], and tension before it [N]."""

    group: tuple[str, tuple[str, ...]]
    body: str
    force: float
    tension: float

    def repeats(self, other: _Hit, criteria: Localising) -> bool:
        return (
            (self.group, self.body) == (other.group, other.body)
            and self.force > 0
            and _nearby(self.force, other.force, criteria.repeat_hit)
            and _nearby(self.tension, other.tension, criteria.repeat_preload)
        )


def _hit(trace: MeasuredTrajectory) -> _Hit:
    """Tell a hit; without a bolt its tension counts as zero."""
    peaks = {body: float(np.abs(force).max()) for body, force in trace.measurement.force.items()}
    body = max(peaks, key=lambda name: peaks[name], default="")
    found = trace.measurement.tension
    tension = 0.0 if found is None or trace.measurement.test == "uncoupled" else found.initial
    return _Hit(trace.group, body, peaks.get(body, 0.0), tension)


def _nearby(a: float, b: float, share: float) -> bool:
    return abs(a - b) <= share * max(abs(a), abs(b))


def _side_by_side(first: Lines, second: Lines) -> bool:
    a, b = first.part.frequency, second.part.frequency
    return a.shape == b.shape and bool(np.allclose(a, b))


def _from_hit(one: Lines, body: str) -> ComplexArray:
    """Lines in phase with those of the hit: records begin at other fractions of a sample before it."""
    own = next(part for part in one.trace.parts if part.samples == one.part.samples)
    force = own.force[:, one.trace.bodies.index(body)]
    return np.asarray(one.white * np.conj(force / np.maximum(np.abs(force), 1e-300))[:, None])


def _seconds(low: float, high: float) -> str:
    return f"{low:g} to {high:g} s" if np.isfinite(high) else f"{low:g} s and more"


class _MeanSquares:
    """Squares and what noise leaves of them, by label, in the order of the labels."""

    def __init__(self, labels: Sequence[str]) -> None:
        self._sums = {label: [0.0, 0.0] for label in labels}

    def add(self, label: str, values: npt.NDArray[np.inexact], noise: FloatArray) -> None:
        one = self._sums[label]
        one[0] += float(np.sum(np.abs(values) ** 2))
        one[1] += float(np.sum(noise))

    def profile(self) -> Profile:
        return tuple(self._means())

    def _means(self) -> Iterator[tuple[str, float]]:
        for label, (square, noise) in self._sums.items():
            if noise > 1.0:  # fewer numbers than one tell nothing
                yield label, square / noise
