"""Laws of the tension and slow readings fitted to the courses of all tests: what each takes from their cost.

Every effect is fitted beside the law's own numbers from several starts along frozen motion, corrected as the
baseline is; the best few are corrected by full re-simulation of their own (`discovery.residual.course_fit`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from joblib import delayed
from scipy import linalg

from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.tension_likelihood import (
    LawCandidate,
    changes_of,
    course,
    law_candidate,
    law_problem,
    names_of,
)
from discovery.courses.variability import tau
from discovery.decide.chance import largest_of_noise, p_value
from discovery.decide.explanation import limited, limited_number
from discovery.explain.tension_gain import Pair, TensionGain, at_bounds
from discovery.residual.course_fit import CourseFit, CourseFits
from discovery.residual.tension_data import TensionData
from discovery.residual.tension_records import coarse
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, LawChange, Member, ModelCorrection
from rom.model.laws import Parameter
from rom.signals.per_record_parameters import per_record_names

_COARSE: Numerical[int] = 3  # nodes that one stands for in a first, rough fit
_UNTOLD: Numerical[float] = 1e6  # times a number: an error that large is that of a direction without rows
_STRENGTHS: Numerical[tuple[float, ...]] = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # times a default


@dataclass(frozen=True, eq=False)
class LawSearch:
    """Fits of effects beside the law of one campaign."""

    data: TensionData
    jobs: int = 1

    @property
    def fits(self) -> CourseFits:
        """Fits of single laws."""
        return CourseFits(self.data)

    def explained(
        self, effects: Sequence[Pair], base: CourseFit, report: Callable[[], None]
    ) -> tuple[list[TensionGain], CourseFit]:
        """Fit every effect, the best of them by re-simulation; return a baseline that is no worse too.

        Parameters
        ----------
        effects : sequence of (Member, ModelCorrection)
            Changes of the law, readings at rest, and faults of the gauge.
        base : CourseFit
            The law alone.
        report : callable
            Called after every effect.

        Returns
        -------
        gains : list of TensionGain
            One for each effect.
        baseline : CourseFit
            The law alone, at least as good as `base`.
        """
        shared = [pair for pair in effects if not per_record_names(pair[1])]
        screened: list[tuple[ModelCorrection, CourseFit]] = []
        for fit in self._each(self._screened, ((*pair, base) for pair in shared)):
            screened.append((shared[len(screened)][1], fit))
            report()
        screened.sort(key=lambda pair: pair[1].training)
        if screened:
            base = self._without_effect(screened[0][1], base)
        gained = []
        for drifting in (effect for _, effect in effects if per_record_names(effect)):
            gained.append(self._drift(drifting, base))
            report()
        fits = [fit for _, fit in screened]
        final = self._each(
            self._final,
            ((fit, rank < self.data.criteria.resimulated_effects) for rank, fit in enumerate(fits)),
        )
        gained += [self._gain(effect, fit, base) for (effect, _), fit in zip(screened, final, strict=True)]
        return self._with_chance(gained, fits, base), base

    def _each(
        self, function: Callable[..., CourseFit], arguments: Iterable[tuple[object, ...]]
    ) -> Iterator[CourseFit]:
        """Results in order, by threads: courses are followed in compiled code that lets others run."""
        yield from side_by_side(self.jobs)(delayed(function)(*of) for of in arguments)

    def _final(self, fit: CourseFit, resimulate: bool) -> CourseFit:
        return self.fits.resimulated(fit) if resimulate else self.fits.with_costs(fit, self.data.frozen)

    def _with_chance(
        self, gained: Sequence[TensionGain], fits: Sequence[CourseFit], base: CourseFit
    ) -> list[TensionGain]:
        """With the chance that noise alone gives any of the effects as much."""
        if not fits:
            return list(gained)
        directions, level = [_directions(fit, base) for fit in fits], max(base.misfit.level, 1.0)
        largest = largest_of_noise(directions, level, self.data.frozen.criteria)
        count = self.data.training
        return [replace(g, p_value=p_value(float(g.gains[:count].sum()), largest)) for g in gained]

    def _without_effect(self, fit: CourseFit, base: CourseFit) -> CourseFit:
        """The law alone fitted from where a fit with an effect ended, if that is better than the baseline.

        Else every effect would gain what the baseline's own fit has missed.
        """
        own = {name: fit.candidate.parameters[name].value for name in base.candidate.free}
        again = self.fits.resimulated(self.fits.fitted(base.candidate.with_values(own), fit))
        return min(base, again, key=lambda one: one.training)

    def _screened(self, member: Member, effect: ModelCorrection, base: CourseFit) -> CourseFit:
        """Fit with an effect from the best of several starts, corrected as the baseline is."""
        own = {name: p.value for name, p in base.candidate.parameters.items() if name in base.candidate.free}
        count, usual = (
            len(self.data.part(hold_out=False)),
            self.data.frozen.criteria.courses.usual_variability,
        )
        scatter = np.array([np.log(usual), 0.0])
        fresh = replace(base, state=replace(base.state, u=np.zeros(count), scatter=scatter))
        pairs = []
        for sharing in self._sharings(effect, base):
            identified = law_candidate(self.data.model, effect, self.data.free, sharing)
            refitted = identified.with_values({n: v for n, v in own.items() if n in identified.parameters})
            pairs.append((refitted, base))
            if not base.misfit.is_noise:  # then it can be far astray: what was identified case by case is one
                pairs.append((identified, fresh))
        train = coarse(self.data.part(hold_out=False), _COARSE)
        fits = [self._coarsely(self._best_start(candidate, start, member, effect, train), start, train)
                for candidate, start in pairs]  # fmt: skip
        best = min(fits, key=lambda fit: fit.training)
        return self.fits.fitted(best.candidate, best, base.problem.offsets, roughly=True)

    def _coarsely(self, candidate: LawCandidate, start: CourseFit, train: FrozenMotion) -> CourseFit:
        """Fit along few nodes, corrected by what a start's own course differs there."""
        own, u = start.candidate, start.state.u
        differs = course(own, self.data.part(hold_out=False), u) - course(own, train, u)
        problem = law_problem(candidate, train, start.problem.offsets + differs)
        first = problem.solve(problem.theta0, start.state.scatter, u, steps=6)
        return self.fits.climbed(problem, first, roughly=True)

    def _best_start(
        self,
        candidate: LawCandidate,
        start: CourseFit,
        member: Member,
        effect: ModelCorrection,
        train: FrozenMotion,
    ) -> LawCandidate:
        """The candidate with those numbers of the effect on its grid that leave least."""
        names = names_of(effect)
        trials: list[tuple[float, int, LawCandidate]] = []
        for point in _starts(member, effect):
            trial = candidate.with_values({names[n]: v for n, v in point.items()})
            problem = law_problem(trial, train, start.problem.offsets)
            state = problem.solve(problem.theta0, start.state.scatter, start.state.u, steps=3)
            trials.append((state.deviance, len(trials), trial))
        return min(trials)[2]

    def _sharings(self, effect: ModelCorrection, base: CourseFit) -> tuple[int | None, ...]:
        """An effect may scatter from test to test as the law does, or be the same in all."""
        known = base.candidate.sharing
        if known is not None or not (isinstance(effect, LawChange) and effect.adds):
            return (known,)
        return (None, len(changes_of(self.data.model, None)))

    def _gain(self, effect: ModelCorrection, fit: CourseFit, base: CourseFit) -> TensionGain:
        if fit.training > base.training:  # as the full simulation has it, the law alone does better
            return TensionGain(_without_strength(effect), np.zeros_like(base.costs))
        numbers = numbers_of(fit)
        own = {name: numbers[path] for name, path in names_of(effect).items()}
        fitted = replace(effect, parameters=own)
        return TensionGain(
            fitted, base.costs - fit.costs, at_bounds(fitted), self._beside(fit), fit.misfit.level, slow=fit
        )

    def _beside(self, fit: CourseFit) -> dict[str, Parameter]:
        """Numbers of the model's own law as the fit has them."""
        numbers = numbers_of(fit)
        return {name: numbers[name] for name in self.data.free if name in numbers}

    def _drift(self, effect: ModelCorrection, base: CourseFit) -> TensionGain:
        """A reading of its own size in every record: a part of the courses' noise about what all share."""
        drift, drifting = self.data.drift, self.data.drifting or self.data.frozen
        train = self.data.part(hold_out=False, of=drifting)
        problem = law_problem(base.candidate, train, base.problem.offsets)
        start = problem.solve(problem.theta0, base.state.scatter, base.state.u, steps=6)
        fit = self.fits.with_costs(self.fits.climbed(problem, start), drifting)
        (name,) = per_record_names(effect)
        low, high = effect.parameters[name].bounds
        mean = effect.with_values(**{name: float(np.clip(drift.mean, low, high))})
        typical = limited(mean, {name: drift.spread})
        return TensionGain(typical, base.costs - fit.costs, (), self._beside(fit), fit.misfit.level)


def _directions(fit: CourseFit, base: CourseFit) -> FloatArray:
    """Directions of the whitened courses that an effect takes up beyond the law alone, (directions, rows).

    What it took off, and its slopes where the fit ended, less what a rate of each test's own and the law's
    numbers can do.
    """
    slope, jacobian = fit.state.slope, fit.problem.jacobian(fit.state)
    stiff = (slope**2).sum(axis=1) + 1 / tau(
        fit.state.scatter, fit.problem.frozen.initial, fit.problem.rules
    ) ** 2
    along = np.einsum("cb,cbp->cp", slope, jacobian) / stiff[:, None]
    columns = (jacobian - slope[:, :, None] * along[:, None, :]).reshape(-1, jacobian.shape[2])
    of_law = np.array([name in base.candidate.free for name in fit.candidate.free], dtype=bool)
    law = linalg.orth(columns[:, of_law])
    own = columns[:, ~of_law] - law @ (law.T @ columns[:, ~of_law])
    return np.vstack([(base.state.residual - fit.state.residual).ravel(), own.T])


def numbers_of(fit: CourseFit) -> dict[str, Parameter]:
    """Return the numbers that a fit moved, by name, with 95 % limits; without where the courses tell nothing.

    Where more than noise is left of the courses, the limits are as much wider.
    """
    variance = np.maximum(np.diag(fit.problem.covariance(fit.state)), 0.0) * max(fit.misfit.level, 1.0)
    numbers, found = fit.candidate.parameters, {}
    for name, error in zip(fit.candidate.free, np.sqrt(variance).tolist(), strict=True):
        told = error < _UNTOLD * max(abs(numbers[name].value), 1.0)
        found[name] = limited_number(numbers[name], error if told else 0.0)
    return found


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


def _without_strength(effect: ModelCorrection) -> ModelCorrection:
    """The effect with strengths of zero."""
    member = CATALOGUE.get(effect.name)  # of a free form all numbers are strengths
    return effect.with_values(**dict.fromkeys(effect.parameters if member is None else member.strengths, 0.0))
