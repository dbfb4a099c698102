"""The force that a model leaves unbalanced: as a map over motion, as a loop, and what depends on what.

The output error E of a record is the motion that a missing force f at a place would make, G d f, and noise of
the spectrum S (`discovery.localisation.lines`). The force that suits it best, by the rule of Gauss and
Markov,

    f = -(b^H r) / |b|^2,   b = W G d,   W^H W = S^-1,   r = W E,

is the equation error Z E of one body, or what two bodies share as a link's force, in the lines at hand. Its
noise has the variance N = 2 / |b|^2. Faded by 1 / (1 + (N / N_0)^2), without phase, where that is above N_0,
twice its median over the lines or over those near the dominant frequency, f goes back to time. Positive
forces pull the first end back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import fft, interpolate

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.localisation.force_history import Course, by_sign
from discovery.localisation.lines import Lines, Place
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_HALF_BINS: Numerical[int] = 13  # of displacement and of velocity, on either side of the middle one
_PER_DECADE: Numerical[int] = 6
_SEED: Numerical[int] = 0
_LOOPS: Numerical[int] = 3  # cycles that are drawn
_FINE: Numerical[int] = 240  # points of their line
_LEAST: Numerical[float] = 1e-9  # of a bin's weight to the largest


@dataclass(frozen=True, eq=False)
class ForceMap:
    """Force that is left unbalanced at one place on training records, over relative motion.

    Attributes
    ----------
    place : str
        Name of the bolted link, or ``"body NAME"``.
    displacement_m, velocity_m_per_s : ndarray, shape (bins + 1,)
        Edges of the bins.
    force_n : ndarray, shape (bins of velocity, bins of displacement)
        Weighted mean; NaN where the motion has not been.
    level, level_positive, level_negative : float
        Mean square of the force over that of noise, and where the displacement is positive, and negative.
    explained : float
        Share of its variance that the map, a static function of displacement and velocity, predicts of
        blocks of records that it was not made from.
    explained_p : float
        Chance of so much in sample if the force knew nothing of the motion: signs of blocks are turned.
    elastic : float
        Share of the map's square that is even in velocity, as of springs; odd is what dissipates.
    rest : float
        Share of the variance that neither the map nor noise has: memory, or what differs between records.
    work_per_cycle_j : float
        Loop area of the first cycles of the record with the largest motion; positive: energy is lost.
    cosine_displacement, cosine_velocity, cosine_chance : float
        Of the angle between force and motion over all records; what noise exceeds in one case of twenty.
    loop : mapping of str to ndarray
        ``displacement_m`` and ``force_n`` of those cycles.
    """

    place: str
    displacement_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    level: float
    level_positive: float
    level_negative: float
    explained: float
    explained_p: float
    elastic: float
    rest: float
    work_per_cycle_j: float
    cosine_displacement: float
    cosine_velocity: float
    cosine_chance: float
    loop: Mapping[str, FloatArray]

    def as_dict(self) -> dict[str, object]:
        """Return plain values for a result file; None where there is nothing."""
        numbers = ("level", "level_positive", "level_negative", "explained", "explained_p", "elastic", "rest",
                   "work_per_cycle_j", "cosine_displacement", "cosine_velocity",
                   "cosine_chance")  # fmt: skip
        return {
            "place": self.place,
            **{name: _plain(getattr(self, name)) for name in numbers},
            "displacement_m": _rounded(self.displacement_m),
            "velocity_m_per_s": _rounded(self.velocity_m_per_s),
            "force_n": [_rounded(row) for row in self.force_n],
            "loop": {name: _rounded(values) for name, values in self.loop.items()},
        }


def courses_at(place: Place, parts: Sequence[Lines], criteria: Criteria = CRITERIA) -> tuple[Course, ...]:
    """Return the unbalanced force at a place along every record that can show it.

    At a link it is told from all lines, as long as all last; on a body from the first part's alone, those
    below four times the dominant frequency, which hold what a flexure does.

    Parameters
    ----------
    place : Place
        A bolted link or a body.
    parts : sequence of Lines
        Whitened lines of all records.
    criteria : Criteria
        Which lines are faded.

    Returns
    -------
    tuple of Course
        One for each record with lines that show it.
    """
    records: dict[int, list[Lines]] = {}
    for one in parts:
        records.setdefault(id(one.trace), []).append(one)
    mine = (ones if place.bolted else ones[:1] for ones in records.values())
    found = (_course(place, ones, criteria) for ones in mine if place.direction(ones[0].trace) is not None)
    return tuple(course for course in found if course.variance.any())


def _course(place: Place, ones: Sequence[Lines], criteria: Criteria) -> Course:
    trace = ones[0].trace
    first = ones[0].part.samples[0]
    count = min(last - first for _, last in (one.part.samples for one in ones)) // trace.stride
    shown = [_response(one, place) for one in ones]
    noise = [
        1 / (np.maximum(np.sum(np.abs(b) ** 2, axis=1), 1e-300) * one.span_s[1])
        for b, one in zip(shown, ones, strict=True)
    ]
    usual = _usual(noise, ones, criteria)
    force, variance = np.zeros(count), np.zeros(count)
    for b, each, one in zip(shown, noise, ones, strict=True):
        faded = 1 / (1 + (each / usual) ** 2)
        across = -np.conj(b) * (faded * each * one.span_s[1])[:, None]
        force += _in_time(np.sum(across * one.white, axis=1)[:, None], one)[:count, 0]
        ends = _in_time((across[:, None] @ one.projected)[:, 0], one)[:count]
        variance += 4 * float(np.sum(np.abs(across) ** 2)) / one.span_s[1] ** 2 - one.projected_variance(ends)
    start = first // trace.stride
    x, v = (motion[start : start + count] for motion in trace.relative(place.ends))
    time = ones[0].span_s[0] + np.arange(count) / trace.rate_hz
    after = (time >= 0.0) & (np.arange(count) < (1 - criteria.localisation.wrapped) * count)
    return Course(time[after], force[after], x[after], v[after], np.maximum(variance[after], 0.0))


def _usual(noise: Sequence[FloatArray], ones: Sequence[Lines], criteria: Criteria) -> float:
    """Power of noise that a line may have and still pass, over all lines of a record."""
    every, frequency = np.concatenate(noise), np.concatenate([one.part.frequency for one in ones])
    near = (
        np.abs(frequency - (ones[0].trace.measurement.strongest_hz or 0.0))
        < criteria.localisation.dominant_width * frequency
    )
    middle = [float(np.median(lines)) for lines in (every, every[near]) if lines.size]
    return criteria.localisation.loud_line * max(middle)


def _response(one: Lines, place: Place) -> npt.NDArray[np.complexfloating]:
    shown = one.response_to(place)
    assert shown is not None  # other parts of the record show it
    return shown


def _in_time(lines: npt.NDArray[np.complexfloating], one: Lines) -> FloatArray:
    """Samples of Fourier integrals (lines, n) at the rate of the record's motion, (samples, n)."""
    (first, last), trace = one.part.samples, one.trace
    count = (last - first) // trace.stride
    spectrum = np.zeros((count // 2 + 1, lines.shape[1]), dtype=np.complex128)
    place = np.rint(one.part.frequency * one.span_s[1]).astype(np.intp)
    inside = place < len(spectrum)
    spectrum[place[inside]] = lines[inside]
    return np.asarray(fft.irfft(spectrum, count, axis=0) * trace.rate_hz)


def force_map(place: str, courses: Sequence[Course], criteria: Criteria = CRITERIA) -> ForceMap:
    """Return what the unbalanced force at a place is of the motion there, as a map and in numbers.

    Parameters
    ----------
    place : str
        Name of the place.
    courses : sequence of Course
        Force and motion there, one for each record.
    criteria : Criteria
        Blocks, folds and the quantile of the chance level.

    Returns
    -------
    ForceMap
        Mean force [N] in bins of displacement [m] and velocity [m/s]; levels over noise, shares, cosines.
    """
    edges = _edges([one.displacement for one in courses]), _edges([one.velocity for one in courses])
    sums = _Sums(courses, edges, criteria)
    level, (positive, negative) = sums.square / sums.noise, by_sign(courses)
    explained = sums.predicted()
    loop, work = _loop(max(courses, key=lambda one: float(np.abs(one.displacement).max())))
    return ForceMap(
        place,
        displacement_m=edges[0],
        velocity_m_per_s=edges[1],
        force_n=sums.mean,
        level=level,
        level_positive=positive,
        level_negative=negative,
        explained=explained,
        explained_p=sums.chance(),
        elastic=sums.elastic(),
        rest=float(np.clip(1.0 - explained - 1.0 / level, 0.0, 1.0)),
        work_per_cycle_j=work,
        cosine_displacement=sums.cosine("displacement")[0],
        cosine_velocity=sums.cosine("velocity")[0],
        cosine_chance=max(sums.cosine(name)[1] for name in ("displacement", "velocity")),
        loop=loop,
    )


def _edges(motions: Sequence[FloatArray]) -> FloatArray:
    """Edges of bins in even ratios: hits differ by decades, and each decays through some."""
    largest = float(f"{max(float(np.abs(one).max()) for one in motions):.2g}") or 1.0
    half = largest * 10.0 ** (np.arange(-_HALF_BINS, 1) / _PER_DECADE)
    return np.concatenate([-half[::-1], half])


class _Sums:
    """Weighted sums of force and motion over blocks of records, by bins of the map.

    A block of a record is longer than noise remembers, so that signs of blocks can be turned
    where noise alone is left, and the sums are as likely.
    """

    def __init__(
        self, courses: Sequence[Course], edges: tuple[FloatArray, FloatArray], criteria: Criteria
    ) -> None:
        self._courses, self._criteria, self._blocks = courses, criteria, int(criteria.localisation.blocks)
        self.shape = (len(edges[1]) - 1, len(edges[0]) - 1)
        sums = [self._sums_of(one, edges) for one in courses]
        self._force = np.concatenate([force for force, _ in sums])
        self._count = np.concatenate([count for _, count in sums])
        self.square = sum(float(np.sum(one.force**2)) * one.weight for one in courses)
        self.noise = sum(float(np.sum(one.variance)) * one.weight for one in courses)

    def _sums_of(self, one: Course, edges: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Sums of the force and of ones in every block and bin, (blocks, bins)."""
        columns, rows = (
            np.clip(np.searchsorted(e, motion) - 1, 0, len(e) - 2)
            for e, motion in zip(edges, (one.displacement, one.velocity), strict=True)
        )
        bins = self.shape[0] * self.shape[1]
        place = self._block_of(one) * bins + rows * self.shape[1] + columns
        force, count = (
            np.bincount(place, weights=w, minlength=self._blocks * bins).reshape(self._blocks, bins)
            for w in (one.force, np.ones_like(one.force))
        )
        return np.asarray(force * one.weight), np.asarray(count * one.weight)

    @cached_property
    def mean(self) -> FloatArray:
        """Mean force in every bin [N]."""
        count = self._count.sum(axis=0)
        there = count > _LEAST * count.max()
        mean = np.full(len(count), np.nan)
        mean[there] = self._force.sum(axis=0)[there] / count[there]
        return mean.reshape(self.shape)

    def _block_of(self, one: Course) -> npt.NDArray[np.intp]:
        """Block of every sample of a record."""
        return np.arange(len(one.force)) * self._blocks // len(one.force)

    def elastic(self) -> float:
        """Share of the map's square that is even in velocity; NaN where no bin has its mirror image."""
        there, count = np.nan_to_num(self.mean), self._count.sum(axis=0).reshape(self.shape)
        weight = np.minimum(count, count[::-1])
        even, odd = (float(np.sum(weight * (there + sign * there[::-1]) ** 2)) for sign in (1, -1))
        return even / (even + odd) if even + odd > 0 else float("nan")

    def predicted(self) -> float:
        """Share of the force's square that means of the other blocks predict; 0 where that is none."""
        folds = int(self._criteria.localisation.folds)
        fold = np.arange(len(self._force)) % folds
        left = 0.0
        for number in range(folds):
            mine = fold == number
            force, count = (sums[~mine].sum(axis=0) for sums in (self._force, self._count))
            mean = np.divide(force, count, out=np.zeros_like(force), where=count > 0)
            left += float(
                np.sum(self._count[mine].sum(axis=0) * mean**2 - 2 * self._force[mine].sum(axis=0) * mean)
            )
        return float(np.clip(-left / self.square, 0.0, 1.0))

    def chance(self) -> float:
        """Chance of so large means in the bins where the signs of blocks are a matter of chance."""
        count, turns = np.maximum(self._count.sum(axis=0), 1e-300), int(self._criteria.chance.draws)
        signs = np.random.default_rng(_SEED).choice((-1.0, 1.0), (turns, len(self._force)))
        turned = np.sum((signs @ self._force) ** 2 / count, axis=1)
        found = float(np.sum(self._force.sum(axis=0) ** 2 / count))
        return float((1 + np.sum(turned >= found)) / (1 + turns))

    def cosine(self, quantity: str) -> tuple[float, float]:
        """Cosine of the angle between force and motion, and what noise exceeds in one case of twenty."""
        product, motion = [], 0.0
        for one in self._courses:
            along = getattr(one, quantity)
            product.append(np.bincount(self._block_of(one), weights=one.force * along) * one.weight)
            motion += float(np.sum(along**2)) * one.weight
        size, every = np.sqrt(self.square * motion), np.concatenate(product)
        if not size:
            return float("nan"), float("nan")
        by_chance = self._criteria.chance.normal_quantile * np.linalg.norm(every)
        return float(every.sum() / size), float(by_chance / size)


def _loop(one: Course) -> tuple[Mapping[str, FloatArray], float]:
    """First cycles of a record, from where the motion turns first, and the work of one [J]."""
    turns = np.flatnonzero(np.diff(np.sign(one.velocity)) != 0)
    last = turns[min(2 * _LOOPS, len(turns) - 1)] if len(turns) > 1 else len(one.force) - 1
    first = turns[0] if len(turns) > 1 else 0
    cycles = slice(first, last + 1)
    x, force, v = one.displacement[cycles], one.force[cycles], one.velocity[cycles]
    step_s = float(one.time[1] - one.time[0])
    number = max((min(2 * _LOOPS, len(turns) - 1)) / 2, 0.5)
    along = np.linspace(0, len(x) - 1, min(_FINE, 8 * len(x)))  # a smooth line also where samples are few
    drawn = interpolate.CubicSpline(np.arange(len(x)), np.stack([x, force], axis=1))(along)
    loop = {"displacement_m": drawn[:, 0], "force_n": drawn[:, 1]}
    return loop, float(np.sum(force * v) * step_s / number)


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _rounded(values: FloatArray) -> list[float | None]:
    """Four digits, as many as a picture shows."""
    return [_plain(float(f"{value:.4g}")) for value in values]


def force_maps(
    where: Sequence[Place], parts: Sequence[Lines], criteria: Criteria = CRITERIA
) -> Iterator[ForceMap]:
    """Yield the map of every place that has moved.

    Parameters
    ----------
    where : sequence of Place
        Bolted links and bodies.
    parts : sequence of Lines
        Whitened lines of all records.
    criteria : Criteria
        As for `courses_at` and `force_map`.

    Yields
    ------
    ForceMap
        As from `force_map`.
    """
    for place in where:
        courses = courses_at(place, parts, criteria)
        if any(np.any(one.displacement) for one in courses):
            yield force_map(place.name, courses, criteria)
