"""The errors that noise alone would make on a set of records: what the true model would score.

Noise of the motion is what its channels show before the hit (`rom.evaluation.record_noise`), noise of a loss
of tension the standard error of its means over both windows. A loss also differs from test to test, which no
law can predict: ``tau`` of the logarithm of the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypedDict

import numpy as np
from scipy import stats

from rom.criteria.number import Numerical
from rom.evaluation.error_measures import Comparison

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
    """Return the errors of a set of records that noise alone would make, in the measures of `summarise`."""
    done = [(c, c.noise) for c in comparisons if c.finished and c.noise is not None]
    loosening = [(c, noise) for c, noise in done if c.test == "loosening" and np.isfinite(c.measured_final)]
    final = [100 * _share(noise.loss_error, c.measured_final) for c, noise in loosening]
    loss = [100 * _share(noise.loss_error, c.initial_tension - c.measured_final) for c, noise in loosening]
    spread = [100 * noise.rate_deviation for _, noise in loosening]
    both = np.hypot(loss, spread).tolist()
    return NoiseFloor(
        motion_nrmse=_known(np.mean, [value for _, noise in done for value in noise.motion_nrmse.values()]),
        relative_motion_nrmse=_known(np.mean, [noise.relative_motion_nrmse for _, noise in done]),
        final_tension_error_percent_mean=_known(np.mean, final, _MEAN),
        final_tension_error_percent_median=_known(np.median, final, _MEDIAN),
        tension_loss_error_percent_median=_known(np.median, loss, _MEDIAN),
        tension_loss_error_percent_median_with_variability=_known(np.median, both, _MEDIAN),
    )


def _share(error: float, size: float) -> float:
    return error / abs(size) if size else np.nan


def _known(
    average: Callable[[Sequence[float]], Any], values: Sequence[float], factor: float = 1.0
) -> float | None:
    """Return the average of numbers that are known, times a factor; None where none is."""
    finite = [value for value in values if np.isfinite(value)]
    return factor * float(average(finite)) if finite else None
