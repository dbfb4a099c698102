"""Which effects of the catalogue promise to balance the forces that a model leaves, and where fits start.

Shapes are not linear in an effect's numbers, and a small strength tells little of a slider: each effect is
tried over a coarse grid of shapes at the sizes of the measured motion, its strengths and the model's own
numbers fitted to each by least squares (variable projection; G. Golub and V. Pereyra, SIAM J. Numer. Anal.
10, 413, 1973).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.explain.probes import Probe, cut_to_bounds, probed_in_pieces
from discovery.explain.scales import at_scale, rescaled, scale_of, sees_normal_force
from discovery.explain.slider_shapes import Held, slider_shapes
from discovery.options import Options
from discovery.residual.force_balance import ForceBalanceResidual
from rom.campaign.channels import FloatArray
from rom.effects import Effect, Member, ModelCorrection, SensorFault, candidates, kind_of_link
from rom.identification.force_balance import declared_model
from rom.progress import counted


class Start(NamedTuple):
    """Where a fit starts: the model with a stiffness that suits the effect, and the effect."""

    state: ForceBalanceResidual
    new: tuple[ModelCorrection, ...]


def screen(residual: ForceBalanceResidual, options: Options) -> tuple[tuple[Probe, ...], ...]:
    """Try every force of the catalogue at every place over a grid of its shapes; the best first.

    Members of a class beside its core too: here they cost little, and loops of slip tell them apart. Faults
    of force sensors and drives as well, which show beside masses that are given, or where they bend forces.
    """
    left = residual.beyond(residual.whitened(residual.force))
    known, found = {effect.path for effect in residual.effects}, []
    pairs = list(candidates_in_balances(residual))
    tell = options.stage("screening effects")
    for member, effect in counted(pairs, len(pairs), tell):
        if effect.path not in known:
            probes = sorted(_probes(member, effect, residual, left), key=lambda one: -one.gain)
            found += [tuple(probes)] if probes else []
    return tuple(sorted(found, key=lambda probes: -probes[0].gain))


def candidates_in_balances(residual: ForceBalanceResidual) -> Iterator[tuple[Member, ModelCorrection]]:
    """Effects at the scales of their places, and faults of the force sensors."""
    balances = residual.balances
    every = (balance for record in balances.records for balance in record.balances)
    channels = dict.fromkeys(one.channel for one in every if np.any(one.terms["force"]))
    model = declared_model(balances)[0]
    for member, added in candidates(model, channels, core=False):
        if member.by_record:
            continue
        if isinstance(added, SensorFault):
            scale = scale_of(balances, f"body:{added.channel.partition('_')[2]}")
            if not added.other and scale is not None:
                yield member, rescaled(added, scale)
        elif member.kind == "force" and not _is_beside_spring(member, added, residual):
            effect = _at_place(member, added, residual)
            if effect is not None:
                yield member, effect


def _is_beside_spring(member: Member, added: ModelCorrection, residual: ForceBalanceResidual) -> bool:
    """Whether an effect is of no use beside the spring that the link has."""
    return member.springless and f"{added.enters}.stiffness.k" in residual.balances.names


def _at_place(member: Member, added: ModelCorrection, residual: ForceBalanceResidual) -> Effect | None:
    balances = residual.balances
    scale = scale_of(balances, added.enters)
    if scale is None or not isinstance(added, Effect):
        return None
    kinds = {link.name: kind_of_link(link.between, link.law) for link in balances.settings.link}
    pressed, rules = sees_normal_force(balances, added.enters), residual.criteria.tension
    ground = kinds.get(added.enters) != "joint" and not pressed
    return at_scale(member, added, scale, ground=ground, pressed=pressed, criteria=rules)


def _probes(
    member: Member, effect: ModelCorrection, residual: ForceBalanceResidual, left: FloatArray
) -> Iterator[Probe]:
    """Probes of every shape, one strength at a time, and of strengths that suit together."""
    shapes = _sliders(member, effect, residual) if member.limits else member.probes(effect)
    probed = [probe for one in shapes if (probe := _probed(member, one, residual, left)) is not None]
    yield from probed
    if member.linear and len(member.strengths) > 1:
        for point in _by_shape(member, probed):
            together = _together(member, point, residual, left)
            if together is not None:
                yield together


def _sliders(
    member: Member, effect: ModelCorrection, residual: ForceBalanceResidual
) -> list[ModelCorrection]:
    """A slider at limits from barely any slip to slip over most of the motion, and gaps likewise."""
    scale = scale_of(residual.balances, effect.enters)
    assert scale is not None
    ((name, least),) = member.strengths.items()
    spring = scale.force / scale.displacement
    strength, stiffness = spring, spring
    if effect.parameters[name].unit == "1":
        strength, stiffness = least, least * residual.constants(effect.enters)[0]
    held = Held(strength, stiffness, scale.displacement, _normal_force(residual, effect.enters))
    return slider_shapes(member, effect, held, residual.criteria.screening)


def _normal_force(residual: ForceBalanceResidual, enters: str) -> float:
    """Mean normal force of a link over training records [N]; zero where none was measured."""
    held = [
        record.motion[enters][2]
        for record in residual.balances.records
        if not record.settings.hold_out and enters in record.motion
    ]
    return float(np.mean(np.concatenate(held))) if held else 0.0


def _probed(
    member: Member, probe: ModelCorrection, residual: ForceBalanceResidual, left: FloatArray
) -> Probe | None:
    force = residual.whitened(residual.force_of(probe, training=True))
    output = force[residual.training]
    if not np.isfinite(output).all() or not np.any(output):
        return None
    within = (0.0, np.inf) if _share(member, probe, residual) else None  # a stiffness that is fitted too
    return probed_in_pieces(member, probe, force, residual, left, within)


def _by_shape(member: Member, probed: Sequence[Probe]) -> list[list[Probe]]:
    """Probes of one shape each, that differ in which strength they have."""
    found: dict[tuple[float, ...], list[Probe]] = {}
    for probe in probed:
        shape = (p.value for name, p in probe.effect.parameters.items() if name not in member.strengths)
        found.setdefault(tuple(shape), []).append(probe)
    return [probes for probes in found.values() if len(probes) > 1]


def _together(
    member: Member, probes: Sequence[Probe], residual: ForceBalanceResidual, left: FloatArray
) -> Probe | None:
    """A probe with all strengths of a shape, as they suit together; None where one leaves its range."""
    columns = [residual.beyond(residual.whitened(residual.force_of(p.effect, training=True))) for p in probes]
    factors = np.linalg.lstsq(np.stack(columns, axis=1), left, rcond=None)[0]
    values = {
        name: factor * number.value
        for probe, factor in zip(probes, factors.tolist(), strict=True)
        for name, number in probe.effect.parameters.items()
        if name in member.strengths and number.value
    }
    effect = probes[0].effect
    if any(not low <= values[n] <= high for n in values for low, high in [effect.parameters[n].bounds]):
        return None
    return _probed(member, effect.with_values(**values), residual, left)


def _share(member: Member, effect: ModelCorrection, residual: ForceBalanceResidual) -> str:
    """Strength that is a share of a stiffness which is fitted beside it; empty where there is none."""
    name = next((name for name in member.strengths if name in member.ends), "")
    return name if name and residual.own_stiffness(effect) else ""


def starts_of(
    probes: Sequence[Probe], residual: ForceBalanceResidual, criteria: Criteria = CRITERIA
) -> list[Start]:
    """The best probes, each at the strength that suits it, and the link's stiffness beside it.

    Parameters
    ----------
    probes : sequence of Probe
        Of one effect, best first.
    residual : ForceBalanceResidual
        That was screened.
    criteria : Criteria
        How many starts.

    Returns
    -------
    list of Start
        What `discovery.explain.force_balance.fitted` takes.
    """
    rules = criteria.screening
    least = rules.balance_start_share * probes[0].gain
    return [_start(one, residual) for one in probes[: int(rules.balance_starts)] if one.gain >= least]


def _start(probe: Probe, residual: ForceBalanceResidual) -> Start:
    """A probe at its best strength; a slider slips where the probe did, whatever the stiffness beside it."""
    member, effect, amplitude = probe.member, probe.effect, probe.amplitude
    scaled = {name: effect.parameters[name].value * amplitude for name in (*member.strengths, *member.limits)}
    share = _share(member, effect, residual)
    if not share or not amplitude > 0:
        return Start(residual, (cut_to_bounds(effect, scaled),))
    balances, path = residual.balances, f"{effect.enters}.stiffness.k"
    rest = residual.force - amplitude * residual.force_of(effect, training=True)
    beside = float(balances.fitted(rest)[0][balances.names.index(path)])
    spring = scaled[share] * residual.values[path]
    stiffness = max(beside, spring / effect.parameters[share].bounds[1])
    state = replace(residual, values={**residual.values, path: stiffness})
    return Start(state, (cut_to_bounds(effect, {**scaled, share: spring / stiffness}),))
