"""What effects in the tension and in its gauge explain: every one of the catalogue, beside the refitted law.

Slow part: the course of the tension after each hit under a law, its case-to-case scatter integrated out
(``discovery.explain.tension_law``). Fast part: what the gauge shows in phase with the motion, late, or at a
line (``discovery.explain.strain_gauge``). The cost of a record is the sum of both, the same before for all
effects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count

from discovery.courses.tension_likelihood import acts_at_rest
from discovery.decide.explanation import Explanation
from discovery.explain.strain_gauge import explained_by_gauge
from discovery.explain.tension_gain import Pair, TensionGain
from discovery.explain.tension_law import LawSearch
from discovery.options import Options
from discovery.residual.course_fit import CourseFit, Misfit
from discovery.residual.tension import TensionResidual
from discovery.residual.tension_data import TensionData
from rom.campaign.channels import FloatArray
from rom.effects import Member, ModelCorrection, SensorFault, candidates
from rom.signals.per_record_parameters import per_record_names
from rom.signals.sensor_correction import moves_levels


@dataclass(frozen=True)
class TensionFindings:
    """What effects explain of the tension, and what the model's own law leaves over of the courses.

    Attributes
    ----------
    explanations : tuple of Explanation
        Those that take most from the training cost first.
    misfit : Misfit
        Of the law alone: that of the residual, or less where a fit beside an effect led to a better one.
    """

    explanations: tuple[Explanation, ...]
    misfit: Misfit


def explain(residual: TensionResidual, options: Options) -> tuple[Explanation, ...]:
    """Return what every effect in the tension or its gauge explains that a model does not hold yet.

    Parameters
    ----------
    residual : TensionResidual
        The measured tension, and the model.
    options : Options
        Threads; its stage "tension" is called with (effects done, effects in all).

    Returns
    -------
    tuple of Explanation
        One for each effect, those that take most from the training cost first; none where the residual holds
        no data.
    """
    return findings(residual, options).explanations


def explain_one(residual: TensionResidual, options: Options, path: str) -> Explanation | None:
    """Return what one effect explains; None where the residual tells nothing of it.

    Parameters
    ----------
    residual : TensionResidual
        The measured tension, and the model.
    options : Options
        As for `explain`.
    path : str
        Path of the effect.

    Returns
    -------
    Explanation or None
        Of the effect with this path.
    """
    return next((e for e in findings(residual, options, path).explanations if e.effect.path == path), None)


def findings(residual: TensionResidual, options: Options, path: str = "") -> TensionFindings:
    """Return the explanations, and the misfit of the law alone that they were compared with.

    Parameters
    ----------
    residual : TensionResidual
        The measured tension, and the model.
    options : Options
        As for `explain`.
    path : str
        Of an effect: no other that shows in the courses is fitted then. All are by default.

    Returns
    -------
    TensionFindings
        Without explanations where the residual holds no data.
    """
    effects = candidates_in_tension(residual)
    fast = [pair for pair in effects if not in_course(*pair)]
    slow = [pair for pair in effects if in_course(*pair) and path in ("", pair[1].path)]
    return compared(residual, slow, fast, options)


def candidates_in_tension(residual: TensionResidual) -> list[Pair]:
    """Effects in the tension or its gauge that a model does not hold yet."""
    held = {effect.path for effect in residual.model.effects}
    return [
        (member, effect)
        for member, effect in candidates(residual.model, ["tension"])
        if effect.enters in ("tension", "sensor:tension") and effect.path not in held
        and effect.kind != "force"
    ]  # fmt: skip


def compared(
    residual: TensionResidual, slow: Sequence[Pair], fast: Sequence[Pair], options: Options
) -> TensionFindings:
    """Fit effects beside the law, and compare each with the law alone.

    Parameters
    ----------
    residual : TensionResidual
        The measured tension, and the model.
    slow, fast : sequence of (Member, ModelCorrection)
        Effects that show in the courses, and those that show in the fast part alone.
    options : Options
        As for `explain`.

    Returns
    -------
    TensionFindings
        Without explanations where the residual holds no data.
    """
    data, base = residual.data, residual.baseline
    if data is None or base is None:
        return TensionFindings((), residual.misfit)
    by_gauge, fast_cost = explained_by_gauge(data, fast)
    by_course, base = LawSearch(data, options.jobs).explained(slow, base, _report(options, len(slow)))
    return TensionFindings(_explanations(data, [*by_course, *by_gauge], base, fast_cost), base.misfit)


def _report(options: Options, whole: int) -> Callable[[], None]:
    """What is called after every effect."""
    progress, done = options.stage("tension"), count()

    def report() -> None:
        if progress is not None:
            progress(next(done), whole)

    report()
    return report


def _explanations(
    data: TensionData, gained: Sequence[TensionGain], base: CourseFit, fast: FloatArray
) -> tuple[Explanation, ...]:
    files, training, before = data.files, data.training, base.costs + fast
    samples = data.frozen.change.shape[1] + int(data.criteria.fast_numbers)
    found = [
        Explanation(
            effect=gain.effect,
            before=dict(zip(files, before.tolist(), strict=True)),
            after=dict(zip(files, (before - gain.gains).tolist(), strict=True)),
            samples=dict.fromkeys(files, samples),
            hold_out=frozenset(files[training:]),
            free_numbers=len(gain.effect.parameters) - len(per_record_names(gain.effect)),
            at_bound=gain.at_bound,
            beside=gain.beside,
            left=base.misfit.level if gain.left is None else gain.left,
            p_value=gain.p_value,
            slow=gain.slow,
        )
        for gain in gained
    ]
    return tuple(sorted(found, key=lambda e: -float(e.gains(hold_out=False).sum())))


def in_course(member: Member, effect: ModelCorrection) -> bool:
    """Whether an effect shows in the course: a law, a reading at rest, a fault that moves a constant."""
    if effect.kind == "law change":
        return True
    probe = member.at(effect.enters)
    return moves_levels(probe) if isinstance(probe, SensorFault) else acts_at_rest(probe)
