"""The closed loop: residual, missing effect, refined model, until the residual is noise or nothing helps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from discovery.acceptance import (
    QUIET,
    harms,
    is_alike,
    is_quiet,
    is_sure,
    matters,
    merit,
)
from discovery.at_rest import explain_at_rest
from discovery.attribution import Probe, explain, explanation, screen, worth_fitting
from discovery.baseline import Baseline
from discovery.closure import Closure, Screened, Step, Verdict
from discovery.disturbances import explain_disturbances
from discovery.explanation import Explanation
from discovery.force_loop import close_forces
from discovery.found_effects import found_effect, label_of, screened
from discovery.free_form import free_forms
from discovery.law_likelihood import acts_at_rest
from discovery.localisation import COURSES, localise
from discovery.state import (
    Stages,
    State,
    approached,
    cost,
    level,
    refitted,
    retold,
    set_aside,
    settled,
    silent,
    with_effects,
    with_law,
)
from discovery.tension_attribution import explain_tension
from discovery.tension_data import Misfit
from discovery.tracing import Evidence, gather, starting, weigh
from rom.campaign import Campaign
from rom.driven import is_driven
from rom.effects import CATALOGUE, Added, Effect, LawChange, Reading, SensorFault
from rom.flexures import as_uncoupled, unlikely
from rom.identification import Identification, identify_campaign, reidentified
from rom.noise_floor import Group, NoiseFloor
from rom.own_numbers import own_names
from rom.spectra import SpectralRecord

MOST_EFFECTS = 3
_FAR_LESS = 0.7


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
    stage = progress or silent
    if is_driven(campaign):
        return close_forces(campaign, jobs, stage)
    found = identify_campaign(campaign, jobs, stage("identifying"))
    loop = _Loop(campaign, found, jobs, stage)
    first = loop.start()
    rested = loop.at_rest(first)
    path = loop.in_motion(rested)
    if not _is_quiet(path):
        formed = loop.formed(rested.states[-1], seed)
        path = path if formed is None else _better(path, loop.in_motion(rested, formed))
    path = loop.in_tension(path)
    last = path.states[-1]
    labels = ["", *(label_of(one.best.effect) for one in path.chosen)]
    return Closure(
        verdict=_verdict(path),
        effects=tuple(found_effect(one.best, one.rivals, last) for one in path.chosen),
        model=last.model,
        steps=tuple(Step(label, state.errors) for label, state in zip(labels, path.states, strict=True)),
        residual_before=localise(first.evidence, _courses(path.tension[:1])),
        residual_after=localise(last.evidence, _courses(path.tension[1:])),
        screened=path.screened,
        set_aside=tuple(f"{doubt.file}: {doubt.message}" for doubt in found.set_aside),
        warnings=(*found.warnings, *(line for line in _doubts(path) if line not in found.warnings)),
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The effect that explains most, and the others that do nearly as well."""

    best: Explanation
    rivals: tuple[Explanation, ...]


@dataclass(frozen=True, eq=False)
class _Path:
    """Models one after the other, the declared one first, and the effects that lead from each to the next."""

    states: tuple[State, ...]
    chosen: tuple[_Chosen, ...]
    screened: tuple[Screened, ...]
    tension: tuple[Misfit, ...] = ()  # of the courses, first and last

    def longer(self, one: _Chosen, state: State) -> _Path:
        """The path with one more effect."""
        return replace(self, states=(*self.states, state), chosen=(*self.chosen, one))


@dataclass(frozen=True, eq=False)
class _Loop:
    campaign: Campaign
    found: Identification
    jobs: int
    stage: Stages

    def start(self) -> State:
        """The declared model, its numbers refitted to all training records.

        An effect may pass for damping in the identification, which is free to scale what it weighs.
        """
        evidence = refitted(self._gathered(starting(self.found, self.found.model)))
        return self._settled(self._nearer(evidence))

    def _nearer(self, evidence: Evidence) -> Evidence:
        """Start from the uncoupled tests instead, where that leaves far less.

        An identification takes what it leaves over for noise: misfit, alike in all coupled records, may lead
        its links anywhere, too far for steps to lead back.
        """
        ties = self.found.linear.ties if self.found.linear is not None else ()
        if level(evidence) <= QUIET or not ties:
            return evidence
        baseline = starting(self.found, as_uncoupled(self.found.model, ties))
        other = refitted(self._gathered(baseline, evidence.floors))
        if level(other) >= _FAR_LESS * level(evidence):
            return evidence
        return refitted(self._gathered(other.baseline))

    def _gathered(self, baseline: Baseline, floors: Mapping[Group, NoiseFloor] | None = None) -> Evidence:
        return gather(self.campaign, baseline, set_aside(self.found), floors, self.stage("tracing"))

    def _settled(self, evidence: Evidence, *, learned: bool = False) -> State:
        return settled(self.campaign, self.found, evidence, self.jobs, self.stage, learned=learned)

    def at_rest(self, state: State) -> _Path:
        """Add what shows before the hits, and would pass for noise: faults of sensors, then disturbances."""
        path = _Path((state,), (), ())
        while len(path.chosen) < MOST_EFFECTS:
            last = path.states[-1]
            one = _chosen(explain_at_rest(last.evidence)) or _chosen(explain_disturbances(last.evidence))
            if one is None:
                break
            path = path.longer(one, self.adopt(last, one, floors_too=True))
        return path

    def in_motion(self, path: _Path, given: _Chosen | None = None) -> _Path:
        """Add effects in the motion, ``given`` the first, until none of the catalogue helps beyond chance."""
        if given is not None:
            after = self.adopt(path.states[-1], given)
            if not matters(path.states[-1].errors, after.errors):
                return path
            path = path.longer(given, after)
        for _ in range(2 * MOST_EFFECTS):
            if len(path.chosen) >= MOST_EFFECTS:
                break
            evidence = path.states[-1].evidence
            probes = screen(evidence, self.jobs, self.stage("screening effects"))
            path = replace(path, screened=path.screened or screened(probes, evidence))
            pairs = self._adopted(path.states[-1], self._explained(probes, evidence))
            settled = _is_quiet(path) and path.states[-1].level > QUIET
            if not pairs or not matters(path.states[-1].errors, pairs[0][1].errors, settled=settled):
                break
            path = self._without_needless(path.longer(*pairs[0]))
        return path

    def _adopted(self, state: State, explained: Sequence[Explanation]) -> list[tuple[_Chosen, State]]:
        """Add what explains most, and the state that it leads to, what leaves least first.

        Far from the plant, where more than noise is left, held-out costs, told by straight lines in the
        model's numbers, may be wrong: what suits the training records better than all others is then tried
        too, and judged where its fit ends.
        """
        one = _chosen(explained)
        pairs = [] if one is None else [(one, self.adopt(state, one))]
        if state.level <= QUIET:
            return pairs
        first = max(explained, key=lambda e: float(e.gains(hold_out=False).sum()), default=None)
        if first is not None and (one is None or first is not one.best) and is_sure(first.of_training()):
            after = self.adopt(state, _Chosen(first, ()))
            fitted = replace(
                first,
                before=state.evidence.costs(state.evidence.residual),
                after=after.evidence.costs(after.evidence.residual),
            )
            if is_sure(fitted):
                pairs.append((_Chosen(fitted, ()), after))
        return sorted(pairs, key=lambda pair: sum(pair[1].evidence.costs(pair[1].evidence.residual).values()))

    def in_tension(self, path: _Path) -> _Path:
        """Add effects in the tension and its gauge, which hardly show in the motion, until none helps.

        They are told along the motion, so where that is not explained nothing is asked. One that makes the
        simulated errors worse, or the courses by more than it explains, is not kept; nor is a law believed
        that only a reading brought up which follows the motion.
        """
        if not _is_quiet(path):
            return path
        before, sure = path, set[str]()
        while True:
            last = path.states[-1]
            tell = self.stage("tension")
            told = explain_tension(self.campaign, last.found, last.model, self.jobs, tell)
            if path.tension and path.tension[-1].loss_to(told.misfit) > _training_gain(path.chosen[-1]):
                return before
            path = replace(path, tension=(*(path.tension or (told.misfit,))[:1], told.misfit))
            apart = path.chosen and _is_apart(path.chosen[-1].best.effect)
            known = [
                e for e in told.explanations if not isinstance(e.effect, LawChange) or e.effect.path in sure
            ]
            one = _chosen(known if apart else told.explanations)
            sure = {e.effect.path for e in told.explanations if is_sure(e)}
            after = self.adopt(last, one) if one is not None and len(path.chosen) < MOST_EFFECTS else None
            if one is None or after is None or harms(last.errors, after.errors):
                return path
            before, path = path, path.longer(one, after)

    def _without_needless(self, path: _Path) -> _Path:
        """Drop an effect that explains nothing beside the others.

        The last one too: the fit that it came with may be better by the model's own numbers alone.
        """
        last = path.states[-1]
        for place, one in enumerate(path.chosen):
            effect, baseline = one.best.effect, last.evidence.baseline
            if not isinstance(effect, Effect) or effect.name not in CATALOGUE:
                continue
            kept = tuple(e for e in last.model.effects if e.path != effect.path)
            lacking = replace(baseline, model=replace(last.model, effects=kept))
            rest = with_effects(weigh(last.evidence.traces, lacking, last.evidence.floors))
            own = next(e for e in last.model.effects if e.path == effect.path)
            if is_sure(explanation(own, CATALOGUE[effect.name], rest)):
                continue
            after = self._settled(refitted(rest))
            return replace(
                path,
                states=(*path.states[:place], *path.states[place + 1 : -1], after),
                chosen=(*path.chosen[:place], *path.chosen[place + 1 :]),
            )
        return path

    def formed(self, state: State, seed: int) -> _Chosen | None:
        """The best term without the catalogue; None where even that does not predict held-out records."""
        sure = [one for one in free_forms(state.evidence, seed) if is_sure(one)]
        if not sure:
            return None
        best = max(sure, key=merit)
        return _Chosen(best, ())

    def _explained(self, probes: Sequence[Sequence[Probe]], evidence: Evidence) -> list[Explanation]:
        """Fit what the screen promises."""
        tell = self.stage("fitting effects")
        left = evidence.beyond(evidence.residual)
        tried = worth_fitting(probes, float(left @ left))
        tasks = (delayed(explain)(one, evidence) for one in tried)
        explanations: list[Explanation] = []
        for one in Parallel(n_jobs=self.jobs, prefer="threads", return_as="generator")(tasks):
            explanations.append(one)
            if tell is not None:
                tell(len(explanations), len(tried))
        return explanations

    def adopt(self, state: State, chosen: _Chosen, *, floors_too: bool = False) -> State:
        """Add an effect, trace all records anew and refit everything together.

        ``floors_too``: what was in the noise before the hits is not any more.
        """
        effect, near = chosen.best.effect, state.evidence.baseline
        if isinstance(effect, LawChange | Reading):  # the motion does not see it
            beside = replace(near, model=effect.added_to(with_law(state.model, chosen.best.beside)))
            evidence = replace(state.evidence, baseline=beside)
        else:
            model, floors = effect.added_to(near.model), None if floors_too else state.evidence.floors
            if isinstance(effect, Effect) and not floors_too:  # first along the old model's traces
                near = self._fitted(approached(state.evidence, effect)).baseline
                model = near.model
            beside = replace(near, model=model)
            evidence = self._fitted(self._gathered(beside, floors))
            if isinstance(effect, SensorFault) and not (floors_too or own_names(effect)):  # from afar so far
                again = refitted(self._gathered(retold(evidence, effect), evidence.floors))
                evidence = min(evidence, again, key=cost)
        return self._settled(evidence, learned=bool(chosen.best.beside))

    def _fitted(self, evidence: Evidence) -> Evidence:
        """Fit all numbers together; where more than noise is left, also from a start that forgets them.

        A model that lacked the effect may have been far from its plant, where steps do not lead back.
        """
        after = refitted(evidence)
        if level(after) <= QUIET:
            return after
        records: dict[str, list[SpectralRecord]] = {}
        for trace, part, _ in after.parts:
            if not trace.settings.hold_out:
                records.setdefault(trace.settings.file, []).append(part)
        near, parts = after.baseline.model, [tuple(parts) for parts in records.values()]
        try:
            anew = reidentified(self.found, parts, self.campaign.settings)
        except np.linalg.LinAlgError:  # forces along a motion that is nowhere near the measured one
            return after
        model = replace(anew, effects=near.effects, identification=None)
        other = refitted(weigh(after.traces, replace(after.baseline, model=model), after.floors))
        return min(after, other, key=cost)


def _chosen(explanations: Sequence[Explanation]) -> _Chosen | None:
    """The effect that explains most beyond chance, and what is like it; None where there is none."""
    sure = [one for one in explanations if is_sure(one)]
    if not sure:
        return None
    best = max(sure, key=merit)
    rivals = [one for one in explanations if one is not best and is_alike(one, best)]
    return _Chosen(best, tuple(sorted(rivals, key=lambda one: -merit(one))))


def _is_apart(effect: Added) -> bool:
    """Whether an effect is a reading that courses are blind to: nothing of a law can hang on it."""
    return isinstance(effect, Reading) and not acts_at_rest(effect)


def _training_gain(one: _Chosen) -> float:
    """What an effect takes from the cost of the training records."""
    return float(one.best.gains(hold_out=False).sum())


def _is_quiet(path: _Path) -> bool:
    """Whether noise alone is left, or next to nothing of what was beyond it."""
    return is_quiet(path.states[-1].level, path.states[0].level)


def _tension_is_quiet(path: _Path) -> bool:
    """Whether courses of the tension differ by no more than noise from the law's, or next to nothing more."""
    if not path.tension or path.tension[-1].is_noise:
        return True
    return is_quiet(path.tension[-1].level, path.tension[0].level)


def _better(path: _Path, other: _Path) -> _Path:
    """The path that leaves noise alone; where neither does, the first unless the other leaves far less."""
    if _is_quiet(other) or other.states[-1].level < _FAR_LESS * path.states[-1].level:
        return replace(other, screened=path.screened)
    return path


def _doubts(path: _Path) -> tuple[str, ...]:
    """Reasons to doubt that the last model is near its plant: numbers that uncoupled tests deny."""
    last = path.states[-1]
    return unlikely(last.model, last.evidence.baseline.ties)


def _courses(misfit: Sequence[Misfit]) -> Mapping[str, float]:
    """The last misfit of the tension's courses by its name in result files."""
    return {COURSES: misfit[-1].level} if misfit else {}


def _verdict(path: _Path) -> Verdict:
    if not _is_quiet(path) or not _tension_is_quiet(path) or (path.chosen and _doubts(path)):
        return "unexplained"
    return "closed" if path.chosen else "no-effect"
