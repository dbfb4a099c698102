"""Mode shapes: what sensors show of modal bodies, and how forces at places act on them.

    y = Phi q + R F,        force on mode i = sum_d Phi_di F_d

with q the motion of the modal bodies [m], y that of the sensors, F the forces at their places [N], and R the
compliance of all modes above the band, which follow a force at once (residual flexibility; D. J. Ewins,
Modal Testing, 2nd ed., 2000, Sec. 4.5). Every shape is 1 at the sensor where it is largest (or -1, where no
sensor stands at the drive point and the shape is positive there): there q_i is what mode i contributes to the
motion, and the mass of its body is the modal mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rom.model.laws import Parameter

FloatArray = npt.NDArray[np.float64]
ByBody = Mapping[str, FloatArray]


def shape_path(mode: str, place: str) -> str:
    """Path of what a mode shows at a place."""
    return f"shape.{mode}.{place}"


def compliance_path(sensor: str, place: str) -> str:
    """Path of what a force at a place moves a sensor by at once [m/N]."""
    return f"compliance.{sensor}.{place}"


@dataclass(frozen=True)
class ModeShapes:
    """Real mode shapes at sensors and drive points, with limits.

    Parameters
    ----------
    sensors : tuple of str
        Places whose motion is measured.
    modes : tuple of str
        Names of the modal bodies.
    forces : tuple of str
        Places where forces act; not all have a sensor.
    numbers : mapping of str to Parameter
        Shapes [1] and compliances [m/N], by path.

    Raises
    ------
    ValueError
        If a shape is missing.
    """

    sensors: tuple[str, ...]
    modes: tuple[str, ...]
    forces: tuple[str, ...]
    numbers: Mapping[str, Parameter] = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", dict(self.numbers))
        wanted = [shape_path(m, p) for m in self.modes for p in (*self.sensors, *self.forces)]
        wanted += [compliance_path(s, f) for s in self.sensors for f in self.forces]
        missing = [path for path in wanted if path not in self.numbers]
        if missing:
            raise ValueError(f"mode shapes must hold {missing[0]!r}, got {', '.join(self.numbers) or 'none'}")

    @cached_property
    def _matrices(self) -> Mapping[tuple[str, ...], FloatArray]:
        return {places: self._matrix(places) for places in (self.sensors, self.forces)}

    def _matrix(self, places: Sequence[str]) -> FloatArray:
        rows = [[self.numbers[shape_path(m, p)].value for m in self.modes] for p in places]
        return np.array(rows, dtype=np.float64).reshape(len(places), len(self.modes))

    def at(self, places: Sequence[str]) -> FloatArray:
        """Shapes at places, (places, modes).

        Raises
        ------
        ValueError
            If a place has no shape.
        """
        unknown = [p for p in places if p not in (*self.sensors, *self.forces)]
        if unknown:
            known = ", ".join(dict.fromkeys((*self.sensors, *self.forces)))
            raise ValueError(f"found no mode shape at {unknown[0]!r}, expected one of {known}")
        known_places = self._matrices.get(tuple(places))
        return self._matrix(places) if known_places is None else known_places

    def compliance(self, sensor: str, place: str) -> float:
        """What a force at a place moves a sensor by at once [m/N]; none where it is not known."""
        known = self.numbers.get(compliance_path(sensor, place))
        return 0.0 if known is None else known.value

    def on_modes(self, force: ByBody) -> dict[str, FloatArray]:
        """Forces on the modal bodies [N] of forces at places [N]; empty without any."""
        if not force:
            return {}
        rows = self.at(tuple(force)).T @ np.stack([np.asarray(f, dtype=np.float64) for f in force.values()])
        return dict(zip(self.modes, rows, strict=True))

    def sensed(
        self, motion: Mapping[str, ByBody], force: ByBody, rate_hz: float, places: Sequence[str]
    ) -> dict[str, dict[str, FloatArray]]:
        """What sensors show of the motion of modal bodies, by quantity and sensor.

        Parameters
        ----------
        motion : mapping of str to mapping of str to ndarray
            By quantity ("displacement", "velocity", "acceleration") and mode, (samples,) [SI].
        force : mapping of str to ndarray
            Forces at places, (samples,) [N].
        rate_hz : float
            Sampling rate [Hz].
        places : sequence of str
            Sensors that are asked for.

        Returns
        -------
        dict
            By quantity and sensor, (samples,) [SI].
        """
        matrix, found = self.at(places), {}
        for kind, by_mode in motion.items():
            rows = matrix @ np.stack([by_mode[mode] for mode in self.modes])
            for place, samples in force.items():
                followed = derived(samples, kind, rate_hz)
                rows += np.outer([self.compliance(sensor, place) for sensor in places], followed)
            found[kind] = dict(zip(places, rows, strict=True))
        return found

    def with_values(self, values: Mapping[str, float]) -> ModeShapes:
        """The same with other numbers, by path; those of others count for nothing."""
        own = {path: value for path, value in values.items() if path in self.numbers}
        if not own:
            return self
        numbers = {p: replace(n, value=float(own[p])) if p in own else n for p, n in self.numbers.items()}
        return replace(self, numbers=numbers)


def derived(samples: FloatArray, kind: str, rate_hz: float) -> FloatArray:
    """A force or its derivatives as a quantity shows what follows it: by central differences.

    Parameters
    ----------
    samples : ndarray, shape (samples,)
        Force [N].
    kind : str
        ``"displacement"``, ``"velocity"`` or ``"acceleration"``: derivative 0, 1 or 2.
    rate_hz : float
        Sampling rate [Hz].
    """
    if kind == "displacement":
        return samples
    padded = np.pad(samples, 1, mode="edge")
    if kind == "velocity":
        return np.asarray((padded[2:] - padded[:-2]) * rate_hz / 2)
    return np.asarray((padded[2:] - 2 * samples + padded[:-2]) * rate_hz**2)
