"""The errors that noise alone would make on a set of records: what the true model would score.

Noise of the motion and of the tension is what their channels show before the hit
(`rom.evaluation.record_noise`), noise of a loss the standard error of its means over both windows. A loss
also differs from test to test, which no law can predict: ``tau`` of the logarithm of the rate. Where the rate
goes with T, T_1 = T_0 exp(-x), and

    d ln(T_0 - T_1) = x exp(-x) / (1 - exp(-x)) d ln(rate).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypedDict, cast

import numpy as np
from scipy import stats

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.error_measures import Comparison, Kind
from rom.evaluation.evaluate import Evaluation
from rom.evaluation.record_noise import MEDIAN, RecordNoise

_MEAN: Numerical[float] = float(np.sqrt(2 / np.pi))
_QUANTILES: Numerical[int] = 400  # of a normal number, over which a mean is taken
_FARTHEST: Numerical[float] = 6.0  # standard deviations


class NoiseFloor(TypedDict):
    """The errors of a set of records that noise alone would make; None where it is not known.

    ``..._with_variability``: that of a law that is right in the mean of all tests.
    """

    motion_nrmse: float | None
    relative_motion_nrmse: float | None
    link_force_nrmse: float | None
    final_tension_error_percent_mean: float | None
    final_tension_error_percent_mean_with_variability: float | None
    final_tension_error_percent_median: float | None
    final_tension_error_percent_median_with_variability: float | None
    final_tension_error_percent_max: float | None
    final_tension_error_percent_max_with_variability: float | None
    tension_loss_error_percent_median: float | None
    tension_loss_error_percent_median_with_variability: float | None
    tension_rmse_n: float | None
    tension_rmse_n_with_variability: float | None


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
    motion = {
        "motion_nrmse": _of_all(
            [noise.motion_nrmse.get(body, np.nan) for c, noise in done for body in c.motion_nrmse]
        ),
        "relative_motion_nrmse": _of_all(
            [noise.relative_motion_nrmse for c, noise in done if np.isfinite(c.relative_motion_nrmse)]
        ),
        "link_force_nrmse": _of_all(
            [noise.link_force_nrmse for c, noise in done if np.isfinite(c.link_force_nrmse)]
        ),
    }
    loosening = [(c, noise) for c, noise in done if c.test == "loosening" and np.isfinite(c.measured_final)]
    at_rest = [noise.tension_rms for c, noise in done if c.test == "hold"]
    tension = _of_tensions(loosening)
    if not loosening:
        tension["tension_rmse_n"] = _known(np.mean, at_rest)
    return cast(NoiseFloor, motion | tension)


def _of_tensions(loosening: Sequence[tuple[Comparison, RecordNoise]]) -> dict[str, float | None]:
    """Floors of the tension's measures: of noise alone, and with what differs between tests."""
    table = [
        (c.measured_final, c.initial_tension - c.measured_final, noise.loss_error, noise.tension_rms)
        for c, noise in loosening
    ]
    final, loss, error, rms = np.array(table, dtype=np.float64).reshape(-1, 4).T
    between = np.array(
        [n.rate_deviation * share_of_rate(c.initial_tension, c.measured_final) for c, n in loosening]
    )
    lost = np.array([n.lost_rms for _, n in loosening])
    found: dict[str, float | None] = {}
    for ending, spread in (("", np.zeros(len(loosening))), ("_with_variability", between)):
        size = np.hypot(error, spread * loss)
        of_final = 100 * _over(size, final)
        found |= {
            f"final_tension_error_percent_mean{ending}": _known(np.mean, of_final, _MEAN),
            f"final_tension_error_percent_median{ending}": _known(np.median, of_final, MEDIAN),
            f"final_tension_error_percent_max{ending}": _known(_largest, of_final),
            f"tension_loss_error_percent_median{ending}": _known(np.median, 100 * _over(size, loss), MEDIAN),
            f"tension_rmse_n{ending}": _known(np.mean, _mean_size(rms, spread * lost)),
        }
    return found


def _over(sizes: FloatArray, of: FloatArray) -> FloatArray:
    shares: FloatArray = np.full(len(sizes), np.nan)
    return np.divide(sizes, np.abs(of), out=shares, where=of != 0)


def _mean_size(fixed: FloatArray, spread: FloatArray) -> FloatArray:
    """Mean of sqrt(fixed^2 + (spread u)^2), u a normal number."""
    u = stats.norm.ppf((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    return np.asarray(np.hypot(fixed[:, None], spread[:, None] * u).mean(axis=1))


def _largest(deviations: FloatArray) -> float:
    """Mean of the largest size among normal numbers of these standard deviations."""
    size, weight = np.linspace(0, _FARTHEST * np.max(deviations), _QUANTILES, retstep=True)
    below = np.prod(
        [2 * stats.norm.cdf(size / max(one, np.finfo(float).tiny)) - 1 for one in deviations], axis=0
    )
    return float(np.sum(1 - below) * weight)


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


def _known(
    average: Callable[[FloatArray], Any], values: Sequence[float] | FloatArray, factor: float = 1.0
) -> float | None:
    """Return the average of numbers that are known, times a factor; None where none is."""
    finite = np.array([value for value in values if np.isfinite(value)])
    return factor * float(average(finite)) if len(finite) else None
