"""The closed loop: residual, missing effect, refined model, until the residual is noise or nothing helps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from discovery.courses.tension_likelihood import acts_at_rest
from discovery.decide.acceptance import (
    MATERIAL,
    QUIET,
    at_noise_floor,
    harms,
    in_tension,
    is_accepted,
    is_significant,
    penalised_gain,
    spread_of,
)
from discovery.decide.explanation import Explanation
from discovery.explain import at_rest, calibration, free_form, free_rate, ground_motion
from discovery.explain.motion import Probe, by_chance, explain, screen, worth_fitting
from discovery.explain.tension import TensionFindings, findings
from discovery.localisation.localise import localise
from discovery.loop.force_loop import close_forces
from discovery.loop.found_effects import found_effect, label_of, screened
from discovery.loop.free_tension import with_free_form
from discovery.loop.history import LoopHistory, Selection, alike, chosen, courses
from discovery.loop.redundant import without_needless, without_needless_in_tension
from discovery.loop.refits import Refits
from discovery.loop.result import Closure, Screened, Step
from discovery.loop.state import (
    Stages,
    State,
    cost,
    level,
    reestimate_noise,
    refitted,
    residual_without,
    silent,
)
from discovery.residual.output_error import WhitenedResidual
from rom.campaign.campaign import Campaign
from rom.effects import Effect, LawChange, ModelCorrection, Reading, SensorFault
from rom.identification.force_balance import is_driven
from rom.identification.identify import identify_campaign
from rom.one_thread import one_threaded
from rom.signals.measured_records import with_stored_records

_AFAR = 10.0  # times noise: what integrating and filtering do to the measured motion is less


@one_threaded
@with_stored_records
def close_loop(campaign: Campaign, jobs: int = 1, progress: Stages | None = None, seed: int = 0) -> Closure:
    """Find what a campaign's declared model lacks, add it, and tell the errors before and after.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`; nothing is fitted to its held-out records.
    jobs : int
        Processes and threads; the numbers do not depend on it.
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
        return close_forces(campaign, jobs, stage, seed)
    found = identify_campaign(campaign, jobs, stage("identifying"))
    loop = _Loop(Refits(campaign, found, jobs, stage))
    first = loop.refits.start()
    loop, path = loop.gauged(LoopHistory((first,)))
    rested = loop.law_first(loop.at_rest(path))
    path = loop.or_formed(loop.moved(rested), rested, seed)
    path = loop.along_law(loop.in_tension(path, seed))
    last = path.last
    labels = ["", *(label_of(one.best.effect) for one in path.chosen)]
    return Closure(
        verdict=path.verdict(),
        effects=tuple(found_effect(one.best, one.rivals, last) for one in path.chosen),
        model=last.model,
        steps=tuple(Step(label, state.errors) for label, state in zip(labels, path.states, strict=True)),
        residual_before=localise(first.evidence, *courses(path.tension[:1])),
        residual_after=localise(last.evidence, *courses(path.tension[1:])),
        screened=path.screened,
        set_aside=tuple(f"{doubt.file}: {doubt.message}" for doubt in loop.refits.found.set_aside),
        warnings=tuple(dict.fromkeys((*loop.refits.found.warnings, *path.doubts(), *path.excuses()))),
    )


@dataclass(frozen=True, eq=False)
class _Loop:
    refits: Refits

    def gauged(self, path: LoopHistory) -> tuple[_Loop, LoopHistory]:
        """Add a fault of the gauge that the declared preloads tell, and identify the campaign anew beside it.

        All that follows rests on the tension: a bolt that a wrong zero shows slack is not even looked at.
        """
        one, refits = chosen(calibration.explain(path.last.evidence, self.refits.options())), self.refits
        if one is None or not isinstance(one.best.effect, SensorFault):
            return self, path
        faults, tell = (one.best.effect,), refits.stage("identifying")
        found = identify_campaign(refits.campaign, refits.jobs, tell, faults)
        refits = replace(refits, found=replace(found, warnings=(*found.warnings, calibration.DISAGREE)))
        return _Loop(refits), path.longer(one, refits.start())

    def at_rest(self, path: LoopHistory) -> LoopHistory:
        """Add what shows before the hits, and would pass for noise: faults of sensors, then disturbances."""
        options = self.refits.options()
        while True:
            last = path.last
            one = chosen(at_rest.explain(last.evidence, options))
            one = one or chosen(ground_motion.explain(last.evidence, options))
            if one is None:
                return path
            path = path.longer(one, self.refits.adopt(last, one.best, floors_too=True))

    def moved(self, path: LoopHistory, given: Selection | None = None) -> LoopHistory:
        """Add effects in the motion; then what shows before the hits once more, judged after them."""
        after = self.in_motion(path, given)
        rested = after if after.names == path.names else self.at_rest(after)
        return after if rested is after else self.in_motion(without_needless(rested, self.refits))

    def in_motion(self, path: LoopHistory, given: Selection | None = None) -> LoopHistory:
        """Add effects in the motion, ``given`` the first, until none of the catalogue helps beyond chance."""
        if given is not None:
            after = self.refits.settled(reestimate_noise(self.refits.beside(path.last, given.best)))
            if not path.improves(after):
                return path
            path = path.longer(given, after)
        seen = {path.names: cost(path.last.evidence)}
        while True:
            found, first = self._most_helpful(path)
            path = replace(path, screened=path.screened or first)
            if found is None:
                return path
            one, beside = found
            freed, one = self._freed(path, one, beside)
            state = self.refits.settled(reestimate_noise(beside)) if is_accepted(one.best) else freed.last
            if freed.improves(state):
                path = without_needless(freed.longer(one, state), self.refits)
                left = cost(path.last.evidence)
                if left > (1 - MATERIAL) * seen.get(path.names, np.inf):
                    return path  # of two effects each takes the other's place
                seen[path.names] = left
            elif freed is path:
                return path
            else:
                path = freed  # with another residual, to be screened anew

    def _most_helpful(
        self, path: LoopHistory
    ) -> tuple[tuple[Selection, WhitenedResidual] | None, tuple[Screened, ...]]:
        """The effect that leaves least, what it leaves, and the first screen.

        Far from the plant by slopes that hold from afar; where that leaves more than next to nothing by those
        nearby too, since a law of the tension is far from linear in its numbers.
        """
        state, found, first = path.last, None, tuple[Screened, ...]()
        for from_afar in (True, False) if state.level > _AFAR and not path.at_noise_floor else (False,):
            evidence = replace(state.evidence, from_afar=from_afar)
            probes = screen(evidence, self.refits.jobs, self.refits.stage("screening effects"))
            first = first or screened(probes, evidence)
            explained = self._explained(probes, evidence)
            other = self._best_beside(replace(state, evidence=evidence), explained)
            found = min((one for one in (found, other) if one), key=_left, default=None)
            if found and at_noise_floor(level(found[1]), state.level):
                break
        return found, first

    def _freed(
        self, path: LoopHistory, one: Selection, beside: WhitenedResidual
    ) -> tuple[LoopHistory, Selection]:
        """Refit the last model from where a fit beside one more effect ended, if that leaves less.

        A fit that was stuck may be freed by any further effect, which would get the credit for it.
        """
        if not path.chosen or not isinstance(one.best.effect, Effect):
            return path, one
        anew = refitted(residual_without(beside, one.best.effect))
        if cost(anew) > (1 - MATERIAL) * cost(path.last.evidence):
            return path, one
        return path.ending(self.refits.settled(anew)), replace(one, best=_told(one.best, anew, beside))

    def _best_beside(
        self, state: State, explained: Sequence[Explanation]
    ) -> tuple[Selection, WhitenedResidual] | None:
        """The effect that leaves least where everything is refitted beside it, and what it leaves.

        That is the one that explains most. Far from the plant, where more than noise is left, held-out costs,
        told by straight lines in the model's numbers, may be wrong: what suits the training records better
        than all others is then tried too, and judged where its fit ends.
        """
        one = chosen(explained)
        found = [] if one is None else [(one, self.refits.beside(state, one.best))]
        first = max(explained, key=lambda e: float(e.gains(hold_out=False).sum()), default=None)
        loud = state.level > QUIET and first is not None and is_accepted(first.of_training())
        if loud and first is not None and (one is None or first is not one.best):
            after = self.refits.beside(state, first)
            fitted, rivals = _told(first, state.evidence, after), alike(explained, first, hold_out=False)
            found += [(Selection(fitted, rivals), after)] if is_accepted(fitted) else []
        return min(found, key=_left, default=None)

    def in_tension(self, path: LoopHistory, seed: int = 0) -> LoopHistory:
        """Add effects in the tension and its gauge; a free form where the catalogue leaves too much.

        They are told along the motion, so where that is not explained none is asked for.
        """
        refits = self.refits
        if not path.is_explained:
            misfit = refits.tension_of(path.last).misfit
            if not misfit.numbers:
                return path
            return replace(path, tension=(*(path.tension or (misfit,))[:1], misfit))
        named = self._named_in_tension(path)
        if named.tension_at_noise_floor:
            return named
        starts = [path, named] if len(named.chosen) > len(path.chosen) else [path]
        return with_free_form(
            named,
            starts,
            lambda state: free_rate.explain(refits.tension_of(state), refits.options(seed)),
            lambda state: refits.tension_of(state).misfit,
            refits.adopt,
        )

    def _named_in_tension(self, path: LoopHistory) -> LoopHistory:
        """Add effects of the catalogue in the tension, which hardly show in the motion, until none helps.

        One that makes the simulated errors worse, or the courses by more than it explains, is not kept; nor
        is a law believed that only a reading brought up which follows the motion.
        """
        before, sure, seen, count = path, set[str](), [path.names], len(path.chosen)
        while True:
            last, told = path.last, self._findings(path.last)
            if path.tension and path.tension[-1].loss_to(told.misfit) > path.chosen[-1].training_gain:
                return before
            path = replace(path, tension=(*(path.tension or (told.misfit,))[:1], told.misfit))
            apart = path.chosen and _is_apart(path.chosen[-1].best.effect)
            known = [
                e for e in told.explanations if not isinstance(e.effect, LawChange) or e.effect.path in sure
            ]
            one = chosen(known if apart else told.explanations)
            sure = {e.effect.path for e in told.explanations if is_accepted(e)}
            if one is None:
                return path
            after = self.refits.adopt(last, one.best)
            if harms(last.errors, after.errors):
                return path
            before, path = path, path.longer(one, after)
            path = without_needless_in_tension(path, count, self._findings, self.refits.adopt)
            if path.names in seen:  # of two effects each takes the other's place
                return before
            seen.append(path.names)

    def _findings(self, state: State, only: str = "") -> TensionFindings:
        return findings(self.refits.tension_of(state), self.refits.options(), only)

    def law_first(self, path: LoopHistory) -> LoopHistory:
        """Add another law of loosening before all effects in the motion, where it is what is plainly wrong.

        Records are traced along a tension that falls by the declared law. Where another one holds, courses
        are off by far more than the motion, and what that lacks then is the right tension.
        """
        refits, last = self.refits, path.last
        if path.is_explained:
            return path
        misfit = refits.tension_of(last).misfit
        if misfit.is_noise or misfit.level <= last.level:
            return path
        named = self._named_in_tension(path)
        laws = [one for one in named.chosen[len(path.chosen) :] if isinstance(one.best.effect, LawChange)]
        if not laws:
            return path
        near = named.last.evidence
        traced = refits.settled(refitted(refits.gathered(near.baseline, near.floors)), learned=True)
        return replace(named.ending(traced), tension=named.tension[:1]) if traced.level < last.level else path

    def along_law(self, path: LoopHistory) -> LoopHistory:
        """Drop what is needless in the motion once the tension falls by the law that was found.

        Until then records are traced along a tension that falls by the quartic law, whose course is a little
        wrong where another law holds; so is the joint's stiffness then, which an effect may make up for.
        """
        has_law = any(isinstance(one.best.effect, LawChange) for one in path.chosen)
        if not has_law or all(in_tension(one.best) for one in path.chosen):
            return path
        near = path.last.evidence
        evidence = refitted(self.refits.gathered(near.baseline, near.floors))
        after = without_needless(path.ending(self.refits.settled(evidence, learned=True)), self.refits)
        return after if len(after.chosen) < len(path.chosen) and after.is_explained else path

    def or_formed(self, path: LoopHistory, start: LoopHistory, seed: int) -> LoopHistory:
        """The trail, or from its start one with a term without the catalogue, where that leaves far less.

        Where names leave next to nothing of much the term must do better by itself: no others follow it.
        """
        if path.last.level <= QUIET:
            return self._or_nearer(path, start, seed)
        formed = self.formed(start.last, seed)
        if formed is None:
            return path
        if not path.at_noise_floor:
            return path.or_better(self.moved(start, formed))
        if spread_of(formed.best) >= path.last.level:
            return path
        return path.or_better(start.longer(formed, self._by_itself(start, formed)))

    def _or_nearer(self, path: LoopHistory, start: LoopHistory, seed: int) -> LoopHistory:
        """The trail, or from its start a term by itself where one beside the names shows their form wrong.

        A drag with |v|^1.5 leaves next to noise where one with v^2 is put in its place. The right form with
        another knee leaves as much, but no term by itself does better than that.
        """
        forces = any(isinstance(one.best.effect, Effect) for one in path.chosen[len(start.chosen) :])
        if not forces or not any(
            is_significant(one) for one in free_form.explain(path.last.evidence, self.refits.options(seed))
        ):
            return path
        formed = self.formed(start.last, seed)
        if formed is None:
            return path
        named, after = path.last.evidence, self._by_itself(start, formed)
        if len(after.evidence.traces) < len(named.traces):
            return path
        if not is_significant(_told(formed.best, named, after.evidence)):
            return path
        return replace(start.longer(formed, after), screened=path.screened)

    def _by_itself(self, start: LoopHistory, formed: Selection) -> State:
        return self.refits.settled(reestimate_noise(self.refits.beside(start.last, formed.best)))

    def formed(self, state: State, seed: int) -> Selection | None:
        """The best term without the catalogue; None where even that does not predict held-out records."""
        sure = [
            one for one in free_form.explain(state.evidence, self.refits.options(seed)) if is_accepted(one)
        ]
        if not sure:
            return None
        best = max(sure, key=penalised_gain)
        return Selection(best, ())

    def _explained(self, probes: Sequence[Sequence[Probe]], evidence: WhitenedResidual) -> list[Explanation]:
        """Fit what the screen promises."""
        tell = self.refits.stage("fitting effects")
        left = evidence.beyond(evidence.residual)
        tried, largest = worth_fitting(probes, float(left @ left)), by_chance(probes)
        tasks = (delayed(explain)(one, evidence, largest) for one in tried)
        explanations: list[Explanation] = []
        for one in Parallel(n_jobs=self.refits.jobs, prefer="threads", return_as="generator")(tasks):
            explanations.append(one)
            if tell is not None:
                tell(len(explanations), len(tried))
        return explanations


def _left(one: tuple[Selection, WhitenedResidual]) -> tuple[int, float]:
    """Records that can be simulated with an effect, most first, then the cost of what it leaves of all."""
    return -len(one[1].traces), float(np.sum(one[1].residual ** 2))


def _told(one: Explanation, before: WhitenedResidual, after: WhitenedResidual) -> Explanation:
    """What an effect explains by fits of everything without it and with it."""
    return replace(one, before=before.costs(before.residual), after=after.costs(after.residual))


def _is_apart(effect: ModelCorrection) -> bool:
    """Whether an effect is a reading that courses are blind to: nothing of a law can hang on it."""
    return isinstance(effect, Reading) and not acts_at_rest(effect)
