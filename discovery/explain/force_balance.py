"""Which missing effect explains the forces that a model leaves unbalanced.

An effect's force along the measured motion is a column beside those of the model's numbers, which are taken
off it and off the residual first (variable projection). Where an effect takes a share of a link's stiffness,
that is fitted beside the effect's own numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from discovery.decide.explanation import Explanation
from discovery.explain.force_balance_screen import Start, screen, starts_of
from discovery.explain.free_form import member_of
from discovery.explain.motion import free_numbers
from discovery.explain.probes import Probe, fit_promising
from discovery.explain.wider_ranges import WIDENINGS, widened
from discovery.options import Options
from discovery.residual.base import Residual, cost
from discovery.residual.ends_of_ranges import on_ends_that_suit
from discovery.residual.force_balance import ForceBalanceResidual, sees_stiffness
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, ModelCorrection
from rom.model.laws import Z95, Parameter

Fit = tuple[ForceBalanceResidual, tuple[ModelCorrection, ...]]
_EVALUATIONS: Numerical[int] = 15
_SHORT: Numerical[int] = 4  # evaluations that tell which start is best
_AT_END: Numerical[float] = 1e-4  # of a number's size
_LITTLE: Numerical[float] = 0.1  # squares of noise by which a number at an end may raise the cost
_STEP: Numerical[float] = 1e-3
_SEEN: Numerical[float] = 1e-2  # of the effects' force: a number that makes less of it is hardly seen
_TENFOLDS: Numerical[int] = 9
_WORST: Numerical[float] = 1e6  # of a row where an effect is no number


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
    before = residual.with_numbers()

    def fit(ones: Sequence[Probe]) -> Explanation | None:
        after, effects = best_fit(starts_of(ones, residual, options.criteria))
        if is_degenerate(effects[-1], ones[0].member):
            return None
        return replace(explanation(effects[-1], before, after), residual=after)

    return fit_promising(probes, residual, options, fit)


def best_fit(starts: Sequence[Start]) -> Fit:
    """The best of short fits from all starts, fitted to its end."""
    short = [fitted(*start, evaluations=_SHORT) for start in starts]
    place = min(range(len(short)), key=lambda k: cost(short[k][0]))
    after, effects = short[place]
    return fitted(replace(after, effects=starts[place].state.effects), effects)


def is_degenerate(effect: ModelCorrection, member: Member) -> bool:
    """Whether a number that the effect is nothing without cannot be told from zero: no gap has no width."""
    numbers = [effect.parameters[name] for name in member.needs]
    return any(n.low is None or n.low <= max(n.bounds[0], 0.0) for n in numbers)


def explanation(effect: ModelCorrection, before: Residual, after: Residual) -> Explanation:
    """Costs of all records with an effect and without.

    Parameters
    ----------
    effect : ModelCorrection
        With its fitted numbers.
    before, after : Residual
        Without it and with it, all other numbers fitted.

    Returns
    -------
    Explanation
        Costs by record, and the numbers that lie at an end of their range.
    """
    free = free_numbers(effect, member_of(effect))
    return Explanation(
        effect=effect,
        before=before.costs(before.residual),
        after=after.costs(after.residual),
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
    state: ForceBalanceResidual, new: Sequence[ModelCorrection], *, evaluations: int = _EVALUATIONS
) -> Fit:
    """Fit new effects beside all numbers of the model, effects that are there already held.

    By trust-region steps within the parameters' ranges.

    Parameters
    ----------
    state : ForceBalanceResidual
        The model so far; a stiffness that an effect takes a share of starts at its value there.
    new : sequence of ModelCorrection
        Where the fit of the effects starts.
    evaluations : int
        Most steps.

    Returns
    -------
    tuple
        The state with the effects at the end, and the new effects with 95 % limits.
    """
    after, effects = _fitted(state, new, evaluations)
    for _ in range(WIDENINGS if evaluations == _EVALUATIONS else 0):
        wider = widened(effects, state.criteria.tension.wider_range)
        if wider is None:
            break
        after, effects = _fitted(replace(after, effects=state.effects), wider, evaluations)
    return after, effects


def _fitted(state: ForceBalanceResidual, new: Sequence[ModelCorrection], evaluations: int) -> Fit:
    numbers = _numbers(state, new)
    if not numbers:  # a stiffness cut off below zero where a link has no spring
        return replace(state, effects=(*state.effects, *new)).with_numbers(), tuple(new)
    balances, rows = state.balances, state.balances.training
    seen = {*(n.name for n in numbers if n.effect is None), *state.carried_stiffnesses}
    kept = [k for k, name in enumerate(balances.names) if name not in seen]
    noise = balances.noise[rows]
    basis = np.linalg.qr(balances.columns[rows][:, kept] / noise[:, None])[0]

    def remainder(at: FloatArray) -> FloatArray:
        values, effects = _at(state, new, numbers, at)
        trial = replace(state, values=values)
        force = state.force[rows].copy()
        for name in seen:
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
    acting = float(np.linalg.norm(_acting(state, new)[rows] / noise))

    def slopes(x: FloatArray) -> FloatArray:
        here = remainder(x)
        columns = (_slope(remainder, here, x, place, (low, high), acting) for place in range(len(x)))
        return np.stack(list(columns), axis=1)

    found = optimize.least_squares(remainder, inside, jac=slopes, bounds=(low, high), x_scale="jac",
                                   max_nfev=evaluations, ftol=1e-5)  # fmt: skip
    most = _LITTLE * max(float(found.fun @ found.fun) / len(found.fun), 1.0)
    ends = on_ends_that_suit(remainder, found.x, low, high, _AT_END, most)
    values, effects = _at(state, new, numbers, ends)
    errors = _errors(found, int(rows.sum())) * [n.size for n in numbers]
    limited = tuple(_limited(effect, place, numbers, errors) for place, effect in enumerate(effects))
    after = replace(state, values=values, effects=(*state.effects, *limited))
    return after.with_numbers(), limited


def _acting(state: ForceBalanceResidual, new: Sequence[ModelCorrection]) -> FloatArray:
    """The force of all effects, (rows,)."""
    return np.asarray(
        sum((state.force_of(effect, training=True) for effect in new), np.zeros(len(state.force)))
    )


def _slope(
    remainder: Callable[[FloatArray], FloatArray],
    here: FloatArray,
    x: FloatArray,
    place: int,
    bounds: tuple[FloatArray, FloatArray],
    acting: float,
) -> FloatArray:
    """Slope of what is left over by one number.

    A number that may be zero can be far smaller than what it is added to, as a constant part of a limit of
    friction is: a step of a share of itself would tell rounding alone. Its step is as large as can be seen.
    """
    low, high = (float(ends[place]) for ends in bounds)
    step = _STEP * max(abs(x[place]), _STEP)
    for _ in range(_TENFOLDS):
        moved = x.copy()
        moved[place] += step if x[place] + step <= high else -step
        change = remainder(moved) - here
        of_all = np.linalg.norm(change) * max(abs(x[place]) / step, 1.0)
        if low * high > 0 or not of_all <= _SEEN * acting:
            break
        step *= 10
    return np.asarray(change / (moved[place] - x[place]))


def _errors(found: optimize.OptimizeResult, rows: int) -> FloatArray:
    """Standard errors of what a fit moved, by what it leaves over, or by noise where that is less."""
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance) * max(2 * found.cost / rows, 1.0), 0.0)))


def _numbers(state: ForceBalanceResidual, new: Sequence[ModelCorrection]) -> list[_Number]:
    numbers, links = [], dict.fromkeys(e.enters for e in new if sees_stiffness(e))
    for link in links:
        name = f"{link}.stiffness.k"
        if name in state.balances.names and not state.shares_stiffness(link):
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
            parameters[number.name] = _with_limits(parameters[number.name], Z95 * float(error))
    return replace(effect, parameters=parameters)


def _with_limits(number: Parameter, reach: float) -> Parameter:
    """The number with limits within its range; on the side of an end at which it lies there is none."""
    (lowest, highest), value = number.bounds, number.value
    low = None if value == lowest else max(value - reach, lowest)
    high = None if value == highest else min(value + reach, highest)
    return replace(number, low=low, high=high)
