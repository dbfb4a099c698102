"""Laws of the tension and slow readings fitted to the courses of all tests: what each takes from their cost.

Every effect is fitted beside the law's own numbers from several starts along frozen motion, corrected as the
baseline is; the best few are corrected by full re-simulation of their own
(`discovery.courses.tension_likelihood`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from joblib import delayed
from scipy import linalg

from discovery.courses.fit import Fit
from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.marginal_likelihood import State, tau
from discovery.courses.tension_likelihood import (
    LawCandidate,
    LawProblem,
    changes_of,
    course,
    law_candidate,
    names_of,
    resimulated,
)
from discovery.decide.chance import largest_of_noise, p_value
from discovery.decide.explanation import limited, limited_number
from discovery.residual.tension import Drift
from discovery.residual.tension_data import Data, Gained, Misfit, Pair, at_bounds
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, LawChange, Member, ModelCorrection
from rom.model.laws import Parameter
from rom.signals.per_record_parameters import per_record_names

_REFINED = 5
_STRENGTHS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # times a default
_FRESH = np.array([np.log(0.5), 0.0])  # scatter to start from
_ROUGHLY = (0.5, 8)  # gain of a step and number of steps: enough to screen by
_ROUNDS = 2  # of correction by re-simulation
_UNTOLD = 2  # directions of a course that may oscillate with the motion
_U_STARTS = (0.0, -1.0, 1.0, -3.0)


@dataclass(frozen=True, eq=False)
class CourseFit:
    """A law fitted to the training courses, and its costs on all records."""

    candidate: LawCandidate
    state: State
    problem: LawProblem
    costs: FloatArray  # all records

    @property
    def training(self) -> float:
        """Cost of the training records."""
        return self.state.deviance

    @property
    def fit(self) -> Fit:
        """The fit as tests are proposed by it."""
        state, problem = self.state, self.problem
        return Fit(
            self.candidate, self.candidate.free, problem.covariance(state), state.deviance,
            (float(state.scatter[0]), float(state.scatter[1])), problem.offsets, state.u, converged=True,
        )  # fmt: skip

    @property
    def misfit(self) -> Misfit:
        """What the law leaves over of the training courses.

        Every course has two directions that nothing is told of, and a rate of its own.
        """
        information = (self.state.slope**2).sum(axis=1)
        told = information / (information + 1 / tau(self.state.scatter, self.problem.frozen.initial) ** 2)
        rows = self.state.residual.shape[1] - _UNTOLD - told
        return Misfit(float((self.state.residual**2).sum() / rows.sum()), float(rows.sum()))


@dataclass(eq=False)
class LawSearch:
    """Fits to the courses of one campaign; `free` are the numbers of the model's own law that may move."""

    data: Data
    free: tuple[str, ...]
    drifting: FrozenMotion
    drift: Drift
    jobs: int = 1

    def baseline(self) -> CourseFit:
        """Fit the law as it is."""
        model = self.data.model
        alone = [place for place, change in enumerate(changes_of(model, None)) if change.adds]
        fits = [self._fitted(law_candidate(model, None, self.free, k), None) for k in (None, *alone)]
        return self._refined(min(fits, key=lambda fit: fit.training))

    def explained(
        self, effects: Sequence[Pair], base: CourseFit, report: Callable[[], None]
    ) -> tuple[list[Gained], CourseFit]:
        """Fit every effect, the best of them by re-simulation; return a baseline that is no worse too."""
        shared = [pair for pair in effects if not per_record_names(pair[1])]
        screened: list[tuple[ModelCorrection, CourseFit]] = []
        for found in self._each(self._screened, ((*pair, base) for pair in shared)):
            screened.append((shared[len(screened)][1], found))
            report()
        screened.sort(key=lambda pair: pair[1].training)
        if screened:
            base = self._without_effect(screened[0][1], base)
        gained = [self._drift(effect, base) for _, effect in effects if per_record_names(effect)]
        fits = [slow for _, slow in screened]
        final = self._each(self._final, ((slow, rank < _REFINED) for rank, slow in enumerate(fits)))
        gained += [
            self._gained(effect, slow, base) for (effect, _), slow in zip(screened, final, strict=True)
        ]
        return self._judged(gained, fits, base), base

    def _each(
        self, function: Callable[..., CourseFit], arguments: Iterable[tuple[object, ...]]
    ) -> Iterator[CourseFit]:
        """Results in order, by threads: courses are followed in compiled code that lets others run."""
        yield from side_by_side(self.jobs)(delayed(function)(*one) for one in arguments)

    def _final(self, slow: CourseFit, refined: bool) -> CourseFit:
        return self._refined(slow) if refined else self._with_costs(slow, self.data.frozen)

    def _judged(self, gained: Sequence[Gained], fits: Sequence[CourseFit], base: CourseFit) -> list[Gained]:
        """With the chance that noise alone gives any of the effects as much."""
        if not fits:
            return list(gained)
        largest = largest_of_noise([_directions(fit, base) for fit in fits], max(base.misfit.level, 1.0))
        count = self.data.training
        return [replace(g, p_value=p_value(float(g.gains[:count].sum()), largest)) for g in gained]

    def _without_effect(self, slow: CourseFit, base: CourseFit) -> CourseFit:
        """The law alone fitted from where a fit with an effect ended, if that is better than the baseline.

        Else every effect would gain what the baseline's own fit has missed.
        """
        own = {name: slow.candidate.parameters[name].value for name in base.candidate.free}
        again = self._refined(self._fitted(base.candidate.with_values(own), slow))
        return min(base, again, key=lambda fit: fit.training)

    def _fitted(
        self,
        candidate: LawCandidate,
        start: CourseFit | None,
        offsets: FloatArray | None = None,
        *,
        roughly: bool = False,
    ) -> CourseFit:
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
        state = problem.fitted(first, *_ROUGHLY) if roughly else problem.fitted(first)
        found = problem.at(state.theta)
        assert isinstance(found, LawCandidate)
        return CourseFit(found, state, problem, np.zeros(0))

    def _refined(self, slow: CourseFit) -> CourseFit:
        """Correct by full re-simulation, fit again, and take the held-out records' costs."""
        for _ in range(_ROUNDS):
            offsets = self._offsets(slow.candidate, slow.problem.frozen, slow.state.u, 0)
            if not np.isfinite(offsets).all():
                break
            slow = self._fitted(slow.candidate, slow, offsets)
        return self._with_costs(slow, self.data.frozen)

    def _offsets(self, candidate: LawCandidate, part: FrozenMotion, u: FloatArray, first: int) -> FloatArray:
        """Full re-simulation less frozen course [N]; small hits leave the tension alone and are not run."""
        struck = np.flatnonzero(self.data.struck[first : first + len(part)])
        out = np.zeros_like(part.change)
        if len(struck):
            some = part.subset(struck)
            out[struck] = resimulated(candidate, some, u[struck], self.data.model)
            out[struck] -= course(candidate, some, u[struck])
        return out

    def _with_costs(self, slow: CourseFit, frozen: FrozenMotion) -> CourseFit:
        """Add costs of all records, held-out ones by corrections of their own."""
        costs = slow.state.by_case + self._log_volume(slow.problem)
        if self.data.training == len(self.data.seen):
            return replace(slow, costs=costs)
        unseen = self.data.part(hold_out=True, of=frozen)
        plain = LawProblem(slow.candidate, unseen, np.zeros_like(unseen.change))
        at = _predictive(plain, slow.state)
        offsets = np.nan_to_num(self._offsets(slow.candidate, unseen, at.u, self.data.training))
        problem = LawProblem(slow.candidate, unseen, offsets)
        # at a rate far from all others the correction at the first mode holds nowhere near
        hidden = np.fmin(_predictive(problem, slow.state).by_case, at.by_case)
        return replace(slow, costs=np.concatenate([costs, hidden + self._log_volume(problem, hold_out=True)]))

    def _log_volume(self, problem: LawProblem, *, hold_out: bool = False) -> FloatArray:
        """What another noise than the usual one adds to costs."""
        usual = np.linalg.slogdet(self.data.part(hold_out=hold_out).covariance)[1]
        return np.asarray(problem.log_determinant - usual)

    def _screened(self, member: Member, effect: ModelCorrection, base: CourseFit) -> CourseFit:
        """Fit with an effect from the best of several starts, corrected as the baseline is."""
        own = {name: p.value for name, p in base.candidate.parameters.items() if name in base.candidate.free}
        names, offsets = names_of(effect), base.problem.offsets
        train = self.data.part(hold_out=False)
        fresh = replace(base, state=replace(base.state, u=np.zeros(len(train)), scatter=_FRESH))
        pairs = []
        for sharing in self._sharings(effect, base):
            identified = law_candidate(self.data.model, effect, self.free, sharing)
            refitted = identified.with_values({n: v for n, v in own.items() if n in identified.parameters})
            pairs.append((refitted, base))
            if not base.misfit.is_noise:  # then it can be far astray: what was identified case by case is one
                pairs.append((identified, fresh))
        fits = []
        for candidate, start in pairs:
            trials: list[tuple[float, int, LawCandidate]] = []
            for point in _starts(member, effect):
                trial = candidate.with_values({names[n]: v for n, v in point.items()})
                problem = LawProblem(trial, train, offsets)
                state = problem.solve(problem.theta0, start.state.scatter, start.state.u, steps=3)
                trials.append((state.deviance, len(trials), trial))
            fits.append(self._fitted(min(trials)[2], start, roughly=True))
        return min(fits, key=lambda fit: fit.training)

    def _sharings(self, effect: ModelCorrection, base: CourseFit) -> tuple[int | None, ...]:
        """An effect may scatter from test to test as the law does, or be the same in all."""
        known = base.candidate.sharing
        if known is not None or not (isinstance(effect, LawChange) and effect.adds):
            return (known,)
        return (None, len(changes_of(self.data.model, None)))

    def _gained(self, effect: ModelCorrection, slow: CourseFit, base: CourseFit) -> Gained:
        if slow.training > base.training:  # as the full simulation has it, the law alone does better
            return Gained(_silent(effect), np.zeros_like(base.costs))
        names, numbers, errors = names_of(effect), slow.candidate.parameters, _errors(slow)
        found = effect.with_values(**{name: numbers[path].value for name, path in names.items()})
        told = limited(found, {name: float(errors[path]) for name, path in names.items()})
        return Gained(
            told, base.costs - slow.costs, at_bounds(told), self._beside(slow, errors), slow.misfit.level,
            slow=slow,
        )  # fmt: skip

    def _beside(self, slow: CourseFit, errors: Mapping[str, float]) -> dict[str, Parameter]:
        """Numbers of the model's own law as the fit has them."""
        numbers = slow.candidate.parameters
        return {name: limited_number(numbers[name], errors.get(name, 0.0)) for name in self.free}

    def _drift(self, effect: ModelCorrection, base: CourseFit) -> Gained:
        """A reading of its own size in every record: a part of the courses' noise about what all share."""
        train = self.data.part(hold_out=False, of=self.drifting)
        problem = LawProblem(base.candidate, train, base.problem.offsets)
        state = problem.fitted(problem.solve(problem.theta0, base.state.scatter, base.state.u, steps=6))
        found = problem.at(state.theta)
        assert isinstance(found, LawCandidate)
        slow = self._with_costs(CourseFit(found, state, problem, np.zeros(0)), self.drifting)
        (name,) = per_record_names(effect)
        low, high = effect.parameters[name].bounds
        mean = effect.with_values(**{name: float(np.clip(self.drift.mean, low, high))})
        typical = limited(mean, {name: self.drift.spread})
        return Gained(
            typical, base.costs - slow.costs, (), self._beside(slow, _errors(slow)), slow.misfit.level
        )


def _directions(fit: CourseFit, base: CourseFit) -> FloatArray:
    """Directions of the whitened courses that an effect takes up beyond the law alone, (directions, rows).

    What it took off, and its slopes where the fit ended, less what a rate of each test's own and the law's
    numbers can do.
    """
    slope, jacobian = fit.state.slope, fit.problem.jacobian(fit.state)
    stiff = (slope**2).sum(axis=1) + 1 / tau(fit.state.scatter, fit.problem.frozen.initial) ** 2
    along = np.einsum("cb,cbp->cp", slope, jacobian) / stiff[:, None]
    columns = (jacobian - slope[:, :, None] * along[:, None, :]).reshape(-1, jacobian.shape[2])
    of_law = np.array([name in base.candidate.free for name in fit.candidate.free], dtype=bool)
    law = linalg.orth(columns[:, of_law])
    own = columns[:, ~of_law] - law @ (law.T @ columns[:, ~of_law])
    return np.vstack([(base.state.residual - fit.state.residual).ravel(), own.T])


def _errors(slow: CourseFit) -> dict[str, float]:
    """Standard errors of all free numbers of a fit."""
    found = np.sqrt(np.maximum(np.diag(slow.problem.covariance(slow.state)), 0.0))
    return dict(zip(slow.candidate.free, found.tolist(), strict=True))


def _starts(member: Member, effect: ModelCorrection) -> list[dict[str, float]]:
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


def _silent(effect: ModelCorrection) -> ModelCorrection:
    member = CATALOGUE.get(effect.name)  # of a free form all numbers are strengths
    return effect.with_values(**dict.fromkeys(effect.parameters if member is None else member.strengths, 0.0))


def _predictive(problem: LawProblem, at: State) -> State:
    """Unseen records at fitted numbers, the deviations integrated out about the best mode."""
    lowest, place = np.full(len(problem.frozen), np.inf), np.zeros(len(problem.frozen))
    for start in _U_STARTS:
        state = problem.solve(problem.theta0, at.scatter, np.full(len(place), start), steps=12)
        place = np.where(state.by_case < lowest, state.u, place)
        lowest = np.fmin(lowest, state.by_case)
    return problem.solve(problem.theta0, at.scatter, place, steps=0)
