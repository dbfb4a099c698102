"""Error of a model on measured records: the measures by which models are compared, like with like.

A simulated response is turned into the quantity that was measured, passes through the same filter chain and
the same tension windows, and only then is a difference taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, TypedDict

import numpy as np
from scipy import linalg

from rom.campaign.campaign import WindowSettings
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.at_rest import held_tension
from rom.evaluation.bands import NO_BAND, TensionBand, tension_band
from rom.evaluation.record_noise import RecordNoise, from_sample_to_sample, noise_of
from rom.evaluation.replay import (
    Replay,
    displacements,
    driven_forces,
    replay,
    shown_tension,
    simulate_measurement,
    tension_known,
    window_mean,
)
from rom.model.model import Model
from rom.signals.processing import Measurement

__all__ = [
    "Comparison",
    "Errors",
    "ErrorsByKind",
    "Kind",
    "compare",
    "compare_all",
    "simulate_measurement",
    "summarise",
]

_SIDE_BY_SIDE: Numerical[int] = 8  # models whose responses are in memory at once
_MOTION_TESTS = ("uncoupled", "coupled", "loosening", "free", "driven")


class Errors(TypedDict):
    """The error measures of a model on a set of records; None where there is nothing to measure."""

    motion_nrmse: float | None
    relative_motion_nrmse: float | None
    final_tension_error_percent_mean: float | None
    final_tension_error_percent_median: float | None
    final_tension_error_percent_max: float | None
    tension_loss_error_percent_median: float | None
    link_force_nrmse: float | None
    tension_rmse_n: float | None
    tension_course_within_band: float | None
    records: int
    failed: int


Kind = Literal["training", "hold_out"]
ErrorsByKind = Mapping[Kind, Errors]


@dataclass(frozen=True)
class Comparison:
    """Simulated against measured for one record; tensions in N, nan where not measured or not asked for.

    `band` is where the tension of one new test lies, `noise` the errors that noise alone makes.
    """

    file: str
    test: str
    finished: bool
    motion_nrmse: Mapping[str, float]
    relative_motion_nrmse: float = np.nan
    link_force_nrmse: float = np.nan
    initial_tension: float = np.nan
    measured_final: float = np.nan
    simulated_final: float = np.nan
    tension_rmse: float = np.nan
    band: TensionBand = NO_BAND
    noise: RecordNoise | None = None

    @property
    def final_error_percent(self) -> float:
        """Return 100 |simulated final - measured final| / |measured final| (the paper's measure)."""
        return _percent(self.simulated_final - self.measured_final, self.measured_final)

    @property
    def simulated_loss(self) -> float:
        """Return initial minus simulated final tension [N]."""
        return self.initial_tension - self.simulated_final

    @property
    def loss_error_percent(self) -> float:
        """Return 100 |simulated loss - measured loss| / |measured loss|."""
        return _percent(
            self.simulated_final - self.measured_final, self.initial_tension - self.measured_final
        )


def compare(model: Model, measurement: Measurement, windows: WindowSettings) -> Comparison:
    """Compare a model with one record.

    Parameters
    ----------
    model : Model
        The model.
    measurement : Measurement
        The record as processed.
    windows : WindowSettings
        Windows of the initial and the final tension [s].

    Returns
    -------
    Comparison
        Errors of the model.
    """
    return compare_all([model], measurement, windows)[0]


def compare_all(
    models: Sequence[Model], measurement: Measurement, windows: WindowSettings, bands: bool = False
) -> tuple[Comparison, ...]:
    """Compare models with one record; what is filtered goes side by side.

    Faults of sensors that a model holds are taken out of the record for it, and numbers that are each
    record's own are estimated from before the impact (``rom.evaluation.replay``).

    Parameters
    ----------
    models : sequence of Model
        The models.
    measurement : Measurement
        The record as processed.
    windows : WindowSettings
        Windows of the initial and the final tension [s].
    bands : bool
        Whether to simulate the bands of the first model's tension too.

    Returns
    -------
    tuple
        A comparison for each model.
    """
    nothing = Comparison(measurement.file, measurement.test, True, {})
    if measurement.test == "cycled":
        return tuple(_of_cycled(nothing, model, measurement) for model in models)
    if measurement.test == "hold":
        return tuple(_of_rest(nothing, model, measurement, windows) for model in models)
    noise = cache(lambda pair: noise_of(measurement, pair))  # the record's, whatever model it is
    starts = range(0, len(models), _SIDE_BY_SIDE)
    return tuple(
        found
        for start in starts
        for found in _of_motion(
            nothing, models[start : start + _SIDE_BY_SIDE], measurement, windows, bands and not start, noise
        )
    )


def _of_motion(
    nothing: Comparison,
    models: Sequence[Model],
    measurement: Measurement,
    windows: WindowSettings,
    bands: bool,
    noise: Callable[[tuple[str, str] | None], RecordNoise],
) -> list[Comparison]:
    replays = {
        place: replay(model, measurement)
        for place, model in enumerate(models)
        if measurement.test in _MOTION_TESTS and tension_known(model, measurement)
    }
    finished = [run for run in replays.values() if run.response.status == "ok"]
    motions = iter(displacements(finished))
    found = []
    for place, model in enumerate(models):
        run, comparison = replays.get(place), nothing
        if run is not None and run.response.status != "ok":
            comparison = replace(nothing, finished=False)
        elif run is not None:
            simulated, pair = next(motions), _coupled_pair(model)
            moved = _with_motion(nothing, pair, run.measurement, simulated)
            comparison = _with_tension(moved, run, windows)
            own = noise(pair)
            if not own.motion_nrmse:
                own = _with_white_noise(own, pair, run.measurement, simulated)
            comparison = replace(
                comparison,
                noise=_with_rate(own, model, comparison.initial_tension),
                band=tension_band(run, windows.final_s, own.tension_rms) if bands and not place else NO_BAND,
            )
        found.append(comparison)
    return found


def _with_motion(
    comparison: Comparison,
    pair: tuple[str, str] | None,
    measurement: Measurement,
    simulated: Mapping[str, FloatArray],
) -> Comparison:
    body, relative = _of_displacements(_nrmse, pair, measurement, simulated)
    return replace(comparison, motion_nrmse=body, relative_motion_nrmse=relative)


def _with_white_noise(
    noise: RecordNoise,
    pair: tuple[str, str] | None,
    measurement: Measurement,
    simulated: Mapping[str, FloatArray],
) -> RecordNoise:
    """Noise of displacements that no filter changes, where no rest before a hit shows it."""
    unfiltered = measurement.chain.band_hz is None
    if not unfiltered or any(motion.kind != "displacement" for motion in measurement.motion.values()):
        return noise
    body, relative = _of_displacements(_white_share, pair, measurement, simulated)
    return replace(noise, motion_nrmse=body, relative_motion_nrmse=relative)


def _of_displacements(
    measure: Callable[[FloatArray, FloatArray], float],
    pair: tuple[str, str] | None,
    measurement: Measurement,
    simulated: Mapping[str, FloatArray],
) -> tuple[dict[str, float], float]:
    """Return a measure of each body's displacement from the hit on, and of that of a pair."""
    start = int((measurement.impact_s or 0.0) * measurement.rate_hz)
    measured = {body: measurement.displacement(body) for body in measurement.motion}
    of_body = {body: measure(simulated[body][start:], measured[body][start:]) for body in measured}
    if pair is None or not set(pair) <= set(measured):
        return of_body, np.nan
    first, second = pair
    shown, seen = simulated[first] - simulated[second], measured[first] - measured[second]
    return of_body, measure(shown[start:], seen[start:])


def summarise(comparisons: Iterable[Comparison]) -> Errors:
    """Return the error measures over a set of records; a simulation that failed is counted, not averaged.

    The tension's is that of loosening records, or of bolts at rest where no record loosens.
    """
    every = list(comparisons)
    done = [c for c in every if c.finished]
    loosening = [c for c in done if c.test == "loosening" and np.isfinite(c.measured_final)]
    final = [c.final_error_percent for c in loosening]
    tensions = loosening or [c for c in done if c.test == "hold"]
    return Errors(
        motion_nrmse=_finite_mean([value for c in done for value in c.motion_nrmse.values()]),
        relative_motion_nrmse=_finite_mean([c.relative_motion_nrmse for c in done]),
        final_tension_error_percent_mean=_finite_mean(final),
        final_tension_error_percent_median=_finite_median(final),
        final_tension_error_percent_max=max((v for v in final if np.isfinite(v)), default=None),
        tension_loss_error_percent_median=_finite_median([c.loss_error_percent for c in loosening]),
        link_force_nrmse=_finite_mean([c.link_force_nrmse for c in done]),
        tension_rmse_n=_finite_mean([c.tension_rmse for c in tensions]),
        tension_course_within_band=_finite_mean([c.band.course_within for c in loosening]),
        records=len(every),
        failed=len(every) - len(done),
    )


def _of_cycled(comparison: Comparison, model: Model, measurement: Measurement) -> Comparison:
    forces = driven_forces(model, measurement)
    if not forces:
        return comparison
    values, noise = (
        float(np.mean([measure(simulated, measured) for simulated, measured in forces.values()]))
        for measure in (_nrmse, _white_share)
    )
    return replace(comparison, link_force_nrmse=values, noise=RecordNoise(link_force_nrmse=noise))


def _of_rest(
    comparison: Comparison, model: Model, measurement: Measurement, windows: WindowSettings
) -> Comparison:
    if measurement.tension is None:
        return comparison
    shown, tension = held_tension(model, measurement)
    return replace(
        comparison,
        initial_tension=tension.initial,
        measured_final=tension.final,
        simulated_final=window_mean(shown, tension.rate_hz, windows.final_s),
        tension_rmse=float(np.sqrt(np.mean((shown - tension.samples) ** 2))),
        noise=RecordNoise(tension_rms=from_sample_to_sample(shown - tension.samples)),
    )


def _coupled_pair(model: Model) -> tuple[str, str] | None:
    """Return the bodies of the bolted link, or of the first link between two bodies."""
    links = [link for link in model.structure.links if "ground" not in (link.first, link.second)]
    bolted = [link for link in links if link.law == "bolted"]
    chosen = (bolted or links)[:1]
    return (chosen[0].first, chosen[0].second) if chosen else None


def _with_tension(comparison: Comparison, run: Replay, windows: WindowSettings) -> Comparison:
    tension, impact_s = run.measurement.tension, run.measurement.impact_s
    if tension is None or not isinstance(run.response.tension, np.ndarray):
        return comparison
    shown, steady = shown_tension(run, tension)
    rmse = np.nan
    if impact_s is not None:
        start = int(impact_s * tension.rate_hz)
        rmse = float(np.sqrt(np.mean((steady - tension.non_oscillatory)[start:] ** 2)))
    return replace(
        comparison,
        initial_tension=tension.initial,
        measured_final=tension.final,
        simulated_final=window_mean(shown, tension.rate_hz, windows.final_s),
        tension_rmse=rmse,
    )


def _with_rate(noise: RecordNoise, model: Model, initial_tension: float) -> RecordNoise:
    known = model.rate_uncertainty
    if known is None or not np.isfinite(initial_tension):
        return noise
    return replace(noise, rate_deviation=known.of_a_test(initial_tension))


def _percent(error: float, size: float) -> float:
    return 100 * abs(error) / abs(size) if size else np.nan


def _nrmse(simulated: FloatArray, measured: FloatArray) -> float:
    """Norm of an error over that of the measured; a simulation that runs away may have no square."""
    size = float(linalg.norm(measured, check_finite=False))
    return float(linalg.norm(simulated - measured, check_finite=False)) / size if size > 0 else np.nan


def _white_share(simulated: FloatArray, measured: FloatArray) -> float:
    """Noise from sample to sample in an error, over the root mean square of the measured."""
    size = float(np.sqrt(np.mean(measured**2)))
    return from_sample_to_sample(simulated - measured) / size if size > 0 else np.nan


def _finite_mean(values: Sequence[float]) -> float | None:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else None


def _finite_median(values: Sequence[float]) -> float | None:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else None
