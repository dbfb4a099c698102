"""The race of candidate tension laws: fitted, re-simulated, cross-validated, compared, ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from joblib import Parallel, delayed

from discovery.courses.fit import ROUNDS, Fit, correction, fit, fit_losses, unchanged, with_uncertainty
from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.ranking import RankingRules
from discovery.laws.candidate import ALWAYS_LISTED, BASELINE, Candidate, rivals_always_in_the_race
from discovery.laws.factors import usual_unit
from discovery.laws.names import names_of
from discovery.ranking import cross_validation as validation
from discovery.ranking import ordering
from discovery.ranking.cross_validation import CrossValidation, Fold
from discovery.ranking.merging import Entrant, merged, same_equations, started_alike, without_vanished
from discovery.ranking.model_limits import widened
from discovery.ranking.ordering import Index
from discovery.ranking.probabilities import probabilities
from discovery.ranking.result import RankedLaw, Ranking, with_law
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.error_measures import Comparison, summarise
from rom.evaluation.evaluate import evaluate
from rom.evaluation.noise_floor import noise_floor
from rom.model.laws import Parameter
from rom.progress import Progress

__all__ = ["RankedLaw", "Ranking", "race"]

_CHUNKS: Numerical[int] = 4  # for each process and stage
Item = TypeVar("Item")
Found = TypeVar("Found")


def race(
    candidates: Sequence[Candidate],
    frozen: FrozenMotion,
    hold_out: FrozenMotion | None = None,
    campaign: Campaign | Sequence[Campaign] | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[RankedLaw, ...]:
    """Rank candidates and the rivals that are always in the race, the best one first.

    Parameters
    ----------
    candidates : sequence of Candidate
        Proposed laws; their numbers are the start of the fit.
    frozen : FrozenMotion
        Motion and tension courses of the training records.
    hold_out : FrozenMotion
        Of records that no fit sees: they only say which records of the campaign are judged as held out.
    campaign : Campaign or sequence of Campaign
        Its loosening records are re-simulated in full with every law listed; None: `errors` are empty. Of
        several bolts one each, in their order.
    seed, jobs, progress
        Of folds and resampling; processes; told what is done, in percent. No number depends on `jobs`.

    Returns
    -------
    tuple of RankedLaw
        The laws of full re-simulation, in the order of `discovery.ranking.ordering.order`.

    Raises
    ------
    ValueError
        If all records have one preload, or are of one bolt.
    """
    rng = np.random.default_rng(seed)
    rules, groups = frozen.criteria.ranking, validation.groups_of(frozen)
    refining = (rules.refined_least, rules.refined_most, rules.refined_reach)
    validating = (rules.validated_least, rules.validated_most, rules.validated_reach)
    folds = validation.folds_of(frozen, groups, seed)
    run = _Runner(jobs, progress, 3 if campaign is None else 4)
    standing = rivals_always_in_the_race(unit_of(frozen))
    same = same_equations(candidates, standing, frozen)
    starts = [*_baseline_starts(standing), *standing]
    starts += [*candidates, *started_alike(starts, same, frozen)]
    first = _lowest(run(0, _fit_some, starts, frozen))
    refined = run(1, _refine_some, _best(first, frozen, refining), frozen)
    refined = _with_reduced(refined, frozen)
    entrants = merged(_best(refined, frozen, refining), frozen, same)
    kept = _best([entrant.fit for entrant in entrants], frozen, validating)
    entrants = [entrant for entrant in entrants if any(entrant.fit is found for found in kept)]
    validated = run(2, _validate_some, [entrant.fit for entrant in entrants], frozen, folds)
    entrants = [replace(e, validation=v) for e, v in zip(entrants, validated, strict=True)]
    laws = _ranked(entrants, frozen, groups, rng)
    if campaign is not None:
        campaigns = (campaign,) if isinstance(campaign, Campaign) else campaign
        laws = _judged(laws, frozen, hold_out, campaigns, jobs, run)
    laws = tuple(
        replace(law, parameters=widened(law, frozen)) if law.rank == 1 or law.source == "given" else law
        for law in laws
    )
    shares = probabilities([law.fit for law in laws], frozen, groups, rng)
    return tuple(replace(law, probability=float(p)) for law, p in zip(laws, shares, strict=True))


@dataclass(frozen=True)
class _Runner:
    """Runs a stage in chunks over processes and says how far it is."""

    jobs: int
    progress: Progress | None
    stages: int

    def __call__(
        self,
        stage: int,
        work: Callable[..., list[Found]],
        items: Sequence[Item],
        frozen: FrozenMotion,
        *others: object,
    ) -> list[Found]:
        count = max(min(_CHUNKS * self.jobs, len(items)), 1)
        chunks = [items[k::count] for k in range(count)]
        tasks = (delayed(work)(chunk, frozen, *others) for chunk in chunks)
        done: list[list[Found]] = []
        self.report(stage, 0.0)
        for part in Parallel(n_jobs=self.jobs, return_as="generator")(tasks):
            done.append(part)
            self.report(stage, len(done) / count)
        found: list[Found] = []
        for place in range(len(items)):
            found.append(done[place % count][place // count])
        return found

    def report(self, stage: int, share: float) -> None:
        if self.progress is not None:
            self.progress(round(100 * (stage + share) / self.stages), 100)


def unit_of(frozen: FrozenMotion) -> float:
    """Return the tension [N] in which ranges and grids of tension laws are."""
    return usual_unit(float(np.median(frozen.initial)))


def _baseline_starts(standing: Sequence[Candidate]) -> list[Candidate]:
    """The baseline from other numbers: what all are compared with must not stop in a side valley."""
    first = next(rival for rival in standing if rival.name == BASELINE)
    inner = first.terms[0].tension.inner
    return [
        first.with_values({"gamma_i": gamma_i, "rho": rho})
        for gamma_i in inner["gamma_i"].grid[::2]
        for rho in inner["rho"].grid[1:3]
    ]


def _lowest(fits: Sequence[Fit | None]) -> list[Fit]:
    """The fit of lowest deviance of each form: a law may start from several numbers.

    Of a form that is both searched and always listed the listed name stays, of these the one given.
    """
    best: dict[tuple[object, ...], Fit] = {}
    for found in fits:
        if found is None:
            continue
        key = found.candidate.key
        other = best.setdefault(key, found)
        lowest = found if found.deviance < other.deviance - 1e-9 else other
        owner = max(other.candidate, found.candidate, key=_precedence)
        if _precedence(owner) > _precedence(lowest.candidate):
            named = replace(lowest.candidate, name=owner.name, source=owner.source)
            lowest = replace(lowest, candidate=named)
        best[key] = lowest
    return list(best.values())


def _precedence(law: Candidate) -> int:
    return ("baseline", "given").index(law.source) + 1 if law.source in ALWAYS_LISTED else 0


def _fit_some(candidates: Sequence[Candidate], frozen: FrozenMotion) -> list[Fit | None]:
    return [_safely(fit, candidate, frozen) for candidate in candidates]


def _refine_some(fits: Sequence[Fit], frozen: FrozenMotion) -> list[Fit | None]:
    return [_safely(_refined, found, frozen) for found in fits]


def _with_reduced(fits: Sequence[Fit | None], frozen: FrozenMotion) -> list[Fit | None]:
    """The fits, and those of laws whose needless terms are dropped."""
    there = [(found, without_vanished(found, frozen)) for found in fits if found is not None]
    reduced = [(found, law) for found, law in there if law is not None]
    more = [_safely(partial(_refitted, law=law), found, frozen) for found, law in reduced]
    return list(_lowest([*fits, *more])) if more else list(fits)


def _refitted(found: Fit, frozen: FrozenMotion, law: Candidate) -> Fit:
    return _refined(fit(law, frozen, found.offsets, found), frozen)


def _refined(found: Fit, frozen: FrozenMotion) -> Fit:
    return with_uncertainty(_corrected(found, frozen), frozen)


def _corrected(found: Fit, frozen: FrozenMotion) -> Fit:
    """Correct by full re-simulation and fit on from the fit at hand.

    Where a law is far from the truth, as the baseline may be, it may be so steep in the tension that the
    corrected fit is lost: then the frozen one stands.
    """
    if found.candidate.holds:
        return found
    if _misses(found, frozen):
        nearer = _safely(_resimulated, found, frozen)  # of quiet records the frozen motion is what is missed
        return nearer if nearer and not _misses(nearer, frozen) else _of_losses(found.candidate, frozen)
    return _resimulated(found, frozen)


def _misses(found: Fit, frozen: FrozenMotion) -> bool:
    """Whether the courses of a law are not those measured."""
    return validation.dispersion(found, frozen) > frozen.criteria.ranking.misfit


def _resimulated(found: Fit, frozen: FrozenMotion) -> Fit:
    for _ in range(ROUNDS):
        offsets = _finite(correction(found, frozen))
        if unchanged(offsets, found, frozen):
            break
        corrected = fit(found.candidate, frozen, offsets, found)
        if validation.lost(corrected, found.deviance):
            break
        found = corrected
    return found


def _of_losses(candidate: Candidate, frozen: FrozenMotion) -> Fit:
    """Fit a law whose courses are not those measured to the losses alone, corrected by full re-simulation."""
    standing = rivals_always_in_the_race(unit_of(frozen))
    start = next((c for c in standing if c.name == candidate.name), candidate)
    found = fit_losses(start, frozen)
    for _ in range(ROUNDS):
        offsets = _finite(correction(found, frozen))
        if unchanged(offsets[:, -1:], replace(found, offsets=found.offsets[:, -1:]), frozen.last_bin()):
            break
        found = fit_losses(found.candidate, frozen, offsets)
    return found


def _finite(offsets: FloatArray) -> FloatArray:
    if not np.isfinite(offsets).all():
        raise OverflowError("a re-simulation diverged")
    return offsets


def _safely(work: Callable[[Item, FrozenMotion], Fit], item: Item, frozen: FrozenMotion) -> Fit | None:
    """Fit of a candidate; None where it cannot be solved or its simulation fails: it is out of the race."""
    try:
        with np.errstate(all="ignore"):
            found = work(item, frozen)
    except (np.linalg.LinAlgError, OverflowError, ValueError):  # ValueError: a number left its bounds
        return None
    return found if np.isfinite(found.deviance) else None


def _validate_some(fits: Sequence[Fit], frozen: FrozenMotion, folds: Sequence[Fold]) -> list[CrossValidation]:
    parts = validation.divide(frozen, folds)
    with np.errstate(all="ignore"):
        return [validation.cross_validate(found, frozen, folds, parts) for found in fits]


def _best(fits: Sequence[Fit | None], frozen: FrozenMotion, share: tuple[float, float, float]) -> list[Fit]:
    """The fits of lowest BIC, and what is always in the race."""
    least, most, reach = share
    there = [(validation.information_criterion(found, frozen), found) for found in fits if found is not None]
    there.sort(key=lambda item: item[0])
    return [
        found
        for place, (criterion, found) in enumerate(there)
        if place < least
        or (place < most and criterion < there[0][0] + reach)
        or found.candidate.source in ALWAYS_LISTED
    ]


def _ranked(
    entrants: Sequence[Entrant], frozen: FrozenMotion, groups: Index, rng: np.random.Generator
) -> tuple[RankedLaw, ...]:
    rules = frozen.criteria.ranking
    fits = [entrant.fit for entrant in entrants]
    checks = [entrant.validation for entrant in entrants if entrant.validation is not None]
    scores = np.stack([check.scores for check in checks])
    numbers = [len(found.free) for found in fits]
    base = next(k for k, entrant in enumerate(entrants) if BASELINE in entrant.names)
    p_values = ordering.p_values(scores, scores[base], groups, rng, rules)
    spread = validation.dispersion(min(fits, key=lambda found: found.deviance), frozen)
    criteria = [validation.information_criterion(found, frozen, spread) for found in fits]
    evidence = np.stack([validation.evidence(found, frozen, spread) for found in fits])
    complexity = [(len(found.free), len(found.candidate.equation)) for found in fits]
    shares = ordering.chosen(scores, evidence, complexity, groups, rng, rules)
    places = ordering.order(scores, evidence, complexity, groups, rules)
    names = names_of([fits[k].candidate for k in places])
    return tuple(
        RankedLaw(
            rank=rank,
            name=name,
            equation=fits[k].candidate.equation,
            parameters=_parameters(fits[k], frozen, groups, rng, spread),
            errors={"training": summarise(()), "hold_out": summarise(())},
            cross_validated_loss_error_percent_median=float(np.median(checks[k].loss_error_percent)),
            cross_validated_score=float(scores[k].sum()),
            delta_bic=criteria[k] - criteria[places[0]],
            wins_against_baseline=(int((scores[k] > scores[base]).sum()), len(frozen)),
            p_value_against_baseline=None if k == base else float(p_values[k]),
            source=fits[k].candidate.source,
            free_numbers=numbers[k],
            look_alikes=entrants[k].look_alikes,
            same_as=entrants[k].same_as,
            fit=fits[k],
            candidate=replace(fits[k].candidate, name=name),
            scores=scores[k],
            chosen=float(shares[k]),
            known_bolt_loss_error_percent_median=_median(checks[k].of_known_bolt),
            identified=frozen.model,
        )
        for rank, (name, k) in enumerate(zip(names, places, strict=True), 1)
    )


def _median(values: FloatArray | None) -> float | None:
    return None if values is None else float(np.median(values))


def _parameters(
    found: Fit, frozen: FrozenMotion, groups: Index, rng: np.random.Generator, spread: float
) -> dict[str, Parameter]:
    """Numbers with 95 % limits."""
    limits = validation.limits(found, frozen, groups, rng, spread)
    return {
        name: replace(p, low=limits[name][0], high=limits[name][1]) if name in limits else p
        for name, p in found.candidate.parameters.items()
    }


def _listed(laws: Sequence[RankedLaw], rules: RankingRules) -> list[RankedLaw]:
    """The first laws, those that come first in many a resample, and what is always in the race."""
    return [
        law
        for law in laws
        if law.rank <= rules.listed or law.chosen >= rules.named or law.source in ALWAYS_LISTED
    ]


def _judged(
    laws: Sequence[RankedLaw],
    frozen: FrozenMotion,
    hold_out: FrozenMotion | None,
    campaigns: Sequence[Campaign],
    jobs: int,
    run: _Runner,
) -> tuple[RankedLaw, ...]:
    """The laws that are listed, with their errors on training and held-out records."""
    listed = _listed(laws, frozen.criteria.ranking)
    judged: list[tuple[bool, tuple[Comparison, ...]]] = []
    for place, campaign in enumerate(campaigns):
        unseen = _files(hold_out, place)
        records = [r for r in campaign.settings.record if r.file in _files(frozen, place) | unseen]
        models = [
            with_law(frozen.bolt_models[place] if frozen.bolt_models else frozen.model, law) for law in listed
        ]

        def report(done: int, total: int, before: int = place) -> None:
            run.report(run.stages - 1, (before + done / total) / len(campaigns))

        of_bolt = evaluate(models, campaign, records, jobs, report, bands="hold_out")
        judged += [(j.settings.file in unseen, j.comparisons) for j in of_bolt if j.comparisons]
    kinds = (("training", False), ("hold_out", True))
    found = []
    for place, law in enumerate(listed):
        of = {kind: [c[place] for held, c in judged if held is hidden] for kind, hidden in kinds}
        errors = {kind: summarise(comparisons) for kind, comparisons in of.items()}
        floors = {kind: noise_floor(comparisons) for kind, comparisons in of.items()}
        found.append(replace(law, rank=place + 1, errors=errors, noise_floor=floors))
    return tuple(found)


def _files(frozen: FrozenMotion | None, bolt: int) -> set[str]:
    """Files of the records of a bolt."""
    if frozen is None:
        return set()
    of = np.zeros(len(frozen), dtype=np.int64) if frozen.bolt is None else frozen.bolt
    return {course.file for course, place in zip(frozen.courses, of, strict=True) if place == bolt}
