"""Which missing effect explains the forces that a model leaves unbalanced.

An effect's force along the measured motion is a column beside those of the model's numbers, which are taken
off it and off the residual first (variable projection). Where an effect takes a share of a link's stiffness,
that is fitted beside the effect's own numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.criteria.number import Numerical
from discovery.decide.chance import by_record, p_value
from discovery.decide.explanation import Explanation
from discovery.explain.free_form import member_of
from discovery.explain.motion import Probe, by_chance, free_numbers, worth_fitting
from discovery.explain.scales import at_scale, scale_of, sees_normal_force
from discovery.options import Options
from discovery.residual.base import cost
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.channels import FloatArray
from rom.effects import Effect, Member, ModelCorrection, SensorFault, candidates
from rom.identification.force_balance import Balances, declared_model
from rom.model.laws import Z95, Parameter
from rom.model.structure import GROUND

_EVALUATIONS: Numerical[int] = 15
_STEP: Numerical[float] = 1e-3
_OWN_STIFFNESS = re.compile(r"\bk\b")
_WORST: Numerical[float] = 1e6  # of a row where an effect is no number
_IMITATED: Numerical[float] = 1e-12  # share of an output that is left beyond the model's numbers: rounding


def explain(residual: ForceBalanceResidual, options: Options) -> list[Explanation]:
    """Return what the effects that a screen promises explain of the forces left unbalanced.

    Parameters
    ----------
    residual : ForceBalanceResidual
        Of the model so far.
    options : Options
        Progress and criteria.
    """
    return explain_screened(screen(residual, options), residual, options)


def screen(residual: ForceBalanceResidual, options: Options) -> tuple[tuple[Probe, ...], ...]:
    """Try every force of the catalogue at every place over a grid of its inner numbers; the best first.

    Members of a class beside its core too: here they cost little, and loops of slip tell them apart. Faults
    of force sensors as well, which show where masses are given.
    """
    left = residual.beyond(residual.whitened(residual.force))
    known, found = {effect.path for effect in residual.effects}, []
    pairs = list(_candidates(residual))
    tell = options.stage("screening effects")
    for done, (member, effect) in enumerate(pairs, 1):
        if effect.path not in known:
            probed = [_probed(member, one, residual, left) for one in member.probes(effect)]
            probes = sorted((one for one in probed if one is not None), key=lambda one: -one.gain)
            found += [tuple(probes)] if probes else []
        if tell is not None:
            tell(done, len(pairs))
    return tuple(sorted(found, key=lambda probes: -probes[0].gain))


def _candidates(residual: ForceBalanceResidual) -> Iterator[tuple[Member, ModelCorrection]]:
    """Effects at the scales of their places, and faults of the force sensors."""
    balances = residual.balances
    channels = dict.fromkeys(b.channel for r in balances.records for b in r.balances)
    model = declared_model(balances)[0]
    for member, added in candidates(model, channels, core=False):
        if member.by_record:
            continue
        if isinstance(added, SensorFault):
            if not added.other and member.core:
                yield member, added
        elif member.kind == "force":
            effect = _at_place(member, added, balances)
            if effect is not None:
                yield member, effect


def _at_place(member: Member, added: ModelCorrection, balances: Balances) -> Effect | None:
    if not isinstance(added, Effect):
        return None
    scale = scale_of(balances, added.enters)
    if scale is None:
        return None
    ends = {link.name: link.between for link in balances.settings.link}.get(added.enters, (GROUND,))
    ground = GROUND in ends and not sees_normal_force(balances, added.enters)
    return at_scale(member, added, scale, ground=ground)


def _probed(
    member: Member, probe: ModelCorrection, residual: ForceBalanceResidual, left: FloatArray
) -> Probe | None:
    force = residual.whitened(residual.force_of(probe, training=True))
    output = force[residual.training]
    if not np.isfinite(output).all() or not np.any(output):
        return None
    beyond = residual.beyond(force)
    size, whole, along = float(beyond @ beyond), float(output @ output), float(beyond @ left)
    if size <= _IMITATED * whole:
        return None
    amplitude = float(np.clip(along / size, *_reach(member, probe)))
    scores = by_record(beyond, left, residual.pieces, int(residual.pieces.max(initial=0)) + 1)
    gain = amplitude * (2 * along - amplitude * size)
    return Probe(member, probe, gain, amplitude, np.sqrt(size / whole), scores)


def _reach(member: Member, probe: ModelCorrection) -> tuple[float, float]:
    numbers = [probe.parameters[name] for name in member.strengths if probe.parameters[name].value]
    ends = [sorted(bound / number.value for bound in number.bounds) for number in numbers]
    return max(low for low, _ in ends), min(high for _, high in ends)


def starts_of(probes: Sequence[Probe], criteria: Criteria = CRITERIA) -> list[ModelCorrection]:
    """The best probes, each at the strength that suits it."""
    rules, found = criteria.screening, []
    least = rules.balance_start_share * probes[0].gain
    for probe in [one for one in probes[: int(rules.balance_starts)] if one.gain >= least]:
        values = {
            name: float(np.clip(number.value * probe.amplitude, *number.bounds))
            for name in probe.member.strengths
            if (number := probe.effect.parameters[name]).value
        }
        found.append(probe.effect.with_values(**values))
    return found


def explain_screened(
    probes: Sequence[Sequence[Probe]], residual: ForceBalanceResidual, options: Options
) -> list[Explanation]:
    """Fit what a screen promises beside the model's numbers, each from its best probes.

    Parameters
    ----------
    probes : sequence of sequences of Probe
        From `screen`.
    residual : ForceBalanceResidual
        Of the model so far.
    options : Options
        Progress and criteria.

    Returns
    -------
    list of Explanation
        Each with the residual beside it.
    """
    promising = worth_fitting(probes, cost(residual), options.criteria)
    largest = by_chance(probes, options.criteria)
    tell, found = options.stage("fitting effects"), []
    before = residual.with_numbers()
    for ones in promising:
        fits = [fitted(residual, (start,)) for start in starts_of(ones, options.criteria)]
        after, effects = min(fits, key=lambda fit: cost(fit[0]))
        explained = explanation(effects[-1], ones[0].member, before, after)
        p_value_ = None if largest is None else p_value(ones[0].gain, largest)
        found.append(replace(explained, p_value=p_value_, residual=after))
        if tell is not None:
            tell(len(found), len(promising))
    return found


def explanation(
    effect: ModelCorrection, member: Member, before: ForceBalanceResidual, after: ForceBalanceResidual
) -> Explanation:
    """Costs of all records with an effect and without.

    Parameters
    ----------
    effect : ModelCorrection
        With its fitted numbers.
    member : Member
        What the catalogue says of it.
    before, after : ForceBalanceResidual
        Without it and with it, all other numbers fitted.

    Returns
    -------
    Explanation
        Costs by record, and the numbers that lie at an end of their range.
    """
    free = free_numbers(effect, member)
    return Explanation(
        effect=effect,
        before=before.costs(),
        after=after.costs(),
        samples=after.samples,
        hold_out=after.hold_out,
        free_numbers=len(free),
        at_bound=tuple(n for n in free if effect.parameters[n].value in effect.parameters[n].bounds),
    )


@dataclass(frozen=True)
class _Number:
    """A number that enters by an effect: of the effect in that place of the list, or a link's stiffness."""

    effect: int | None
    name: str
    start: float
    size: float
    low: float
    high: float


def fitted(
    state: ForceBalanceResidual, new: Sequence[ModelCorrection]
) -> tuple[ForceBalanceResidual, tuple[ModelCorrection, ...]]:
    """Fit new effects beside all numbers of the model, effects that are there already held.

    By trust-region steps within the parameters' ranges. Returns the state with the effects at the end, and
    the new effects with 95 % limits.
    """
    numbers = _numbers(state, new)
    balances, rows = state.balances, state.balances.training
    own = [n.name for n in numbers if n.effect is None]
    kept = [k for k, name in enumerate(balances.names) if name not in own]
    noise = balances.noise[rows]
    basis = np.linalg.qr(balances.columns[rows][:, kept] / noise[:, None])[0]

    def remainder(at: FloatArray) -> FloatArray:
        values, effects = _at(state, new, numbers, at)
        trial = replace(state, values=values)
        force = state.force[rows].copy()
        for name in own:
            force -= values[name] * balances.columns[rows, balances.names.index(name)]
        for effect in effects:
            force -= trial.force_of(effect, training=True)[rows]
        white = force / noise
        found = white - basis @ (basis.T @ white)
        return found if np.isfinite(found).all() else np.full(len(found), _WORST)

    at = np.array([n.start / n.size for n in numbers])
    low, high = (np.array([bound / n.size for n, bound in zip(numbers, bounds, strict=True)])
                 for bounds in ([n.low for n in numbers], [n.high for n in numbers]))  # fmt: skip
    margin = 1e-9 * np.minimum(high - low, 1.0)
    inside = np.clip(at, low + margin, high - margin)
    steps = np.full(len(at), _STEP)
    found = optimize.least_squares(remainder, inside, bounds=(low, high), x_scale="jac", diff_step=steps,
                                   max_nfev=_EVALUATIONS, ftol=1e-5)  # fmt: skip
    at = np.where(np.abs(found.x - high) < 1e-6 * np.abs(high), high, found.x)
    values, effects = _at(state, new, numbers, at)
    spread = max(2 * found.cost / rows.sum(), 1.0)
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True) * spread
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * [n.size for n in numbers]
    limited = tuple(_limited(effect, place, numbers, errors) for place, effect in enumerate(effects))
    after = replace(state, values=values, effects=(*state.effects, *limited))
    return _settled(after, own), limited


def _settled(state: ForceBalanceResidual, own: Sequence[str]) -> ForceBalanceResidual:
    """The model's other numbers refitted, those that the effects share held as they were fitted."""
    balances = state.balances
    held = [k for k, name in enumerate(balances.names) if name in own]
    rest = [k for k in range(len(balances.names)) if k not in held]
    force = state.force - balances.columns[:, held] @ np.array(
        [state.values[balances.names[k]] for k in held]
    )
    others = replace(
        balances, columns=balances.columns[:, rest], names=tuple(balances.names[k] for k in rest)
    )
    found = others.fitted(force)[0]
    return replace(state, values={**state.values, **dict(zip(others.names, found.tolist(), strict=True))})


def _numbers(state: ForceBalanceResidual, new: Sequence[ModelCorrection]) -> list[_Number]:
    numbers, links = [], dict.fromkeys(e.enters for e in new if _OWN_STIFFNESS.search(e.equation))
    for link in links:
        name = f"{link}.stiffness.k"
        if name in state.balances.names and not _shared(state, link):
            value = max(state.values[name], 1e-12)
            numbers.append(_Number(None, name, value, value, 0.0, np.inf))
    for place, effect in enumerate(new):
        for name in free_numbers(effect, member_of(effect)):
            p = effect.parameters[name]
            size = max(
                abs(p.value),
                0.1 * min((abs(b) for b in p.bounds if b and np.isfinite(b)), default=0.0),
                1e-300,
            )
            if _shows(state, effect, name, size):
                numbers.append(_Number(place, name, p.value, size, *p.bounds))
    return numbers


def _shows(state: ForceBalanceResidual, effect: ModelCorrection, name: str, size: float) -> bool:
    """Whether a number changes the force; a factor of the normal force does not where that is unknown."""
    old = effect.parameters[name]
    step = _STEP * size if old.value + _STEP * size <= old.bounds[1] else -_STEP * size
    moved = effect.with_values(**{name: old.value + step})
    return not np.array_equal(
        state.force_of(moved, training=True), state.force_of(effect, training=True), equal_nan=True
    )


def _shared(state: ForceBalanceResidual, link: str) -> bool:
    """Whether an effect that is held sees the stiffness of a link already."""
    return any(e.enters == link and _OWN_STIFFNESS.search(e.equation) for e in state.effects)


def _at(
    state: ForceBalanceResidual, new: Sequence[ModelCorrection], numbers: Sequence[_Number], at: FloatArray
) -> tuple[dict[str, float], list[ModelCorrection]]:
    values, effects = dict(state.values), list(new)
    for number, share in zip(numbers, at, strict=True):
        value = float(np.clip(share * number.size, number.low, number.high))
        if number.effect is None:
            values[number.name] = value
        else:
            effects[number.effect] = effects[number.effect].with_values(**{number.name: value})
    return values, effects


def _limited(
    effect: ModelCorrection, place: int, numbers: Sequence[_Number], errors: FloatArray
) -> ModelCorrection:
    parameters: dict[str, Parameter] = dict(effect.parameters)
    for number, error in zip(numbers, errors, strict=True):
        if number.effect == place:
            old = parameters[number.name]
            reach = Z95 * float(error)
            parameters[number.name] = replace(old, low=old.value - reach, high=old.value + reach)
    return replace(effect, parameters=parameters)
