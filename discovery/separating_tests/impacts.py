"""Tests that would separate rival laws most, found by simulating many a hit under each of them.

A law's course after a hit is compared as ``y = ln(-ln(T / T_0))`` in every bin: there a factor exp(u) on the
rate adds u. If law a is true, a number of hits adds up to the expected log likelihood ratio against law b

    LLR = (c - r' (1 + A)^-1 r) / 2,   c = sum d' W^-1 d,   r = sum J' W^-1 d,   A = sum J' W^-1 J,

with d the difference of both courses (law b simulated at the level of law a, that shift added back), W the
covariance of noise, scatter of the rate and error of the model, and J the change of the course by one
standard error of each principal direction of what was fitted to law b: what scatter or other numbers of the
law could absorb does not count. The change J is linear: where half of the tension is lost a refit absorbs far
more than that, and such hits are not proposed.

Where laws were fitted to several bolts, the tests are for the one on which they tell best: simulated with its
model at its own rate under each law, and what is not known of that rate is one more number to law b. No new
bolt is proposed, for at the same rate it never tells more: LLR is ``D' (W + J J')^-1 D / 2``, which falls as
the variance of the rate grows, from ``1 / (1 / sigma^2 + information)`` of a tested bolt to sigma^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from discovery.courses.fit import Fit, at_fit, deviation_of_bolt
from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.separating import Separating
from discovery.laws.candidate import Candidate
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_FORCES: Numerical[tuple[float, ...]] = (
    0.25,
    0.4,
    0.6,
    0.85,
    1.15,
)  # of the strongest measured
_PULSES: Numerical[tuple[float, ...]] = (0.5, 1.0)  # of the measured length, and the longest allowed
_PRELOADS: Numerical[int] = 8
_LEAD_S: Numerical[float] = 0.002
_LEAD_SHARE: Numerical[float] = 1 / 250  # of the time after a hit, where that is brief
_LENGTH_S: Numerical[float] = 1.0  # later bins tell little more
_LEAST_LOSS: Numerical[float] = 1e-12  # of the tension
_STEP: Numerical[float] = 1e-3


@dataclass(frozen=True)
class Proposal:
    """A test to be made, as one of a list that goes together.

    Attributes
    ----------
    body : str
        The body to be hit.
    peak_force, pulse_length, preload : float
        Of a half sine [N], [s]; tension before [N].
    hits : int
        How many such hits.
    laws : tuple of str
        The two laws that it separates best.
    expected_gain : float
        2 ln of their likelihood ratio that one such hit is expected to add to the tests before it in the
        list, in the mean of its hits.
    odds : float
        To one, expected after this test and those before it in the list, between the two laws that are
        hardest to separate, of those that can be separated.
    bolt : str
        The bolt to be hit, where there are several.
    """

    body: str
    peak_force: float
    pulse_length: float
    preload: float
    hits: int
    laws: tuple[str, str]
    expected_gain: float
    odds: float
    bolt: str = ""

    @property
    def hit(self) -> str:
        """What to do, in words."""
        number = "once" if self.hits == 1 else f"{self.hits} times"
        hit = f"hit {self.body} {number} with {self.peak_force:.3g} N for {1e3 * self.pulse_length:.2g} ms"
        where = f" of {self.bolt}" if self.bolt else ""
        return f"{hit} at a preload of {self.preload:.3g} N{where}"

    @property
    def outcome(self) -> str:
        """The odds after it, in words."""
        odds = f"{self.odds:.0f}" if self.odds < 1e6 else "a million and more"
        return f"odds of {odds} to 1 after it"

    @property
    def summary(self) -> str:
        """What to do, and what for, in one sentence."""
        return f"{self.hit}: separates {self.laws[0]!r} from {self.laws[1]!r}; {self.outcome}"


@dataclass(frozen=True, eq=False)
class _Grid:
    """Hits to choose from, each (hits,), and where their bins are from the hit [s]."""

    body: str
    peak_force: FloatArray
    pulse_length: FloatArray
    preload: FloatArray
    offsets_s: FloatArray
    rate_hz: float

    @property
    def lead_s(self) -> float:
        """Time before the hit [s]."""
        return min(_LEAD_S, _LEAD_SHARE * float(self.offsets_s[-1]))

    @property
    def force(self) -> FloatArray:
        """Half sines, (hits, samples) [N]."""
        samples = int((self.lead_s + self.offsets_s[-1]) * self.rate_hz) + 2
        time = np.arange(samples) / self.rate_hz - self.lead_s
        phase = time / self.pulse_length[:, None]
        inside = (phase > 0) & (phase < 1)
        return np.where(inside, self.peak_force[:, None] * np.sin(np.pi * phase), 0.0)


def propose_tests(
    fits: Sequence[Fit], frozen: FrozenMotion, most_tests: int | None = None, bolts: Sequence[str] = ()
) -> tuple[Proposal, ...]:
    """Choose few tests by greedy search, one hit after the other, until every two laws are told apart.

    Parameters
    ----------
    fits : sequence of Fit
        The first two or three laws, fitted to ``frozen``; a law without terms is left out.
    frozen : FrozenMotion
        Measured courses: their forces, pulses, preloads and noise are the guide. Limits of the
        proposed forces, pulses and preloads, and the tension that a hit must leave, are in its criteria.
    most_tests : int
        Different tests at most; not given: as the criteria have it.
    bolts : sequence of str
        Names of the bolts, where there are several; "bolt 1" and so on if not given.

    Returns
    -------
    tuple of Proposal
        All of one bolt. Empty where there are no two laws, or no test within reach separates any two of them.
    """
    rivals = [found for found in fits if found.candidate.rated(np.ones(1))]
    if len(rivals) < 2:
        return ()
    most = int(frozen.criteria.separating.tests) if most_tests is None else most_tests
    grid, aim = _grid(frozen), frozen.criteria.separating.odds
    if frozen.bolt is None:
        return _plan(rivals, [(0.0, 0.0)] * len(rivals), frozen, grid, most)[1]
    states = [at_fit(found, frozen)[1] for found in rivals]
    plans = []
    for place, (model, cases) in enumerate(frozen.by_bolt()):
        rates = [
            deviation_of_bolt(found, state, frozen.initial, cases)
            for found, state in zip(rivals, states, strict=True)
        ]
        pairs, tests = _plan(rivals, rates, replace(frozen, model=model), grid, most)
        name = bolts[place] if bolts else f"bolt {place + 1}"
        plans.append((pairs, tuple(replace(test, bolt=name) for test in tests)))
    return max(plans, key=lambda plan: _preference(plan[0], plan[1], aim))[1]


def _preference(pairs: int, tests: Sequence[Proposal], aim: float) -> tuple[float, ...]:
    """More pairs told apart, the aim reached, by fewer hits, at higher odds."""
    odds = tests[-1].odds if tests else 0.0
    return pairs, min(odds, aim), -float(sum(test.hits for test in tests)), odds


def _plan(
    rivals: Sequence[Fit],
    rates: Sequence[tuple[float, float]],
    frozen: FrozenMotion,
    grid: _Grid,
    most: int,
) -> tuple[int, tuple[Proposal, ...]]:
    """Return how many pairs of laws can be told apart, and the tests.

    ``rates`` has for each law the deviation of the bolt's ln rate, and its standard deviation.
    """
    rules = frozen.criteria.separating
    responses = [_response(found, *rate, frozen, grid) for found, rate in zip(rivals, rates, strict=True)]
    ways = [_way(a, b, frozen, grid) for a, b in permutations(responses, 2)]
    names = [(a.candidate.name, b.candidate.name) for a, b in permutations(rivals, 2)]
    many = _by_pair(names, [way.of_each(int(rules.hits)) for way in ways])
    reachable = [i for i, name in enumerate(names) if many[frozenset(name)].max() >= np.log(rules.least_odds)]
    if not reachable:
        return 0, ()
    ways, names = [ways[i] for i in reachable], [names[i] for i in reachable]
    tests = _proposals(ways, names, _greedy(ways, names, most, rules), grid)
    return len({frozenset(name) for name in names}), tests


def _grid(frozen: FrozenMotion) -> _Grid:
    courses, rules = frozen.courses, frozen.criteria.separating
    peaks = [float(np.abs(course.force).max()) for course in courses]
    strongest = max(peaks)
    widths = [
        np.sum(np.abs(c.force) > 0.5 * peak) / c.rate_hz for c, peak in zip(courses, peaks, strict=True)
    ]
    pulse = 1.5 * float(np.median(widths))  # a half sine is above its half for two thirds of its length
    initial = np.maximum(frozen.initial, 1e-3)
    preloads = np.geomspace(
        initial.min() / rules.preload_range, initial.max() * rules.preload_range, _PRELOADS
    )
    forces = [*(share for share in _FORCES if share < rules.hardest), rules.hardest]
    pulses = [*(share for share in _PULSES if share < rules.longest), rules.longest]
    every = np.array(list(product(strongest * np.array(forces), pulse * np.array(pulses), preloads)))
    offsets = np.median([c.edges_s - c.impact_s for c in courses], axis=0)
    within = max(int(np.sum(offsets <= _LENGTH_S)), min(len(offsets), 2))
    bodies = [course.body for course in courses]
    body = max(sorted(set(bodies)), key=bodies.count)
    rate = float(np.median([course.rate_hz for course in courses]))
    return _Grid(body, every[:, 0], every[:, 1], every[:, 2], offsets[:within], rate)


@dataclass(frozen=True, eq=False)
class _Response:
    """Courses of y under a law: (hits, bins), by one standard error (hits, bins, numbers), by u; tension."""

    candidate: Candidate
    deviation: float
    course: FloatArray
    by_number: FloatArray
    by_deviation: FloatArray
    scatter: FloatArray
    tension: FloatArray


def _response(found: Fit, deviation: float, error: float, frozen: FrozenMotion, grid: _Grid) -> _Response:
    force = grid.force
    still = np.full(len(grid.preload), deviation)
    tension = _simulated(found.candidate, still, frozen, grid, force)
    here = _levels(tension, grid)
    ahead = _levels(_simulated(found.candidate, still + _STEP, frozen, grid, force), grid)
    columns = [
        (_levels(_simulated(moved, still, frozen, grid, force), grid) - here) / _STEP
        for moved in _principal_steps(found)
    ]
    by_deviation = (ahead - here) / _STEP
    columns += [error * by_deviation] if error > 0 else []
    by_number = np.stack(columns, axis=-1) if columns else np.zeros((*here.shape, 0))
    return _Response(
        found.candidate, deviation, here, by_number, by_deviation, found.tau(grid.preload), tension
    )


def _simulated(
    candidate: Candidate, deviations: FloatArray, frozen: FrozenMotion, grid: _Grid, force: FloatArray
) -> FloatArray:
    model = frozen.model.with_tension_law(candidate.law(), frozen.link)
    rated = candidate.rated(frozen.factors(deviations))
    vary = {f"{frozen.link}.tension_rate.{name}": values for name, values in rated.items()}
    edges = grid.lead_s + grid.offsets_s
    return model.mean_tensions(force, grid.rate_hz, grid.preload, edges, vary, grid.body)


def _levels(tension: FloatArray, grid: _Grid) -> FloatArray:
    """``ln(-ln(T / T_0))``; a course that diverged counts as no loss."""
    share = np.nan_to_num(tension / grid.preload[:, None], nan=1.0)
    return np.asarray(np.log(-np.log(np.clip(share, _LEAST_LOSS, 1 - _LEAST_LOSS))))


def _principal_steps(found: Fit) -> list[Candidate]:
    """The law moved by a small share of a standard error along each principal direction of its fit."""
    values, vectors = np.linalg.eigh(found.covariance)
    logs = found.candidate.coefficient_names
    here = {name: parameter.value for name, parameter in found.candidate.parameters.items()}
    steps = []
    for size, direction in zip(np.sqrt(np.maximum(values, 0.0)), vectors.T, strict=True):
        change = _STEP * size * direction
        moved = {
            name: here[name] * float(np.exp(np.clip(by, -1, 1)))
            if name in logs and here[name] > 0
            else here[name] + by
            for name, by in zip(found.free, change, strict=True)
        }
        steps.append(found.candidate.with_values(moved))
    return steps


@dataclass(frozen=True, eq=False)
class _Way:
    """What every hit adds to c, r and A if one law is true and another one is held against it."""

    c: FloatArray
    r: FloatArray
    A: FloatArray

    def ratio(self, c: FloatArray, r: FloatArray, A: FloatArray) -> FloatArray:
        """Log likelihood ratios of sums, (...,)."""
        solved = np.linalg.solve(np.eye(A.shape[-1]) + A, r[..., None])[..., 0]
        return np.asarray(0.5 * np.maximum(c - (r * solved).sum(axis=-1), 0.0))

    def of(self, counts: FloatArray) -> FloatArray:
        """Log likelihood ratio of numbers of hits of each kind, (hits,); result of no dimension."""
        return self.ratio(counts @ self.c, counts @ self.r, np.tensordot(counts, self.A, 1))

    def of_each(self, hits: int) -> FloatArray:
        """The same for a number of hits of each kind alone, (hits,)."""
        return self.ratio(hits * self.c, hits * self.r, hits * self.A)

    def with_one_more(self, counts: FloatArray) -> FloatArray:
        """The same with one more of each, (hits,)."""
        sums = counts @ self.c, counts @ self.r, np.tensordot(counts, self.A, 1)
        return self.ratio(sums[0] + self.c, sums[1] + self.r, sums[2] + self.A)


def _way(true: _Response, rival: _Response, frozen: FrozenMotion, grid: _Grid) -> _Way:
    rules = frozen.criteria.separating
    initial = np.log(np.maximum(frozen.initial, 1e-3))
    nearest = np.argmin(np.abs(initial - np.log(grid.preload)[:, None]), axis=1)
    bins = len(grid.offsets_s) - 1
    share = np.clip(np.nan_to_num(true.tension / grid.preload[:, None], nan=1.0), 1e-6, 1 - _LEAST_LOSS)
    per_newton = 1 / (grid.preload[:, None] * share * -np.log(share))
    difference = true.course - rival.course
    level = np.average(difference, axis=1, weights=1 / np.arange(1, bins + 1))  # the first bins know best
    moved = _simulated(rival.candidate, rival.deviation + level, frozen, grid, grid.force)
    difference = true.course - _levels(moved, grid) + rival.by_deviation * level[:, None]
    spread = rival.scatter[:, None] * rival.by_deviation
    covariance = frozen.covariance[nearest][:, :bins, :bins] * per_newton[:, :, None] * per_newton[:, None, :]
    covariance = covariance + spread[:, :, None] * spread[:, None, :] + rules.shape_error**2 * np.eye(bins)
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))  # of very different orders
    columns = np.concatenate([difference[..., None], rival.by_number], axis=-1) / size[..., None]
    left = np.minimum(true.tension, moved)[:, -1] / grid.preload
    columns[~(left > rules.least_left)] = 0.0  # also where a simulation diverged
    solved = np.linalg.solve(covariance / (size[:, :, None] * size[:, None, :]), columns)
    sums = np.einsum("hbi,hbj->hij", columns, solved)
    return _Way(sums[:, 0, 0], sums[:, 1:, 0], sums[:, 1:, 1:])


Names = Sequence[tuple[str, str]]


def _by_pair(names: Names, ratios: Sequence[FloatArray]) -> dict[frozenset[str], FloatArray]:
    """The smaller ratio of both ways, by pair of laws."""
    found: dict[frozenset[str], FloatArray] = {}
    for name, ratio in zip(names, ratios, strict=True):
        found[frozenset(name)] = np.minimum(found.get(frozenset(name), ratio), ratio)
    return found


def _greedy(ways: Sequence[_Way], names: Names, most_tests: int, rules: Separating) -> list[int]:
    """Hits one after the other, each the one that brings all pairs nearest to the aim."""
    chosen: list[int] = []
    aim = float(np.log(rules.odds))
    counts = np.zeros(len(ways[0].c))
    while len(chosen) < rules.hits:
        pairs = np.stack(list(_by_pair(names, [way.with_one_more(counts) for way in ways]).values()))
        worth = np.minimum(pairs, aim).sum(axis=0) + 1e-3 * np.log1p(pairs).sum(axis=0)
        if len(set(chosen)) == most_tests:
            worth[[hit for hit in range(len(worth)) if hit not in chosen]] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        counts[best] += 1
        if pairs[:, best].min() >= aim:
            break
    return chosen


def _proposals(ways: Sequence[_Way], names: Names, chosen: list[int], grid: _Grid) -> tuple[Proposal, ...]:
    found, counts = [], np.zeros(len(grid.preload))
    before = _by_pair(names, [way.of(counts) for way in ways])
    for hit in dict.fromkeys(chosen):
        hits = chosen.count(hit)
        counts[hit] = hits
        after = _by_pair(names, [way.of(counts) for way in ways])
        gains = {key: float(ratio - before[key]) / hits for key, ratio in after.items()}
        pair = max(gains, key=lambda key: gains[key])
        before, worst = after, min(float(ratio) for ratio in after.values())
        found.append(
            Proposal(
                body=grid.body,
                peak_force=float(grid.peak_force[hit]),
                pulse_length=float(grid.pulse_length[hit]),
                preload=float(grid.preload[hit]),
                hits=hits,
                laws=next(name for name in names if frozenset(name) == pair),
                expected_gain=2 * gains[pair],
                odds=float(np.exp(min(worst, 700.0))),
            )
        )
    return tuple(found)
