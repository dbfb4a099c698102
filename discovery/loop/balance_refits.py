"""Models of a campaign that drives its bodies or links, refitted to its balances of forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discovery.decide.acceptance import (
    MaterialErrors,
    at_noise_floor,
    is_accepted,
    is_material,
    meets_worse,
    motion_errors,
)
from discovery.decide.explanation import Explanation
from discovery.detection.force_balance import BalanceMeter
from discovery.detection.limit import Meter
from discovery.explain import free_force
from discovery.explain.driven_fit import fitted_by_simulation, standard_error
from discovery.explain.force_balance import explain_screened, fitted
from discovery.explain.force_balance_screen import screen
from discovery.explain.free_form import member_of
from discovery.localisation.force import localise_forces, numbers_of
from discovery.localisation.localise import Localisation
from discovery.loop.driven_stage import searched
from discovery.loop.history import LoopHistory
from discovery.loop.refits import FixedTensionRefits, Probes
from discovery.loop.refitted_numbers import with_limits
from discovery.loop.simulated_contest import contested
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Residual, level
from discovery.residual.course_fit import Misfit
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.separating_tests.driven_runs import separating_runs
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.effects import ModelCorrection
from rom.evaluation.error_measures import ErrorsByKind, Kind, summarise
from rom.evaluation.evaluate import evaluate
from rom.identification.balance_warnings import noise_warnings, sign_warnings
from rom.identification.force_balance import OFFSET, Balances, balances_of, model_of, standard_errors
from rom.model.laws import Z95, Parameter
from rom.model.model import Model
from rom.signals.measured_records import measured_record
from rom.signals.processing import Measurement
from rom.signals.quality import Doubt


@dataclass(frozen=True, eq=False)
class BalanceRefits(FixedTensionRefits[ForceBalanceResidual]):
    """Fits of a campaign's models by the forces that they leave unbalanced."""

    campaign: Campaign
    balances: Balances
    record_doubts: tuple[Doubt, ...]
    options: Options
    residual_type = ForceBalanceResidual

    @classmethod
    def of(cls, campaign: Campaign, options: Options) -> BalanceRefits:
        """Read and balance all records.

        Raises
        ------
        ValueError
            If nothing can be identified from the campaign.
        """
        options.stage("identifying")
        return cls(campaign, *balances_of(campaign), options)

    @property
    def aside(self) -> tuple[Doubt, ...]:
        """Doubts about records."""
        return self.record_doubts

    @property
    def warnings(self) -> tuple[str, ...]:
        """Forces of the wrong sign, and noise that makes numbers too small."""
        return (*sign_warnings(self.balances), *noise_warnings(self.balances))

    def start(self) -> State:
        """The declared model."""
        zero = dict.fromkeys(self.balances.names, 0.0)
        residual = ForceBalanceResidual(self.balances, (), zero, self.options.criteria)
        return self.evaluated(residual.with_numbers())

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        """The model of a residual and its errors, its numbers fitted by simulation where that meets more.

        The residual, and with it what is left of the forces, stays that of the balances.
        """
        return self._by_simulation(super().evaluated(residual, law_is_fitted=law_is_fitted))

    @cached_property
    def _declared_level(self) -> float:
        """What the declared model leaves of the forces, in noise."""
        zero = dict.fromkeys(self.balances.names, 0.0)
        return level(ForceBalanceResidual(self.balances, (), zero, self.options.criteria).with_numbers())

    def _by_simulation(self, state: State) -> State:
        """The state with numbers fitted by simulation, where noise alone is left or far less than before.

        Where a force is missing they would stand in for it: only where next to nothing is left of the forces,
        or noise makes the numbers of the balances too small.
        """
        rules, before = self.options.criteria, state.errors["training"]["motion_nrmse"]
        explained = at_noise_floor(state.level, self._declared_level, rules, state.by_chance)
        if before is None or not (explained or noise_warnings(self.balances)):
            return state
        own = self.own(state.residual)
        found = fitted_by_simulation(state.model, own.balances.names, self._driven_training, rules)
        if found is None:
            return state
        after = self.with_numbers(found.model, found.numbers, own)
        error = after.errors["training"]["motion_nrmse"]
        to_noise = found.level <= rules.acceptance.noise_level
        least = 0.0 if to_noise else rules.acceptance.material_error
        gained = error is not None and error <= (1 - least) * before
        if not gained or any(meets_worse(state.errors[kind], after.errors[kind]) for kind in after.errors):
            return state
        line = (
            f"numbers are fitted by simulation, with which the motion of training records is met within "
            f"{100 * (error or 0.0):.3g} % (with those that balance the forces best: {100 * before:.3g} %); "
            "what is left of the forces is that of the latter"
        )
        return replace(
            after, residual=own, material=self._material_errors(own, after.errors),
            warnings=(*after.warnings, line), simulated_to_noise=to_noise,
        )  # fmt: skip

    @property
    def _driven_training(self) -> list[Measurement]:
        """Training records of driven bodies, as processed."""
        training = [r for r in self.sound if not r.hold_out and r.test == "driven"]
        return [measured_record(self.campaign, r).measurement for r in training]

    @cached_property
    def row_rates_hz(self) -> dict[str, float]:
        """Rates at which the forces are balanced [Hz], by file."""
        return {r.settings.file: r.smoothing.rate_hz(r.rate_hz) for r in self.balances.records}

    def with_numbers(
        self, model: Model, numbers: Mapping[str, Parameter], residual: ForceBalanceResidual
    ) -> State:
        """A model whose numbers are not those of the balances, its errors, and what it leaves unbalanced.

        Parameters
        ----------
        model : Model
            With its offsets and effects.
        numbers : mapping of str to Parameter
            Those that were fitted, with limits, by path.
        residual : ForceBalanceResidual
            Of other numbers and effects.
        """
        known, names = model.parameters, self.balances.names
        values = dict(residual.values) | {name: known[name].value for name in names if name in known}
        offsets = {name.rpartition(".")[0] for name in names}
        effects = tuple(effect for effect in model.effects if effect.path not in offsets)
        own = replace(residual, effects=effects, values=values)
        errors = [standard_error(numbers[name]) if name in numbers else 0.0 for name in names]
        lines = model_of(self.balances, [values[name] for name in names], errors)[1]
        return self._state(own, with_limits(model, numbers), lines)

    def _material_errors(self, residual: ForceBalanceResidual, errors: ErrorsByKind) -> MaterialErrors:
        """Of the forces, and of the motion on hold-out records where there are any."""
        kind: Kind = "hold_out" if errors["hold_out"]["motion_nrmse"] is not None else "training"
        return ({"force_error": residual.force_error(), "motion_nrmse": errors[kind]["motion_nrmse"]},)

    def _model_of(self, residual: ForceBalanceResidual) -> tuple[Model, tuple[str, ...]]:
        balances = self.balances
        values = [residual.values[name] for name in balances.names]
        model, lines = model_of(balances, values, standard_errors(balances, residual.force, values))
        return replace(model, effects=(*model.effects, *residual.effects)), lines

    def _not_worse(self, residual: Residual, found: Sequence[Explanation]) -> list[Explanation]:
        """Explanations of effects with which free simulations meet the motion no worse than without.

        On hold-out records where there are any that move bodies: forces along a measured motion may balance
        better with a form that the motion itself refutes.
        """
        moving = [r for r in self.sound if r.test != "cycled"]
        chosen = [r for r in moving if r.hold_out] or moving
        if not chosen or not found:
            return list(found)
        options, after = self.options, [self.own(one.residual) for one in found if one.residual is not None]
        models = [self._model_of(one)[0] for one in (self.own(residual), *after)]
        judged = evaluate(models, self.campaign, chosen, options.jobs)
        before, *errors = (
            summarise(one.comparisons[place] for one in judged if one.comparisons)
            for place in range(len(models))
        )
        return [one for one, error in zip(found, errors, strict=True) if not meets_worse(before, error)]

    def _told_by_simulation(
        self, residual: ForceBalanceResidual, found: list[Explanation]
    ) -> list[Explanation]:
        """What simulations say of the effects that leave next to nothing of much, where there are several."""
        rules = self.options.criteria
        if at_noise_floor(level(residual), self._declared_level, rules):
            return found
        last = [
            (one, self.own(one.residual))
            for one in found
            if one.residual is not None and is_accepted(one, rules)
        ]
        close = [
            (one, self._model_of(own)[0])
            for one, own in last
            if at_noise_floor(level(own), self._declared_level, rules)
        ]
        faults = any(one.effect.kind != "force" for one, _ in close)  # of sensors, which no simulation tells
        if len(close) < 2 or faults:
            return found
        measured = [measured_record(self.campaign, r).measurement for r in self.sound]
        without = self._model_of(residual)[0]
        return contested(close, without, self.balances.names, measured, rules) or found

    def _beside_others(self, residual: ForceBalanceResidual) -> ForceBalanceResidual:
        return _together(residual) if len(residual.effects) > 1 else residual

    def _fitted_with(self, residual: ForceBalanceResidual, effect: ModelCorrection) -> ForceBalanceResidual:
        return fitted(residual, (effect,))[0]

    def _fitted_without(
        self, residual: ForceBalanceResidual, effect: ModelCorrection
    ) -> ForceBalanceResidual:
        return _together(
            replace(residual, effects=tuple(e for e in residual.effects if e.path != effect.path))
        )

    def screen(self, residual: Residual) -> Probes:
        """Probes of every effect of the catalogue at the scale of its place."""
        return screen(self.own(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises, but for those with which the motion is met worse."""
        found = explain_screened(probes, self.own(residual), self.options)
        return self._told_by_simulation(self.own(residual), self._not_worse(residual, found))

    def in_simulation(self, history: LoopHistory) -> LoopHistory:
        """The history with forces that free simulations show beside those of the balances.

        Forces with a memory turn sharply, which balances of a differentiated motion tell badly: simulations
        first go on without these. The same object where balances leave noise alone, where a record is no
        driven one, and where nothing is found with which the motion of held-out records is met better than
        with the balances' numbers.
        """
        if history.at_noise_floor or any(record.test != "driven" for record in self.sound):
            return history
        before = motion_errors(history.last.errors)
        for begun in dict.fromkeys((history.without_memory, history)):
            found = self._searched(begun)
            if found and is_material(before, motion_errors(found.last.errors), criteria=history.criteria):
                return self._without_vanished(begun, found)
        return history

    def _without_vanished(self, begun: LoopHistory, found: LoopHistory) -> LoopHistory:
        """What is found from before the first effect of the balances that is nothing beside what is found.

        It stood for that. The same object where there is none, or where the motion needs it.
        """
        nothing = {effect.path for effect in found.last.model.effects if _is_nothing(effect)}
        vanished = (p for p, one in enumerate(begun.selections) if one.best.effect.path in nothing)
        first = next(vanished, None)
        again = None if first is None else self._searched(begun.until(first))
        if again is None:
            return found
        errors = (motion_errors(one.last.errors) for one in (again, found))
        return found if is_material(*errors, criteria=begun.criteria) else again

    def _searched(self, history: LoopHistory) -> LoopHistory | None:
        """The history with what a search by simulation finds from there; None where that is nothing."""
        measured = [measured_record(self.campaign, record).measurement for record in self.sound]
        found = searched(
            self.campaign, measured, history.last.model, self.balances.names, self.row_rates_hz, self.options
        )
        if found is None or not found.selections:
            return None
        last = self._with_limits_of(found, history, [one for one in measured if not one.hold_out])
        for selection, state in zip(found.selections, (*found.states[1:-1], last), strict=True):
            history = history.extended(selection, state)
        return history

    def _with_limits_of(
        self, found: LoopHistory, history: LoopHistory, training: Sequence[Measurement]
    ) -> State:
        """The last model of a search in simulations with limits, and what it leaves of the forces."""
        names, rules = self.balances.names, self.options.criteria
        simulated = fitted_by_simulation(
            found.last.model, names, training, rules, self.row_rates_hz, rounds=0
        )
        model, numbers = (found.last.model, {}) if simulated is None else simulated[:2]
        state = self.with_numbers(model, numbers, self.own(history.last.residual))
        shown = ", ".join(selection.best.effect.name for selection in found.selections)
        line = f"numbers are fitted by simulation: {shown} shows in the motion, not in the balance of forces"
        return replace(state, warnings=(*state.warnings, line))

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """The best sparse sum of terms in one link."""
        return self._not_worse(state.residual, free_force.explain(self.own(state.residual), self.options))

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Masses and stiffnesses that effects drive to zero, dampings that they drive below it beyond chance.

        A damping of zero is none: friction may be all that there is. An offset may have either sign.
        """
        first, last = (self.own(state.residual) for state in (history.states[0], history.last))
        least = dict(zip(self.balances.names, _largest_plausible(last).tolist(), strict=True))
        return tuple(
            f"{name}: zero with the effects, {first.values[name]:.4g} without them"
            for name in self.balances.names
            if not name.endswith(f".{OFFSET}.F_0")
            and first.values[name] > 0
            and not last.values[name] > 0
            and (".damping." not in name or least[name] < 0)
        )

    def meters(self, history: LoopHistory) -> Sequence[Meter]:
        """Effects in the balances."""
        return [BalanceMeter(self.own(history.last.residual), history.chance)]

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:
        """Where the forces left unbalanced live."""
        residual = self.own(state.residual)
        return localise_forces(residual, numbers_of(residual, state.evaluations))

    def _separating_tests(
        self, effect: ModelCorrection, rivals: Sequence[ModelCorrection], residual: ForceBalanceResidual
    ) -> list[str]:
        return separating_runs(effect, rivals, residual)


def _largest_plausible(residual: ForceBalanceResidual) -> FloatArray:
    """Upper 95 % limits of the model's numbers, (numbers,), were they free to have either sign."""
    balances, rows = residual.balances, residual.training
    noise = balances.noise[rows]
    free = np.linalg.lstsq(balances.columns[rows] / noise[:, None], residual.force[rows] / noise, rcond=None)
    errors = standard_errors(balances, residual.force, free[0].tolist())
    return np.asarray(free[0] + Z95 * errors)


def _is_nothing(effect: ModelCorrection) -> bool:
    """Whether limits of all its strengths hold zero."""
    numbers = [effect.parameters[name] for name in member_of(effect).strengths if name in effect.parameters]
    told = [(n.low, n.high) for n in numbers if n.low is not None and n.high is not None]
    return len(told) == len(numbers) > 0 and all(low <= 0 <= high for low, high in told)


def _together(residual: ForceBalanceResidual) -> ForceBalanceResidual:
    """All effects fitted again beside each other."""
    if not residual.effects:
        return residual.with_numbers()
    return fitted(replace(residual, effects=()), residual.effects)[0]
