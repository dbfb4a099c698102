"""Limits of an effect's numbers from closures of simulated campaigns: bias removed, width calibrated.

The refined model, with numbers p and half-widths h of their limits, is the truth of every replicate; one that
names the effect again finds p* with h*. The studentised errors

    z* = (p* - p) / h*

have mean m and standard deviation s over n replicates. Bias is h m, and the limits are

    p - h m +- t_(n-1) s (1 + 1 / n)^(1/2) h:

what half-widths lack is made up by s, as in the first step of prepivoting (R. Beran, Biometrika 74, 457,
1987). They are never narrower than the closure's own, p +- h: records differ by more than is drawn, which
shows in h, not in z*. Student's t stands for the quantiles of z*: of 40
replicates the outermost are no 95 % limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from discovery.criteria.bootstrap import Bootstrap

Data = Mapping[str, Any]


def bootstrap_limits(
    closure: Data, replicates: Sequence[Data], failed: int = 0, criteria: Bootstrap | None = None
) -> dict[str, Any]:
    """Return what closures of simulated campaigns say of a closure.

    Parameters
    ----------
    closure : mapping
        Content of ``closure.json``, whose refined model was simulated.
    replicates : sequence of mapping
        The same of every simulated campaign.
    failed : int
        Simulated campaigns that could not be closed.
    criteria : Bootstrap, optional
        The numbers that decide.

    Returns
    -------
    dict
        How many replicates there are, how many name any effect, and for every effect how many name it first
        and at all, and the limits of its numbers.
    """
    rules = criteria or Bootstrap()
    return {
        "replicates": len(replicates),
        "failed": failed,
        "named_any": sum(bool(one["effects"]) for one in replicates),
        "effects": [_of_effect(effect, replicates, rules) for effect in closure["effects"]],
    }


def _of_effect(effect: Data, replicates: Sequence[Data], rules: Bootstrap) -> dict[str, Any]:
    named = [_same(effect, one["effects"]) for one in replicates]
    again = [one for one in named if one is not None]
    first = sum(_same(effect, one["effects"][:1]) is not None for one in replicates)
    return {
        "name": effect["name"],
        "enters": effect["enters"],
        "first": first,
        "named": len(again),
        "parameters": {
            name: _of_number(parameter, [one["parameters"].get(name) for one in again], rules)
            for name, parameter in effect["parameters"].items()
            if not parameter.get("of_records")
        },
    }


def _same(effect: Data, among: Sequence[Data]) -> Data | None:
    place = (effect["name"], effect["enters"])
    return next((one for one in among if (one["name"], one["enters"]) == place), None)


def _of_number(parameter: Data, found: Sequence[Data | None], rules: Bootstrap) -> dict[str, Any]:
    """Bias and limits of one number; None where too few replicates have limits of it."""
    value, half = parameter["value"], _half_width(parameter)
    pairs = [(one["value"], _half_width(one)) for one in found if one is not None]
    errors = np.array([(at - value) / width for at, width in pairs if width])
    row = {"value": value, "low": None, "high": None, "unit": parameter["unit"], "bias": None}
    if not half or len(errors) < rules.fewest:
        return row | {"replicates": len(errors)}
    count, bias = len(errors), half * float(errors.mean())
    quantile = float(stats.t.ppf((1 + rules.level) / 2, count - 1)) * np.sqrt(1 + 1 / count)
    width = half * max(float(errors.std(ddof=1)) * quantile, 1.0)
    best = value - bias
    limits = {"value": best, "low": best - width, "high": best + width, "bias": bias}
    return row | limits | {"replicates": count}


def _half_width(parameter: Data) -> float:
    """Half the width of a number's limits; 0 where it has none, as at an end of its range."""
    low, high = parameter["low"], parameter["high"]
    return 0.0 if low is None or high is None else (high - low) / 2
