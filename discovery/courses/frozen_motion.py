"""The motion of all loosening tests, frozen: what tension laws are fitted along before full re-simulation.

Every test is simulated once with the identified model and its own gamma of ``|v|^4 T``, so that the motion
has felt the measured loss. Along it a motion factor m has the exposure ``M(t) = integral of m from the hit
to t``, and a law is one scalar equation, ``dT = sum_j c_j g_j(T) dM_j``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from discovery.courses.between_bolts import Bolts, Index
from discovery.courses.motion_grid import (
    LEAD_S,
    Corners,
    averages_over,
    grid_corners,
    knots_between,
    places_kept,
    times_of,
    with_nuisance,
)
from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.laws.factors import Factor
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.identification.gamma_per_case import LooseningCase, matching_gammas
from rom.model.laws import power_loosening
from rom.model.model import Model
from rom.signals.tension_bins import TensionCourse

_NOTHING: Numerical[float] = 1e-16  # of the largest exposure
_RECENT: Numerical[int] = 32  # interpolated exposures that are kept
_SAME_BIN: Numerical[float] = 0.2  # of a bin's width, by which its end may differ from bolt to bolt
NUISANCE_DIRECTIONS: Numerical[int] = 2  # of every case: a x and b x^2


@dataclass(frozen=True, eq=False)
class FrozenMotion:
    """Frozen motion, exposures and measured courses of many tests.

    Attributes
    ----------
    courses : tuple of TensionCourse
        What was measured.
    model : Model
        The identified model; of several bolts the first one's.
    nodes : ndarray, shape (6, nodes of all cases)
        Time from the hit [s], relative displacement [m] and velocity [m/s], link force and its damping part
        [N], tension [N]; dense in the first 60 ms. `starts`, shape (cases + 1,), divides them.
    knots_s : ndarray, shape (knots,)
        Times from the hit at which exposures are kept [s]; the edges of the bins are among them.
    edges_s : ndarray, shape (bins + 1,)
        Edges of the bins from the hit [s], the median of all cases.
    averages : ndarray, shape (bins, knots)
        Weights of the knots in the mean over each bin.
    change : ndarray, shape (cases, bins)
        Measured changes of tension [N].
    covariance : ndarray, shape (cases, bins, bins)
        Their covariance with two wide directions for an oscillating part ``a x + b x^2`` [N^2].
    signed : bool
        Whether tests may tighten: a case's deviation u makes its rate 1 + u times the law's, not exp(u).
    criteria : Criteria
        The numbers that decide, for all that is fitted along the motion.
    bolt : ndarray, shape (cases,), optional
        Place in `bolt_models` of every case's bolt, where there are several of one kind.
    """

    courses: tuple[TensionCourse, ...]
    model: Model
    nodes: FloatArray
    starts: npt.NDArray[np.int64]
    knots_s: FloatArray
    edges_s: FloatArray
    averages: FloatArray
    change: FloatArray
    covariance: FloatArray
    signed: bool = False
    criteria: Criteria = CRITERIA
    bolt: Index | None = None
    bolt_models: tuple[Model, ...] = ()
    _exposures: dict[tuple[str, tuple[float, ...]], FloatArray] = field(default_factory=dict, repr=False)
    _recent: dict[tuple[str, tuple[float, ...]], FloatArray] = field(default_factory=dict, repr=False)
    _whole: FrozenMotion | None = field(default=None, repr=False)  # of a subset: where its exposures are kept
    _index: tuple[int, ...] = field(default=(), repr=False)

    def __len__(self) -> int:
        return len(self.courses)

    @cached_property
    def initial(self) -> FloatArray:
        """Tension before the hit [N], (cases,)."""
        return np.array([course.initial for course in self.courses])

    @property
    def link(self) -> str:
        """Name of the bolted link."""
        return self.model.structure.bolted_links[0]

    @cached_property
    def bolts(self) -> Bolts | None:
        """Which cases are of one bolt, where there are several bolts."""
        return None if self.bolt is None else Bolts(np.unique(self.bolt, return_inverse=True)[1])

    def by_bolt(self) -> Iterator[tuple[Model, Index]]:
        """Every bolt's model and the places of its cases."""
        if self.bolt is None:
            yield self.model, np.arange(len(self))
            return
        for place in np.unique(self.bolt):
            yield self.bolt_models[place], np.flatnonzero(self.bolt == place)

    def with_models(self, change: Callable[[Model], Model]) -> FrozenMotion:
        """The same with other models for re-simulation."""
        return replace(
            self, model=change(self.model), bolt_models=tuple(change(model) for model in self.bolt_models)
        )

    def factors(self, deviations: FloatArray | None) -> FloatArray:
        """Factor of every case on a law's rate, (cases,), from its deviation; 1 where none are given."""
        if deviations is None:
            return np.ones(len(self))
        return 1.0 + deviations if self.signed else np.exp(deviations)

    def of_case(self, case: int) -> FloatArray:
        """Nodes of one case, (6, nodes)."""
        return self.nodes[:, self.starts[case] : self.starts[case + 1]]

    def exposure(self, factor: Factor) -> FloatArray:
        """Cumulative integral of a motion factor at the knots, (cases, knots) [its unit times s].

        Between a grid's values of the inner parameters it is interpolated by cubics, in its logarithm along
        exponents: a fit moves them often, and the integrals at the grid's values serve all fits.
        """
        if factor.key not in self._recent:
            while len(self._recent) >= _RECENT:
                del self._recent[next(iter(self._recent))]
            self._recent[factor.key] = self._found_exposure(factor)
        return self._recent[factor.key]

    def _found_exposure(self, factor: Factor) -> FloatArray:
        if self._whole is not None:
            return self._whole.exposure(factor)[list(self._index)]
        corners = [grid_corners(inner.value, inner.step) for inner in factor.inner.values()]
        logarithmic = [inner.unit == "1" for inner in factor.inner.values()]
        return self._interpolated(factor, tuple(factor.inner), corners, logarithmic)

    def _interpolated(
        self, factor: Factor, names: tuple[str, ...], corners: list[Corners], logarithmic: list[bool]
    ) -> FloatArray:
        """Interpolate along the first inner parameter, and within that along the others."""
        if not names:
            return self._integrated(factor)
        parts = [
            self._interpolated(factor.at_node(names[0], value), names[1:], corners[1:], logarithmic[1:])
            for value, _ in corners[0]
        ]
        weights = [weight for _, weight in corners[0]]
        if len(parts) == 1:
            return parts[0]
        if not logarithmic[0]:
            return np.maximum(sum(w * part for w, part in zip(weights, parts, strict=True)), 0.0)
        floors = [max(_NOTHING * float(part.max()), 1e-300) for part in parts]
        logs = [np.log(np.maximum(part, floor)) for part, floor in zip(parts, floors, strict=True)]
        return np.exp(sum(w * log for w, log in zip(weights, logs, strict=True)))

    def _integrated(self, factor: Factor) -> FloatArray:
        if factor.key not in self._exposures:
            self._exposures[factor.key] = self.integral(factor.of_motion(*self.nodes[1:5]))
        return self._exposures[factor.key]

    def integral(self, values: FloatArray) -> FloatArray:
        """Cumulative integral at the knots, (cases, knots), of what has these values at the nodes."""
        steps, place, share = self._quadrature
        total = np.cumsum(np.concatenate([[0.0], (values[1:] + values[:-1]) * steps]))
        at_knots = total[place] + share * (total[place + 1] - total[place])
        return np.asarray(at_knots - at_knots[:, :1])

    @cached_property
    def _quadrature(self) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
        """Half the steps of the trapezoidal rule, and where the knots lie between nodes, (cases, knots)."""
        time = self.nodes[0]
        steps = 0.5 * np.maximum(np.diff(time), 0.0)  # no step leads from one case to the next
        places, shares = [], []
        for a, b in pairwise(self.starts):
            place = np.clip(np.searchsorted(time[a:b], self.knots_s, side="right") - 1, 0, b - a - 2) + a
            places.append(place)
            shares.append(np.clip((self.knots_s - time[place]) / (time[place + 1] - time[place]), 0.0, 1.0))
        return steps, np.stack(places), np.stack(shares)

    def subset(self, index: Sequence[int] | npt.NDArray[np.int64]) -> FrozenMotion:
        """The same for some of the cases, in the order of ``index``; repeats are allowed."""
        chosen = [int(i) for i in index]
        parts = [self.of_case(i) for i in chosen]
        return replace(
            self,
            courses=tuple(self.courses[i] for i in chosen),
            nodes=np.concatenate(parts, axis=1),
            starts=np.cumsum([0, *(part.shape[1] for part in parts)]),
            change=self.change[chosen],
            covariance=self.covariance[chosen],
            bolt=None if self.bolt is None else self.bolt[chosen],
            _exposures={},
            _recent={},
            _whole=self._whole or self,
            _index=tuple(self._index[i] for i in chosen) if self._whole else tuple(chosen),
        )

    def last_bin(self) -> FrozenMotion:
        """The same with the last bin alone: the losses."""
        return replace(
            self,
            edges_s=self.edges_s[-2:],
            averages=self.averages[-1:],
            change=self.change[:, -1:],
            covariance=self.covariance[:, -1:, -1:],
        )

    def without_cache(self) -> FrozenMotion:
        """The same without kept exposures, to be sent to another process."""
        return replace(self, _exposures={}, _recent={})


def freeze(
    model: Model,
    courses: Sequence[TensionCourse],
    *,
    signed: bool = False,
    criteria: Criteria = CRITERIA,
) -> FrozenMotion:
    """Simulate every test with its own gamma and keep the motion of the bolted link.

    Parameters
    ----------
    model : Model
        The identified model.
    courses : sequence of TensionCourse
        What was measured.
    signed : bool
        Whether tests may tighten.
    criteria : Criteria
        The numbers that decide.

    Raises
    ------
    ValueError
        If there are no courses, or the model has not one bolted link.
    """
    return _frozen([(model, courses)], signed, criteria)


def freeze_bolts(
    bolts: Sequence[tuple[Model, Sequence[TensionCourse]]],
    *,
    signed: bool = False,
    criteria: Criteria = CRITERIA,
) -> FrozenMotion:
    """The same for several bolts of one kind, each with the model identified from its own tests.

    Parameters
    ----------
    bolts : sequence of (Model, sequence of TensionCourse)
        Identified model and measured courses of every bolt.
    signed, criteria
        As for `freeze`.

    Raises
    ------
    ValueError
        As `freeze`, or if the tension histories of two bolts are not in the same bins of time.
    """
    frozen = _frozen(bolts, signed, criteria)
    widths = np.diff(frozen.edges_s)
    for place, (_, courses) in enumerate(bolts):
        for course in courses:
            off = np.abs(course.edges_s[: len(widths) + 1] - course.impact_s - frozen.edges_s)[1:] / widths
            if off.max() > _SAME_BIN:
                raise ValueError(
                    f"bolt {place + 1}: {course.file}: found bins of time that differ from those of the "
                    "other bolts, expected records of equal length, rate and windows"
                )
    bolt = np.repeat(np.arange(len(bolts)), [len(courses) for _, courses in bolts])
    return replace(frozen, bolt=bolt, bolt_models=tuple(model for model, _ in bolts))


def _frozen(
    bolts: Sequence[tuple[Model, Sequence[TensionCourse]]], signed: bool, criteria: Criteria
) -> FrozenMotion:
    model = bolts[0][0]
    links = model.structure.bolted_links
    if len(links) != 1:
        raise ValueError(f"a tension law needs a model with one bolted link, this one has {len(links)}")
    courses = [course for _, of_bolt in bolts for course in of_bolt]
    if not courses:
        raise ValueError("found no loosening record with tension, force and a hit; expected some to fit")
    bins = min(len(course.change) for course in courses)
    offsets = np.median([c.edges_s[: bins + 1] - c.impact_s for c in courses], axis=0)
    knots = knots_between(offsets)
    nodes = [
        part
        for own, of_bolt in bolts
        for part in _simulated(own, of_bolt, offsets, criteria.courses.least_final)
    ]
    averages = averages_over(knots, offsets)
    kept = tuple(_cut(course, bins) for course in courses)
    covariance = [
        with_nuisance(course.covariance, part, offsets) for course, part in zip(kept, nodes, strict=True)
    ]
    return FrozenMotion(
        courses=kept,
        model=model,
        nodes=np.concatenate(nodes, axis=1),
        starts=np.cumsum([0, *(part.shape[1] for part in nodes)]),
        knots_s=knots,
        edges_s=offsets,
        averages=averages,
        change=np.stack([course.change for course in kept]),
        covariance=np.stack(covariance),
        signed=signed,
        criteria=criteria,
    )


def _cut(course: TensionCourse, bins: int) -> TensionCourse:
    return replace(
        course,
        edges_s=course.edges_s[: bins + 1],
        change=course.change[:bins],
        covariance=course.covariance[:bins, :bins],
    )


def _simulated(
    model: Model, courses: Sequence[TensionCourse], offsets: FloatArray, least_final: float
) -> list[FloatArray]:
    link = next(link for link in model.structure.links if link.law == "bolted")
    window, end_s, times = courses[0].final_window, float(offsets[-1]), times_of(offsets)
    cases = [
        LooseningCase(c.file, c.body, c.force, c.rate_hz, c.initial,
                      max(c.final, least_final * c.initial), c.final_error, c.given)
        for c in courses
    ]  # fmt: skip
    gammas, _ = matching_gammas(model, cases, window)
    laws = model.link_laws[link.name]
    found = []
    for course, gamma in zip(courses, gammas.tolist(), strict=True):
        rate = power_loosening(max(gamma, 0.0))
        own = in_record(model, course.given).with_tension_law(rate, link.name)
        response = own.simulate({course.body: course.force}, course.rate_hz, course.initial)
        hit = round(course.impact_s * course.rate_hz)
        first = max(hit - round(LEAD_S * max(times, 1.0) * course.rate_hz), 0)
        last = min(hit + int(end_s * course.rate_hz) + 1, len(course.force))
        x, v = (
            _relative(motion, link.first, link.second)[first:last]
            for motion in (response.displacement, response.velocity)
        )
        tension = np.asarray(response.tension)[first:last]
        time = np.arange(first, last) / course.rate_hz - course.impact_s
        places = places_kept(v, time, times)
        x, v, tension = x[places], v[places], tension[places]
        damping = laws.damping(tension) * v
        force = laws.stiffness(tension) * x + damping
        found.append(np.stack([time[places], x, v, force, damping, tension]))
    return found


def _relative(motion: object, first: str, second: str) -> FloatArray:
    values = [motion[body] if body != "ground" else 0.0 for body in (first, second)]  # type: ignore[index]
    return np.asarray(values[0] - values[1])
