"""Whether an effect explains more than chance would, matters, and can be told from others."""

from __future__ import annotations

import numpy as np

from discovery.decide.chance import FALSE_ALARMS
from discovery.decide.explanation import Explanation
from rom.evaluation.error_measures import Errors, ErrorsByKind, Kind

# Least gains in cost on training and on held-out records. On clean campaigns of usual size chance and a plant
# that is not quite the model's make less (`benchmarks.false_alarms`); of training records in the motion not
# always, but then a share of the cost asks for more.
SURELY = 20.0
_OF_MOTION, _OF_TENSION = (150.0, SURELY), (SURELY, 0.0)
MATERIAL = 0.01
"""Share of the cost: less changes nothing that matters."""
QUIET = 1.2
"""Mean square of a residual that still counts as noise."""
ALIKE = 12.0
"""Difference in cost within chance."""
NEAR = 0.05
"""Of the gain: what a slightly wrong form of the right effect may lose."""
_MATTERS, _MATTERS_MORE = 0.02, 0.1  # of an error
_SCATTER = 0.2  # of an error of few records that is noise for the most part
_HARM = 1.5  # times an error
_LEFT = 0.03  # of what was beyond noise
_EXACT = {"motion_nrmse": 0.005, "relative_motion_nrmse": 0.02}  # a dozen samples tell a hit no better


def at_noise_floor(level: float, first: float) -> bool:
    """Whether a mean square is that of noise, or next to nothing of what was ``first`` beyond it."""
    return level - 1 <= max(QUIET - 1, _LEFT * (first - 1))


def is_exact(errors: ErrorsByKind) -> bool:
    """Whether all records are simulated as exactly as their hits are known.

    Quiet sensors show what the samples of a hammer's pulse leave open, which no effect is behind.
    """
    kinds = [of for of in errors.values() if of["records"]]
    told = [(_error(of, name), most) for of in kinds for name, most in _EXACT.items()]
    return (
        errors["training"]["motion_nrmse"] is not None
        and not any(of["failed"] for of in kinds)
        and all(value is None or value < most for value, most in told)
    )


def spread_of(one: Explanation) -> float:
    """Mean square of what an effect leaves over, one at least: misfit makes differences less telling."""
    samples = sum(one.samples[file] for file in one.after if file not in one.hold_out)
    return max(one.cost(hold_out=False) / max(samples, 1) if one.left is None else one.left, 1.0)


def penalised_gain(one: Explanation) -> float:
    """Cost taken away on all records in units of chance, less what free numbers take by themselves."""
    gains = one.gains(hold_out=False).sum() + one.gains(hold_out=True).sum()
    return float(gains / spread_of(one)) - 2 * one.free_numbers


def is_accepted(one: Explanation) -> bool:
    """Whether an effect explains more than any of the catalogue would by chance, on held-out records too.

    One in the motion must not suit a few of these, whose tension may be misread, at the cost of most others.
    """
    if one.p_value is not None and one.p_value > FALSE_ALARMS:
        return False
    unseen = one.gains(hold_out=True)
    if not in_tension(one) and 2 * int(np.sum(unseen > 0)) < unseen.size:
        return False
    return one.share() > MATERIAL and is_significant(one)


def is_significant(one: Explanation) -> bool:
    """Whether an effect gains more than chance makes, however small its share of the cost."""
    trained, held_out = _OF_TENSION if in_tension(one) else _OF_MOTION
    spread, unseen = spread_of(one), one.gains(hold_out=True)
    seen = float(one.gains(hold_out=False).sum())
    return seen / spread > trained and (not unseen.size or float(unseen.sum()) / spread > held_out)


def in_tension(one: Explanation) -> bool:
    """Whether an effect shows in the tension alone."""
    return one.effect.enters in ("tension", "sensor:tension")


def is_alike(one: Explanation, best: Explanation) -> bool:
    """Whether an effect's cost is within chance of the best one's, or of a slightly wrong form of it."""
    spread = spread_of(best)
    held = bool(best.hold_out & set(best.before))
    # few tests that are held out tell anything of the tension: what they cannot tell apart training tests may
    for hold_out in {held, held and not in_tension(best)}:
        gain = best.gains(hold_out=hold_out).sum()
        lag = gain - one.gains(hold_out=hold_out).sum()
        if lag / spread > max(ALIKE, NEAR * gain / spread):
            return False
    return True


def is_material(
    before: ErrorsByKind, after: ErrorsByKind, *, settled: bool = False, closes: bool = False
) -> bool:
    """Whether an effect in the motion lowers an error there that people care for.

    ``settled``: more than noise is left, but next to nothing of what was; a force that is a per cent wrong
    leaves as much, and an effect that only mends another one's form lowers errors a little. ``closes``:
    little of what was beyond noise is left with the effect; no error need fall by much then, and one may
    rise, be it of few records near their noise or because another effect, still missing, makes most of it.
    """
    least = _MATTERS_MORE if settled else 0.0 if closes else _MATTERS
    kind: Kind = "hold_out" if before["hold_out"]["motion_nrmse"] is not None else "training"
    ratios = [
        new / old
        for name in ("motion_nrmse", "relative_motion_nrmse")
        if (old := _error(before[kind], name)) and (new := _error(after[kind], name)) is not None
    ]
    return bool(ratios) and min(ratios) <= 1 - least and max(ratios) <= 1 + (_SCATTER if closes else _MATTERS)


def harms(before: ErrorsByKind, after: ErrorsByKind) -> bool:
    """Whether an effect in the tension makes the model worse where it is simulated on.

    What suits courses each with a rate of its own can still ruin the law that all share. Losses scatter from
    test to test by about a factor of two, so the few that are held out may be met well by chance before: the
    mean over training and held-out records counts, and may rise a little; none may be lost.
    """
    if any(after[kind]["failed"] > before[kind]["failed"] for kind in before):
        return True
    return any(_risen(before, after, name) > _HARM for name in ("tension_rmse_n", "motion_nrmse"))


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
