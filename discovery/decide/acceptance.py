"""Whether an effect explains more than chance would, matters, and can be told from others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.explanation import Explanation
from rom.criteria.number import Numerical
from rom.evaluation.error_measures import Errors, ErrorsByKind, Kind

_KNOWN: Numerical[float] = 1e9  # degrees of freedom: next to no chance is left

OVER_NOISE = "motion_over_noise"
"""Name of an error of the motion as it is measured; the others of the motion are of displacements."""

MaterialErrors = Sequence[Mapping[str, float | None]]
"""Errors by name, one mapping a kind of record: of the first kind that has any are two models compared."""


def at_noise_floor(level: float, first: float, criteria: Criteria = CRITERIA, by_chance: float = 1.0) -> bool:
    """Whether a mean square is that of noise, or next to nothing of what was ``first`` beyond it.

        level - 1 <= max(noise_level - 1, by_chance - 1, explained_remainder (first - 1))

    Parameters
    ----------
    level, first : float
        Mean squares of the whitened residual with the effects and without; 1 is noise.
    criteria : Criteria
        The numbers that decide.
    by_chance : float
        What noise alone leaves at times, where the mean is of few rows.

    Returns
    -------
    bool
        True for noise, or next to nothing of the first residual.
    """
    rules = criteria.acceptance
    most = max(rules.noise_level, by_chance) - 1
    return level - 1 <= max(most, rules.explained_remainder * (first - 1))


def closes(before: float, after: float, criteria: Criteria = CRITERIA, by_chance: float = 1.0) -> bool:
    """Whether little of what was beyond noise is left, or what noise alone leaves of so few rows at times.

    Parameters
    ----------
    before, after : float
        Mean squares of the whitened residual without an effect and with it; 1 is noise.
    criteria, by_chance
        As for `at_noise_floor`.
    """
    return after - 1 <= max(criteria.closing.closing_share * (before - 1), by_chance - 1)


def noise_by_chance(rows: int, freedom: float, criteria: Criteria = CRITERIA) -> float:
    """Mean square that noise alone leaves of rows at times: an upper quantile of F.

    Parameters
    ----------
    rows : int
        Whitened numbers.
    freedom : float
        Degrees of freedom to which their noise is known.
    criteria : Criteria
        The numbers that decide.
    """
    return float(stats.f.isf(criteria.tension.misfit_chance, rows, min(freedom, _KNOWN)))


def is_exact(errors: ErrorsByKind, criteria: Criteria = CRITERIA) -> bool:
    """Whether all records are simulated as exactly as their hits are known.

    Quiet sensors show what the samples of a hammer's pulse leave open, which no effect is behind.
    """
    rules = criteria.acceptance
    limits = {"motion_nrmse": rules.exact_motion, "relative_motion_nrmse": rules.exact_relative_motion}
    kinds = [of for of in errors.values() if of["records"]]
    compared = [(_error(of, name), most) for of in kinds for name, most in limits.items()]
    return (
        errors["training"]["motion_nrmse"] is not None
        and not any(of["failed"] for of in kinds)
        and all(value is None or value < most for value, most in compared)
    )


def spread_of(one: Explanation) -> float:
    """Mean square of what an effect leaves over, one at least: misfit makes differences less telling."""
    samples = sum(one.samples[file] for file in one.after if file not in one.hold_out)
    return max(one.cost(hold_out=False) / max(samples, 1) if one.left is None else one.left, 1.0)


def penalised_gain(one: Explanation) -> float:
    """Cost taken away on all records in units of chance, less what free numbers take by themselves."""
    gains = one.gains(hold_out=False).sum() + one.gains(hold_out=True).sum()
    return float(gains / spread_of(one)) - 2 * one.free_numbers


def is_accepted(one: Explanation, criteria: Criteria = CRITERIA) -> bool:
    """Whether an effect explains more than any of the catalogue would by chance, on held-out records too.

    One in the motion must not suit a few of these, whose tension may be misread, at the cost of most others.
    """
    if one.p_value is not None and one.p_value > criteria.chance.false_alarms:
        return False
    unseen = one.gains(hold_out=True)
    if not in_tension(one) and 2 * int(np.sum(unseen > 0)) < unseen.size:
        return False
    return one.share() > criteria.acceptance.material_share and is_significant(one, criteria)


def is_significant(one: Explanation, criteria: Criteria = CRITERIA) -> bool:
    """Whether an effect gains more than chance makes, however small its share of the cost."""
    rules = criteria.acceptance
    trained, held_out = (
        (rules.training_gain_tension, rules.hold_out_gain_tension)
        if in_tension(one)
        else (rules.training_gain_motion, rules.hold_out_gain_motion)
    )
    spread, unseen = spread_of(one), one.gains(hold_out=True)
    seen = float(one.gains(hold_out=False).sum())
    return seen / spread > trained and (not unseen.size or float(unseen.sum()) / spread > held_out)


def in_tension(one: Explanation) -> bool:
    """Whether an effect shows in the tension alone."""
    return one.effect.enters in ("tension", "sensor:tension")


def is_indistinguishable(one: Explanation, best: Explanation, criteria: Criteria = CRITERIA) -> bool:
    """Whether an effect's cost is within chance of the best one's, or of a slightly wrong form of it.

    Parameters
    ----------
    one : Explanation
        The effect that is asked about.
    best : Explanation
        The effect that explains most.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    bool
        True where both cost about the same, on training records too for effects in the tension.
    """
    rules, spread = criteria.acceptance, spread_of(best)
    held = bool(best.hold_out & set(best.before))
    # few tests that are held out tell anything of the tension: what they cannot tell apart training tests may
    for hold_out in {held, held and not in_tension(best)}:
        gain = best.gains(hold_out=hold_out).sum()
        lag = gain - one.gains(hold_out=hold_out).sum()
        if lag / spread > max(rules.indistinguishable_cost, rules.indistinguishable_share * gain / spread):
            return False
    return True


def is_material(
    before: MaterialErrors,
    after: MaterialErrors,
    *,
    least: float | None = None,
    closes: bool = False,
    criteria: Criteria = CRITERIA,
) -> bool:
    """Whether an effect in the motion lowers an error there that people care for.

        min(after / before) <= 1 - least,  max(after / before) <= 1 + rise

    Parameters
    ----------
    before, after : sequence of mapping of str to float or None
        Errors of the motion or of the forces by name, on hold-out records first. Of the first kind that has
        any before are they compared; where none of its records can be simulated after, nothing is lowered.
    least : float or None
        Share by which an error must fall, where that is not the usual one: more than noise is left, but next
        to nothing of what was; a force that is a per cent wrong leaves as much, and an effect that only mends
        another one's form lowers errors a little.
    closes : bool
        Little of what was beyond noise is left with the effect; no error need fall by much then, and where
        one of displacements falls another may rise, be it of few records near their noise or because
        another effect, still missing, makes most of it.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    bool
        False where no error is known on either side.
    """
    rules = criteria.acceptance
    least = (0.0 if closes else rules.material_error) if least is None else least
    known = (pair for pair in zip(before, after, strict=True) if any(pair[0].values()))
    was, now = next(known, ({}, {}))
    ratios = {name: new / old for name, old in was.items() if old and (new := now[name]) is not None}
    falls = any(ratio <= 1 for name, ratio in ratios.items() if name != OVER_NOISE)
    rise = rules.error_rise_closing if closes and falls else rules.material_error
    return bool(ratios) and min(ratios.values()) <= 1 - least and max(ratios.values()) <= 1 + rise


def motion_errors(errors: ErrorsByKind) -> MaterialErrors:
    """Errors of the motion that an effect there has to lower, of hold-out and of training records."""
    kinds: tuple[Kind, ...] = ("hold_out", "training")
    names = ("motion_nrmse", "relative_motion_nrmse")
    return tuple({name: _error(errors[kind], name) for name in names} for kind in kinds)


def meets_worse(before: Errors, after: Errors) -> bool:
    """Whether the motion of some records is simulated worse with an effect than without, or not any more."""
    if after["failed"] > before["failed"]:
        return True
    old, new = before["motion_nrmse"], after["motion_nrmse"]
    return old is not None and (new is None or new > old)


def harms(before: ErrorsByKind, after: ErrorsByKind, criteria: Criteria = CRITERIA) -> bool:
    """Whether an effect in the tension makes the model worse where it is simulated on.

    What suits courses each with a rate of its own can still ruin the law that all share. Losses scatter from
    test to test by about a factor of two, so the few that are held out may be met well by chance before: the
    mean over training and held-out records counts, and may rise a little; none may be lost.

    Parameters
    ----------
    before, after : mapping of str to Errors
        Errors by kind of record, without the effect and with it.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    bool
        True where more records fail, or a mean error rises by more than the factor allowed.
    """
    if any(after[kind]["failed"] > before[kind]["failed"] for kind in before):
        return True
    names = ("tension_rmse_n", "motion_nrmse")
    return any(_risen(before, after, name) > criteria.acceptance.harm for name in names)


def _risen(before: ErrorsByKind, after: ErrorsByKind, name: str) -> float:
    """A mean error of all records in what it was before; infinite where a kind has none any more."""
    old, new = 0.0, 0.0
    for kind, errors in before.items():
        was, now = _error(errors, name), _error(after[kind], name)
        if was is not None:
            old += errors["records"] * was
            new += errors["records"] * (np.inf if now is None else now)
    return new / old if old > 0 else 0.0


def _error(errors: Errors, name: str) -> float | None:
    value = errors[name]  # type: ignore[literal-required]
    return None if value is None else float(value)
