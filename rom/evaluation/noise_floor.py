"""The errors that noise alone would make on a set of records: what the true model would score.

Noise of the motion is what its channels show before the hit (`rom.evaluation.record_noise`), noise of a loss
of tension the standard error of its means over both windows. A loss also differs from test to test, which no
law can predict: ``tau`` of the logarithm of the rate. Where the rate goes with T, T_1 = T_0 exp(-x), and

    d ln(T_0 - T_1) = x exp(-x) / (1 - exp(-x)) d ln(rate).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypedDict

import numpy as np
from scipy import stats

from rom.criteria.number import Numerical
from rom.evaluation.error_measures import Comparison, Kind
from rom.evaluation.evaluate import Evaluation
from rom.evaluation.record_noise import RecordNoise

_MEDIAN: Numerical[float] = float(stats.norm.ppf(0.75))  # of the size of a normal number, over its deviation
_MEAN: Numerical[float] = float(np.sqrt(2 / np.pi))


class NoiseFloor(TypedDict):
    """The errors of a set of records that noise alone would make; None where it is not known.

    ``..._with_variability``: that of a law that is right in the mean of all tests.
    """

    motion_nrmse: float | None
    relative_motion_nrmse: float | None
    final_tension_error_percent_mean: float | None
    final_tension_error_percent_median: float | None
    tension_loss_error_percent_median: float | None
    tension_loss_error_percent_median_with_variability: float | None


def noise_floor(comparisons: Iterable[Comparison]) -> NoiseFloor:
    """Return the errors of a set of records that noise alone would make, in the measures of `summarise`.

    Errors of the motion stand for all records or for none: means over others are no floor.

    Parameters
    ----------
    comparisons : iterable of Comparison
        Of the records; those that did not finish do not count.

    Returns
    -------
    NoiseFloor
        In the units of the errors.
    """
    done = [(c, c.noise or RecordNoise()) for c in comparisons if c.finished]
    loosening = [(c, noise) for c, noise in done if c.test == "loosening" and np.isfinite(c.measured_final)]
    final = [100 * _share(noise.loss_error, c.measured_final) for c, noise in loosening]
    loss = [100 * _share(noise.loss_error, c.initial_tension - c.measured_final) for c, noise in loosening]
    spread = [
        100 * noise.rate_deviation * share_of_rate(c.initial_tension, c.measured_final)
        for c, noise in loosening
    ]
    both = np.hypot(loss, spread).tolist()
    return NoiseFloor(
        motion_nrmse=_of_all(
            [noise.motion_nrmse.get(body, np.nan) for c, noise in done for body in c.motion_nrmse]
        ),
        relative_motion_nrmse=_of_all(
            [noise.relative_motion_nrmse for c, noise in done if np.isfinite(c.relative_motion_nrmse)]
        ),
        final_tension_error_percent_mean=_known(np.mean, final, _MEAN),
        final_tension_error_percent_median=_known(np.median, final, _MEDIAN),
        tension_loss_error_percent_median=_known(np.median, loss, _MEDIAN),
        tension_loss_error_percent_median_with_variability=_known(np.median, both, _MEDIAN),
    )


def floors_by_kind(judged: Iterable[Evaluation]) -> dict[Kind, NoiseFloor]:
    """Return the errors that noise alone would make over training and over hold-out records."""
    every = [one for one in judged if one.comparisons]
    training, hold_out = (
        noise_floor(one.comparisons[0] for one in every if one.settings.hold_out is held)
        for held in (False, True)
    )
    return {"training": training, "hold_out": hold_out}


def share_of_rate(initial_n: float, final_n: float) -> float:
    """Return d ln(loss) / d ln(rate): 1 where little of the tension is lost."""
    if not initial_n > final_n > 0:
        return 1.0
    lost = float(np.log(initial_n / final_n))
    return float(lost / np.expm1(lost))


def _of_all(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values and np.isfinite(values).all() else None


def _share(error: float, size: float) -> float:
    return error / abs(size) if size else np.nan


def _known(
    average: Callable[[Sequence[float]], Any], values: Sequence[float], factor: float = 1.0
) -> float | None:
    """Return the average of numbers that are known, times a factor; None where none is."""
    finite = [value for value in values if np.isfinite(value)]
    return factor * float(average(finite)) if finite else None
