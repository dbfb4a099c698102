"""The closed loop of campaigns that drive bodies or links and have no bolt: driven, free and cycled records.

The residual is the equation error (``rom.identification.equation_error``): forces that the model leaves
unbalanced along the
measured motion, over what the sensors' white noise makes of them. Screening, fits beside the model's numbers,
acceptance on held-out records, look-alikes and verdicts are those of impact tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from discovery.decide.acceptance import at_noise_floor, is_accepted, is_alike, penalised_gain, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import (
    ForceBalanceResidual,
    explain_forces,
    explained,
    fitted,
    screen_forces,
)
from discovery.explain.free_force import free_force
from discovery.explain.motion import Probe, worth_fitting
from discovery.localisation.force import localise_forces, numbers_of
from discovery.localisation.localise import Localisation
from discovery.loop.history import FAR_LESS
from discovery.loop.result import Closure, FoundEffect, LookAlike, Screened, Step, Verdict
from discovery.loop.state import Stages
from rom.campaign.campaign import Campaign
from rom.effects import CATALOGUE, candidates
from rom.evaluation.error_measures import ErrorsByKind, summarise
from rom.evaluation.evaluate import Evaluation, evaluate
from rom.identification.force_balance import SOUND, Balances, balances_of, model_of, noise_share
from rom.model.model import Model
from rom.signals.quality import Doubt

_MATTERS = 0.02  # of the force error on held-out records
_TOLD = 3.0  # standard errors


@dataclass(frozen=True, eq=False)
class _Stage:
    """A model with so many effects, what it leaves over, and its errors."""

    state: ForceBalanceResidual
    model: Model
    errors: ErrorsByKind
    judged: tuple[Evaluation, ...]
    lines: tuple[str, ...]

    @property
    def level(self) -> float:
        """Mean square of the residual on training records; 1 is noise."""
        return float(np.mean(self.state.residual[self.state.balances.training] ** 2))

    def force_error(self) -> float:
        """RMS of unbalanced over measured force, held-out records where there are any."""
        balances = self.state.balances
        rows = ~balances.training if not balances.training.all() else balances.training
        return float(np.linalg.norm((self.state.residual * balances.noise)[rows]))


@dataclass(frozen=True, eq=False)
class _Found:
    best: Explanation
    rivals: tuple[Explanation, ...]


def close_forces(campaign: Campaign, jobs: int, stage: Stages, seed: int = 0) -> Closure:
    """Find what the declared model lacks of a campaign for which
    ``rom.identification.force_balance.is_driven`` holds.

    Parameters
    ----------
    campaign : Campaign
        Nothing is fitted to its held-out records but the state of the bodies at their start.
    jobs : int
        Processes of the simulations.
    stage : callable
        As for ``discovery.close_loop``.
    seed : int
        Of the ensembles of the sparse fits.

    Raises
    ------
    ValueError
        If nothing can be identified from the campaign.
    """
    stage("identifying")
    balances, doubts = balances_of(campaign)
    zero = dict.fromkeys(balances.names, 0.0)
    stages = [_staged(campaign, ForceBalanceResidual(balances, (), zero).with_numbers(), doubts, jobs, stage)]
    chosen: list[_Found] = []
    screened: tuple[Screened, ...] = ()
    seen = [frozenset[str]()]
    while True:
        tell = stage("screening effects")
        probes = screen_forces(stages[-1].state, stages[-1].model)
        if tell is not None:
            tell(1, 1)
        screened = screened or _screened(probes, stages[-1].state)
        one, state = _best(probes, stages[-1].state, stage)
        if one is None or state is None:
            break
        needed = _without_needless(_together(state)) if len(state.effects) > 1 else state
        names = frozenset(effect.path for effect in needed.effects)
        after = _staged(campaign, needed, doubts, jobs, stage)
        if names in seen or after.force_error() > (1 - _MATTERS) * stages[-1].force_error():
            break
        kept = [place for place, old in enumerate(chosen) if old.best.effect.path in names]
        stages = [stages[0], *(stages[place + 1] for place in kept), after]
        chosen = [*(chosen[place] for place in kept), one]
        seen.append(names)
    named = stages, chosen
    for place, found, state in _formed(stages, chosen, seed):
        after = _staged(campaign, state, doubts, jobs, stage)
        if _is_far_better(after, stages[-1]):
            stages, chosen = [*named[0][: place + 1], after], [*named[1][:place], found]
    first, last = stages[0], stages[-1]
    labels = ["", *(f"{one.best.effect.name} ({one.best.effect.enters})" for one in chosen)]
    return Closure(
        verdict=_verdict(first, last, bool(chosen)),
        effects=tuple(_told(one, last) for one in chosen),
        model=last.model,
        steps=tuple(Step(label, one.errors) for label, one in zip(labels, stages, strict=True)),
        residual_before=_localised(first),
        residual_after=_localised(last),
        screened=screened,
        set_aside=tuple(f"{doubt.file}: {doubt.message}" for doubt in doubts),
        warnings=(*last.lines, *_wrong_way(balances), *_noisy(balances)),
    )


def _staged(
    campaign: Campaign, state: ForceBalanceResidual, doubts: Sequence[Doubt], jobs: int, stage: Stages
) -> _Stage:
    """Make the model of a state and tell its errors on all sound records."""
    balances = state.balances
    left = state.force[balances.training] - balances.columns[balances.training] @ [
        state.values[name] for name in balances.names
    ]
    scale = float(np.sqrt(np.mean((left / balances.noise[balances.training]) ** 2)))
    matrix = balances.columns[balances.training] / balances.noise[balances.training, None]
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    gram = (matrix / size).T @ (matrix / size)
    errors = scale * np.sqrt(np.maximum(np.diag(np.linalg.pinv(gram, hermitian=True)), 0.0)) / size
    model, lines = model_of(balances, [state.values[name] for name in balances.names], errors)
    for effect in state.effects:
        model = model.with_effect(effect)
    aside = {doubt.file for doubt in doubts}
    records = [r for r in campaign.settings.record if r.file not in aside]
    judged = evaluate([model], campaign, records, jobs, stage("errors"))
    training, hold_out = (
        summarise(c for one in judged for c in one.comparisons if one.settings.hold_out is held)
        for held in (False, True)
    )
    return _Stage(state, model, {"training": training, "hold_out": hold_out}, judged, lines)


def _best(
    probes: Sequence[Sequence[Probe]], state: ForceBalanceResidual, stage: Stages
) -> tuple[_Found | None, ForceBalanceResidual | None]:
    """Fit what the screen promises; the effect that explains most beyond chance, and the state with it."""
    left = float(np.sum(state.residual[state.balances.training] ** 2))
    tell, tried = stage("fitting effects"), worth_fitting(probes, left)
    fits = []
    for one in tried:
        fits.append(explain_forces(one, state))
        if tell is not None:
            tell(len(fits), len(tried))
    sure = [fit for fit in fits if is_accepted(fit[0])]
    if not sure:
        return None, None
    best, after = max(sure, key=lambda fit: penalised_gain(fit[0]))
    rivals = [one for one, _ in sure if one is not best and is_alike(one, best)]
    return _Found(best, tuple(sorted(rivals, key=lambda one: -penalised_gain(one)))), after


def _formed(
    stages: Sequence[_Stage], chosen: Sequence[_Found], seed: int
) -> Iterator[tuple[int, _Found, ForceBalanceResidual]]:
    """Yield free forms in place of what the catalogue named, and beside it, with how many names they keep.

    None where the names leave noise alone, or next to nothing.
    """
    if at_noise_floor(stages[-1].level, stages[0].level):
        return
    for kept in dict.fromkeys((0, len(chosen))):
        told = free_force(stages[kept].state, seed)
        if told is not None and is_accepted(told[0]):
            yield kept, _Found(told[0], ()), told[1]


def _is_far_better(after: _Stage, before: _Stage) -> bool:
    return after.level < FAR_LESS * before.level and after.force_error() < before.force_error()


def _together(state: ForceBalanceResidual) -> ForceBalanceResidual:
    """All effects of a state fitted again beside each other."""
    return fitted(replace(state, effects=()), state.effects)[0]


def _without_needless(state: ForceBalanceResidual) -> ForceBalanceResidual:
    """Drop one effect after the other that explains nothing beside the others; the last one stays."""
    for effect in state.effects[:-1]:
        rest = _together(replace(state, effects=tuple(e for e in state.effects if e is not effect)))
        if not is_accepted(explained(effect, CATALOGUE[effect.name], rest, state)):
            return _without_needless(rest)
    return state


def _verdict(first: _Stage, last: _Stage, found: bool) -> Verdict:
    if not at_noise_floor(last.level, first.level):
        return "unexplained"
    return "closed" if found else "no-effect"


def _told(found: _Found, last: _Stage) -> FoundEffect:
    best, costs = found.best, found.best.cost(hold_out=True)
    tried = len(candidates(last.model))
    effect = next(
        e for e in last.state.effects if (e.name, e.enters) == (best.effect.name, best.effect.enters)
    )
    gains = best.gains(hold_out=True)
    chance = float(
        stats.chi2.sf(best.gains(hold_out=False).sum() / spread_of(best), max(best.free_numbers, 1))
    )
    return FoundEffect(
        effect=effect,
        look_alikes=tuple(
            LookAlike(one.effect.name, one.effect.enters, one.cost(hold_out=True) / costs if costs else 1.0)
            for one in found.rivals
        ),
        source="catalogue" if effect.name in CATALOGUE else "free-form",
        share=best.share(),
        p_value=min(1.0, tried * chance),
        wins=(int((gains > 0).sum()), len(gains)),
        chance="likelihood ratio",
    )


def _screened(probes: Sequence[Sequence[Probe]], state: ForceBalanceResidual) -> tuple[Screened, ...]:
    cost = float(np.sum(state.residual[state.balances.training] ** 2))
    found = []
    for best, *_ in probes:
        name = next(n for n in best.member.strengths if best.effect.parameters[n].value)
        value = best.effect.parameters[name].value * best.amplitude
        found.append(Screened(best.effect.name, best.effect.enters, max(best.gain, 0.0) / cost, value))
    return tuple(found)


def _localised(stage: _Stage) -> Localisation:
    return localise_forces(stage.state, numbers_of(stage.state, stage.judged))


def _noisy(balances: Balances) -> tuple[str, ...]:
    share = noise_share(balances)
    if share <= SOUND:
        return ()
    return (
        f"noise makes {100 * share:.2g} % of the square of a term behind the filter: its number comes out "
        "too small by as much, and what is left over may pass for an effect",
    )


def _wrong_way(balances: Balances) -> tuple[str, ...]:
    """Links whose damping is below zero beyond chance: their force was measured with the other sign."""
    lines = []
    for link in balances.settings.link:
        rows = [
            (balance.terms["force"], balance.terms[f"{link.name}.x"], balance.terms[f"{link.name}.v"])
            for record in balances.records
            if record.settings.test == "cycled" and not record.settings.hold_out
            for balance in record.balances
            if balance.place == link.name
        ]
        if rows:
            force, x, v = (np.concatenate(column) for column in zip(*rows, strict=True))
            table = np.stack([v, x, np.ones_like(x)], axis=1)
            found = np.linalg.lstsq(table, force, rcond=None)[0]
            spread = float(np.mean((force - table @ found) ** 2))
            error = np.sqrt(spread * np.linalg.pinv(table.T @ table, hermitian=True)[0, 0])
            if found[0] < -_TOLD * error:
                lines.append(
                    f"link_force_{link.name}: gives out energy along the motion; expected the force that "
                    "pulls the first body back, turn its sign round"
                )
    return tuple(lines)
