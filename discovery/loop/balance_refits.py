"""Models of a campaign that drives its bodies or links, refitted to its balances of forces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.decide.acceptance import is_accepted, meets_worse
from discovery.decide.explanation import Explanation
from discovery.explain import free_force
from discovery.explain.force_balance import explain_screened, explanation, fitted
from discovery.explain.force_balance_screen import screen
from discovery.localisation.force import localise_forces, numbers_of
from discovery.localisation.localise import Localisation
from discovery.loop.found_effects import describe
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.refits import Probes
from discovery.loop.result import FoundEffect
from discovery.loop.state import State, errors_of
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.residual.tension import TensionResidual
from discovery.separating_tests.balances import separating_runs
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, ModelCorrection, SensorFault
from rom.evaluation.error_measures import Kind, summarise
from rom.evaluation.evaluate import evaluate
from rom.identification.force_balance import (
    Balances,
    balances_of,
    model_of,
    noise_warnings,
    sign_warnings,
    standard_errors,
)
from rom.model.laws import Z95
from rom.model.model import Model


@dataclass(frozen=True, eq=False)
class BalanceRefits:
    """Fits of a campaign's models by the forces that they leave unbalanced; see `discovery.loop.refits`."""

    campaign: Campaign
    balances: Balances
    set_aside: tuple[str, ...]
    doubtful: frozenset[str]
    options: Options

    @classmethod
    def of(cls, campaign: Campaign, options: Options) -> BalanceRefits:
        """Read and balance all records.

        Raises
        ------
        ValueError
            If nothing can be identified from the campaign.
        """
        options.stage("identifying")
        balances, doubts = balances_of(campaign)
        lines = tuple(f"{doubt.file}: {doubt.message}" for doubt in doubts)
        return cls(campaign, balances, lines, frozenset(doubt.file for doubt in doubts), options)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Forces of the wrong sign, and noise that makes numbers too small."""
        return (*sign_warnings(self.balances), *noise_warnings(self.balances))

    def start(self) -> State:
        """The declared model."""
        zero = dict.fromkeys(self.balances.names, 0.0)
        residual = ForceBalanceResidual(self.balances, (), zero, self.options.criteria)
        return self.evaluated(residual.with_numbers())

    def corrected(self, fault: SensorFault) -> BalanceRefits:
        """The same: without a bolt there is no gauge."""
        raise ValueError(f"a campaign without a bolt has no gauge, got {fault.path}")

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:  # noqa: ARG002
        """Make the model of a residual, and simulate all sound records."""
        balance = _balance(residual)
        model, lines = self._model(balance)
        records = [r for r in self.campaign.settings.record if r.file not in self.doubtful]
        options = self.options
        evaluations = evaluate([model], self.campaign, records, options.jobs, options.stage("errors"))
        errors = errors_of(evaluations)
        kind: Kind = "hold_out" if errors["hold_out"]["motion_nrmse"] is not None else "training"
        force, motion = balance.force_error(), errors[kind]["motion_nrmse"]
        material = ({"force_error": force, "motion_nrmse": motion},)
        least = options.criteria.acceptance.material_error
        return State(model, balance, errors, material, least, None, evaluations, lines)

    def _model(self, residual: ForceBalanceResidual) -> tuple[Model, tuple[str, ...]]:
        """The model of a residual with its effects, and what to know of it."""
        balances = self.balances
        values = [residual.values[name] for name in balances.names]
        model, lines = model_of(balances, values, standard_errors(balances, residual.force, values))
        for effect in residual.effects:
            model = model.with_effect(effect)
        return model, lines

    def _sound(self, residual: Residual, found: Sequence[Explanation]) -> list[Explanation]:
        """Explanations of effects with which free simulations meet the motion no worse than without.

        On hold-out records where there are any that move bodies: forces along a measured motion may balance
        better with a form that the motion itself refutes.
        """
        records = [r for r in self.campaign.settings.record if r.file not in self.doubtful]
        moving = [r for r in records if r.test != "cycled"]
        chosen = [r for r in moving if r.hold_out] or moving
        if not chosen or not found:
            return list(found)
        options, after = self.options, [_balance(one.residual) for one in found if one.residual is not None]
        models = [self._model(one)[0] for one in (_balance(residual), *after)]
        judged = evaluate(models, self.campaign, chosen, options.jobs)
        before, *errors = (
            summarise(one.comparisons[place] for one in judged if one.comparisons)
            for place in range(len(models))
        )
        return [one for one, error in zip(found, errors, strict=True) if not meets_worse(before, error)]

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:  # noqa: ARG002
        """All effects fitted together.

        Parameters
        ----------
        state : State
            The model so far.
        explanation : Explanation
            Of the effect that is added.
        renew_noise : bool
            Without effect: noise comes from the channels alone.

        Returns
        -------
        Residual
            Of the model with the effect.
        """
        residual = _balance(state.residual)
        if explanation.residual is None:
            return fitted(residual, (explanation.effect,))[0]
        after = _balance(explanation.residual)
        return _together(after) if len(after.effects) > 1 else after

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:  # noqa: ARG002
        """None: the model's own numbers are linear, and no fit of them is stuck."""
        return None

    def with_present_noise(self, residual: Residual) -> Residual:
        """The same: noise comes from the channels alone."""
        return residual

    def along_law(self, state: State) -> State:
        """The same: there is no bolt whose tension falls."""
        return state

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the others leave over, refitted, where an effect is redundant; None where it is not."""
        last = _balance(history.last.residual)
        path = history.selections[place].best.effect.path
        effect = next(e for e in last.effects if e.path == path)
        if effect.name not in CATALOGUE or place + 1 == len(history.selections):
            return None
        others = tuple(e for e in last.effects if e.path != path)
        rest = _together(replace(last, effects=others))
        explained = explanation(effect, CATALOGUE[effect.name], rest, last)
        return None if is_accepted(explained, self.options.criteria) else rest

    def views(self, history: LoopHistory) -> Iterable[State]:
        """The last state: forces along the measured motion hold from any distance."""
        yield history.last

    def screen(self, residual: Residual) -> Probes:
        """Probes of every effect of the catalogue at the scale of its place."""
        return screen(_balance(residual), self.options)

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises, but for those with which the motion is met worse."""
        return self._sound(residual, explain_screened(probes, _balance(residual), self.options))

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """The best sparse sum of terms in one link."""
        return self._sound(state.residual, free_force.explain(_balance(state.residual), self.options))

    def tension(self, state: State) -> TensionResidual | None:  # noqa: ARG002
        """None: there is no bolt."""
        return None

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Masses and stiffnesses that effects drive to zero, dampings that they drive below it beyond chance.

        A damping of zero is none: friction may be all that there is.
        """
        first, last = (_balance(state.residual) for state in (history.states[0], history.last))
        least = dict(zip(self.balances.names, _largest_plausible(last).tolist(), strict=True))
        return tuple(
            f"{name}: zero with the effects, {first.values[name]:.4g} without them"
            for name in self.balances.names
            if first.values[name] > 0
            and not last.values[name] > 0
            and (".damping." not in name or least[name] < 0)
        )

    def localise(self, state: State, misfit: Sequence[Misfit] = ()) -> Localisation:  # noqa: ARG002
        """Where the forces left unbalanced live."""
        residual = _balance(state.residual)
        return localise_forces(residual, numbers_of(residual, state.evaluations))

    def described(self, selection: Selection, state: State) -> FoundEffect:
        """An effect with the limits of the last fit, and what is indistinguishable from it."""
        residual = _balance(state.residual)

        def limited(effect: ModelCorrection, _: ModelCorrection) -> ModelCorrection:
            return effect

        def separating(effect: ModelCorrection, rivals: Sequence[ModelCorrection]) -> list[str]:
            return separating_runs(effect, rivals, residual)

        return describe(selection, state, (), limited, separating)


def _largest_plausible(residual: ForceBalanceResidual) -> FloatArray:
    """Upper 95 % limits of the model's numbers, (numbers,), were they free to have either sign."""
    balances, rows = residual.balances, residual.training
    noise = balances.noise[rows]
    free = np.linalg.lstsq(balances.columns[rows] / noise[:, None], residual.force[rows] / noise, rcond=None)
    errors = standard_errors(balances, residual.force, free[0].tolist())
    return np.asarray(free[0] + Z95 * errors)


def _balance(residual: Residual) -> ForceBalanceResidual:
    assert isinstance(residual, ForceBalanceResidual)
    return residual


def _together(residual: ForceBalanceResidual) -> ForceBalanceResidual:
    """All effects fitted again beside each other."""
    if not residual.effects:
        return residual.with_numbers()
    return fitted(replace(residual, effects=()), residual.effects)[0]
