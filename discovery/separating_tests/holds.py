"""How much longer a bolt should be watched at rest for two readings to be told apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discovery.residual.at_rest import RestResidual
from discovery.residual.rest_records import RestRecord
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection, Reading

_LONGER: Numerical[tuple[float, ...]] = (2.0, 4.0, 8.0, 16.0, 32.0)
_POINTS: Numerical[int] = 512
_STEP: Numerical[float] = 1e-3


def longer_rests(
    effect: ModelCorrection, rivals: Sequence[ModelCorrection], residual: RestResidual
) -> list[str]:
    """Return for each rival how long a record would show the difference, in words.

    Its cost between the two beside noise as in the longest training record, were that as much longer, is that
    by which effects are told apart.

    Parameters
    ----------
    effect : ModelCorrection
        As it was found.
    rivals : sequence of ModelCorrection
        What is indistinguishable from it.
    residual : RestResidual
        Of the model with the effect.

    Returns
    -------
    list of str
        One for each rival.
    """
    train = [(r, v) for r, v in zip(residual.records, residual.variances, strict=True)
             if not r.settings.hold_out]  # fmt: skip
    record, variance = max(train, key=lambda one: one[0].duration_s)
    least = residual.criteria.acceptance.indistinguishable_cost
    found = []
    for rival in rivals:
        longer = (t for t in _LONGER if _apart(effect, rival, record, variance, t) > least)
        times = next(longer, None)
        found.append(
            "no record at rest of 32 times the length separates them"
            if times is None
            else f"a record at rest of {times * record.duration_s:.3g} s"
        )
    return found


def _apart(
    effect: ModelCorrection, rival: ModelCorrection, record: RestRecord, variance: FloatArray, times: float
) -> float:
    """Cost of what the rival, fitted anew, lacks in a record that is so many times as long."""
    assert isinstance(effect, Reading)
    assert isinstance(rival, Reading)
    time = np.linspace(0.0, times * record.duration_s, _POINTS)
    shown = rival.at_rest(time)
    columns = [np.ones_like(time)]
    for name, number in rival.parameters.items():
        step = _STEP * (abs(number.value) or number.bounds[1])
        step = step if number.value + step <= number.bounds[1] else -step
        columns.append((rival.with_values(**{name: number.value + step}).at_rest(time) - shown) / step)
    basis = np.linalg.qr(np.stack(columns, axis=1))[0]
    difference = effect.at_rest(time) - shown
    rest = difference - basis @ (basis.T @ difference)
    of_mean = float(np.mean(variance[: record.slow])) / (len(record.time) * times)  # of a slow change [N^2]
    return float(np.mean(rest**2)) / of_mean
