"""Band of a predicted tension: where that of one new test lies with 95 % probability.

    var(ln rate) = tau(T)^2 + g' C g,   g = d ln(rate) / d(numbers of the tension law), at this test

tau is the between-test standard deviation and C the covariance of the law's numbers. The slopes are ratios of
changes of the simulated final tension, for a small change of each number and of the whole rate. The ends
are simulated with the rate at both 97.5 % quantiles of Student's t; what noise adds is added in quadrature:
the errors of both measured means, and along the course that of the tension without its oscillation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.replay import Replay, shown_tension, window_mean
from rom.identification.gamma_per_case import own_rate
from rom.model.laws import Z95
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty

_LOG_STEP: Numerical[float] = 0.1
_LARGEST_LOG: Numerical[float] = 12.0  # of the rate: beyond, the bolt keeps or loses all of its tension


@dataclass(frozen=True)
class TensionBand:
    """95 % limits [N] of the final tension of one new test, and the share of the time after its hit at which
    the measured tension lies within those of its course; not a number where nothing is known.
    """

    low: float = np.nan
    high: float = np.nan
    course_within: float = np.nan


NO_BAND = TensionBand()


def tension_band(run: Replay, window_s: tuple[float, float], noise_rms: float) -> TensionBand:
    """Return where the tension of one new test lies.

    Parameters
    ----------
    run : Replay
        A record simulated with a model.
    window_s : tuple of float
        Over which the final tension is averaged [s], from and to.
    noise_rms : float
        Root mean square [N] of the noise of the tension without its oscillation.

    Returns
    -------
    TensionBand
        Not a number where the model does not tell how its rate differs, or the record is no impact test of
        one bolt.
    """
    model, tension = run.model, run.measurement.tension
    forces = {b: f for b, f in run.measurement.applied_force.items() if b in model.structure.body_names}
    known = model.rate_uncertainty
    if known is None or tension is None or run.measurement.test != "loosening" or len(forces) != 1:
        return NO_BAND
    half = _half_width_of(run, known, forces, window_s)
    own = own_rate(1.0)
    scaled, rate_hz = model.with_effect(own), run.measurement.rate_hz
    initial = max(tension.initial, 0.0)
    fast, slow = (
        scaled.with_values({f"{own.path}.factor": float(factor)}).simulate(forces, rate_hz, initial)
        for factor in np.exp([half, -half])
    )
    (shown, steady), *others = (
        shown_tension(replace(run, response=response), tension) for response in (run.response, fast, slow)
    )
    final = window_mean(shown, tension.rate_hz, window_s)
    ends = [window_mean(end, tension.rate_hz, window_s) - final for end, _ in others]
    noise = Z95 * np.hypot(tension.initial_error, tension.final_error)
    hit = int((run.measurement.impact_s or 0.0) * tension.rate_hz)
    courses = [(end - steady)[hit:] for _, end in others]
    off = (tension.non_oscillatory - steady)[hit:]
    above = np.hypot(Z95 * noise_rms, np.maximum(np.maximum(*courses), 0.0))
    below = np.hypot(Z95 * noise_rms, np.minimum(np.minimum(*courses), 0.0))
    return TensionBand(
        float(final - np.hypot(min(*ends, 0.0), noise)),
        float(final + np.hypot(max(*ends, 0.0), noise)),
        float(np.mean((off <= above) & (off >= -below))) if np.isfinite(noise_rms) else np.nan,
    )


def _half_width_of(
    run: Replay, known: RateUncertainty, forces: Mapping[str, FloatArray], window_s: tuple[float, float]
) -> float:
    """Half the width of the 95 % limits of ln rate at a test."""
    model, tension = run.model, run.measurement.tension
    assert tension is not None
    ((body, force),) = forces.items()
    own = own_rate(1.0)
    scaled, factor = model.with_effect(own), f"{own.path}.factor"
    initial = max(tension.initial, 0.0)
    names, steps = _steps(model, known)
    paths = [_path(model, name) for name in names]
    values = {p: np.full(len(paths) + 2, model.parameter(p).value) for p in paths}
    for place, (path, step) in enumerate(zip(paths, steps, strict=True)):
        values[path][place + 2] += step
    factors = np.ones(len(paths) + 2)
    factors[1] = np.exp(_LOG_STEP)
    here, faster, *moved = scaled.final_tension(
        np.tile(force, (len(factors), 1)),
        run.measurement.rate_hz,
        np.full(len(factors), initial),
        {factor: factors, **values},
        window_s,
        body,
    )
    return _half_width(known, initial, (faster - here) / _LOG_STEP, (np.array(moved) - here) / steps)


def _steps(model: Model, known: RateUncertainty) -> tuple[tuple[str, ...], FloatArray]:
    """Numbers of the law that are known only so well, and a standard error of each, into its range."""
    errors = np.sqrt(np.maximum(np.diag(np.reshape(known.covariance, (len(known.parameters),) * 2)), 0.0))
    names, steps = [], []
    for name, error in zip(known.parameters, errors, strict=True):
        if error > 0:
            number = model.parameter(_path(model, name))
            names.append(name)
            steps.append(error if number.value + error <= number.bounds[1] else -error)
    return tuple(names), np.array(steps)


def _path(model: Model, name: str) -> str:
    """Where a model has a number of its law, or of what changes that."""
    return name if "." in name else f"{model.structure.bolted_links[0]}.tension_rate.{name}"


def _half_width(known: RateUncertainty, tension: float, of_rate: float, of_numbers: FloatArray) -> float:
    """Return half the width of the 95 % limits of ln rate, from slopes of the final tension [N]."""
    errors = np.reshape(known.covariance, (len(known.parameters),) * 2)
    kept = np.diag(errors) > 0
    covariance = errors[np.ix_(kept, kept)]
    variance = known.of_a_test(tension) ** 2
    if of_rate:
        slopes = np.nan_to_num(of_numbers) / of_rate
        variance += max(float(slopes @ covariance @ slopes), 0.0)
    quantile = float(stats.t.ppf(0.975, known.degrees_of_freedom))
    return min(quantile * float(np.sqrt(variance)), _LARGEST_LOG)
