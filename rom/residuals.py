"""Error of a model on measured records: the measures by which models are compared, like with like.

A simulated response is turned into the quantity that was measured, passes through the same filter chain and
the same tension windows, and only then is a difference taken.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from rom.campaign import WindowSettings
from rom.channels import FloatArray
from rom.model import Model
from rom.processing import Measurement, displacement, driven_displacement
from rom.simulation import Response
from rom.structure import GROUND, Structure

_MOTION_TESTS = ("uncoupled", "coupled", "loosening", "free", "driven")
_STATE_ITERATIONS = 3


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
    records: int
    failed: int


@dataclass(frozen=True)
class Comparison:
    """Simulated against measured for one record; tensions in N, nan where not measured."""

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


def simulate_measurement(model: Model, measurement: Measurement) -> Response:
    """Simulate a record from its measured force and initial tension; a free record's initial state is fitted
    to it.

    Raises
    ------
    ValueError
        Where a bolted model is asked for a record that gives no initial tension.
    """
    if measurement.test == "uncoupled":
        model = model.without_bolt()
    model = _moving(model, measurement.motion)
    force = {body: f for body, f in measurement.applied_force.items() if body in model.structure.body_names}
    if not force:
        force = {model.structure.body_names[0]: np.zeros(measurement.samples)}
    tension = _initial_tension(model, measurement)
    if measurement.test != "free":
        return model.simulate(force, measurement.rate_hz, tension)
    return _free_response(model, measurement, force, tension)


def _moving(model: Model, bodies: Collection[str]) -> Model:
    """Return the model of the moving bodies: one that rests in a record is ground to the others."""
    if not bodies or set(model.structure.body_names) <= set(bodies):
        return model
    ends = {body: body if body in bodies else GROUND for body in (*model.structure.body_names, GROUND)}
    links = tuple(
        replace(link, first=ends[link.first], second=ends[link.second])
        for link in model.structure.links
        if ends[link.first] != ends[link.second]
    )
    names = {link.name for link in links}
    bodies_left = tuple(body for body in model.structure.bodies if body.name in bodies)
    return model.on(Structure(bodies_left, links), {name: model.link_laws[name] for name in names})


def compare(model: Model, measurement: Measurement, windows: WindowSettings) -> Comparison:
    """Compare a model with one record."""
    return compare_all([model], measurement, windows)[0]


def compare_all(
    models: Sequence[Model], measurement: Measurement, windows: WindowSettings
) -> tuple[Comparison, ...]:
    """Compare models with one record; what is filtered goes side by side."""
    if measurement.test == "cycled":
        return tuple(_compare_cycled(model, measurement) for model in models)
    responses = {
        place: simulate_measurement(model, measurement)
        for place, model in enumerate(models)
        if _can_be_compared(model, measurement)
    }
    motions = iter(_displacements([r for r in responses.values() if r.status == "ok"], measurement))
    found = []
    for place, model in enumerate(models):
        response = responses.get(place)
        comparison = Comparison(measurement.file, measurement.test, True, {})
        if response is not None and response.status != "ok":
            comparison = replace(comparison, finished=False)
        elif response is not None:
            comparison = _with_motion(comparison, model, measurement, next(motions))
            comparison = _with_tension(comparison, response, measurement, windows)
        found.append(comparison)
    return tuple(found)


def _can_be_compared(model: Model, measurement: Measurement) -> bool:
    known = measurement.test == "uncoupled" or _tension_known(model, measurement)
    return known and measurement.test in _MOTION_TESTS


def _displacements(
    responses: Sequence[Response], measurement: Measurement
) -> tuple[Mapping[str, FloatArray], ...]:
    """Return the displacements [m] of responses, by body, as the sensors and the filter chain show them."""
    found: list[dict[str, FloatArray]] = [{} for _ in responses]
    for kind in {motion.kind for motion in measurement.motion.values()}:
        bodies = [body for body, motion in measurement.motion.items() if motion.kind == kind]
        rows = [_quantity(response, kind, body) for response in responses for body in bodies]
        if not rows:
            continue
        filtered = iter(displacement(kind, np.stack(rows), measurement.rate_hz, measurement.chain))
        for of_response in found:
            of_response.update((body, next(filtered)) for body in bodies)
    return tuple(found)


def _with_motion(
    comparison: Comparison, model: Model, measurement: Measurement, simulated: Mapping[str, FloatArray]
) -> Comparison:
    start = int((measurement.impact_s or 0.0) * measurement.rate_hz)
    measured = {body: measurement.displacement(body) for body in measurement.motion}
    nrmse = {body: _nrmse(simulated[body][start:], measured[body][start:]) for body in measured}
    pair = _coupled_pair(model)
    if pair is None or not set(pair) <= set(measured):
        return replace(comparison, motion_nrmse=nrmse)
    first, second = pair
    relative = _nrmse(
        (simulated[first] - simulated[second])[start:], (measured[first] - measured[second])[start:]
    )
    return replace(comparison, motion_nrmse=nrmse, relative_motion_nrmse=relative)


def summarise(comparisons: Iterable[Comparison]) -> Errors:
    """Return the error measures over a set of records; a simulation that failed is counted, not averaged."""
    every = list(comparisons)
    done = [c for c in every if c.finished]
    loosening = [c for c in done if c.test == "loosening" and np.isfinite(c.measured_final)]
    final = [c.final_error_percent for c in loosening]
    return Errors(
        motion_nrmse=_finite_mean([value for c in done for value in c.motion_nrmse.values()]),
        relative_motion_nrmse=_finite_mean([c.relative_motion_nrmse for c in done]),
        final_tension_error_percent_mean=_finite_mean(final),
        final_tension_error_percent_median=_finite_median(final),
        final_tension_error_percent_max=max((v for v in final if np.isfinite(v)), default=None),
        tension_loss_error_percent_median=_finite_median([c.loss_error_percent for c in loosening]),
        link_force_nrmse=_finite_mean([c.link_force_nrmse for c in done]),
        tension_rmse_n=_finite_mean([c.tension_rmse for c in loosening]),
        records=len(every),
        failed=len(every) - len(done),
    )


def window_mean(samples: FloatArray, rate_hz: float, window_s: tuple[float, float]) -> float:
    """Return the mean over a time window, cut at the record's end."""
    inside = samples[int(window_s[0] * rate_hz) : int(window_s[1] * rate_hz)]
    return float(inside.mean()) if len(inside) else float(samples[-1])


def _quantity(response: Response, kind: str, body: str) -> FloatArray:
    quantities: Mapping[str, FloatArray] = getattr(response, kind)
    return quantities[body]


def _tension_known(model: Model, measurement: Measurement) -> bool:
    """Return whether a record tells the tension at which its simulation starts, or the model needs none."""
    needed = any(
        law.sees_tension
        for link in model.structure.bolted_links
        for law in (model.link_laws[link].stiffness, model.link_laws[link].damping)
    )
    return not needed or measurement.tension is not None or measurement.preload_n is not None


def _initial_tension(model: Model, measurement: Measurement) -> Mapping[str, float] | None:
    bolts = model.structure.bolted_links
    if not bolts:
        return None
    if measurement.tension is not None:
        return dict.fromkeys(bolts, max(measurement.tension.initial, 0.0))
    if measurement.preload_n is not None:
        return dict.fromkeys(bolts, measurement.preload_n)
    if _tension_known(model, measurement):
        return dict.fromkeys(bolts, 0.0)
    raise ValueError(
        f"{measurement.file}: found no strain, tension or preload_n, "
        "expected one of them as the initial tension of the bolted link"
    )


def _free_response(
    model: Model,
    measurement: Measurement,
    force: Mapping[str, FloatArray],
    tension: Mapping[str, float] | None,
) -> Response:
    """Fit every body's initial displacement and velocity by Gauss-Newton steps on the filtered motion."""
    bodies = model.structure.body_names
    scale = max(float(np.abs(measurement.displacement(body)).max()) for body in measurement.motion)
    speed = scale * 2 * np.pi * _fastest_motion(measurement)
    unit = np.concatenate([np.full(len(bodies), scale or 1.0), np.full(len(bodies), speed or 1.0)])
    measured = np.concatenate([measurement.displacement(body) for body in measurement.motion])

    def run(state: FloatArray) -> tuple[Response, FloatArray]:
        displacements, velocities = np.split(state * unit, 2)
        response = model.simulate(
            force,
            measurement.rate_hz,
            tension,
            initial_displacement=dict(zip(bodies, displacements, strict=True)),
            initial_velocity=dict(zip(bodies, velocities, strict=True)),
        )
        shown = _displacements([response], measurement)[0]
        return response, np.concatenate([shown[body] for body in measurement.motion])

    state = np.zeros(2 * len(bodies))
    response, simulated = run(state)
    for _ in range(_STATE_ITERATIONS):
        step = 1e-2
        jacobian = np.stack(
            [(run(state + step * e)[1] - simulated) / step for e in np.eye(len(state))], axis=1
        )
        if not np.isfinite(jacobian).all():
            break
        state = state + np.linalg.lstsq(jacobian, measured - simulated, rcond=None)[0]
        response, simulated = run(state)
    return response


def _fastest_motion(measurement: Measurement) -> float:
    """Return a frequency [Hz] typical of the motion: RMS velocity over RMS displacement."""
    ratios = []
    for body in measurement.motion:
        x = measurement.displacement(body)
        ratios.append(
            float(np.std(np.diff(x)) * measurement.rate_hz / (2 * np.pi * max(float(np.std(x)), 1e-300)))
        )
    return max(ratios)


def _compare_cycled(model: Model, measurement: Measurement) -> Comparison:
    values = []
    for name in model.structure.link_names:
        force = measurement.link.get(f"link_force_{name}")
        motion = measurement.link.get(f"link_displacement_{name}")
        if force is not None and motion is not None:
            tension = _initial_tension(model, measurement) if name in model.structure.bolted_links else None
            simulated = model.link_force(
                name, driven_displacement(motion), motion.rate_hz, (tension or {}).get(name, 0.0)
            )
            values.append(_nrmse(simulated, force.samples))
    return Comparison(
        measurement.file,
        measurement.test,
        True,
        {},
        link_force_nrmse=float(np.mean(values)) if values else np.nan,
    )


def _coupled_pair(model: Model) -> tuple[str, str] | None:
    """Return the bodies of the bolted link, or of the first link between two bodies."""
    links = [link for link in model.structure.links if "ground" not in (link.first, link.second)]
    bolted = [link for link in links if link.law == "bolted"]
    chosen = (bolted or links)[:1]
    return (chosen[0].first, chosen[0].second) if chosen else None


def _with_tension(
    comparison: Comparison, response: Response, measurement: Measurement, windows: WindowSettings
) -> Comparison:
    tension = measurement.tension
    if tension is None or not isinstance(response.tension, np.ndarray):
        return comparison
    time = np.arange(len(tension.samples)) / tension.rate_hz
    simulated = np.interp(time, response.time, response.tension)
    rmse = np.nan
    if measurement.impact_s is not None:
        start = int(measurement.impact_s * tension.rate_hz)
        rmse = float(np.sqrt(np.mean((simulated - tension.non_oscillatory)[start:] ** 2)))
    return replace(
        comparison,
        initial_tension=tension.initial,
        measured_final=tension.final,
        simulated_final=window_mean(simulated, tension.rate_hz, windows.final_s),
        tension_rmse=rmse,
    )


def _percent(error: float, size: float) -> float:
    return 100 * abs(error) / abs(size) if size else np.nan


def _nrmse(simulated: FloatArray, measured: FloatArray) -> float:
    size = float(np.sqrt(np.mean(measured**2)))
    return float(np.sqrt(np.mean((simulated - measured) ** 2))) / size if size > 0 else np.nan


def _finite_mean(values: Sequence[float]) -> float | None:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else None


def _finite_median(values: Sequence[float]) -> float | None:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else None
