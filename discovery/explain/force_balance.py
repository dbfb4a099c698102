"""Which missing effect explains the forces that a declared model leaves unbalanced
(``rom.identification.equation_error``).

An effect's force along the measured motion is a column beside those of the model's numbers, which are taken
off it and off the residual first (variable projection). Where an effect takes a share of a link's stiffness,
that is fitted beside the effect's own numbers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize

from discovery.decide.explanation import Explanation
from discovery.explain.free_form import member_of
from discovery.explain.motion import Probe, free_numbers
from discovery.explain.scales import at_scale, scale_of, sees_normal_force
from rom.campaign.channels import FloatArray
from rom.effects import Effect, Member, ModelCorrection, candidates
from rom.identification.force_balance import Balances
from rom.model.laws import Parameter
from rom.model.model import Model
from rom.model.structure import GROUND

_Z95 = 1.96
_EVALUATIONS = 15
_STEP = 1e-3
_STARTS, _NEARLY = 6, 0.5  # starting points; of the best one's gain
_OWN_STIFFNESS = re.compile(r"\bk\b")
_WORST = 1e6  # of a row where an effect is no number


@dataclass(frozen=True, eq=False)
class ForceBalanceResidual:
    """Balances of forces, the effects of the model so far, and its numbers by path."""

    balances: Balances
    effects: tuple[Effect, ...]
    values: Mapping[str, float]

    def constants(self, enters: str) -> tuple[float, float]:
        """Stiffness and damping of a link; zero of a body."""
        return self.values.get(f"{enters}.stiffness.k", 0.0), self.values.get(f"{enters}.damping.c", 0.0)

    def of(self, effect: Effect, *, training: bool = False) -> FloatArray:
        """Rows of an effect's force [N]."""
        return self.balances.of(effect, *self.constants(effect.enters), training=training)

    @cached_property
    def force(self) -> FloatArray:
        """Measured forces less those of the effects [N]."""
        return np.asarray(
            self.balances.force - sum((self.of(effect) for effect in self.effects), np.zeros(1))
        )

    @cached_property
    def residual(self) -> FloatArray:
        """What is left unbalanced, over the noise."""
        names = self.balances.names
        numbers = np.array([self.values[name] for name in names])
        return np.asarray((self.force - self.balances.columns @ numbers) / self.balances.noise)

    def with_numbers(self) -> ForceBalanceResidual:
        """The same with the numbers that suit the training rows best."""
        names, found = self.balances.names, self.balances.fitted(self.force)[0]
        return replace(self, values={**self.values, **dict(zip(names, found.tolist(), strict=True))})

    def costs(self) -> dict[str, float]:
        """Squares of the residual by record."""
        records, owner = self.balances.records, self.balances.owner
        sums = np.bincount(owner, weights=self.residual**2, minlength=len(records))
        return {r.settings.file: float(s) for r, s in zip(records, sums, strict=True)}


def screen_forces(state: ForceBalanceResidual, model: Model) -> tuple[tuple[Probe, ...], ...]:
    """Try every force of the catalogue at every place over a grid of its inner numbers; the best first.

    Members of a class beside its core too: here they cost little, and loops of slip tell them apart.
    """
    rows = state.balances.training
    noise = state.balances.noise[rows]
    basis = np.linalg.qr(state.balances.columns[rows] / noise[:, None])[0]
    left = _beyond(basis, state.force[rows] / noise)
    known, found = {(effect.name, effect.enters) for effect in state.effects}, []
    for member, added in candidates(model, core=False):
        if member.kind != "force" or member.by_record or (added.name, added.enters) in known:
            continue
        effect = _at_place(member, added, state.balances)
        if effect is None:
            continue
        probed = [_probed(member, one, state, basis, left) for one in member.probes(effect)]
        probes = sorted((one for one in probed if one is not None), key=lambda one: -one.gain)
        if probes:
            found.append(tuple(probes))
    return tuple(sorted(found, key=lambda probes: -probes[0].gain))


def _at_place(member: Member, added: ModelCorrection, balances: Balances) -> Effect | None:
    if not isinstance(added, Effect):
        return None
    scale = scale_of(balances, added.enters)
    if scale is None:
        return None
    ends = {link.name: link.between for link in balances.settings.link}.get(added.enters, (GROUND,))
    ground = GROUND in ends and not sees_normal_force(balances, added.enters)
    return at_scale(member, added, scale, ground=ground)


def _beyond(basis: FloatArray, rows: FloatArray) -> FloatArray:
    return np.asarray(rows - basis @ (basis.T @ rows))


def _probed(
    member: Member, probe: ModelCorrection, state: ForceBalanceResidual, basis: FloatArray, left: FloatArray
) -> Probe | None:
    assert isinstance(probe, Effect)
    rows = state.balances.training
    output = state.of(probe, training=True)[rows] / state.balances.noise[rows]
    if not np.isfinite(output).all() or not np.any(output):
        return None
    beyond = _beyond(basis, output)
    size, whole, along = float(beyond @ beyond), float(output @ output), float(beyond @ left)
    if size <= 1e-12 * whole:
        return None
    amplitude = float(np.clip(along / size, *_reach(member, probe)))
    return Probe(member, probe, amplitude * (2 * along - amplitude * size), amplitude, np.sqrt(size / whole))


def _reach(member: Member, probe: ModelCorrection) -> tuple[float, float]:
    numbers = [probe.parameters[name] for name in member.strengths if probe.parameters[name].value]
    ends = [sorted(bound / number.value for bound in number.bounds) for number in numbers]
    return max(low for low, _ in ends), min(high for _, high in ends)


def starts_of(probes: Sequence[Probe]) -> list[Effect]:
    """The best probes, each at the strength that suits it."""
    found = []
    for probe in [one for one in probes[:_STARTS] if one.gain >= _NEARLY * probes[0].gain]:
        values = {
            name: float(np.clip(number.value * probe.amplitude, *number.bounds))
            for name in probe.member.strengths
            if (number := probe.effect.parameters[name]).value
        }
        made = probe.effect.with_values(**values)
        assert isinstance(made, Effect)
        found.append(made)
    return found


def explain_forces(
    probes: Sequence[Probe], state: ForceBalanceResidual
) -> tuple[Explanation, ForceBalanceResidual]:
    """Fit an effect beside the model's numbers from its best probes: what it explains, the state with it."""
    fits = [fitted(state, (one,)) for one in starts_of(probes)]
    best, effects = min(fits, key=lambda fit: _cost(fit[0]))
    after, before = best, replace(state, values=dict(state.values)).with_numbers()
    return explained(effects[-1], probes[0].member, before, after), after


def _cost(state: ForceBalanceResidual) -> float:
    return float(np.sum(state.residual[state.balances.training] ** 2))


def explained(
    effect: Effect, member: Member, before: ForceBalanceResidual, after: ForceBalanceResidual
) -> Explanation:
    """Costs of all records with an effect and without."""
    records = after.balances.records
    counts = np.bincount(after.balances.owner, minlength=len(records))
    free = free_numbers(effect, member)
    return Explanation(
        effect=effect,
        before=before.costs(),
        after=after.costs(),
        samples={r.settings.file: int(n) for r, n in zip(records, counts, strict=True)},
        hold_out=frozenset(r.settings.file for r in records if r.settings.hold_out),
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
    state: ForceBalanceResidual, new: Sequence[Effect]
) -> tuple[ForceBalanceResidual, tuple[Effect, ...]]:
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

    def left(at: FloatArray) -> FloatArray:
        values, effects = _moved(state, new, numbers, at)
        trial = replace(state, values=values)
        force = state.force[rows].copy()
        for name in own:
            force -= values[name] * balances.columns[rows, balances.names.index(name)]
        for effect in effects:
            force -= trial.of(effect, training=True)[rows]
        found = _beyond(basis, force / noise)
        return found if np.isfinite(found).all() else np.full(len(found), _WORST)

    at = np.array([n.start / n.size for n in numbers])
    low, high = (np.array([bound / n.size for n, bound in zip(numbers, bounds, strict=True)])
                 for bounds in ([n.low for n in numbers], [n.high for n in numbers]))  # fmt: skip
    margin = 1e-9 * np.minimum(high - low, 1.0)
    inside = np.clip(at, low + margin, high - margin)
    steps = np.full(len(at), _STEP)
    found = optimize.least_squares(left, inside, bounds=(low, high), x_scale="jac", diff_step=steps,
                                   max_nfev=_EVALUATIONS, ftol=1e-5)  # fmt: skip
    at = np.where(np.abs(found.x - high) < 1e-6 * np.abs(high), high, found.x)
    values, effects = _moved(state, new, numbers, at)
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


def _numbers(state: ForceBalanceResidual, new: Sequence[Effect]) -> list[_Number]:
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


def _shows(state: ForceBalanceResidual, effect: Effect, name: str, size: float) -> bool:
    """Whether a number changes the force; a factor of the normal force does not where that is unknown."""
    old = effect.parameters[name]
    step = _STEP * size if old.value + _STEP * size <= old.bounds[1] else -_STEP * size
    moved = effect.with_values(**{name: old.value + step})
    return not np.array_equal(state.of(moved, training=True), state.of(effect, training=True), equal_nan=True)


def _shared(state: ForceBalanceResidual, link: str) -> bool:
    """Whether an effect that is held sees the stiffness of a link already."""
    return any(e.enters == link and _OWN_STIFFNESS.search(e.equation) for e in state.effects)


def _moved(
    state: ForceBalanceResidual, new: Sequence[Effect], numbers: Sequence[_Number], at: FloatArray
) -> tuple[dict[str, float], list[Effect]]:
    values, effects = dict(state.values), list(new)
    for number, share in zip(numbers, at, strict=True):
        value = float(np.clip(share * number.size, number.low, number.high))
        if number.effect is None:
            values[number.name] = value
        else:
            effects[number.effect] = effects[number.effect].with_values(**{number.name: value})
    return values, effects


def _limited(effect: Effect, place: int, numbers: Sequence[_Number], errors: FloatArray) -> Effect:
    parameters: dict[str, Parameter] = dict(effect.parameters)
    for number, error in zip(numbers, errors, strict=True):
        if number.effect == place:
            old = parameters[number.name]
            reach = _Z95 * float(error)
            parameters[number.name] = replace(old, low=old.value - reach, high=old.value + reach)
    return replace(effect, parameters=parameters)
