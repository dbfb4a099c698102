"""Fits of a model of simulated records with its effects, all numbers and states beside each other.

A fit of one more effect starts with parts of the records, each from a state of its own, so short that the
phase is not lost, and goes on over ever longer ones.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from discovery.decide.explanation import limited, standard_errors
from discovery.explain.free_form import member_of
from discovery.explain.motion import free_numbers
from discovery.explain.wider_ranges import WIDENINGS, widened
from discovery.residual.base import cost
from discovery.residual.simulation import Fit, SimulationResidual, refitted
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection

_DAMPINGS: Numerical[tuple[float, ...]] = (1.0, 0.5)  # shares of the dampings at which a fit starts
_SHORT: Numerical[int] = 8  # rounds of slopes that tell which start is best
_OF_TENSION = re.compile(r"\bT\b")


def fitted(
    residual: SimulationResidual, starts: Sequence[ModelCorrection], parts: SimulationResidual | None = None
) -> SimulationResidual:
    """Return the residual with one more effect, all numbers fitted.

    Parameters
    ----------
    residual : SimulationResidual
        Of the model so far.
    starts : sequence of ModelCorrection
        The effect at one place or more; the fit goes on from where it suits parts of the records best.
    parts : SimulationResidual or None
        ``residual.in_parts()``, where that is known.
    """
    own = bool(member_of(starts[0]).starts)
    near = residual.in_first_parts() if own else parts or residual.in_parts()
    return together(_over_all(residual, _begun(near, starts)))


def _over_all(residual: SimulationResidual, begun: SimulationResidual) -> SimulationResidual:
    """All records with the model of a fit to parts; where these are short, fitted to longer ones before."""
    near = residual.of_model(begun.model)
    if not residual.is_out_of_phase:
        return near
    return residual.of_model(together(near.in_parts(), _SHORT).model)


def _begun(parts: SimulationResidual, starts: Sequence[ModelCorrection]) -> SimulationResidual:
    """A short fit of one more effect to parts of the records, from the start that suits them best.

    A linear damping has taken the place of what is missing: fits start with all of it and with half, unless
    balances of forces have told it.
    """
    shares = _DAMPINGS[:1] if parts.thorough else _DAMPINGS
    dampings = {path: parts.model.parameter(path).value for path in parts.names if path.endswith(".c")}
    found = []
    for effect, share in product(starts, shares):
        model = parts.model.with_values({path: share * value for path, value in dampings.items()})
        found.append(together(replace(parts, model=model.with_effect(effect)), _SHORT))
    return min(found, key=cost)


def together(residual: SimulationResidual, rounds: int | None = None) -> SimulationResidual:
    """All numbers fitted again beside each other; effects with 95 % limits.

    Numbers of effects that end where their range does are fitted again in a wider one.
    """
    after = _fitted_within_ranges(residual, rounds)
    factor, rate_hz = residual.criteria.tension.wider_range, max(r.row_rate_hz for r in residual.rings)
    for _ in range(WIDENINGS):
        wider = widened(after.model.effects, factor, rate_hz)
        if wider is None:
            break
        after = _fitted_within_ranges(replace(after, model=replace(after.model, effects=wider)), rounds)
    return after


def _fitted_within_ranges(residual: SimulationResidual, rounds: int | None) -> SimulationResidual:
    effects = residual.model.effects
    fit = refitted(residual, {effect.path: shown_numbers(effect, residual) for effect in effects}, rounds)
    errors, after = errors_of(fit), fit.residual
    with_limits = tuple(
        limited(
            effect, {n: errors[path] for n in effect.parameters if (path := f"{effect.path}.{n}") in errors}
        )
        for effect in after.model.effects
    )
    return replace(after, model=replace(after.model, effects=with_limits))


def errors_of(fit: Fit) -> dict[str, float]:
    """Standard errors by path, the larger of those of single rows and of blocks of rows that err as one.

    Those beside a number that a bound holds are those of a fit without it.
    """
    model, columns = fit.residual.model, np.arange(fit.slopes.shape[1])
    held = [
        k for k, path in enumerate(fit.paths) if model.parameter(path).value in model.parameter(path).bounds
    ]
    errors = _errors_of(fit, columns)
    free = np.setdiff1d(columns, held)
    errors[free] = _errors_of(fit, free)
    return dict(zip(fit.paths, errors.tolist(), strict=False))


def _errors_of(fit: Fit, columns: npt.NDArray[np.int64]) -> FloatArray:
    """Standard errors of the numbers of some columns of the slopes, the others held."""
    slopes = fit.slopes[:, columns]
    tiny = np.finfo(float).tiny
    largest = np.maximum(np.abs(slopes).max(axis=0, initial=0.0), tiny)
    # squares of slopes by a number next to zero overflow
    size = np.maximum(largest * np.linalg.norm(slopes / largest, axis=0), tiny)
    table = slopes / size
    inverse = np.asarray(np.linalg.pinv(table.T @ table, rcond=1e-12, hermitian=True))
    spread = max(float(fit.rows @ fit.rows) / len(fit.rows), 1.0)
    pieces = fit.residual.pieces
    scores = np.stack([np.bincount(pieces, weights=column * fit.rows) for column in table.T], axis=1)
    of_units = standard_errors(inverse, np.asarray(scores, dtype=np.float64), spread)
    with np.errstate(over="ignore"):  # what shows next to nothing has errors without an end
        return np.asarray(of_units / size)


def shown_numbers(effect: ModelCorrection, residual: SimulationResidual) -> tuple[str, ...]:
    """Numbers that a fit moves; a factor of the tension shows nothing without one."""
    names = free_numbers(effect, member_of(effect))
    if residual.model.structure.bolted_links:
        return names
    return tuple(n for n in names if not _OF_TENSION.search(_terms_of(n, effect.equation)))


def _terms_of(name: str, equation: str) -> str:
    """What a number is multiplied with at once, wherever it stands in an equation."""
    return " ".join(re.findall(rf"\b{name}\b\s*\*\s*(\w+)", equation))
