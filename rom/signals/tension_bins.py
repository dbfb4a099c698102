"""The course of the tension after a hit: means over time bins, and the covariance of their noise.

A bin's change is its mean tension minus the mean before the hit. Its noise is white noise averaged over the
bin, a random walk and a steady drift since the time before the hit (thermal, of the gauge or of the joint):

    cov_ij = s^2 (delta_ij / n_i + 1 / n_0) + q min(t_i, t_j) + d^2 t_i t_j,   t from the middle of the mean
    before the hit, n samples in a mean.

s, q and d are fitted by maximum likelihood to tests that leave the tension alone, all of a campaign at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize

from rom.campaign.campaign import CampaignSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.signals.processing import Measurement

_SHORTEST_S: Numerical[float] = 3e-3
_SHORTEST_SHARE: Numerical[float] = 1 / 2400  # of the time after a hit, where that is brief
_FEWEST_SAMPLES: Numerical[int] = 8
_BINS: Numerical[int] = 12
_MARGIN_S: Numerical[float] = 0.05  # a late hit does not push the last bin out of the record
_MARGIN_SHARE: Numerical[float] = 1 / 150  # of the time after a hit, where that is brief
_LEAST_QUIET: Numerical[int] = 6
_LEAST_ERROR: Numerical[float] = 1e-6  # [N]; of a record without noise, of a bolt of usual tension:
_USUAL_N: Numerical[tuple[float, float]] = (3.0, 3000.0)  # [N]; of others in proportion
_RIDGE: Numerical[float] = 1e-13  # of all variances: drift alone is one direction, rounding makes it none
_TINY: Numerical[float] = 1e-24


@dataclass(frozen=True, eq=False)
class TensionBins:
    """Changes of the mean tension [N] in time bins against the mean before them.

    Attributes
    ----------
    edges_s : ndarray, shape (bins + 1,)
        From the record's first sample [s], half a sample before the first of a bin: a mean over samples is
        then the mean over the time between edges.
    change : ndarray, shape (bins,)
        Mean in the bin minus the mean before [N].
    counts : ndarray, shape (bins,)
        Samples in each mean; `count_before`: in the mean before.
    lag_s : ndarray, shape (bins,)
        From the middle of the mean before to the middle of each bin [s].
    slope : float
        dT/d(strain) there [N per unit of strain]: from strain noise to tension noise.
    level : float
        Size of the mean before [N].
    """

    edges_s: FloatArray
    change: FloatArray
    counts: FloatArray
    count_before: int
    lag_s: FloatArray
    slope: float
    rate_hz: float
    level: float = 100.0


@dataclass(frozen=True)
class CourseNoise:
    """Variances of white noise (a sample), random walk (a second) and drift (a second squared).

    In units of strain, times the calibration's slope squared; drift and walk in newton where `of_tension`.
    """

    white: float
    walk: float
    drift: float
    of_tension: bool

    def covariance(self, bins: TensionBins) -> FloatArray:
        """Covariance [N^2] of the changes of a record, (bins, bins)."""
        square = bins.slope**2
        slow = self.walk * np.minimum.outer(bins.lag_s, bins.lag_s)
        slow = slow + self.drift * np.multiply.outer(bins.lag_s, bins.lag_s)
        white = self.white * square * (np.diag(1 / bins.counts) + 1 / max(bins.count_before, 1))
        own = max(bins.level, _TINY) / float(np.clip(bins.level, *_USUAL_N))
        floor = (_LEAST_ERROR * own) ** 2 * np.eye(len(bins.counts))
        total = white + slow * (1.0 if self.of_tension else square) + floor
        return np.asarray(total + _RIDGE * np.trace(total) * np.eye(len(bins.counts)))


@dataclass(frozen=True, eq=False)
class TensionCourse:
    """One loosening test: the hit, and the course of the tension after it.

    `preload` [N] groups repeated tests; `force` [N] runs from the record's first sample to the end of what is
    compared; `final` is the mean over the campaign's final window, with its standard error. `given` are
    masses and stiffnesses of this record alone, by path.
    """

    file: str
    hold_out: bool
    preload: float
    body: str
    force: FloatArray
    rate_hz: float
    impact_s: float
    initial: float
    edges_s: FloatArray
    change: FloatArray
    covariance: FloatArray
    tension_rate_hz: float
    final_window: tuple[float, float]
    final: float
    final_error: float
    given: Mapping[str, float] = field(default_factory=dict)


def bins_after_hit(measurement: Measurement, settings: CampaignSettings) -> TensionBins | None:
    """Return the changes after the hit, in bins that widen from 3 ms to seconds, from less where the time
    after the hit is brief; None without hit or tension.

    The bins' places after the hit are the same in every record of a campaign; those that a record, or the
    final window, does not hold whole are left out.
    """
    tension, impact = measurement.tension, measurement.impact_s
    if tension is None or impact is None:
        return None
    end = settings.windows.final_s[1]
    after = end - settings.sampling.pretrigger_s
    offsets = _offsets(after - min(_MARGIN_S, _MARGIN_SHARE * after), tension.rate_hz)
    within = impact + offsets <= min(end, len(tension.samples) / tension.rate_hz)
    before = settings.windows.initial_s
    before = (before[0], min(before[1], impact))
    return _binned(measurement, impact + offsets[within], before)


def bins_before_hit(measurement: Measurement) -> TensionBins | None:
    """Return the changes before the hit, where nothing happens: the first quarter is the mean before."""
    tension, impact = measurement.tension, measurement.impact_s
    if tension is None or impact is None:
        return None
    quiet = 0.95 * impact
    return _binned(measurement, 0.25 * quiet + _offsets(0.75 * quiet, tension.rate_hz), (0.0, 0.25 * quiet))


def _offsets(length_s: float, rate_hz: float) -> FloatArray:
    shortest = max(min(_SHORTEST_S, _SHORTEST_SHARE * length_s), _FEWEST_SAMPLES / rate_hz)
    if length_s <= 2 * shortest:
        return np.zeros(1)
    return np.concatenate([[0.0], np.geomspace(shortest, length_s, _BINS)])


def _binned(
    measurement: Measurement, edges_s: FloatArray, before_s: tuple[float, float]
) -> TensionBins | None:
    tension = measurement.tension
    if tension is None or len(edges_s) < 2:
        return None
    rate = tension.rate_hz
    first, last = (int(t * rate) for t in before_s)
    places = np.round(edges_s * rate).astype(int)
    if last - first < _FEWEST_SAMPLES or np.any(np.diff(places) < 1):
        return None
    total = np.concatenate([[0.0], np.cumsum(tension.samples)])
    counts = np.diff(places)
    mean_before = (total[last] - total[first]) / (last - first)
    return TensionBins(
        (places - 0.5) / rate,
        np.diff(total[places]) / counts - mean_before,
        counts.astype(float),
        last - first,
        0.5 * (edges_s[1:] + edges_s[:-1]) - 0.5 * (before_s[0] + before_s[1]),
        tension.slope,
        rate,
        abs(float(mean_before)),
    )


def course_noise(coupled: Sequence[TensionBins], before: Sequence[TensionBins]) -> CourseNoise | None:
    """Fit the noise to tests that leave the tension alone, or, where they are few, to the time before hits.

    Whether walk and drift are of the strain or of the tension is decided by the likelihood.
    """
    quiet = coupled if len(coupled) >= _LEAST_QUIET else [*coupled, *before]
    if not quiet:
        return None
    fits = [_fitted(quiet, of_tension) for of_tension in (False, True)]
    return min(fits, key=lambda fit: fit[0])[1]


def _fitted(quiet: Sequence[TensionBins], of_tension: bool) -> tuple[float, CourseNoise]:
    slope = 1.0 if of_tension else float(np.median([bins.slope for bins in quiet]))
    white = np.median([np.mean(b.change**2 * b.counts) / b.slope**2 for b in quiet]) + _TINY
    slow = np.median([np.mean(b.change**2) for b in quiet]) / slope**2 + _TINY
    lag = float(np.median([bins.lag_s[-1] for bins in quiet]))
    start: FloatArray = np.log(np.array([0.5 * white, 0.1 * slow / lag, 0.1 * slow / lag**2]))

    def noise(logs: FloatArray) -> CourseNoise:
        white, walk, drift = (float(v) for v in np.exp(np.clip(logs, start - 25, start + 25)))
        return CourseNoise(white, walk, drift, of_tension)

    stacks = _stacked(quiet, of_tension)

    def deviance(logs: FloatArray) -> float:
        trial = noise(logs)
        return sum(stack.deviance(trial) for stack in stacks)

    found = optimize.minimize(
        deviance, start, method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.02, "maxiter": 400}
    )
    return float(found.fun), noise(np.asarray(found.x))


@dataclass(frozen=True, eq=False)
class _Stack:
    """Changes of records with as many bins, and what variances of one make of their covariance."""

    change: FloatArray  # (records, bins, 1)
    units: FloatArray  # white, walk, drift and the floor, (4, records, bins, bins)

    def deviance(self, noise: CourseNoise) -> float:
        """Twice the negative logarithm of the likelihood, less a constant."""
        variances = np.array([noise.white, noise.walk, noise.drift, 1.0])
        matrices = np.einsum("u,urij->rij", variances, self.units)
        sizes = np.einsum("rii->r", matrices)[:, None, None]
        root = np.linalg.cholesky(matrices + _RIDGE * sizes * np.eye(matrices.shape[1]))
        scaled = np.linalg.solve(root, self.change)
        return float((scaled**2).sum()) + 2 * float(np.log(np.einsum("rii->ri", root)).sum())


def _stacked(quiet: Sequence[TensionBins], of_tension: bool) -> list[_Stack]:
    none = CourseNoise(0.0, 0.0, 0.0, of_tension)
    ones = replace(none, white=1.0), replace(none, walk=1.0), replace(none, drift=1.0)
    stacks = []
    for size in sorted({len(bins.change) for bins in quiet}):
        alike = [bins for bins in quiet if len(bins.change) == size]
        floor = np.stack([none.covariance(bins) for bins in alike])
        units = [np.stack([one.covariance(bins) for bins in alike]) - floor for one in ones]
        change = np.stack([bins.change for bins in alike])[:, :, None]
        stacks.append(_Stack(change, np.stack([*units, floor])))
    return stacks
