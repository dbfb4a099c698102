"""Fits of a tension law to the courses of all tests, corrected by full re-simulation.

A law is fitted along frozen motion, then corrected by what a full simulation with the fitted numbers differs
from that, and fitted again (`discovery.courses.tension_likelihood`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from discovery.courses.fit import Fit, known_fit
from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.likelihood_steps import climbed
from discovery.courses.marginal_likelihood import Problem, State
from discovery.courses.tension_likelihood import (
    LawCandidate,
    changes_of,
    course,
    law_candidate,
    law_problem,
    resimulated,
)
from discovery.courses.variability import tau
from discovery.criteria.criteria import CRITERIA
from discovery.criteria.tension import Tension
from discovery.residual.tension_data import TensionData
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_STEPS: Numerical[tuple[float, int]] = (0.05, 20)  # gain of a step in deviance, number of steps
_ROUGH_STEPS: Numerical[tuple[float, int]] = (0.5, 8)  # the same to screen by
_ROUNDS: Numerical[int] = 2  # of correction by re-simulation
_U_STARTS: Numerical[tuple[float, ...]] = (0.0, -1.0, 1.0, -3.0)


@dataclass(frozen=True)
class Misfit:
    """Mean square of what a law leaves over of the courses, 1 being noise, of so many free numbers.

    `fit` is that law's, from which `discovery.localisation.tension.tension_views` takes where the misfit is.
    """

    level: float
    numbers: float
    fit: CourseFit | None = None
    criteria: Tension = CRITERIA.tension

    @property
    def is_noise(self) -> bool:
        """Whether chance alone would leave as much, or nearly so."""
        if self.numbers <= 0:
            return True
        by_chance = float(stats.chi2.isf(self.criteria.misfit_chance, self.numbers)) / self.numbers
        return self.level <= max(self.criteria.misfit_floor, by_chance)

    def loss_to(self, after: Misfit) -> float:
        """How much more of the courses another model leaves, as a cost."""
        return (after.level - self.level) * after.numbers


@dataclass(frozen=True, eq=False)
class CourseFit:
    """A law fitted to the training courses, and its costs on all records."""

    candidate: LawCandidate
    state: State
    problem: Problem
    costs: FloatArray  # all records
    criteria: Tension = CRITERIA.tension

    @property
    def training(self) -> float:
        """Cost of the training records."""
        return self.state.deviance

    @property
    def fit(self) -> Fit:
        """The fit as tests are proposed by it."""
        return known_fit(self.problem, self.state, self.candidate)

    @property
    def misfit(self) -> Misfit:
        """What the law leaves over of the training courses.

        Every course has two directions that nothing is told of, and a rate of its own.
        """
        information = (self.state.slope**2).sum(axis=1)
        deviation = tau(self.state.scatter, self.problem.frozen.initial, self.problem.rules)
        determined = information / (information + 1 / deviation**2)
        rows = self.state.residual.shape[1] - self.criteria.free_directions - determined
        level = float((self.state.residual**2).sum() / rows.sum())
        return Misfit(level, float(rows.sum()), self, self.criteria)


@dataclass(frozen=True, eq=False)
class CourseFits:
    """Fits of laws to the courses of one campaign."""

    data: TensionData

    def law_alone(self) -> CourseFit:
        """Fit the model's own law; each change that adds to its rate may scatter with it or not."""
        model, free = self.data.model, self.data.free
        alone = [place for place, change in enumerate(changes_of(model, None)) if change.adds]
        fits = [self.fitted(law_candidate(model, None, free, k), None) for k in (None, *alone)]
        return self.resimulated(min(fits, key=lambda fit: fit.training))

    def fitted(
        self,
        candidate: LawCandidate,
        start: CourseFit | None,
        offsets: FloatArray | None = None,
        *,
        roughly: bool = False,
    ) -> CourseFit:
        """Fit to the training courses, from a start with another fit's scatter, deviations and corrections.

        Parameters
        ----------
        candidate : LawCandidate
            The law, its numbers to start from.
        start : CourseFit or None
            Another fit; unit rates where there is none.
        offsets : ndarray, shape (training records, bins), optional
            Corrections by re-simulation [N], those of the start by default.
        roughly : bool
            Whether few steps are enough.

        Returns
        -------
        CourseFit
            At the likelihood's maximum over the training records.
        """
        train = self.data.part(hold_out=False)
        if offsets is None:
            offsets = start.problem.offsets if start is not None else np.zeros_like(train.change)
        problem = law_problem(candidate, train, offsets)
        if start is None:
            scatter = np.array([np.log(problem.rules.usual_variability), 0.0])
            first = problem.solve(problem.theta0, scatter, np.zeros(len(train)), steps=12)
        else:
            first = problem.solve(problem.theta0, start.state.scatter, start.state.u, steps=6)
        return self.climbed(problem, first, roughly=roughly)

    def climbed(self, problem: Problem, state: State, *, roughly: bool = False) -> CourseFit:
        """The fit to which steps from a state lead, without costs.

        Parameters
        ----------
        problem : Problem
            Of a `LawCandidate`.
        state : State
            The start.
        roughly : bool
            Whether few steps are enough.
        """
        state, _ = climbed(problem, state, *(_ROUGH_STEPS if roughly else _STEPS))
        candidate = problem.at(state.theta)
        assert isinstance(candidate, LawCandidate)
        return CourseFit(candidate, state, problem, np.zeros(0), self.data.criteria)

    def resimulated(self, fit: CourseFit) -> CourseFit:
        """Correct by full re-simulation, fit again, and add the held-out records' costs."""
        for _ in range(_ROUNDS):
            offsets = self._offsets(fit.candidate, fit.problem.frozen, fit.state.u, 0)
            if not np.isfinite(offsets).all():
                break
            fit = self.fitted(fit.candidate, fit, offsets)
        return self.with_costs(fit, self.data.frozen)

    def with_costs(self, fit: CourseFit, frozen: FrozenMotion) -> CourseFit:
        """Add costs of all records, held-out ones by corrections of their own."""
        costs = fit.state.by_case + self._log_volume(fit.problem)
        if self.data.training == len(self.data.records):
            return replace(fit, costs=costs)
        unseen = self.data.part(hold_out=True, of=frozen)
        plain = law_problem(fit.candidate, unseen, np.zeros_like(unseen.change))
        at = _predictive(plain, fit.state)
        offsets = np.nan_to_num(self._offsets(fit.candidate, unseen, at.u, self.data.training))
        problem = law_problem(fit.candidate, unseen, offsets)
        # at a rate far from all others the correction at the first mode holds nowhere near
        hidden = np.fmin(_predictive(problem, fit.state).by_case, at.by_case)
        return replace(fit, costs=np.concatenate([costs, hidden + self._log_volume(problem, hold_out=True)]))

    def _offsets(self, candidate: LawCandidate, part: FrozenMotion, u: FloatArray, first: int) -> FloatArray:
        """Full re-simulation less frozen course [N]; small hits leave the tension alone and are not run."""
        struck = np.flatnonzero(self.data.struck[first : first + len(part)])
        out = np.zeros_like(part.change)
        if len(struck):
            some = part.subset(struck)
            out[struck] = resimulated(candidate, some, u[struck], self.data.model)
            out[struck] -= course(candidate, some, u[struck])
        return out

    def _log_volume(self, problem: Problem, *, hold_out: bool = False) -> FloatArray:
        """What another noise than the usual one adds to costs."""
        usual = np.linalg.slogdet(self.data.part(hold_out=hold_out).covariance)[1]
        return np.asarray(problem.log_determinant - usual)


def _predictive(problem: Problem, at: State) -> State:
    """Unseen records at fitted numbers, the deviations integrated out about the best mode."""
    lowest, place = np.full(len(problem.frozen), np.inf), np.zeros(len(problem.frozen))
    for start in _U_STARTS:
        state = problem.solve(problem.theta0, at.scatter, np.full(len(place), start), steps=12)
        place = np.where(state.by_case < lowest, state.u, place)
        lowest = np.fmin(lowest, state.by_case)
    return problem.solve(problem.theta0, at.scatter, place, steps=0)
