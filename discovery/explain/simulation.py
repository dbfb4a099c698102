"""Which missing effect explains what a simulation leaves over of ring-downs and driven records.

An effect is screened by what a small strength of it changes of the motion, what the model's numbers and the
states can imitate taken off; it is then fitted by simulation, all of these beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from joblib import delayed
from scipy import signal

from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import explanation
from discovery.explain.free_form import member_of, single_terms, sparse_sum, terms_at
from discovery.explain.probes import Probe, cut_to_bounds, fit_promising, probed_in_pieces, scaled
from discovery.explain.scales import Scale, at_scale, ends_of
from discovery.explain.simulation_fit import fitted
from discovery.explain.slider_shapes import Held, slider_shapes
from discovery.options import Options
from discovery.residual.base import cost
from discovery.residual.simulation import SimulationResidual
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Effect, Member, ModelCorrection, candidates_of, places
from rom.model.model import Model
from rom.progress import counted

_CHANGE: Numerical[float] = 1e-2  # of the motion, by which a probe moves it
_ROUGH: Numerical[int] = 12  # parts
_PEAKS: Numerical[int] = 2  # over frequency, at which fits start
_BESIDE: Numerical[tuple[float, ...]] = (0.94, 0.96, 0.98, 1.02, 1.04, 1.06)  # of a frequency in a grid


def explain(residual: SimulationResidual, options: Options) -> list[Explanation]:
    """Return what the effects that a screen promises explain.

    Parameters
    ----------
    residual : SimulationResidual
        Of the model so far.
    options : Options
        Progress and criteria.
    """
    return explain_screened(screen(residual, options), residual, options)


def screen(residual: SimulationResidual, options: Options) -> tuple[tuple[Probe, ...], ...]:
    """Try every force of the catalogue at every place over a grid of its inner numbers; the best first.

    Of a wide grid the points that a few parts of the records promise most of are tried on all. Records that
    are out of phase are screened in short parts, and gains are shares of what is left of these.
    """
    pairs = list(candidates_in_decays(residual))
    seen = residual.in_parts() if residual.is_out_of_phase else residual
    rough, most = seen.in_parts(_ROUGH), int(options.criteria.screening.rough_probes)
    tasks = (delayed(_screened)(member, effect, seen, rough, most) for member, effect in pairs)
    every = counted(side_by_side(options.jobs)(tasks), len(pairs), options.stage("screening effects"))
    found = sorted((probes for probes in every if probes), key=lambda probes: -probes[0].gain)
    share = 1.0 if seen is residual else cost(residual) / cost(seen)
    return tuple(tuple(one.of_more(share) for one in probes) for probes in found)


def _screened(
    member: Member, effect: Effect, residual: SimulationResidual, rough: SimulationResidual, most: int
) -> tuple[Probe, ...]:
    """Probes of one effect, best first: of many those that parts of the records promise most of."""
    shapes = _sliders(member, effect, residual) if member.limits else member.probes(effect)
    seen: Sequence[ModelCorrection] = [shape for shape in shapes if _is_seen(shape, residual)]
    own = [name for name, number in effect.parameters.items() if number.unit == "Hz"]
    if len(seen) > most and not own:
        seen = [one.effect for one in _probed_all(member, seen, rough)[:most]]
    found = _probed_all(member, seen, residual)
    return _at_peaks(member, own[0], found, residual) if own and found else found


def _at_peaks(
    member: Member, frequency: str, found: Sequence[Probe], residual: SimulationResidual
) -> tuple[Probe, ...]:
    """Probes at frequencies of an effect's own, the best at each peak of a grid first: fits start there.

    A resonance is narrower than a grid's steps, and parts of records are too short to show it.
    """
    rising = sorted(found, key=lambda one: one.effect.parameters[frequency].value)
    peaks, _ = signal.find_peaks(np.pad([one.gain for one in rising], 1))
    best, tries = list[Probe](), list[Probe]()
    for peak in sorted((rising[place - 1] for place in peaks), key=lambda one: -one.gain)[:_PEAKS]:
        number = peak.effect.parameters[frequency]
        near = (float(np.clip(share * number.value, *number.bounds)) for share in _BESIDE)
        beside = [peak.effect.with_values(**{frequency: value}) for value in near]
        tried = _probed_all(member, [one for one in beside if _is_seen(one, residual)], residual)
        best.append(max((peak, *tried), key=lambda one: one.gain))
        tries += tried
    others = [one for one in (*found, *tries) if all(one is not first for first in best)]
    return tuple(one for ones in (best, others) for one in sorted(ones, key=lambda one: -one.gain))


def _sliders(
    member: Member, effect: ModelCorrection, residual: SimulationResidual
) -> Sequence[ModelCorrection]:
    """A slider that takes a share of a constant stiffness, at limits over the whole motion."""
    path, scale = f"{effect.enters}.stiffness.k", scale_at(residual, effect.enters)
    if scale is None or path not in residual.model.parameters:
        return member.probes(effect)
    ((_, share),) = member.strengths.items()
    held = Held(share, share * residual.model.parameter(path).value, scale.displacement)
    return slider_shapes(member, effect, held, residual.criteria.screening)


def _probed_all(
    member: Member, probes: Sequence[ModelCorrection], residual: SimulationResidual
) -> tuple[Probe, ...]:
    """What points of one effect's grid explain, best first."""
    found = (_probed(member, probe, residual, residual.unexplained) for probe in probes)
    return tuple(sorted((one for one in found if one is not None), key=lambda one: -one.gain))


def _is_seen(probe: ModelCorrection, residual: SimulationResidual) -> bool:
    """Whether the rows can show an effect with a frequency of its own; far above, it is mass or stiffness."""
    highest = min(ring.row_rate_hz for ring in residual.rings) / 4
    return all(number.value < highest for number in probe.parameters.values() if number.unit == "Hz")


def candidates_in_decays(residual: SimulationResidual) -> Iterator[tuple[Member, Effect]]:
    """Forces of the catalogue at the scales of their places.

    Those with a memory are tried from the core alone: as simulated, they cost much.
    """
    kinds, scales = places(residual.model), dict[str, Scale | None]()
    bolted, rules = residual.model.structure.bolted_links, residual.criteria.tension
    for member, added in candidates_of(Effect, residual.model, core=False):
        has_spring = f"{added.enters}.stiffness.k" in residual.names
        if member.kind != "force" or member.by_record or (member.springless and has_spring):
            continue
        if member.state_units and not member.core:
            continue
        if added.enters not in scales:
            scales[added.enters] = scale_at(residual, added.enters)
        scale = scales[added.enters]
        if scale is not None:
            ground, pressed = kinds[added.enters] != "joint", added.enters in bolted
            there = at_scale(member, added, scale, ground=ground, pressed=pressed, criteria=rules)
            yield member, _below_rate(there, residual)


def _below_rate(effect: Effect, residual: SimulationResidual) -> Effect:
    """The effect whose own frequencies end at the rate of the rows, which tell no higher one from that."""
    highest, numbers = max(ring.row_rate_hz for ring in residual.rings), dict(effect.parameters)
    for name, number in numbers.items():
        low, high = number.bounds
        if number.unit == "Hz" and low < highest < high:
            numbers[name] = replace(number, value=min(number.value, highest), bounds=(low, highest))
    return replace(effect, parameters=numbers)


def in_other_shapes(residual: SimulationResidual) -> list[Model]:
    """The model with its last effect in each shape of its grid, at its strength."""
    *others, last = residual.model.effects
    found = dict[tuple[float, ...], Model]()
    without = replace(residual, model=replace(residual.model, effects=tuple(others)))
    for member, effect in candidates_in_decays(without):
        if effect.path != last.path or not member.inner:
            continue
        for shape in member.probes(effect):
            inner = {name: shape.parameters[name].value for name in member.inner}
            moved = replace(residual.model, effects=(*others, cut_to_bounds(last, inner)))
            found.setdefault(tuple(inner.values()), moved)
    return list(found.values())


def scale_at(residual: SimulationResidual, enters: str) -> Scale | None:
    """Scale of a place over the training records, from the model's own motion; None where nothing moves."""
    first, second = ends_of(residual.model, enters)
    masses = {body.name: body.mass for body in residual.model.structure.bodies}
    force, x, v = list[float](), list[float](), list[float]()
    for place in residual.trained:
        ring = residual.rings[place]
        response = ring.response(residual.model, residual.states[place])
        parts = []
        for quantity in (response.displacement, response.velocity, response.acceleration):
            still = np.zeros(len(response.time))
            parts.append((quantity.get(first, still), quantity.get(second, still)))
        if response.status != "ok":
            continue
        x.append(float(np.ptp(parts[0][0] - parts[0][1])) / 2)
        v.append(float(np.abs(parts[1][0] - parts[1][1]).max()))
        force += [
            masses[b] * float(a.std()) for b, a in zip((first, second), parts[2], strict=True) if b in masses
        ]
    return Scale.largest(force, x, v)


def _probed(
    member: Member, probe: ModelCorrection, residual: SimulationResidual, left: FloatArray
) -> Probe | None:
    small = moved_little(member, probe, residual)
    if small is None:
        return None
    return probed_in_pieces(member, small[0], small[1], residual, left)


def moved_little(
    member: Member, probe: ModelCorrection, residual: SimulationResidual
) -> tuple[ModelCorrection, FloatArray] | None:
    """Return a probe at a strength that moves the motion by a small share of it, and what it changes.

    Parameters
    ----------
    member : Member
        What the catalogue says of it.
    probe : ModelCorrection
        At any strength.
    residual : SimulationResidual
        Of the model so far.

    Returns
    -------
    tuple of (ModelCorrection, ndarray) or None
        None where no such strength is found.
    """
    rows = np.concatenate([ring.whitened for ring in residual.rings if not ring.hold_out])
    size = float(np.linalg.norm(rows))
    for _ in range(4):
        output = residual.output_of(probe)
        share = np.inf if output is None else float(np.linalg.norm(output)) / size
        if output is not None and 0 < share <= 3 * _CHANGE:
            return probe, output
        if share == 0.0:
            return None
        factor = max(_CHANGE / share, 1e-4) if np.isfinite(share) else 1e-2
        probe = scaled(member, probe, factor)
    return None


def explain_screened(
    probes: Sequence[Sequence[Probe]], residual: SimulationResidual, options: Options
) -> list[Explanation]:
    """Fit what a screen promises beside the model's numbers and the states, each from its best probes.

    Parameters
    ----------
    probes : sequence of sequences of Probe
        From `screen`.
    residual : SimulationResidual
        Of the model so far.
    options : Options
        Progress and criteria.

    Returns
    -------
    list of Explanation
        Each with the residual beside it.
    """
    starts, parts = int(options.criteria.screening.starts), residual.in_parts()

    def fit(ones: Sequence[Probe]) -> Explanation:
        after = fitted(residual, [one.start for one in ones[:starts]], parts)
        return replace(explanation(after.model.effects[-1], residual, after), residual=after)

    return fit_promising(probes, residual, options, fit)


def free_forms(residual: SimulationResidual, options: Options) -> tuple[Explanation, ...]:
    """The sparse sum in one link that leaves least of the training records, with the residual beside it."""
    found = []
    left, taken = (
        residual.unexplained,
        {e.enters for e in residual.model.effects if e.name == "free-form"},
    )
    for link in residual.model.structure.links:
        scale = scale_at(residual, link.name)
        if scale is None or link.name in taken:
            continue
        terms = terms_at(scale.displacement, scale.velocity, tension=False, criteria=options.criteria.tension)
        columns = [_column(one, residual) for one in single_terms(terms, link.name)]
        effect = sparse_sum(np.stack(columns, axis=1), left, terms, link.name, options.seed, options.criteria)
        if effect is not None:
            after = fitted(residual, [effect])
            formed = after.model.effects[-1]
            found.append(replace(explanation(formed, residual, after), residual=after))
    return tuple(sorted(found, key=lambda one: one.cost(hold_out=False))[:1])


def _column(term: Effect, residual: SimulationResidual) -> FloatArray:
    """What a term of coefficient one makes of the rows; NaN where no small coefficient can be simulated."""
    small = moved_little(member_of(term), term, residual)
    if small is None:
        return np.full(int(residual.training.sum()), np.nan)
    (coefficient,) = small[0].parameters.values()
    return residual.beyond(small[1]) / coefficient.value
