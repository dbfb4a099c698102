"""Motion of a record's modes as its sensors are compared. A mode moves by itself, and is worked out once.

Most steps of a fit change one mode: a number of it, an effect in it, its state at the start. The others are
where they were.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import in_record
from rom.identification.modal_sensors import by_measured_force, forces_of
from rom.model.model import Model
from rom.model.shapes import ModeShapes, derived, shape_path
from rom.model.structure import Structure
from rom.signals.processing import Measurement

_KEPT: Numerical[int] = 256  # motions of one mode; a fit goes back to the last few


@dataclass(frozen=True)
class _Alone:
    """One mode of a model, and all that its motion depends on."""

    mode: str
    numbers: tuple[object, ...]
    pushes: tuple[float | None, ...]
    start: tuple[float, float]
    tolerance: float
    model: Model = field(compare=False, repr=False)


class ModalMotion:
    """Motion of the modes of a record.

    Parameters
    ----------
    measurement : Measurement
        The record.
    compared : callable
        Samples of a quantity, (..., samples), as they are compared, (..., rows).
    """

    def __init__(self, measurement: Measurement, compared: Callable[[str, FloatArray], FloatArray]) -> None:
        self._measurement, self._compared = measurement, compared
        self._kinds = tuple(dict.fromkeys(motion.kind for motion in measurement.motion.values()))
        self._of_mode = lru_cache(_KEPT)(self._worked_out)

    def of_modes(self, model: Model, state: FloatArray, tolerance: float) -> dict[str, FloatArray] | None:
        """By quantity what modes show, (modes, rows) [SI]; None where one does not finish.

        Parameters
        ----------
        model : Model
            Of modes.
        state : ndarray, shape (2 modes,)
            Displacements [m], then velocities [m/s].
        tolerance : float
            As for `Model.simulate`.
        """
        model, rows = in_record(model, self._measurement.given), []
        for mode, *start in zip(model.structure.body_names, *np.split(state, 2), strict=True):
            at, moving = (float(value) for value in start)
            found = self._of_mode(_alone(model, mode, self._measurement.force, (at, moving), tolerance))
            if found is None:
                return None
            rows.append(found)
        return {kind: np.stack([of[kind] for of in rows]) for kind in self._kinds}

    def of_sensors(self, shapes: ModeShapes, of_modes: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """By quantity what all sensors would show, (sensors, rows) [SI], with what follows forces at once."""
        sensors = tuple(self._measurement.motion)
        matrix, found = shapes.at(sensors), {}
        for kind, rows in of_modes.items():
            found[kind] = matrix @ rows
            for place, followed in self.followed[kind].items():
                found[kind] += np.outer([shapes.compliance(sensor, place) for sensor in sensors], followed)
        return found

    @cached_property
    def followed(self) -> dict[str, dict[str, FloatArray]]:
        """By quantity and place what follows a force at once, for a compliance of 1 m/N, (rows,) [SI]."""
        seen = self._measurement
        return {
            kind: {
                place: self._compared(kind, derived(force, kind, seen.rate_hz))
                for place, force in seen.applied_force.items()
            }
            for kind in self._kinds
        }

    def _worked_out(self, one: _Alone) -> dict[str, FloatArray] | None:
        seen, structure = self._measurement, one.model.structure
        place = structure.body_names.index(one.mode)
        links = tuple(link for link in structure.links if link.first == one.mode)
        alone = one.model.on(
            Structure((structure.bodies[place],), links),
            {link.name: one.model.link_laws[link.name] for link in links},
        )
        force = forces_of(one.model, seen).get(one.mode, np.zeros(seen.samples))
        at, moving = ({one.mode: value} for value in one.start)
        response = alone.simulate({one.mode: force}, seen.rate_hz, None, at, moving, tolerance=one.tolerance)
        if response.status != "ok":
            return None
        motion = {kind: getattr(response, kind)[one.mode] for kind in self._kinds}
        if seen.test == "driven" and "acceleration" in motion:
            sampled = by_measured_force(alone, response, seen)
            motion["acceleration"] = sampled.get(one.mode, motion["acceleration"])
        return {kind: self._compared(kind, samples) for kind, samples in motion.items()}


def _alone(
    model: Model, mode: str, forces: Iterable[str], start: tuple[float, float], tolerance: float
) -> _Alone:
    structure, shapes = model.structure, model.shapes
    assert shapes is not None
    numbers: list[object] = [structure.bodies[structure.body_names.index(mode)].mass]
    for link in structure.links:
        if link.first == mode:
            laws = model.link_laws[link.name]
            numbers += [(law.function, *law.values.tolist()) for law in (laws.stiffness, laws.damping)]
    inside = (f"body:{mode}", *(link.name for link in structure.links if link.first == mode))
    for effect in model.effects_of("force"):
        if effect.enters in inside:
            numbers.append((effect.function, *effect.values.tolist()))
    known = (shapes.numbers.get(shape_path(mode, place)) for place in forces)
    pushes = tuple(None if one is None else one.value for one in known)
    return _Alone(mode, tuple(numbers), pushes, start, tolerance, model)
