"""Effects at small strengths, what they could explain of a residual, and which of them are worth a fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import delayed

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.chance import by_record, largest_by_chance, p_value
from discovery.decide.explanation import Explanation
from discovery.options import Options
from discovery.residual.base import ProjectedResidual, cost
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, ModelCorrection, look_alikes
from rom.progress import counted

_IMITATED: Numerical[float] = 1e-12  # share of an output that is left beyond the model's numbers: rounding
LARGEST: Numerical[float] = 1e150  # times noise; the square of much more is no number


@dataclass(frozen=True, eq=False)
class Probe:
    """An effect at a small strength, and how much of the residual it explains at its best strength.

    `gain` is the cost taken away from the training records, `amplitude` the best multiple of the probe's
    strength, `kept` the share of its output that no number of the model can imitate, `scores` what each
    record tells of it (`discovery.decide.chance`).
    """

    member: Member
    effect: ModelCorrection
    gain: float
    amplitude: float
    kept: float
    scores: FloatArray | None = None

    @property
    def start(self) -> ModelCorrection:
        """The effect at the strength that suits it, within its range; a slider slips where the probe did."""
        return scaled(self.member, self.effect, self.amplitude)

    def of_more(self, factor: float) -> Probe:
        """The same share of a cost that is so many times as large."""
        scores = None if self.scores is None else np.sqrt(factor) * self.scores
        return replace(self, gain=factor * self.gain, scores=scores)


def scaled(member: Member, effect: ModelCorrection, factor: float) -> ModelCorrection:
    """The effect with a force as many times as large, within its range; a slider slips where it did.

    Parameters
    ----------
    member : Member
        With the names of its strengths and limits.
    effect : ModelCorrection
        With values.
    factor : float
        What these are multiplied by.
    """
    names = (*member.strengths, *member.limits)
    return cut_to_bounds(effect, {name: factor * effect.parameters[name].value for name in names})


def cut_to_bounds(effect: ModelCorrection, values: Mapping[str, float]) -> ModelCorrection:
    """The effect with values cut to their bounds."""
    return effect.with_values(
        **{name: float(np.clip(value, *effect.parameters[name].bounds)) for name, value in values.items()}
    )


def reach(member: Member, probe: ModelCorrection) -> tuple[float, float]:
    """Multiples of a probe's strength that its range allows."""
    numbers = [probe.parameters[name] for name in member.strengths if probe.parameters[name].value]
    ends = [sorted(bound / number.value for bound in number.bounds) for number in numbers]
    return max(low for low, _ in ends), min(high for _, high in ends)


def probed(
    member: Member,
    effect: ModelCorrection,
    beyond: FloatArray,
    left: FloatArray,
    whole: float,
    scores: FloatArray | None = None,
    within: tuple[float, float] | None = None,
) -> Probe:
    """Return the probe of an effect at a small strength.

    Parameters
    ----------
    member : Member
        What the catalogue says of it.
    effect : ModelCorrection
        At a small strength.
    beyond, left : ndarray, shape (training rows,)
        What of its output, and of the residual, no number of the model can imitate.
    whole : float
        Square of its output.
    scores : ndarray, shape (records,), optional
        What each record tells of it.
    within : tuple of float, optional
        Multiples of its strength that are allowed; by its range if not given.
    """
    size, along = float(beyond @ beyond), float(beyond @ left)
    amplitude = float(np.clip(along / size, *(within or reach(member, effect))))
    gain = amplitude * (2 * along - amplitude * size)
    return Probe(member, effect, gain, amplitude, float(np.sqrt(size / whole)), scores)


def probed_in_pieces(
    member: Member,
    effect: ModelCorrection,
    output: FloatArray,
    residual: ProjectedResidual,
    left: FloatArray,
    within: tuple[float, float] | None = None,
) -> Probe | None:
    """Return the probe of an effect in few, long records; None where the model's numbers imitate it, or where
    its output is too large for its square.

    Parameters
    ----------
    member, effect, left, within
        As for `probed`.
    output : ndarray, shape (rows,)
        Of the effect, whitened.
    residual : ProjectedResidual
        Of the model so far.
    """
    if np.abs(output).max(initial=0.0) > LARGEST:
        return None
    beyond, mine = residual.beyond(output), output[residual.training]
    whole = float(mine @ mine)
    if not float(beyond @ beyond) > _IMITATED * whole:
        return None
    scores = by_record(beyond, left, residual.pieces, int(residual.pieces.max(initial=0)) + 1)
    return probed(member, effect, beyond, left, whole, scores, within)


def by_chance(probes: Sequence[Sequence[Probe]], criteria: Criteria = CRITERIA) -> FloatArray | None:
    """The largest gain of any effect of a screen under draws of the records' signs, (draws,).

    Over effects that a rough screen left out too it was the same on three campaigns. None where there are too
    few records for their signs to tell anything.
    """
    scores = [one.scores for ones in probes for one in ones if one.scores is not None]
    if not scores or len(scores[0]) < criteria.chance.fewest_pieces:
        return None
    return largest_by_chance(np.stack(scores), criteria)


def promising(
    probes: Sequence[Sequence[Probe]], left: float, largest: FloatArray | None, criteria: Criteria = CRITERIA
) -> list[Sequence[Probe]]:
    """The first effects of a screen, special cases of them, and what shares a class and place with the first.

    Not those that explain next to nothing of what is left, or far less than the first; none where chance
    explains as much as the first.

    Parameters
    ----------
    probes : sequence
        From `screen`.
    left : float
        Cost of the residual, the model's numbers taken off.
    largest : ndarray, shape (draws,), or None
        From `by_chance`.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    list
        Probes of the effects to fit.
    """
    near, most = _in_reach(probes, left, largest, criteria), int(criteria.screening.fitted_effects)
    if not near:
        return []
    first = near[0][0]
    alike = look_alikes(first.effect.name)

    def in_class(one: Sequence[Probe]) -> bool:
        return one[0].effect.name in alike and one[0].effect.enters == first.effect.enters

    special = {(name, one[0].effect.enters) for one in near[:most] for name in one[0].member.contains}

    def is_special(one: Sequence[Probe]) -> bool:
        return (one[0].effect.name, one[0].effect.enters) in special

    return [*near[:most], *(one for one in near[most:] if in_class(one) or is_special(one))]


def _in_reach(
    probes: Sequence[Sequence[Probe]], left: float, largest: FloatArray | None, criteria: Criteria
) -> list[Sequence[Probe]]:
    """Effects that do not explain next to nothing of what is left, or far less than the first."""
    rules = criteria.screening
    least = rules.least_share * criteria.acceptance.material_share * left
    first = probes[0][0] if probes else None
    if first is None or first.gain < least:
        return []
    if largest is not None and p_value(first.gain, largest) > criteria.chance.false_alarms:
        return []  # none could be accepted: the chance of each is that of its best probe
    return [one for one in probes if one[0].gain >= max(rules.share_of_first * first.gain, least)]


def fit_promising(
    probes: Sequence[Sequence[Probe]],
    residual: ProjectedResidual,
    options: Options,
    fit: Callable[[Sequence[Probe]], Explanation | None],
) -> list[Explanation]:
    """Fit what a screen promises, effects side by side; the chance of each is that of its best probe.

    A coarse grid of shapes tells where an effect enters better than which one it is. So where the best fit
    leaves more than noise, the other effects at its place that promise as much as a fit needs are fitted too.

    Parameters
    ----------
    probes : sequence of sequences of Probe
        From a screen.
    residual : ProjectedResidual
        Of the model so far.
    options : Options
        Progress and criteria.
    fit : callable
        From the probes of an effect to what it explains; None where it is no effect.
    """
    largest, criteria = by_chance(probes, options.criteria), options.criteria
    left, tell = cost(residual), options.stage("fitting effects")

    def fits(chosen: Sequence[Sequence[Probe]]) -> Iterator[Explanation]:
        each = side_by_side(options.jobs)(delayed(fit)(ones) for ones in chosen)
        for ones, explained in zip(chosen, counted(each, len(chosen), tell), strict=True):
            if explained is not None:
                p = None if largest is None else p_value(ones[0].gain, largest)
                yield replace(explained, p_value=p)

    chosen = promising(probes, left, largest, criteria)
    found = list(fits(chosen))
    best = min(found, key=lambda one: one.cost(hold_out=False), default=None)
    noise = criteria.acceptance.noise_level * float(residual.training.sum())
    if best is None or best.cost(hold_out=False) <= noise:
        return found
    others = (one for one in _in_reach(probes, left, largest, criteria) if one not in chosen)
    return [*found, *fits([one for one in others if one[0].effect.enters == best.effect.enters])]
