"""What readings of the catalogue explain of the tension of bolts that were watched at rest.

One record alone cannot tell a creep from a tension, or a gauge, that wanders by chance. So costs are
-2 ln L beside noise that holds a wander as large as the records ask for, with the effect and without:

    G = min_c L(c) - min_(c, theta) L(c, theta)

and chance is drawn: lines of noise with that wander, and what the best of the catalogue takes from them.
Ranges of the effects are those of the campaign: a reading may be as large as the tension, a time as short as
a sample and as long as ten records.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from discovery.courses.tension_likelihood import acts_at_rest
from discovery.decide.chance import p_value
from discovery.decide.explanation import Explanation
from discovery.explain.probes import Probe, reach
from discovery.explain.rest_fit import fitted
from discovery.options import Options
from discovery.residual.at_rest import RestResidual
from discovery.residual.gauge_noise import deviances, drawn_lines, wander_of
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import CATALOGUE, Member, ModelCorrection
from rom.model.laws import Parameter
from rom.progress import counted

_WANDERS: Numerical[FloatArray] = np.concatenate([[0.0], np.geomspace(0.03, 30.0, 10)])
_STARTS: Numerical[int] = 2
_SEED: Numerical[int] = 0
_PROBE: Numerical[float] = 1e-3  # of the largest strength
_AT_BOUND: Numerical[float] = 1e-6
_TINY: Numerical[float] = 1e-300
BASIS = "what the slow tension has beyond noise that wanders"


def explain(residual: RestResidual, options: Options) -> list[Explanation]:
    """Return what every reading that shows at rest explains.

    Parameters
    ----------
    residual : RestResidual
        Of the model so far.
    options : Options
        Progress and criteria.
    """
    return explain_screened(screen(residual, options), residual, options)


def screen(residual: RestResidual, options: Options) -> tuple[tuple[Probe, ...], ...]:
    """Try every reading that shows at rest over a grid of its inner numbers; the best first.

    Parameters
    ----------
    residual : RestResidual
        Of the model so far.
    options : Options
        Progress and criteria.

    Returns
    -------
    tuple of tuple of Probe
        Probes of every effect, best first.
    """
    held, found = {effect.path for effect in residual.effects}, []
    members = [member for member in CATALOGUE.values() if shows_at_rest(member)]
    progress = options.stage("screening effects")
    for member in counted(members, len(members), progress):
        effect = at_campaign(member, residual)
        if effect.path not in held:
            probes = [_probed(member, one, residual) for one in _grid(member, effect, residual)]
            found.append(tuple(sorted(probes, key=lambda probe: -probe.gain)))
    return tuple(sorted(found, key=lambda probes: -probes[0].gain))


def shows_at_rest(member: Member) -> bool:
    """Whether it is a reading that adds something while nothing moves."""
    return member.kind == "measured tension" and acts_at_rest(member.at("tension"))


def at_campaign(member: Member, residual: RestResidual) -> ModelCorrection:
    """Return a reading with the ranges of a campaign, by the units of its numbers.

    Parameters
    ----------
    member : Member
        Of the catalogue.
    residual : RestResidual
        Whose training records have tensions, lengths and intervals between samples.
    """
    train = [record for record in residual.records if not record.settings.hold_out]
    tension = max(abs(record.tension) for record in train) or 1.0
    longest = max(record.duration_s for record in train)
    rules = residual.criteria.at_rest
    seconds = (rules.shortest_time * min(r.step_s for r in train), rules.longest_time * longest)
    most = {"N": tension, "N/s": tension / longest}
    numbers: dict[str, Parameter] = {}
    for name, number in member.parameters.items():
        low, high = number.bounds
        if number.unit in most:
            low, high = (np.sign(bound) * most[number.unit] for bound in (low, high))
        elif number.unit == "s":
            low, high = seconds
        value = float(np.clip(number.value, low, high))
        numbers[name] = replace(number, value=value, bounds=(float(low), float(high)))
    return member.at("tension", numbers)


def _grid(member: Member, effect: ModelCorrection, residual: RestResidual) -> Iterator[ModelCorrection]:
    """The effect at small strengths, one at a time, over time constants and the member's grid."""
    times = int(residual.criteria.at_rest.times)
    none = effect.with_values(**dict.fromkeys(member.strengths, 0.0))
    inner = {
        name: np.geomspace(*number.bounds, times)
        if number.unit == "s"
        else member.inner.get(name, (number.value,))
        for name, number in effect.parameters.items()
        if name not in member.strengths
    }
    for strength in member.strengths:
        size = _PROBE * effect.parameters[strength].bounds[1]
        for point in product(*inner.values()):
            values = {name: float(value) for name, value in zip(inner, point, strict=True)}
            yield none.with_values(**{strength: size}, **values)


def _probed(member: Member, probe: ModelCorrection, residual: RestResidual) -> Probe:
    output = _output(probe, residual)
    along, size = float(output @ residual.beyond(residual.residual)), float(output @ output)
    amplitude = float(np.clip(along / size, *reach(member, probe))) if size > 0 else 0.0
    return Probe(member, probe, amplitude * (2 * along - amplitude * size), amplitude, 1.0)


def _output(reading: ModelCorrection, residual: RestResidual) -> FloatArray:
    """Training rows of a reading over the gauge's noise."""
    lines = residual.rows([record.of(reading) for record in residual.records])
    return residual.beyond(lines / residual.sizes)


def explain_screened(
    probes: Sequence[Sequence[Probe]], residual: RestResidual, options: Options
) -> list[Explanation]:
    """Fit every effect of a screen from its best probes, all numbers of the others beside it.

    Parameters
    ----------
    probes : sequence of sequence of Probe
        From `screen`.
    residual : RestResidual
        Of the model so far.
    options : Options
        Progress and criteria.

    Returns
    -------
    list of Explanation
        Each with the residual beside it.
    """
    if not probes:
        return []
    found, progress = [], options.stage("fitting effects")
    gains, drawn = by_chance_at_rest(probes, residual, options)
    for place, ones in enumerate(counted(probes, len(probes), progress)):
        fits = [fitted(residual, (*residual.effects, one.start)) for one in ones[:_STARTS]]
        after = min(fits, key=lambda fit: _training_cost(fit, residual))
        explained = explanation(after.effects[-1], residual, after)
        found.append(replace(explained, p_value=p_value(gains[place], drawn), residual=after))
    return found


def _training_cost(fit: RestResidual, before: RestResidual) -> float:
    return sum(cost for file, cost in fit.deviances(before).items() if file not in fit.hold_out)


def explanation(effect: ModelCorrection, before: RestResidual, after: RestResidual) -> Explanation:
    """Costs of all records with an effect and without.

    Parameters
    ----------
    effect : ModelCorrection
        With its fitted numbers.
    before, after : RestResidual
        Without it and with it, all other numbers fitted.

    Returns
    -------
    Explanation
        Costs by record, and the numbers that lie at an end of their range.
    """
    free = [name for name, number in effect.parameters.items() if number.bounds[0] < number.bounds[1]]
    return Explanation(
        effect=effect,
        before=before.deviances(after),
        after=after.deviances(after),
        samples=after.samples,
        hold_out=after.hold_out,
        free_numbers=len(free),
        at_bound=tuple(name for name in free if _is_at_bound(effect.parameters[name])),
        left=1.0,  # the wander in the noise allows for the rest
        basis=BASIS,
    )


def _is_at_bound(number: Parameter) -> bool:
    low, high = number.bounds
    return bool(min(number.value - low, high - number.value) <= _AT_BOUND * abs(number.value))


def by_chance_at_rest(
    probes: Sequence[Sequence[Probe]], residual: RestResidual, options: Options
) -> tuple[list[float], FloatArray]:
    """Return the gain of every effect's best probe, and the largest of any in noise that wanders, (draws,).

    Parameters
    ----------
    probes : sequence of sequence of Probe
        From `screen`.
    residual : RestResidual
        Of the model so far.
    options : Options
        For the number of draws.
    """
    mine = residual.training
    noise, whole = (residual.rows(of)[mine] for of in (residual.noise, residual.variances))
    drawn = drawn_lines([whole / noise], options.criteria.chance.draws, _SEED)
    rows = np.column_stack([residual.residual[mine], drawn])
    shapes = residual.rows([record.wander for record in residual.records])[mine] / noise
    scale = wander_of(rows[:, 0] ** 2, shapes) or 1 / float(shapes.max())
    lowest = np.full(rows.shape[1], np.inf)
    best = np.full((len(probes), rows.shape[1]), np.inf)
    outputs = [np.stack([_output(one.effect, residual) for one in ones]) for ones in probes]
    for wander in scale * _WANDERS:
        variances = 1 + wander * shapes
        cost = deviances(rows**2, variances[:, None]).sum(axis=0)
        lowest = np.minimum(lowest, cost)
        for place, output in enumerate(outputs):
            along, size = (output / variances) @ rows, ((output**2) / variances).sum(axis=1)
            gain = along**2 / np.maximum(size, _TINY)[:, None]
            best[place] = np.minimum(best[place], cost - gain.max(axis=0))
    gains = lowest - best
    return gains[:, 0].tolist(), gains[:, 1:].max(axis=0)
