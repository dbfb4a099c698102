"""What effects in the tension and in its gauge explain: every one of the catalogue, beside the refitted law.

Slow part: the course of the tension after each hit under a law, its case-to-case scatter integrated out
(``discovery.explain.tension_law``). Fast part: what the gauge shows in phase with the motion, late, or at a
line
(``discovery.explain.gauge``). The cost of a record is the sum of both, the same before for all effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.courses.tension_likelihood import acts_at_rest
from discovery.decide.acceptance import is_accepted, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.free_form import PRICE
from discovery.explain.free_rate import free_rates
from discovery.explain.gauge import explained_by_gauge
from discovery.explain.tension_law import CourseFit, LawSearch
from discovery.localisation.tension import tension_views
from discovery.residual.tension import drifted, frozen_of, noises, read_tensions
from discovery.residual.tension_data import Data, Gained, Misfit, Pair
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.effects import LawChange, Member, ModelCorrection, Reading, SensorFault, candidates
from rom.effects.free_form import FREE_FORM
from rom.identification.identify import Identification
from rom.identification.reduce import Progress
from rom.model.model import Model
from rom.signals.per_record_parameters import per_record_names
from rom.signals.sensor_correction import moves_levels

_FEWEST = 3  # loosening records
_ALLOWED_DRIFT = 0.005  # [N/s]; half the smallest plausible one
_FAST = 8  # about so many numbers tell a record's fast part


@dataclass(frozen=True)
class TensionFindings:
    """What effects explain of the tension, and what the model's own law leaves over of the courses.

    Attributes
    ----------
    explanations : tuple of Explanation
        Those that take most from the training cost first.
    misfit : Misfit
        Mean square of what the law leaves over of the training courses, and where that is.
    """

    explanations: tuple[Explanation, ...]
    misfit: Misfit


_NOTHING = TensionFindings((), Misfit(1.0, 0.0))


def explain_tension(
    campaign: Campaign,
    found: Identification,
    model: Model,
    jobs: int = 1,
    progress: Progress | None = None,
    only: str = "",
) -> TensionFindings:
    """Return what every effect in the tension or its gauge explains that a model does not hold yet.

    Parameters
    ----------
    campaign : Campaign
        As read by `rom.read_campaign`.
    found : Identification
        For the names of the law's numbers that were identified.
    model : Model
        The current model, effects that were accepted in it.
    jobs : int
        Processes for reading records, threads for fits.
    progress : callable
        Called with (effects done, effects in all).
    only : str
        Path of an effect: no other that shows in the courses is fitted then. All are by default.

    Returns
    -------
    TensionFindings
        One explanation for each effect, those that take most from the training cost first; none where the
        model has not one bolted link, or too few training records have a tension and a hit.
    """
    search = _search(campaign, found, model, jobs)
    if search is None:
        return _NOTHING
    held = {effect.path for effect in model.effects}
    effects = [
        (member, effect)
        for member, effect in candidates(model, ["tension"])
        if effect.enters in ("tension", "sensor:tension") and effect.path not in held
        and isinstance(effect, (LawChange, Reading, SensorFault))
    ]  # fmt: skip
    return _explained(search, effects, search.baseline(), progress, only)


def tension_misfit(campaign: Campaign, found: Identification, model: Model, jobs: int = 1) -> Misfit | None:
    """Return what a model's own law leaves over of the training courses; None where nothing is told."""
    search = _search(campaign, found, model, jobs)
    return None if search is None else _viewed(search.baseline())


def explain_freely(
    campaign: Campaign, found: Identification, model: Model, jobs: int = 1, seed: int = 0
) -> TensionFindings:
    """Return what the best sum of terms beside a model's tension law explains: a form found from the courses.

    Parameters
    ----------
    campaign, found, model, jobs
        As for `explain_tension`.
    seed : int
        Of the ensembles of the sparse fits.

    Returns
    -------
    TensionFindings
        One explanation at most: of the sums that explain more than chance, on held-out records too, the one
        of lowest cost with a price for every term. None where the courses are at noise, or the model has a
        free form in its tension already.
    """
    search = _search(campaign, found, model, jobs)
    if search is None:
        return _NOTHING
    base = search.baseline()
    if base.misfit.is_noise or any(isinstance(e, LawChange) and e.name == FREE_FORM for e in model.effects):
        return TensionFindings((), _viewed(base))
    told = _explained(search, free_rates(search.data, seed), base)
    sure = [one for one in told.explanations if _is_told_by_unseen(one)]
    spread = min((spread_of(one) for one in sure), default=1.0)
    sure.sort(key=lambda one: one.cost(hold_out=False) / spread + PRICE * one.free_numbers)
    return replace(told, explanations=tuple(sure[:1]))


def _is_told_by_unseen(one: Explanation) -> bool:
    """Whether held-out records ask for a sum too: of so many sums one suits training records by chance."""
    unseen = one.gains(hold_out=True)
    return is_accepted(one) and (not unseen.size or float(unseen.sum()) / spread_of(one) > PRICE)


def _search(campaign: Campaign, found: Identification, model: Model, jobs: int) -> LawSearch | None:
    """Read the courses; None where there are too few, or none."""
    if len(model.structure.bolted_links) != 1:
        return None
    seen = read_tensions(campaign, model, jobs)
    if sum(s.settings.test == "loosening" and not s.settings.hold_out for s in seen) < _FEWEST:
        return None
    ordered = tuple(sorted(seen, key=lambda s: s.settings.hold_out))
    noise_of = noises(ordered, _ALLOWED_DRIFT)
    if noise_of is None:
        return None
    steady, drifting, drift = noise_of
    drifts = any(isinstance(e, Reading) and per_record_names(e) for e in model.effects)
    noise = drifting if drifts else steady
    data = Data(
        model, ordered, frozen_of(ordered, noise, model), sum(not s.settings.hold_out for s in ordered),
        np.array([s.settings.test == "loosening" for s in ordered]),
    )  # fmt: skip
    free = tuple(found.gamma_fit.free) if found.gamma_fit is not None else ()
    return LawSearch(data, free, drifted(data.frozen, ordered, noise, drifting, drift.mean), drift, jobs)


def _explained(
    search: LawSearch,
    effects: Sequence[Pair],
    base: CourseFit,
    progress: Progress | None = None,
    only: str = "",
) -> TensionFindings:
    data = search.data
    of_course = [pair for pair in effects if _of_course(*pair)]
    slow = [pair for pair in of_course if only in ("", pair[1].path)]
    done = iter(range(1, len(slow) + 1))

    def report() -> None:
        if progress is not None:
            progress(next(done), len(slow))

    by_gauge, fast = explained_by_gauge(data, [pair for pair in effects if pair not in of_course])
    by_course, base = search.explained(slow, base, report)
    return TensionFindings(_explanations(data, [*by_course, *by_gauge], base, fast), _viewed(base))


def _viewed(base: CourseFit) -> Misfit:
    """What a law leaves over of the courses, and where."""
    return replace(base.misfit, views=tension_views(base))


def _explanations(
    data: Data, gained: Sequence[Gained], base: CourseFit, fast: FloatArray
) -> tuple[Explanation, ...]:
    files, training, before = data.files, data.training, base.costs + fast
    count = data.frozen.change.shape[1] + _FAST
    found = [
        Explanation(
            one.effect,
            dict(zip(files, before.tolist(), strict=True)),
            dict(zip(files, (before - one.gains).tolist(), strict=True)),
            dict.fromkeys(files, count),
            frozenset(files[training:]),
            len(one.effect.parameters) - len(per_record_names(one.effect)),
            one.at_bound,
            one.beside,
            base.misfit.level if one.left is None else one.left,
            one.p_value,
            one.slow,
        )
        for one in gained
    ]
    return tuple(sorted(found, key=lambda e: -float(e.gains(hold_out=False).sum())))


def _of_course(member: Member, effect: ModelCorrection) -> bool:
    """Whether an effect shows in the course: a law, a reading at rest, a fault that moves a constant."""
    if isinstance(effect, LawChange):
        return True
    probe = member.at(effect.enters)
    if isinstance(probe, Reading):
        return acts_at_rest(probe)
    assert isinstance(probe, SensorFault)
    return moves_levels(probe)
