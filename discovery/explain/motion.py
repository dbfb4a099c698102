"""Which missing effect explains a residual of the motion: a quick screen of the catalogue, then joint fits.

An effect is fitted beside all numbers of the declared model, most of which it resembles: what those explain
is taken off its output and off the residual first (variable projection; G. Golub and V. Pereyra, SIAM J.
Numer. Anal. 10, 413, 1973). Numbers come from training records; costs are told for held-out ones too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
from joblib import delayed

from discovery.decide.chance import by_record, p_value
from discovery.decide.explanation import Explanation, limited, standard_errors
from discovery.explain.effect_outputs import output_of, outputs_of, slopes_of
from discovery.explain.probes import Probe, by_chance, cut_to_bounds, probed, promising
from discovery.explain.scales import OF_GROUND, OF_JOINT, Scale, at_scale, scale_along
from discovery.options import Options
from discovery.residual.output_error import WhitenedResidual
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Effect, Member, ModelCorrection, candidates, places
from rom.progress import Progress, counted
from rom.signals.per_record_parameters import per_record_names

_ITERATIONS: Numerical[int] = 12
_AT_ONCE: Numerical[int] = 16  # probes
_SETTLED: Numerical[float] = 1e-4  # of the cost


def motion_channels(residual: WhitenedResidual) -> tuple[str, ...]:
    """Names of the force and motion channels that the records hold."""
    names: dict[str, None] = {}
    for trace in residual.traces:
        names |= {f"force_{body}": None for body in trace.measurement.force}
        names |= {f"{motion.kind}_{body}": None for body, motion in trace.measurement.motion.items()}
    return tuple(names)


def explain(residual: WhitenedResidual, options: Options) -> list[Explanation]:
    """Return what the effects that a screen promises explain of the motion.

    Parameters
    ----------
    residual : WhitenedResidual
        Of the model so far.
    options : Options
        Threads, progress and criteria.
    """
    return explain_screened(screen(residual, options), residual, options)


def screen(residual: WhitenedResidual, options: Options) -> tuple[tuple[Probe, ...], ...]:
    """Try every effect of the catalogue at every place at small strengths; each effect's probes, best first.

    On some training records first, then the best of them on all. Effects are ordered by what their best probe
    explains.
    """
    residual = residual.of_training()
    there = [
        (member, member.probes(effect))
        for member, effect in candidates_in_motion(residual)
        if not per_record_names(effect)  # those show before the hits
    ]
    jobs, tell, rules = options.jobs, options.stage("screening effects"), residual.criteria.screening
    rough = _probed_all(there, residual.of(telling(residual)), jobs, tell)
    least = rules.rough_share * rough[0][0].gain if rough else 0.0
    best = [
        (probes[0].member, [probe.effect for probe in probes[: int(rules.rough_probes)]])
        for place, probes in enumerate(rough)
        if place < rules.rough_effects or probes[0].gain > least
    ]
    return _probed_all(best, residual, jobs, None)


def candidates_in_motion(residual: WhitenedResidual) -> list[tuple[Member, ModelCorrection]]:
    """Forces and faults of sensors in the motion that a model does not hold yet."""
    model = residual.baseline.model
    known = {(effect.name, effect.enters) for effect in model.effects}
    unusual = unusual_scales(residual)
    return [
        (member, _at_scale(member, effect, unusual, residual))
        for member, effect in candidates(model, motion_channels(residual))
        if member.kind in ("force", "sensor")
        and effect.enters != "sensor:tension"
        and (effect.name, effect.enters) not in known
    ]


def unusual_scales(residual: WhitenedResidual) -> dict[str, Scale]:
    """Scales of the places that move far more or less than the catalogue's."""
    model, most = residual.baseline.model, residual.criteria.tension.usual_sizes
    found = {}
    for enters, kind in places(model).items():
        scale = scale_along(residual.traces, model, enters)
        if scale is not None and not scale.is_near(OF_JOINT if kind == "joint" else OF_GROUND, most):
            found[enters] = scale
    return found


def _at_scale(
    member: Member, effect: ModelCorrection, unusual: Mapping[str, Scale], residual: WhitenedResidual
) -> ModelCorrection:
    if not isinstance(effect, Effect) or member.kind != "force" or effect.enters not in unusual:
        return effect
    ground = places(residual.baseline.model)[effect.enters] != "joint"
    scale, rules = unusual[effect.enters], residual.criteria.tension
    pressed = effect.enters in residual.baseline.model.structure.bolted_links
    return at_scale(member, effect, scale, ground=ground, pressed=pressed, criteria=rules)


def telling(residual: WhitenedResidual) -> list[int]:
    """Places of some records: those that most is left over of, and a few of all."""
    costs = np.array(list(residual.costs(residual.left_over(residual.residual)).values()))
    every = max(round(1 / residual.criteria.screening.record_share), 1)
    most = np.argsort(costs)[::-1][: -(-len(costs) // every)]
    return sorted({*most.tolist(), *range(0, len(costs), every)})


def _probed_all(
    there: Sequence[tuple[Member, Sequence[ModelCorrection]]],
    residual: WhitenedResidual,
    jobs: int,
    progress: Progress | None,
) -> tuple[tuple[Probe, ...], ...]:
    """Probes of every effect, best first; effects by what their best one explains."""
    left = residual.beyond(residual.residual)
    tasks = (delayed(_probed)(member, probes, residual, left) for member, probes in there)
    results = side_by_side(jobs)(tasks)
    found: list[tuple[Probe, ...]] = list(counted(results, len(there), progress))
    return tuple(sorted((probes for probes in found if probes), key=lambda probes: -probes[0].gain))


def _probed(
    member: Member, probes: Sequence[ModelCorrection], residual: WhitenedResidual, left: FloatArray
) -> tuple[Probe, ...]:
    found, owner = [], residual.owner[residual.training]
    for first in range(0, len(probes), _AT_ONCE):
        some = probes[first : first + _AT_ONCE]
        outputs = outputs_of(some, residual)
        wholes = np.sum(outputs[residual.training] ** 2, axis=0)
        rows = np.ascontiguousarray(residual.beyond(outputs).T)
        for probe, beyond, whole in zip(some, rows, wholes.tolist(), strict=True):
            size = float(beyond @ beyond)
            if size > 1e-18 * whole and whole and np.isfinite(size):
                scores = by_record(beyond, left, owner, len(residual.traces))
                found.append(probed(member, probe, beyond, left, whole, scores))
    return tuple(sorted(found, key=lambda probe: -probe.gain))


def explain_screened(
    probes: Sequence[Sequence[Probe]], residual: WhitenedResidual, options: Options
) -> list[Explanation]:
    """Fit the effects that a screen promises.

    Parameters
    ----------
    probes : sequence of sequences of Probe
        From `screen`.
    residual : WhitenedResidual
        Of the model so far, on all records.
    options : Options
        Threads, progress and criteria.

    Returns
    -------
    list of Explanation
        One for each effect that was fitted, in the order of the screen.
    """
    remainder, criteria = residual.beyond(residual.residual), options.criteria
    largest, tell = by_chance(probes, criteria), options.stage("fitting effects")
    chosen = promising(probes, float(remainder @ remainder), largest, criteria)
    training, most = residual.of_training(), int(criteria.screening.starts)
    starts = [_starts(ones, most) for ones in chosen]
    each = [(ones[0].member, start) for ones, own in zip(chosen, starts, strict=True) for start in own]
    fits = side_by_side(options.jobs)(delayed(_fitted)(*one, training) for one in each)
    found = iter(list(counted(fits, len(each), tell)))  # all: a pool warns of results that no one takes
    best = [min(islice(found, len(own)), key=lambda fit: fit[1])[0] for own in starts]
    told = (
        delayed(_explained)(ones, effect, residual, largest)
        for ones, effect in zip(chosen, best, strict=True)
    )
    return list(side_by_side(options.jobs)(told))


def explain_effect(
    probes: Sequence[Probe], residual: WhitenedResidual, largest: FloatArray | None = None
) -> Explanation:
    """Fit an effect and the model's numbers together, from its best probes.

    Parameters
    ----------
    probes : sequence of Probe
        Of one effect, best first.
    residual : WhitenedResidual
        All records; held-out ones are judged alone.
    largest : ndarray, shape (draws,)
        Gains that the screen makes by chance: the effect's is told from its best probe. None: not told.

    Returns
    -------
    Explanation
        The effect, and costs of every record without and with it.
    """
    training, starts = residual.of_training(), _starts(probes, int(residual.criteria.screening.starts))
    fits = (_fitted(probes[0].member, start, training) for start in starts)
    return _explained(probes, min(fits, key=lambda fit: fit[1])[0], residual, largest)


def _explained(
    probes: Sequence[Probe],
    effect: ModelCorrection,
    residual: WhitenedResidual,
    largest: FloatArray | None,
) -> Explanation:
    """Costs with a fitted effect, and the chance of what its best probe gains."""
    found = explanation(effect, probes[0].member, residual)
    return found if largest is None else replace(found, p_value=p_value(probes[0].gain, largest))


def _starts(probes: Sequence[Probe], most: int) -> list[ModelCorrection]:
    """The best probes of different inner numbers, each at the strength that suits it."""
    found: dict[tuple[float, ...], ModelCorrection] = {}
    for probe in probes:
        inner = tuple(probe.effect.parameters[name].value for name in probe.member.inner)
        if inner not in found and len(found) < most:
            found[inner] = probe.start
    return list(found.values())


def free_numbers(effect: ModelCorrection, member: Member) -> tuple[str, ...]:
    """Parameters that a fit moves: not those of the link's own stiffness, of a record, or of a choice."""
    held = {*member.of_stiffness, *member.by_record}
    return tuple(
        name
        for name, parameter in effect.parameters.items()
        if name not in held and not _is_choice(member, name) and parameter.bounds[0] < parameter.bounds[1]
    )


def _is_choice(member: Member, name: str) -> bool:
    return set(member.inner.get(name, ())) == {-1.0, 1.0}


def _sizes(effect: ModelCorrection, names: Sequence[str], member: Member) -> FloatArray:
    """What a parameter's steps are counted in."""
    return np.array(
        [max(abs(effect.parameters[n].value), 0.3 * abs(member.parameters[n].value), 1e-12) for n in names]
    )


def _fitted(
    member: Member, effect: ModelCorrection, residual: WhitenedResidual
) -> tuple[ModelCorrection, float]:
    """Levenberg-Marquardt steps in an effect's numbers, those of the model taken out at every step."""
    names = free_numbers(effect, member)
    left = residual.beyond(residual.residual - output_of(effect, residual))
    cost, damping = float(left @ left), 1e-4
    for _ in range(_ITERATIONS):
        slopes = _slopes(effect, names, member, residual)
        matrix, right = slopes.T @ slopes, slopes.T @ left
        trial = None
        for _ in range(6):
            step = np.linalg.lstsq(matrix + damping * np.diag(np.diag(matrix)), right, rcond=1e-12)[0]
            moved = dict(zip(names, step * _sizes(effect, names, member), strict=True))
            trial = cut_to_bounds(effect, {n: effect.parameters[n].value + moved[n] for n in names})
            after = residual.beyond(residual.residual - output_of(trial, residual))
            if float(after @ after) < cost:
                break
            trial, damping = None, max(damping * 10, 1e-6)
        if trial is None:
            break
        gain = cost - float(after @ after)
        effect, left, cost, damping = trial, after, cost - gain, damping / 10
        if gain < _SETTLED * cost:
            break
    return effect, cost


def _slopes(
    effect: ModelCorrection, names: Sequence[str], member: Member, residual: WhitenedResidual
) -> FloatArray:
    """Slopes of the output by an effect's numbers in their sizes, the model's taken off: (rows, numbers)."""
    return residual.beyond(slopes_of(effect, names, _sizes(effect, names, member), residual))


def explanation(effect: ModelCorrection, member: Member, residual: WhitenedResidual) -> Explanation:
    """Costs with an effect and without, and its numbers with their limits.

    Parameters
    ----------
    effect : ModelCorrection
        With its fitted numbers.
    member : Member
        What the catalogue says of it.
    residual : WhitenedResidual
        Of the model without the effect, on all records.

    Returns
    -------
    Explanation
        With 95 % limits, and costs of every record without and with the effect.
    """
    names = free_numbers(effect, member)
    rows = residual.residual - output_of(effect, residual)
    beyond = residual.beyond(rows)
    spread = max(float(beyond @ beyond) / len(beyond), 1.0)
    slopes = _slopes(effect, names, member, residual)
    inverse = np.asarray(np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True), dtype=float)
    errors = standard_errors(inverse, _by_record(slopes, beyond, residual), spread)
    errors *= _sizes(effect, names, member)
    return Explanation(
        effect=limited(effect, dict(zip(names, errors.tolist(), strict=True))),
        before=residual.costs(residual.left_over(residual.residual)),
        after=residual.costs(residual.left_over(rows)),
        samples=residual.samples,
        hold_out=frozenset(t.settings.file for t in residual.traces if t.settings.hold_out),
        free_numbers=len(names),
        at_bound=tuple(n for n in names if effect.parameters[n].value in effect.parameters[n].bounds),
    )


def _by_record(slopes: FloatArray, left: FloatArray, residual: WhitenedResidual) -> FloatArray:
    """Slopes times what is left over, summed over the rows of every record, (records, numbers)."""
    owner, records = residual.owner[residual.training], len(residual.traces)
    products = (slopes * left[:, None])[: len(owner)]
    return np.stack([np.bincount(owner, weights=one, minlength=records) for one in products.T], axis=1)
