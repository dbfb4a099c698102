"""The closed loop: residual, missing effect, refined model, until the residual is noise or nothing helps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from scipy import stats

from discovery.attribution import (
    Probe,
    explain,
    free_numbers,
    motion_channels,
    output_of,
    screen,
    slopes_of,
)
from discovery.baseline import effect_number, size_of
from discovery.closure import Closure, ErrorsByKind, FoundEffect, Kind, LookAlike, Screened, Step, Verdict
from discovery.explanation import Explanation
from discovery.free_form import free_forms
from discovery.localisation import localise
from discovery.tension_attribution import explain_tension
from discovery.tracing import Evidence, gather, starting, weigh
from rom.campaign import Campaign
from rom.comparison import judge
from rom.effects import CATALOGUE, Added, Effect, candidates, look_alikes
from rom.identification import Identification, identify_campaign, relearned
from rom.model import Model
from rom.reduction import Progress
from rom.residuals import Errors, summarise

Stages = Callable[[str], Progress | None]
MOST_EFFECTS = 3
_FITTED = 5  # of the screened effects
_PROMISING, _WORTH = 0.3, 0.4  # of what an effect must explain; of what the first one does
# Gains in cost on training and on held-out records that chance does not make over a whole catalogue; on clean
# campaigns the largest are 110 of 10^5 rows and 15 in the motion, 13 and 5 in the tension.
_OF_MOTION, _OF_TENSION = (150.0, 20.0), (20.0, 0.0)
_MATERIAL = 0.01  # share of the cost: less changes nothing that matters
_ALIKE = 12.0  # difference in cost within chance
_NEAR = 0.05  # of the gain: what a slightly wrong form of the right effect may lose
_QUIET = 1.2  # mean square of the residual that still counts as noise
_REFITS = 3
_FAR_LESS = 0.7
_LEFT = 0.03  # of what was beyond noise
_MATTERS = 0.02  # of an error


def close_loop(campaign: Campaign, jobs: int = 1, progress: Stages | None = None, seed: int = 0) -> Closure:
    """Find what a campaign's declared model lacks, add it, and tell the errors before and after.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`; nothing is fitted to its held-out records.
    jobs : int
        Processes; the numbers do not depend on it.
    progress : callable
        Called with the name of a stage; returns what is then called with (done, in all), or None.
    seed : int
        Of the ensembles of the sparse fits.

    Returns
    -------
    Closure
        Verdict, effects, refined model, errors after every step.

    Raises
    ------
    ValueError
        If nothing can be identified from the campaign.
    """
    stage: Stages = progress or (lambda _: None)
    found = identify_campaign(campaign, jobs, stage("identifying"))
    loop = _Loop(campaign, found, jobs, stage)
    first = loop.start()
    path = loop.search(first)
    if not _is_quiet(path):
        formed = loop.formed(first, seed)
        path = path if formed is None else _better(path, loop.search(first, formed))
    last = path.states[-1]
    labels = ["", *(_label(one.best.effect) for one in path.chosen)]
    return Closure(
        verdict=_verdict(path),
        effects=tuple(_found(one, last) for one in path.chosen),
        model=last.model,
        steps=tuple(Step(label, state.errors) for label, state in zip(labels, path.states, strict=True)),
        residual_before=localise(first.evidence),
        residual_after=localise(last.evidence),
        screened=path.screened,
        set_aside=tuple(f"{doubt.file}: {doubt.message}" for doubt in found.set_aside),
        warnings=found.warnings,
    )


@dataclass(frozen=True, eq=False)
class _State:
    """A model, what it leaves over, and its errors."""

    model: Model
    evidence: Evidence
    errors: ErrorsByKind
    found: Identification


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The effect that explains most, and the others that do nearly as well."""

    best: Explanation
    rivals: tuple[Explanation, ...]


@dataclass(frozen=True, eq=False)
class _Path:
    """Models one after the other, the declared one first, and the effects that lead from each to the next."""

    states: tuple[_State, ...]
    chosen: tuple[_Chosen, ...]
    screened: tuple[Screened, ...]


@dataclass(frozen=True, eq=False)
class _Loop:
    campaign: Campaign
    found: Identification
    jobs: int
    stage: Stages

    def start(self) -> _State:
        """The declared model, its numbers refitted to all training records."""
        baseline = starting(self.found, self.found.model)
        return self._state(gather(self.campaign, baseline, self._aside, progress=self.stage("tracing")))

    @property
    def _aside(self) -> frozenset[str]:
        return frozenset(doubt.file for doubt in self.found.set_aside)

    def _state(self, evidence: Evidence) -> _State:
        """Settle the numbers, learn the tension law anew, and tell the errors."""
        evidence = refitted(evidence)
        found = relearned(self.found, evidence.baseline.model)
        model = replace(found.model, identification=None)
        evidence = replace(evidence, baseline=replace(evidence.baseline, model=model))
        return _State(model, evidence, self._errors(model), found)

    def _errors(self, model: Model) -> ErrorsByKind:
        records = [r for r in self.campaign.settings.record if r.file not in self._aside]
        judged = judge([model], self.campaign, records, self.jobs, self.stage("errors"))
        by_kind = {
            kind: summarise(c for one in judged for c in one.comparisons if one.settings.hold_out is held)
            for kind, held in (("training", False), ("hold_out", True))
        }
        return {"training": by_kind["training"], "hold_out": by_kind["hold_out"]}

    def search(self, state: _State, given: _Chosen | None = None) -> _Path:
        """Add effects, ``given`` the first, until nothing in the catalogue helps beyond chance."""
        states: list[_State] = [state]
        chosen: list[_Chosen] = []
        screened: tuple[Screened, ...] = ()
        while len(chosen) < MOST_EFFECTS:
            one = given if given is not None and not chosen else None
            if one is None:
                probes = screen(states[-1].evidence, self.jobs, self.stage("screening effects"))
                screened = screened or _screened(probes, states[-1].evidence)
                one = self.choose(states[-1], probes)
            if one is None:
                break
            after = self.adopt(states[-1], one)
            if not _matters(one, states[-1].errors, after.errors):
                break
            states.append(after)
            chosen.append(one)
        return _Path(tuple(states), tuple(chosen), screened)

    def formed(self, state: _State, seed: int) -> _Chosen | None:
        """The best term without the catalogue; None where even that does not predict held-out records."""
        sure = [one for one in free_forms(state.evidence, seed) if _is_sure(one)]
        if not sure:
            return None
        best = max(sure, key=_merit)
        return _Chosen(best, ())

    def choose(self, state: _State, probes: Sequence[Sequence[Probe]]) -> _Chosen | None:
        """The effect that explains most beyond chance, and what is like it; None where there is none."""
        tell = self.stage("fitting effects")
        tried = _worth_fitting(probes, state.evidence)
        tasks = (delayed(explain)(one, state.evidence) for one in tried)
        explanations: list[Explanation] = []
        for one in Parallel(n_jobs=self.jobs, prefer="threads", return_as="generator")(tasks):
            explanations.append(one)
            if tell is not None:
                tell(len(explanations), len(tried))
        explanations += explain_tension(
            self.campaign, state.found, state.model, self.jobs, self.stage("tension")
        )
        sure = [one for one in explanations if _is_sure(one)]
        if not sure:
            return None
        best = max(sure, key=_merit)
        rivals = [one for one in explanations if one is not best and _comparable(one, best)]
        alike = sorted((one for one in rivals if _is_alike(one, best)), key=lambda one: -_merit(one))
        return _Chosen(best, tuple(alike))

    def adopt(self, state: _State, chosen: _Chosen) -> _State:
        """Add an effect, trace all records anew and refit everything together."""
        effect = chosen.best.effect
        baseline = state.evidence.baseline
        if isinstance(effect, Effect):
            rows = state.evidence.residual - output_of(effect, state.evidence)
            baseline = baseline.moved(state.evidence.steps(rows))
        model = effect.added_to(baseline.model)
        evidence = gather(
            self.campaign, replace(baseline, model=model), self._aside, state.evidence.floors,
            self.stage("tracing"),
        )  # fmt: skip
        return self._state(evidence)


def refitted(evidence: Evidence) -> Evidence:
    """Gauss-Newton steps in all numbers of a model, those of its effects among them, on training records."""
    for _ in range(_REFITS):
        beside = with_effects(evidence)
        moved = evidence.baseline.moved(beside.steps(beside.residual))
        evidence = weigh(evidence.traces, moved, evidence.floors)
    return with_effects(evidence)


def with_effects(evidence: Evidence) -> Evidence:
    """The same with slopes by the numbers of the model's own forces."""
    columns, names = [evidence.jacobian], list(evidence.names)
    for effect in evidence.baseline.model.effects:
        if isinstance(effect, Effect):
            member = CATALOGUE.get(effect.name)
            free = tuple(effect.parameters) if member is None else free_numbers(effect, member)
            sizes = np.array([size_of(effect.parameters[name].value) for name in free])
            columns.append(slopes_of(effect, free, sizes, evidence))
            names += [effect_number(effect, name) for name in free]
    return replace(evidence, jacobian=np.concatenate(columns, axis=1), names=tuple(names))


def _worth_fitting(probes: Sequence[Sequence[Probe]], evidence: Evidence) -> list[Sequence[Probe]]:
    """The first effects of the screen, and what shares a class and place with the very first.

    Not those that explain next to nothing of the residual, or far less than the first.
    """
    left = evidence.beyond(evidence.residual)
    least = _PROMISING * _MATERIAL * float(left @ left)
    first = probes[0][0] if probes else None
    if first is None or first.gain < least:
        return []
    alike = look_alikes(first.effect.name)

    def in_class(one: Sequence[Probe]) -> bool:
        return one[0].effect.name in alike and one[0].effect.enters == first.effect.enters

    near = [one for one in probes if one[0].gain >= max(_WORTH * first.gain, least)]
    return [*near[:_FITTED], *(one for one in near[_FITTED:] if in_class(one))]


def _spread(one: Explanation) -> float:
    """Mean square of what an effect leaves over, one at least: misfit makes differences less telling."""
    samples = sum(one.samples[file] for file in one.after if file not in one.hold_out)
    return max(one.cost(hold_out=False) / max(samples, 1), 1.0)


def _merit(one: Explanation) -> float:
    gains = one.gains(hold_out=False).sum() + one.gains(hold_out=True).sum()
    return float(gains / _spread(one)) - 2 * one.free_numbers


def _is_sure(one: Explanation) -> bool:
    """Whether an effect explains more than any of the catalogue would by chance, on held-out records too."""
    trained, held_out = _OF_TENSION if _in_tension(one) else _OF_MOTION
    spread, unseen = _spread(one), one.gains(hold_out=True)
    if float(one.gains(hold_out=False).sum()) / spread <= trained or one.share() <= _MATERIAL:
        return False
    return not unseen.size or float(unseen.sum()) / spread > held_out


def _in_tension(one: Explanation) -> bool:
    return one.effect.enters in ("tension", "sensor:tension")


def _comparable(one: Explanation, other: Explanation) -> bool:
    """Whether costs are over the same residual: of the motion, or of the tension."""
    return set(one.before) == set(other.before) and all(
        np.isclose(one.before[file], other.before[file], rtol=1e-6) for file in one.before
    )


def _is_alike(one: Explanation, best: Explanation) -> bool:
    """Whether an effect's cost is within chance of the best one's, or of a slightly wrong form of it."""
    spread = _spread(best)
    lag = [best.gains(hold_out=h).sum() - one.gains(hold_out=h).sum() for h in (False, True)]
    gain = [best.gains(hold_out=h).sum() for h in (False, True)]
    held = bool(best.hold_out & set(best.before))
    place = 1 if held else 0
    return bool(lag[place] / spread <= max(_ALIKE, _NEAR * gain[place] / spread))


def _matters(chosen: _Chosen, before: ErrorsByKind, after: ErrorsByKind) -> bool:
    """Whether an effect in the motion lowers an error there that people care for; others pass."""
    if _in_tension(chosen.best):
        return True
    kind: Kind = "hold_out" if before["hold_out"]["motion_nrmse"] is not None else "training"
    ratios = [
        new / old
        for name in ("motion_nrmse", "relative_motion_nrmse")
        if (old := _error(before[kind], name)) and (new := _error(after[kind], name)) is not None
    ]
    return bool(ratios) and min(ratios) <= 1 - _MATTERS and max(ratios) <= 1 + _MATTERS


def _error(errors: Errors, name: str) -> float | None:
    value = errors[name]  # type: ignore[literal-required]
    return None if value is None else float(value)


def _level(state: _State) -> float:
    """Mean square of what a model leaves over on training records; 1 is noise.

    At the numbers that it has: those that would suit better are no excuse.
    """
    return float(np.mean(state.evidence.residual[state.evidence.training] ** 2))


def _is_quiet(path: _Path) -> bool:
    """Whether noise alone is left, or next to nothing of what was beyond it."""
    beyond = _level(path.states[-1]) - 1
    return beyond <= max(_QUIET - 1, _LEFT * (_level(path.states[0]) - 1))


def _better(path: _Path, other: _Path) -> _Path:
    """The path that leaves noise alone; where neither does, the first unless the other leaves far less."""
    if _is_quiet(other) or _level(other.states[-1]) < _FAR_LESS * _level(path.states[-1]):
        return replace(other, screened=path.screened)
    return path


def _verdict(path: _Path) -> Verdict:
    if not _is_quiet(path):
        return "unexplained"
    return "closed" if path.chosen else "no-effect"


def _found(chosen: _Chosen, state: _State) -> FoundEffect:
    best = chosen.best
    gained = float(best.gains(hold_out=False).sum())
    tried = len(candidates(state.model, (*motion_channels(state.evidence), "tension")))
    effect = next(
        (e for e in state.model.effects if (e.name, e.enters) == (best.effect.name, best.effect.enters)),
        best.effect,
    )
    limited = {
        name: replace(p, low=_moved(old.low, p.value - old.value), high=_moved(old.high, p.value - old.value))
        for (name, p), old in zip(effect.parameters.items(), best.effect.parameters.values(), strict=True)
    }
    gains = best.gains(hold_out=True)
    costs = best.cost(hold_out=True)
    return FoundEffect(
        effect=replace(effect, parameters=limited),
        look_alikes=tuple(
            LookAlike(one.effect.name, one.effect.enters, one.cost(hold_out=True) / costs if costs else 1.0)
            for one in chosen.rivals
        ),
        source="catalogue" if best.effect.name in CATALOGUE else "free-form",
        share=best.share(),
        p_value=min(1.0, tried * float(stats.chi2.sf(gained / _spread(best), max(best.free_numbers, 1)))),
        wins=(int((gains > 0).sum()), len(gains)),
    )


def _moved(limit: float | None, shift: float) -> float | None:
    return None if limit is None else limit + shift


def _label(effect: Added) -> str:
    return f"{effect.name} ({effect.enters})"


def _screened(probes: Iterable[Sequence[Probe]], evidence: Evidence) -> tuple[Screened, ...]:
    left = evidence.beyond(evidence.residual)
    cost = float(left @ left)
    found = []
    for best, *_ in probes:
        strength = next(iter(best.member.strengths))
        value = best.effect.parameters[strength].value * best.amplitude
        found.append(Screened(best.effect.name, best.effect.enters, best.gain / cost, value))
    return tuple(found)
