"""All numbers of a model of driven bodies, fitted by simulation from where the balances of forces end.

Balances weigh every instant alone. Integrated over a record, what is a little wrong adds up, most of all
where no spring leads back: numbers that balance the forces best need not be those that move the bodies as
measured. Fitted are the rows of `discovery.residual.simulation`. A record whose first samples tell its state
starts there, as it is compared with (`rom.evaluation.replay`); of others the state is fitted too. What shapes
a force, as the speed at which friction turns, keeps the value at which forces balance: motion hardly tells
it, and fits would wander along it. All states and shapes are fitted in the end where that leaves noise alone:
noise of first samples makes the other numbers wrong, noise of the measured motion the shapes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from discovery.criteria.criteria import Criteria
from discovery.decide.explanation import limited_number
from discovery.explain.free_form import member_of
from discovery.explain.simulation_fit import errors_of, shown_numbers
from discovery.residual.base import level
from discovery.residual.simulation import Fit, SimulationResidual, refitted
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection
from rom.evaluation.replay import replay, starts_at_first_samples
from rom.identification.ring_down import RingDown, ring_down
from rom.identification.ring_down_states import fitted_state
from rom.model.laws import Z95, Parameter
from rom.model.model import Model
from rom.signals.processing import Measurement
from rom.signals.sensor_correction import corrected

_RESTARTS: Numerical[int] = 4  # in which states that first samples tell are taken anew with a fitted model
_LITTLE: Numerical[float] = 0.01  # of the mean square
_TOLERANCE: Numerical[float] = 1e-6  # of simulations: where friction turns, finer ones end no lower
_FINE_TOLERANCE: Numerical[float] = 1e-8  # where noise alone is left: a stop's fit to 1e-6 ended 5 errors off
Numbers = dict[str, Parameter]


class SimulatedModel(NamedTuple):
    """A model fitted by simulation, its numbers that were fitted, and the mean square that it leaves."""

    model: Model
    numbers: Numbers
    level: float


def driven_residual(
    model: Model,
    names: Sequence[str],
    measurements: Sequence[Measurement],
    criteria: Criteria,
    row_rates_hz: Mapping[str, float] | None = None,
) -> SimulationResidual | None:
    """Return what simulations of records with driven bodies leave over of their motion.

    Parameters
    ----------
    model : Model
        Faults of its sensors are taken out of the records; the residual's model has its forces alone.
    names : sequence of str
        Paths of the declared model's numbers that a fit moves; one that is zero stays so. Those of its forces
        move beside them.
    measurements : sequence of Measurement
        Records.
    criteria : Criteria
        The numbers that decide.
    row_rates_hz : mapping of str to float
        Rates of the rows [Hz] by file; some rows a period of a record's strongest line where not given.

    Returns
    -------
    SimulationResidual or None
        None where no record has a force that drives a body.
    """
    driven = [one for one in measurements if one.test == "driven" and _is_driven(one)]
    if not driven:
        return None
    moved = replace(model, effects=model.effects_of("force"))
    own = {path for effect in model.effects for path in (f"{effect.path}.{n}" for n in effect.parameters)}
    free = tuple(n for n in names if n in model.parameters and n not in own and model.parameter(n).value)
    rates = row_rates_hz or {}
    whole = (ring_down(corrected(one, model), moved, rows_hz=rates.get(one.file)) for one in driven)
    rings = tuple(replace(ring, tolerance=float(_TOLERANCE)) for ring in whole)
    started = frozenset(r.file for r in rings if starts_at_first_samples(moved, r.measurement))
    states = tuple(_state(ring, moved, known=ring.file in started) for ring in rings)
    return SimulationResidual(rings, moved, free, states, criteria, started, turning=True)


def fitted_by_simulation(
    model: Model,
    names: Sequence[str],
    measurements: Sequence[Measurement],
    criteria: Criteria,
    row_rates_hz: Mapping[str, float] | None = None,
    rounds: int | None = None,
) -> SimulatedModel | None:
    """Return a model of driven bodies with the numbers that simulate its records best.

    Parameters
    ----------
    model : Model
        Where the fit starts.
    names, criteria, row_rates_hz
        As for `driven_residual`.
    measurements : sequence of Measurement
        Records that may be fitted to.
    rounds : int or None
        As for `discovery.residual.simulation.refitted`; numbers that stay get limits too.

    Returns
    -------
    SimulatedModel or None
        Numbers that were fitted come with 95 % limits, the wider of this fit's and the start's. None where no
        record has a force that drives a body.
    """
    residual = driven_residual(model, names, measurements, criteria, row_rates_hz)
    if residual is None:
        return None
    moved = residual.model
    strengths = {e.path: [n for n in _strengths(e) if e.parameters[n].value] for e in moved.effects}
    fit = refitted(residual, strengths, rounds)
    for _ in range(_RESTARTS if residual.started and rounds != 0 else 0):
        again = driven_residual(fit.residual.model, names, measurements, criteria, row_rates_hz)
        after = fit if again is None else refitted(again, strengths, rounds)
        gained = level(fit.residual) - level(after.residual)
        fit = after if gained > 0 else fit
        if not gained > _LITTLE * level(fit.residual):
            break
    beside = _beside_states_and_shapes(fit.residual, _TOLERANCE)
    if level(beside.residual) <= criteria.acceptance.noise_level:
        fit = _beside_states_and_shapes(beside.residual, _FINE_TOLERANCE)
    found = fit.residual.model
    numbers = {
        path: limited_number(found.parameter(path), max(error, standard_error(moved.parameter(path))))
        for path, error in errors_of(fit).items()
    }
    effects = [_of_effect(old, new, numbers) for old, new in zip(moved.effects, found.effects, strict=True)]
    fitted = replace(found, effects=(*effects, *model.effects_of("sensor fault")))
    return SimulatedModel(fitted, numbers, level(fit.residual))


def _beside_states_and_shapes(residual: SimulationResidual, tolerance: float) -> Fit:
    rings = tuple(replace(ring, tolerance=float(tolerance)) for ring in residual.rings)
    free = {effect.path: shown_numbers(effect, residual) for effect in residual.model.effects}
    return refitted(replace(residual, rings=rings, started=frozenset(), thorough=True), free)


def standard_error(number: Parameter) -> float:
    """Standard error that a number's 95 % limits tell, in its unit; 0 without limits."""
    return 0.0 if number.low is None or number.high is None else (number.high - number.low) / (2 * Z95)


def _strengths(effect: ModelCorrection) -> Sequence[str]:
    member = member_of(effect)
    return [name for name in effect.parameters if name in (*member.strengths, *member.limits)]


def _of_effect(old: ModelCorrection, new: ModelCorrection, numbers: Numbers) -> ModelCorrection:
    """The effect as fitted; of numbers that were held the limits stay."""
    known = {name: numbers.get(f"{new.path}.{name}", old.parameters[name]) for name in new.parameters}
    return replace(new, parameters=known)


def _is_driven(measurement: Measurement) -> bool:
    return bool(measurement.motion) and any(np.any(f) for f in measurement.applied_force.values())


def _state(ring: RingDown, model: Model, *, known: bool) -> FloatArray:
    """State at the first sample, (2 bodies,): displacements [m], then velocities [m/s]."""
    if not known:
        return fitted_state(ring, model)
    response = replay(model, ring.measurement).response
    parts = (response.displacement, response.velocity)
    return np.array([float(part[body][0]) for part in parts for body in ring.bodies])
