"""Which run would tell two forces apart that the driven or cycled records at hand cannot.

A run like one at hand, with its motion multiplied: what of the difference between the two forces along that
motion no free number can imitate, over the records at hand and that run together, beyond what is left of it
now, is by how much the run would raise the cost of the rival.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from discovery.explain.free_form import member_of
from discovery.explain.motion import free_numbers
from discovery.residual.force_balance import ForceBalanceResidual
from discovery.separating_tests.normal_sums import NormalSums
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection

_FACTORS: Numerical[tuple[float, ...]] = (2.0, 0.5, 4.0, 0.25)  # of the motion, the mildest first
_STEP: Numerical[float] = 1e-3


def separating_runs(
    best: ModelCorrection, rivals: Sequence[ModelCorrection], residual: ForceBalanceResidual
) -> list[str]:
    """Return for every rival the run, in words, that would tell it from the best effect; empty for none.

    Parameters
    ----------
    best : ModelCorrection
        An effect of the residual's model.
    rivals : sequence of ModelCorrection
        With their fitted numbers.
    residual : ForceBalanceResidual
        Of the refined model.

    Returns
    -------
    list of str
        One for each rival, in their order.
    """
    rules, balances = residual.criteria.acceptance, residual.balances
    runs = [
        (place, factor)
        for factor in _FACTORS
        for place, record in enumerate(balances.records)
        if not record.settings.hold_out
    ]
    here = replace(residual, effects=())
    words = []
    for rival in rivals:
        now = _sums(best, rival, here)
        found = ""
        for place, factor in runs:
            scaled = replace(here, balances=balances.scaled(place, factor))
            own = _sums(best, rival, scaled)
            gain = min((now + own).remainder() - now.remainder(), own.cost)
            needed = max(rules.indistinguishable_cost, rules.indistinguishable_share * _size(best, scaled))
            if np.isfinite(gain) and gain > needed:
                found = _words(residual, place, factor)
                break
        words.append(found)
    return words


def _sums(best: ModelCorrection, rival: ModelCorrection, residual: ForceBalanceResidual) -> NormalSums:
    """Sums over the training rows: what free numbers imitate, and the difference of two forces."""
    rows, force = residual.training, _white(rival, residual)
    columns = [residual.balances.columns[rows] / residual.balances.noise[rows, None]]
    for name in free_numbers(rival, member_of(rival)):
        number = rival.parameters[name]
        step = _STEP * (abs(number.value) or 1.0)
        step = step if number.value + step <= number.bounds[1] else -step
        ahead = _white(rival.with_values(**{name: number.value + step}), residual)
        columns.append(((ahead - force) / step * abs(step) / _STEP)[:, None])
    table, difference = np.concatenate(columns, axis=1), force - _white(best, residual)
    return NormalSums(table.T @ table, table.T @ difference, float(difference @ difference))


def _white(effect: ModelCorrection, residual: ForceBalanceResidual) -> FloatArray:
    return residual.whitened(residual.force_of(effect))[residual.training]


def _size(effect: ModelCorrection, residual: ForceBalanceResidual) -> float:
    """What an effect explains that the model's own numbers cannot."""
    beyond = residual.beyond(residual.whitened(residual.force_of(effect)))
    return float(beyond @ beyond)


def _words(residual: ForceBalanceResidual, place: int, factor: float) -> str:
    record = residual.balances.records[place]
    where = ", ".join(dict.fromkeys(b.place.removeprefix("body:") for b in record.balances))
    verb = "cycle" if record.settings.test == "cycled" else "drive"
    return f"{verb} {where} as in {record.settings.file}, with {factor:g} times its motion"
