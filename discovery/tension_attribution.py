"""What effects in the tension and in its gauge explain: every one of the catalogue, beside the refitted law.

Slow part: the course of the tension after each hit under a law, its case-to-case scatter integrated out
(``discovery.law_likelihood``). Fast part: what the gauge shows in phase with the motion, late, or at a line
(``discovery.tension_rows``). The cost of a record is the sum of both, the same before for all effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from discovery.explanation import Explanation
from discovery.law_likelihood import (
    LawCandidate,
    LawProblem,
    course,
    law_candidate,
    names_of,
    resimulated,
    slow_reading,
)
from discovery.likelihood import State
from discovery.motion import Frozen
from discovery.tension_rows import (
    Projected,
    Seen,
    altered,
    disturbed,
    following,
    frozen_of,
    noises,
    read_tensions,
    with_noise,
)
from rom.campaign import Campaign
from rom.channels import FloatArray
from rom.effects import CATALOGUE, Added, LawChange, Member, Motion, Reading, SensorFault, candidates
from rom.identification import Identification
from rom.model import Model
from rom.own_numbers import own_names
from rom.reduction import Progress

_REFINED = 5
_STRENGTHS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # times a default
_TRIED = 2  # best starts that are fitted
_ROUNDS = 2  # of correction by re-simulation
_Z95 = 1.959964
_U_STARTS = (0.0, -1.0, 1.0, -3.0)
_LINE_HZ = np.arange(-0.15, 0.151, 0.05)  # about a line's nominal frequency
_ALLOWED = 0.3  # of the smallest plausible strength of a fault: in every record by chance
_AT_BOUND = 1e-6  # of a range


@dataclass(frozen=True, eq=False)
class Slow:
    """A law fitted to the training courses, and its costs on all records."""

    candidate: LawCandidate
    state: State
    problem: LawProblem
    costs: FloatArray  # all records

    @property
    def training(self) -> float:
        """Cost of the training records."""
        return self.state.deviance


@dataclass(frozen=True, eq=False)
class Data:
    """All records of a campaign that tell something of the tension, training ones first."""

    model: Model
    seen: tuple[Seen, ...]
    frozen: Frozen
    training: int
    struck: FloatArray  # whether a record is a loosening one: coupled ones are not run again

    @property
    def files(self) -> list[str]:
        """Files in order."""
        return [seen.settings.file for seen in self.seen]

    def part(self, *, hold_out: bool, of: Frozen | None = None) -> Frozen:
        """Training or held-out records."""
        whole = of or self.frozen
        ends = (self.training, len(self.seen)) if hold_out else (0, self.training)
        return whole.subset(range(*ends))


def explain_tension(
    campaign: Campaign,
    found: Identification,
    model: Model,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[Explanation, ...]:
    """Return what every effect in the tension or its gauge explains that a model does not hold yet.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    found : Identification
        For the names of the law's numbers that were identified.
    model : Model
        The current model, effects that were accepted in it.
    jobs : int
        Processes for reading records.
    progress : callable
        Called with (effects done, effects in all).

    Returns
    -------
    tuple of Explanation
        One for each effect, those that take most from the training cost first.

    Raises
    ------
    ValueError
        If the model has not one bolted link, or no record has a tension and a hit.
    """
    seen = read_tensions(campaign, model, jobs)
    if not any(not s.settings.hold_out for s in seen):
        raise ValueError(f"{campaign.path}: found no training record with a tension and a hit")
    ordered = tuple(sorted(seen, key=lambda s: s.settings.hold_out))
    steady, drifting = noises(ordered)
    held = {effect.path for effect in model.effects}
    drifts = any(isinstance(e, Reading) and own_names(e) for e in model.effects)
    noise = drifting if drifts else steady
    data = Data(
        model, ordered, frozen_of(ordered, noise, model), sum(not s.settings.hold_out for s in ordered),
        np.array([s.settings.test == "loosening" for s in ordered]),
    )  # fmt: skip
    effects = [
        (member, effect)
        for member, effect in candidates(model, ["tension"])
        if effect.enters in ("tension", "sensor:tension") and effect.path not in held
        and isinstance(effect, (LawChange, Reading, SensorFault))
    ]  # fmt: skip
    free = tuple(found.gamma_fit.free) if found.gamma_fit is not None else ()
    slope = 1.0 if drifting.of_tension else float(np.median([s.bins.slope for s in ordered]))
    size = slope * float(np.sqrt(drifting.drift))
    search = _Search(data, free, with_noise(data.frozen, ordered, noise, drifting), size)
    return search.explained(effects, progress)


Pair = tuple[Member, Added]
Gained = tuple[Added, FloatArray, tuple[str, ...]]  # effect, costs taken away by record, numbers at a bound


@dataclass(eq=False)
class _Search:
    """The fits of one campaign."""

    data: Data
    free: tuple[str, ...]
    drifting: Frozen
    drift: float  # its typical size [N/s]

    def explained(self, effects: Sequence[Pair], progress: Progress | None) -> tuple[Explanation, ...]:
        laws = [pair for pair in effects if _of_course(*pair)]
        first = self._fitted(law_candidate(self.data.model, None, self.free), None)
        base = self._refined(first, self.data.frozen)
        gained, fast = self._fast([pair for pair in effects if pair not in laws])
        done = 0

        def report() -> None:
            nonlocal done
            done += 1
            if progress is not None:
                progress(done, len(laws))

        screened = []
        for member, effect in laws:
            if own_names(effect):
                gained.append(self._drift(effect, base))
            else:
                screened.append((effect, self._screened(member, effect, base)))
            report()
        screened.sort(key=lambda pair: pair[1].training)
        for rank, (effect, slow) in enumerate(screened):
            final = self._refined(slow, self.data.frozen) if rank < _REFINED else slow
            gained.append(self._gained(effect, final, base))
        return self._explanations(gained, base, fast)

    def _fitted(self, candidate: LawCandidate, start: Slow | None, offsets: FloatArray | None = None) -> Slow:
        """Fit to training courses from a start with another fit's scatter, deviations and corrections."""
        train = self.data.part(hold_out=False)
        if offsets is None:
            offsets = start.problem.offsets if start is not None else np.zeros_like(train.change)
        problem = LawProblem(candidate, train, offsets)
        first = (
            problem.first(None)
            if start is None
            else problem.solve(problem.theta0, start.state.scatter, start.state.u, steps=6)
        )
        state = problem.fitted(first)
        found = problem.at(state.theta)
        assert isinstance(found, LawCandidate)
        return Slow(found, state, problem, np.zeros(0))

    def _refined(self, slow: Slow, frozen: Frozen) -> Slow:
        """Correct by full re-simulation, fit again, and take the held-out records' costs."""
        for _ in range(_ROUNDS):
            offsets = self._offsets(slow.candidate, slow.problem.frozen, slow.state.u, 0)
            if not np.isfinite(offsets).all():
                break
            slow = self._fitted(slow.candidate, slow, offsets)
        return self._with_costs(slow, frozen, None)

    def _offsets(self, candidate: LawCandidate, part: Frozen, u: FloatArray, first: int) -> FloatArray:
        """Full re-simulation less frozen course [N]; small hits leave the tension alone and are not run."""
        struck = np.flatnonzero(self.data.struck[first : first + len(part)])
        out = np.zeros_like(part.change)
        if len(struck):
            some = part.subset(struck)
            out[struck] = resimulated(candidate, some, u[struck], self.data.model)
            out[struck] -= course(candidate, some, u[struck])
        return out

    def _with_costs(self, slow: Slow, frozen: Frozen, offsets: FloatArray | None) -> Slow:
        """Add costs of all records; held-out ones by corrections of their own, or those given."""
        costs = slow.state.by_case + self._log_volume(slow.problem)
        if self.data.training == len(self.data.seen):
            return replace(slow, costs=costs)
        unseen = self.data.part(hold_out=True, of=frozen)
        if offsets is None:
            offsets = np.zeros_like(unseen.change)
            at = _predictive(LawProblem(slow.candidate, unseen, offsets), slow.state)
            offsets = np.nan_to_num(self._offsets(slow.candidate, unseen, at.u, self.data.training))
        problem = LawProblem(slow.candidate, unseen, offsets)
        hidden = _predictive(problem, slow.state).by_case
        hidden = hidden + self._log_volume(problem, hold_out=True)
        return replace(slow, costs=np.concatenate([costs, hidden]))

    def _log_volume(self, problem: LawProblem, *, hold_out: bool = False) -> FloatArray:
        """What another noise than the usual one adds to costs."""
        usual = np.linalg.slogdet(self.data.part(hold_out=hold_out).covariance)[1]
        return np.asarray(problem.log_determinant - usual)

    def _screened(self, member: Member, effect: Added, base: Slow) -> Slow:
        """Fit with an effect from the best of several starts, corrected as the baseline is."""
        candidate = law_candidate(self.data.model, effect, self.free)
        values = {name: p.value for name, p in base.candidate.parameters.items()}
        candidate = candidate.with_values(
            {n: v for n, v in values.items() if n in candidate.parameters and n in base.candidate.free}
        )
        names = names_of(effect)
        train, offsets = self.data.part(hold_out=False), base.problem.offsets
        starts: list[tuple[float, int, LawCandidate]] = []
        for point in _starts(member, effect):
            trial = candidate.with_values({names[n]: v for n, v in point.items()})
            problem = LawProblem(trial, train, offsets)
            state = problem.solve(problem.theta0, base.state.scatter, base.state.u, steps=3)
            starts.append((state.deviance, len(starts), trial))
        fits = [self._fitted(trial, base) for _, _, trial in sorted(starts)[:_TRIED]]
        best = min(fits, key=lambda fit: fit.training)
        return self._with_costs(best, self.data.frozen, None)

    def _gained(self, effect: Added, slow: Slow, base: Slow) -> Gained:
        if slow.training > base.training:  # as the full simulation has it, the law alone does better
            return _silent(effect), np.zeros_like(base.costs), ()
        names, numbers = names_of(effect), slow.candidate.parameters
        error = np.sqrt(np.maximum(np.diag(slow.problem.covariance(slow.state)), 0.0))
        errors = dict(zip(slow.candidate.free, error, strict=True))
        found = effect.with_values(**{name: numbers[path].value for name, path in names.items()})
        limited = _limited(found, {name: float(errors[path]) for name, path in names.items()})
        return limited, base.costs - slow.costs, _at_bounds(limited)

    def _drift(self, effect: Added, base: Slow) -> Gained:
        """A reading of its own size in every record: a part of the courses' noise, its size unknown."""
        train = self.data.part(hold_out=False, of=self.drifting)
        problem = LawProblem(base.candidate, train, base.problem.offsets)
        state = problem.fitted(problem.solve(problem.theta0, base.state.scatter, base.state.u, steps=6))
        found = problem.at(state.theta)
        assert isinstance(found, LawCandidate)
        slow = self._with_costs(Slow(found, state, problem, np.zeros(0)), self.drifting, None)
        (name,) = own_names(effect)
        low, high = effect.parameters[name].bounds
        return (
            effect.with_values(**{name: float(np.clip(self.drift, low, high))}),
            base.costs - slow.costs,
            (),
        )

    def _fast(self, effects: Sequence[Pair]) -> tuple[list[Gained], FloatArray]:
        """Gains of effects in the fast part, and its cost by record."""
        readings = [(m, e) for m, e in effects if isinstance(e, Reading)]
        gained: list[Gained] = []
        cost = np.zeros(len(self.data.seen))
        if readings:
            rows, places = self._rows(readings)
            cost += [float(row.seen @ row.seen) for row in rows]
            gained += [self._linear(effect, rows, places[effect.path]) for _, effect in readings]
        for member, effect in effects:
            if not isinstance(effect, SensorFault):
                continue
            found, before = self._line(member, effect) if own_names(effect) else self._altered(member, effect)
            cost += before
            gained.append(found)
        return gained, cost

    def _nodes(self, case: int) -> FloatArray:
        return self.data.frozen.of_case(case)

    def _rows(self, readings: Sequence[Pair]) -> tuple[list[Projected], Mapping[str, slice]]:
        units: list[Reading] = []
        places = {}
        for member, effect in readings:
            first = len(units)
            for name in member.strengths:
                none = effect.with_values(**dict.fromkeys(member.strengths, 0.0))
                unit = none.with_values(**{name: member.strengths[name]})
                assert isinstance(unit, Reading)
                units.append(unit)
            places[effect.path] = slice(first, len(units))
        rows = []
        for case, seen in enumerate(self.data.seen):
            motion = _measured_motion(seen)
            rows.append(following(seen, self._nodes(case), [unit.added(motion) for unit in units]))
        return rows, places

    def _linear(self, effect: Added, rows: Sequence[Projected], place: slice) -> Gained:
        train = rows[: self.data.training]
        squares = np.array([row.columns[:, place].T @ row.columns[:, place] for row in train])
        rights = np.array([row.columns[:, place].T @ row.seen for row in train])
        inverse = np.linalg.pinv(squares.sum(axis=0))
        found = inverse @ rights.sum(axis=0)
        scores = rights - squares @ found
        error = np.sqrt(np.maximum(np.diag(inverse @ (scores.T @ scores) @ inverse), np.diag(inverse)))
        left = [row.seen - row.columns[:, place] @ found for row in rows]
        gains = [float(row.seen @ row.seen - rest @ rest) for row, rest in zip(rows, left, strict=True)]
        names = list(effect.parameters)[: len(found)]
        least = CATALOGUE[effect.name].strengths
        values, errors = {}, {}
        for name, value, spread in zip(names, found, error, strict=True):
            low, high = effect.parameters[name].bounds
            values[name] = float(np.clip(value * least[name], low, high))
            errors[name] = float(spread * least[name])
        limited = _limited(effect.with_values(**values), errors)
        return limited, np.array(gains), _at_bounds(limited)

    def _altered(self, member: Member, effect: SensorFault) -> tuple[Gained, FloatArray]:
        (name,) = member.strengths
        low, high = effect.parameters[name].bounds
        sizes = np.geomspace(0.2 * member.strengths[name], high, 60)
        grid = np.concatenate([-sizes[::-1], sizes] if low < 0 else [sizes])
        faults = [effect.with_values(**{name: float(value)}) for value in grid]
        least = int(np.argmin(np.abs(grid - _ALLOWED * member.strengths[name])))
        rows = [altered(seen, self._nodes(case), faults, least) for case, seen in enumerate(self.data.seen)]
        gains = np.array(
            [(row.seen @ row.seen) - ((row.seen[:, None] - row.columns) ** 2).sum(axis=0) for row in rows]
        )
        total = gains[: self.data.training].sum(axis=0)
        best = int(np.argmax(total))
        bend = -np.gradient(np.gradient(total, grid), grid)[best]
        limited = _limited(faults[best], {name: float(np.sqrt(2 / max(bend, 1e-300)))})
        before = np.array([float(row.seen @ row.seen) for row in rows])
        return (limited, gains[:, best], _at_bounds(limited)), before

    def _line(self, member: Member, effect: SensorFault) -> tuple[Gained, FloatArray]:
        """A disturbance of each record's own size, told before the hit, at one frequency for all."""
        own = own_names(effect)
        (inner,) = [name for name in effect.parameters if name not in own]
        grid = np.array([f + d for f in member.inner[inner] for d in _LINE_HZ])
        none = effect.with_values(**dict.fromkeys(own, 0.0))
        gains, coefficients, before = [], [], []
        for case, seen in enumerate(self.data.seen):
            zero = np.zeros(len(seen.tension))
            groups = [
                [none.with_values(**{name: 1.0, inner: float(f)}).apply(zero, seen.rate_hz) for name in own]
                for f in grid
            ]
            row = disturbed(seen, self._nodes(case), groups)
            assert row.own is not None
            before.append(float(row.seen @ row.seen))
            sizes = row.own.reshape(len(grid), len(own))
            parts = row.columns.reshape(len(row.seen), len(grid), len(own))
            rest = row.seen[:, None] - np.einsum("rfo,fo->rf", parts, sizes)
            gains.append(before[-1] - (rest**2).sum(axis=0))
            coefficients.append(sizes)
        table = np.array(gains)
        best = int(np.argmax(table[: self.data.training].sum(axis=0)))
        mean = np.array(coefficients)[: self.data.training, best].mean(axis=0)
        values = dict(zip(own, mean.tolist(), strict=True))
        found = effect.with_values(**values, **{inner: float(grid[best])})
        return (found, table[:, best], ()), np.array(before)

    def _explanations(
        self, gained: Sequence[Gained], base: Slow, fast: FloatArray
    ) -> tuple[Explanation, ...]:
        files, training = self.data.files, self.data.training
        before = base.costs + fast
        count = base.problem.frozen.change.shape[1] + 8
        found = [
            Explanation(
                effect,
                dict(zip(files, before.tolist(), strict=True)),
                dict(zip(files, (before - gains).tolist(), strict=True)),
                dict.fromkeys(files, count),
                frozenset(files[training:]),
                len(effect.parameters) - len(own_names(effect)),
                at_bound,
            )
            for effect, gains, at_bound in gained
        ]
        return tuple(sorted(found, key=lambda e: -float(e.gains(hold_out=False).sum())))


def _of_course(member: Member, effect: Added) -> bool:
    """Whether an effect shows in the course: a law, a reading at rest, a fault that moves a constant."""
    if isinstance(effect, LawChange):
        return True
    probe = member.at(effect.enters)
    if isinstance(probe, Reading):
        return bool(np.abs(slow_reading(probe, np.array([0.0, 0.1, 1.0]))).max() > 0)
    assert isinstance(probe, SensorFault)
    level = np.full(64, 100.0)
    return not own_names(effect) and not np.allclose(probe.apply(level, 1e3), level)


def _starts(member: Member, effect: Added) -> list[dict[str, float]]:
    """Values to start from: default strengths times powers of ten, over the grid of the others."""
    points = []
    for inner in product(*member.inner.values()):
        for factor, sign in product(_STRENGTHS, (1.0, -1.0)):
            values = dict(zip(member.inner, inner, strict=True))
            for name, least in member.strengths.items():
                number = effect.parameters[name]
                low, high = number.bounds
                if sign < 0 <= low:
                    break
                values[name] = float(np.clip(sign * factor * (number.value or least), low, high))
            else:
                if values not in points:
                    points.append(values)
    return points


def _silent(effect: Added) -> Added:
    return effect.with_values(**dict.fromkeys(CATALOGUE[effect.name].strengths, 0.0))


def _predictive(problem: LawProblem, at: State) -> State:
    """Unseen records at fitted numbers, the deviations integrated out about the best mode."""
    lowest, place = np.full(len(problem.frozen), np.inf), np.zeros(len(problem.frozen))
    for start in _U_STARTS:
        state = problem.solve(problem.theta0, at.scatter, np.full(len(place), start), steps=12)
        place = np.where(state.by_case < lowest, state.u, place)
        lowest = np.fmin(lowest, state.by_case)
    return problem.solve(problem.theta0, at.scatter, place, steps=0)


def _measured_motion(seen: Seen) -> Motion:
    time = np.arange(len(seen.tension)) / seen.rate_hz
    return Motion(time, seen.course.impact_s, seen.displacement, seen.link_force, seen.bodies)


def _limited(effect: Added, errors: Mapping[str, float]) -> Added:
    """The effect with 95 % limits, within the ranges."""
    parameters = {}
    for name, number in effect.parameters.items():
        low, high = number.bounds
        half = _Z95 * errors.get(name, 0.0)
        if half > 0 and np.isfinite(half):
            ends = (max(number.value - half, low), min(number.value + half, high))
            number = replace(number, low=ends[0], high=ends[1])
        parameters[name] = number
    return replace(effect, parameters=parameters)


def _at_bounds(effect: Added) -> tuple[str, ...]:
    found = []
    for name, number in effect.parameters.items():
        low, high = number.bounds
        near = _AT_BOUND * (high - low)
        if number.value >= high - near or number.value <= low + near:
            found.append(name)
    return tuple(found)
