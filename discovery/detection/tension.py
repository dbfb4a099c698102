"""What effects in the tension and its gauge add to the tension's histories, and to their fast part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.marginal_likelihood import Problem, State
from discovery.courses.tension_likelihood import course, law_candidate, law_problem
from discovery.courses.variability import tau
from discovery.decide.chance import largest_of_noise
from discovery.detection.limit import dispersion
from discovery.detection.power import Background, Response
from discovery.explain.strain_gauge import fault_rows, measured_motion, reading_rows
from discovery.explain.tension import candidates_in_tension, in_course
from discovery.residual.course_fit import CourseFit, CourseFits, predictive
from discovery.residual.tension import TensionResidual
from discovery.residual.tension_data import TensionData
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Member, ModelCorrection, Reading, SensorFault
from rom.signals.per_record_parameters import per_record_names

OWN_NUMBERS = "it has a number of each record's own; its limit is not calculated"
PRELOADS = "declared preloads alone show it; its limit is not calculated"
_SAME: Numerical[float] = 1e-8
_TINY: Numerical[float] = 1e-300


@dataclass(frozen=True, eq=False)
class _Part:
    """Training or hold-out histories: the law's fit to them, and its slopes without each test's own rate."""

    problem: Problem
    state: State

    def marginal(self, rows: FloatArray) -> FloatArray:
        """Whitened rows, (cases, bins) or (cases, bins, n), as the rate of each test leaves them."""
        slope = self.state.slope
        size = np.maximum(np.linalg.norm(slope, axis=1), 1e-300)
        along = slope / size[:, None]
        deviation = tau(self.state.scatter, self.problem.frozen.initial, self.problem.rules)
        share = 1 - 1 / np.sqrt(1 + (deviation * size) ** 2)
        shaped = rows if rows.ndim == 3 else rows[:, :, None]
        taken = np.einsum("cb,cbp->cp", along, shaped) * share[:, None]
        return np.asarray((shaped - along[:, :, None] * taken[:, None, :]).reshape(rows.shape))

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes by the law's free numbers, (cases, bins, numbers)."""
        return self.marginal(self.problem.jacobian(self.state))

    @property
    def left(self) -> FloatArray:
        """What the law leaves over, (cases, bins)."""
        return self.marginal(self.state.residual)

    def change(self, shown: FloatArray) -> FloatArray:
        """Changes of histories [N], (cases, bins), whitened."""
        return self.marginal(np.einsum("cij,cj->ci", self.problem.whitener, shown))


@dataclass(frozen=True, eq=False)
class TensionMeter:
    """Effects in the tension's histories: laws, slow readings, faults that move a level.

    Attributes
    ----------
    residual : TensionResidual
        Of the last model.
    data : TensionData
        Its records.
    base : CourseFit
        The fit of the model's own law.
    blocked : str
        Why none is looked for; empty where they are.
    """

    residual: TensionResidual
    data: TensionData
    base: CourseFit
    blocked: str = ""

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Effects of the catalogue in the histories."""
        return [pair for pair in candidates_in_tension(self.residual) if in_course(*pair)]

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:
        """A drift is each record's own."""
        if self.blocked or per_record_names(effect):
            return self.blocked or OWN_NUMBERS
        return PRELOADS if member.kind == "sensor" else ""

    def is_linear(self, member: Member) -> bool:  # noqa: ARG002
        """A tension that is lost is lost once."""
        return False

    @cached_property
    def _parts(self) -> tuple[_Part, _Part | None]:
        """Training and hold-out histories."""
        first = _Part(self.base.problem, self.base.state)
        if self.data.training == len(self.data.records):
            return first, None
        unseen = self.data.part(hold_out=True)
        problem = law_problem(self.base.candidate, unseen, np.zeros_like(unseen.change))
        return first, _Part(problem, predictive(problem, self.base.state))

    @cached_property
    def _law(self) -> FloatArray:
        """Slopes of the training histories by the law's numbers, (rows, numbers)."""
        slopes = self._parts[0].slopes
        return slopes.reshape(-1, slopes.shape[2])

    @cached_property
    def background(self) -> Background:
        """What the law leaves of the histories; chance is that of normal numbers along all effects."""
        criteria, misfit = self.data.frozen.criteria, self.base.misfit
        rules = criteria.acceptance
        level = max(misfit.level, 1.0)
        return Background(
            float(self.base.costs[: self.data.training].sum()), misfit.level,
            (rules.training_gain_tension, rules.hold_out_gain_tension),
            chance=self._chance(level), criteria=criteria,
        )  # fmt: skip

    def _chance(self, level: float) -> FloatArray:
        directions = []
        for member, effect in self.pairs():
            if not self.unavailable(member, effect):
                rows = [r for probe in member.probes(effect) if (r := self._beyond(probe)) is not None]
                directions += [np.stack([one[0].ravel() for one in rows])] if rows else []
        none = np.zeros(0)
        return largest_of_noise(directions, level, self.data.frozen.criteria) if directions else none

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training histories."""
        found = (self._beyond(effect) for effect in effects)
        return [0.0 if one is None else float(np.sum(one[0] ** 2)) for one in found]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response | None]:
        """What effects add."""
        return [self._response(effect) for effect in effects]

    def _response(self, effect: ModelCorrection) -> Response | None:
        found = self._beyond(effect)
        if found is None:
            return None
        trained, unseen, felt = found
        squares = [np.sum(rows**2, axis=1) for rows in (trained, unseen)]
        second, other = self._parts[1], 1.0
        if second is not None:
            other = dispersion(np.sum(unseen * second.left, axis=1), float(squares[1].sum()), 1.0)
        kept = self._kept(effect, float(squares[0].sum()))
        level = max(self.base.misfit.level, 1.0)
        return Response(kept * squares[0], kept * squares[1], level, felt=felt, unseen_dispersion=other)

    def _kept(self, effect: ModelCorrection, square: float) -> float:
        """Share of the square that is left where the law and the between-test variability are refitted."""
        base, first = self.base, self._parts[0]
        frozen = first.problem.frozen
        shown = self._shown(effect, frozen, first.state.u)
        moved = replace(frozen, change=frozen.change + shown)
        problem = law_problem(base.candidate, moved, base.problem.offsets)
        start = problem.solve(base.state.theta, base.state.scatter, base.state.u, steps=6)
        alone = CourseFits(self.data).climbed(problem, start, roughly=True)
        gain = alone.state.deviance - base.state.deviance
        return float(np.clip(gain / max(square, _TINY), 0.0, 1.0))

    def _beyond(self, effect: ModelCorrection) -> tuple[FloatArray, FloatArray, float] | None:
        """What the law and the rates of each test leave of an effect, (cases, bins), and what it changes."""
        first, second = self._parts
        shown = self._shown(effect, first.problem.frozen, first.state.u)
        if not np.isfinite(shown).all():
            return None
        change = first.change(shown)
        numbers = linalg.lstsq(self._law, change.ravel(), cond=_SAME)[0]
        beyond = change - first.slopes @ numbers
        unseen = np.zeros((0, change.shape[1]))
        if second is not None:
            there = self._shown(effect, second.problem.frozen, second.state.u)
            unseen = second.change(there) - second.slopes @ numbers
        lost = first.problem.frozen.change[self.data.struck[: self.data.training].astype(bool)]
        whole, moved = np.sqrt(np.mean(lost**2)), np.sqrt(np.mean(shown**2))
        return beyond, unseen, 100 * float(moved / max(whole, 1e-300))

    def _shown(self, effect: ModelCorrection, frozen: FrozenMotion, u: FloatArray) -> FloatArray:
        """Change that an effect makes of histories with the rates of the fit [N], (cases, bins)."""
        base = self.base.candidate
        own = {name: base.parameters[name].value for name in base.free}
        with_it = law_candidate(self.data.model, effect, self.data.free, base.sharing)
        with_it = with_it.with_values({n: v for n, v in own.items() if n in with_it.parameters})
        return course(with_it, frozen, u) - course(base, frozen, u)


@dataclass(frozen=True, eq=False)
class GaugeMeter:
    """Readings that follow the motion, and faults of the gauge that show about the hit.

    Attributes
    ----------
    residual : TensionResidual
        Of the last model.
    data : TensionData
        Its records.
    base : CourseFit
        The fit of the model's own law.
    blocked : str
        Why none is looked for; empty where they are.
    """

    residual: TensionResidual
    data: TensionData
    base: CourseFit
    blocked: str = ""

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Effects of the catalogue in the fast part."""
        return [pair for pair in candidates_in_tension(self.residual) if not in_course(*pair)]

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:  # noqa: ARG002
        """Mains are each record's own."""
        return self.blocked or (OWN_NUMBERS if per_record_names(effect) else "")

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""
        return member.linear and member.kind != "sensor"

    @cached_property
    def background(self) -> Background:
        """The histories' cost alone: that of the fast part is small beside it."""
        criteria = self.data.frozen.criteria
        rules = criteria.acceptance
        return Background(
            float(self.base.costs[: self.data.training].sum()), self.base.misfit.level,
            (rules.training_gain_tension, rules.hold_out_gain_tension), criteria=criteria,
        )  # fmt: skip

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training records."""
        return [one.square for one in self.responses(effects)]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response]:
        """What effects add."""
        member = CATALOGUE[effects[0].name]
        name = next(name for name in member.strengths if effects[0].parameters[name].value)
        sizes = np.array([effect.parameters[name].value for effect in effects])
        if isinstance(effects[0], Reading):
            rows, places = reading_rows(self.data, [(member, effects[0])])
            column = places[effects[0].path].start + list(member.strengths).index(name)
            units = [row.columns[:, column] / member.strengths[name] for row in rows]
            squares = np.array([[float(unit @ unit) * size**2 for size in sizes] for unit in units])
        else:
            assert isinstance(effects[0], SensorFault)
            least = self.data.criteria.gauge_fault * member.strengths[name]  # every gauge may have as much
            projected = fault_rows(self.data, member, effects[0], np.array([least, *sizes]))
            squares = np.array([np.sum(row.columns[:, 1:] ** 2, axis=0) for row in projected])
        count, felt = self.data.training, [self._felt(effect) for effect in effects]
        return [Response(of[:count], of[count:], felt=one) for of, one in zip(squares.T, felt, strict=True)]

    def _felt(self, effect: ModelCorrection) -> float:
        """RMS of what an effect adds to the readings of training records over that of their changes [%]."""
        added, whole = 0.0, 0.0
        for record in self.data.records[: self.data.training]:
            if isinstance(effect, Reading):
                rows = effect.added(measured_motion(record))
            else:
                assert isinstance(effect, SensorFault)
                rows = effect.apply(record.tension, record.rate_hz) - record.tension
            added += float(rows @ rows)
            whole += float(np.sum((record.tension - record.course.initial) ** 2))
        return 100 * float(np.sqrt(added / max(whole, 1e-300)))
