"""What a simulation leaves over of a motion, whitened by the noise, and fits of all its numbers.

    r = (y - y_model(theta, x_0, v_0)) / sigma

in the channels as they are measured (`rom.identification.ring_down`). The state (x_0, v_0) at the first
sample belongs to each record and is fitted to it, on held-out records too; the numbers theta of the model and
its effects are fitted to training records alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.residual.base import Kind, ProjectedResidual
from discovery.residual.ends_of_ranges import on_ends_that_suit
from discovery.residual.fitted_number import FittedNumber
from discovery.residual.least_squares import minimum, minimum_nearby
from discovery.residual.simulation_slopes import SimulatedRecord, UnseenRecord, orthonormal, slopes_of
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import ModelCorrection
from rom.identification.equation_error import noise_freedom
from rom.identification.ring_down import PERIODS, RingDown
from rom.identification.ring_down_states import first_state, fitted_state
from rom.model.model import Model

_ROUNDS: Numerical[int] = 10
_THOROUGH: Numerical[int] = 30  # rounds
_PARTS: Numerical[int] = 32
_FEWER_PERIODS: Numerical[tuple[float, ...]] = (3.0, 1.5, 0.75)  # a part, where more are out of phase
_MODAL_PARTS: Numerical[int] = 8  # each has several sensors and modes
_ROUGH_TOLERANCE: Numerical[float] = 1e-6  # of simulations of parts, which tell where a fit starts
_LITTLE: Numerical[float] = 0.1  # gained by a step, in squares of noise: a number at its limit loses four
_OF_NO_USE: Numerical[float] = 1e-3  # gained by a step, of the cost of a fit that leaves more than noise
_CHANGE: Numerical[float] = 100.0  # times a simulation's tolerance: share of motion that a slope's step moves
_CHANGE_TURNING: Numerical[float] = 3e-3  # that share where friction turns within a sample
_AT_END: Numerical[float] = 1e-4  # of an end: beyond it a fit would go on
_WORST: Numerical[float] = 3.0  # times the motion, where a simulation does not end


@dataclass(frozen=True, eq=False)
class SimulationResidual(ProjectedResidual):
    """Records, a model with its effects, and the state of every record.

    Attributes
    ----------
    rings : tuple of RingDown
        Sound records.
    model : Model
        With the effects so far.
    names : tuple of str
        Paths of the declared model's numbers that the records tell.
    states : tuple of ndarray
        State of each record at its first sample, (2 bodies,) [m], [m/s].
    started : frozenset of str
        Files of records whose state is known and not fitted.
    thorough : bool
        Whether fits take all the steps that they need, the model being near enough from the start.
    turning : bool
        Whether friction may turn within a sample: slopes tell the cost near by alone then.
    """

    kind: ClassVar[Kind] = "simulation"
    rings: tuple[RingDown, ...]
    model: Model
    names: tuple[str, ...]
    states: tuple[FloatArray, ...]
    criteria: Criteria = CRITERIA
    started: frozenset[str] = frozenset()
    thorough: bool = False
    turning: bool = False

    @property
    def rounds(self) -> int:
        """Of slopes, at most, in one fit."""
        return _THOROUGH if self.thorough else _ROUNDS

    @property
    def change(self) -> float:
        """Share of the motion by which a step for a slope moves it."""
        return _CHANGE_TURNING if self.turning else _CHANGE * max(ring.tolerance for ring in self.rings)

    def little(self, cost: float) -> float:
        """What a fit's last step lowers a cost by: a tenth of a row's mean square, more of a rough fit's."""
        level = cost / max(int(self.training.sum()), 1)
        enough = self.criteria.acceptance.noise_level
        return _LITTLE * level if self.thorough or level <= enough else _OF_NO_USE * cost

    @cached_property
    def shown(self) -> tuple[FloatArray | None, ...]:
        """What the model shows of each record over the noise, None where it does not finish."""
        pairs = zip(self.rings, self.states, strict=True)
        return tuple(ring.simulated(self.model, state) for ring, state in pairs)

    def trained_shown(self) -> tuple[FloatArray | None, ...]:
        """The same of the training records alone, which a fit asks for twice.

        Kept without the lock that a cached property has up to Python 3.11: fits run side by side.
        """
        known = self.__dict__.get("_trained_shown")
        if known is None:
            pairs = [(self.rings[place], self.states[place]) for place in self.trained]
            known = tuple(ring.simulated(self.model, state) for ring, state in pairs)
            self.__dict__["_trained_shown"] = known
        return known

    @cached_property
    def residual(self) -> FloatArray:
        """What is left over, over the noise, (rows,)."""
        pairs = zip(self.rings, self.shown, strict=True)
        return np.concatenate([left_over(ring, shown) for ring, shown in pairs])

    @cached_property
    def owner(self) -> npt.NDArray[np.int64]:
        """Place of each row's record, (rows,)."""
        return np.repeat(np.arange(len(self.rings)), [ring.measured.size for ring in self.rings])

    @property
    def held_out(self) -> list[tuple[str, bool]]:
        """File of each record, and whether no number may be fitted to it."""
        return [(ring.file, ring.hold_out) for ring in self.rings]

    @property
    def trained(self) -> tuple[int, ...]:
        """Places of the records that are not held out."""
        return tuple(place for place, ring in enumerate(self.rings) if not ring.hold_out)

    @property
    def free_states(self) -> tuple[int, ...]:
        """Places of the training records whose states are fitted."""
        return tuple(place for place in self.trained if self.rings[place].file not in self.started)

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of the training rows."""
        rings = [self.rings[place] for place in self.trained]
        return sum(noise_freedom(ring.measurement.samples) * len(ring.channels) for ring in rings)

    @property
    def is_out_of_phase(self) -> bool:
        """Whether so much is left of a record of bodies that small changes of the model tell nothing."""
        if self.model.shapes is not None:
            return False
        rings = [self.rings[place] for place in self.trained]
        _, record = np.unique([ring.file for ring in rings], return_inverse=True)
        left = [np.sum(left_over(*one) ** 2) for one in zip(rings, self.trained_shown(), strict=True)]
        whole = np.bincount(record, [np.sum(ring.whitened**2) for ring in rings])
        return bool(np.any(np.bincount(record, left) > self.criteria.screening.out_of_phase**2 * whole))

    @property
    def record_count(self) -> int:
        """Records whose simulation finishes."""
        return sum(shown is not None for shown in self.shown)

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis of what the model's numbers and the states can move, (training rows, numbers)."""
        return orthonormal(self.slopes)

    @cached_property
    def slopes(self) -> FloatArray:
        """Of training rows by the numbers in their sizes, then by the states, (training rows, columns)."""
        numbers = [FittedNumber.of(path, self.model) for path in self.names]
        return slopes_of(self.model, self._simulated, numbers, {}, self.change)

    @cached_property
    def unseen(self) -> tuple[UnseenRecord, ...]:
        """Held-out records that the model follows, and their slopes."""
        numbers, found = [FittedNumber.of(path, self.model) for path in self.names], []
        for ring, state, shown in zip(self.rings, self.states, self.shown, strict=True):
            if ring.hold_out and shown is not None:
                one = SimulatedRecord(ring, state, shown, ring.file not in self.started)
                table = slopes_of(self.model, [one], numbers, {}, self.change)
                basis = orthonormal(table[:, len(numbers) :])
                found.append(UnseenRecord(one, table[:, : len(numbers)], basis))
        return tuple(found)

    @property
    def _simulated(self) -> list[SimulatedRecord]:
        """Training records as the model shows them."""
        shown = zip(self.trained, self.trained_shown(), strict=True)
        return [
            SimulatedRecord(self.rings[k], self.states[k], one, k in self.free_states) for k, one in shown
        ]

    @cached_property
    def unexplained(self) -> FloatArray:
        """What of the residual the numbers and states cannot imitate; training rows."""
        return self.beyond(self.residual)

    def output_of(self, effect: ModelCorrection) -> FloatArray | None:
        """What an effect changes of the training records from the states as they are, (rows,).

        Held-out rows are zero; None where a simulation does not finish.
        """
        model, found = self.model.with_effect(effect), []
        for ring, state, shown in zip(self.rings, self.states, self.shown, strict=True):
            still = np.zeros(ring.measured.size)
            moved = still if ring.hold_out or shown is None else ring.simulated(model, state)
            if moved is None:
                return None
            found.append(still if ring.hold_out or shown is None else moved - shown)
        return np.concatenate(found)

    def of_model(self, model: Model) -> SimulationResidual:
        """The same of another model; free states of training records suit their first periods."""
        kept = self.started | {ring.file for ring in self.rings if ring.hold_out}
        pairs = zip(self.rings, self.states, strict=True)
        states = tuple(old if ring.file in kept else first_state(ring, model) for ring, old in pairs)
        return replace(self, model=model, states=states)

    def in_parts(self, most: int | None = None) -> SimulationResidual:
        """Some parts of the training records, each from a state of its own: where a fit starts.

        Over a whole record a frequency that is a little wrong loses the phase, and every period lost is a
        valley of the cost; a part is too short for that (multiple shooting; H. Bock, Springer Ser. Chem.
        Phys. 18, 102, 1981). Of many parts every second, third, ... does. Where the model is far off, parts
        are as short as it takes.
        """
        most = most or (_PARTS if self.model.shapes is None else _MODAL_PARTS)
        for periods in (PERIODS, *_FEWER_PERIODS):
            parts = [part for k in self.trained for part in self.rings[k].parts(periods)]
            found = self._of_parts(parts[:: -(-len(parts) // most)])
            if not found.is_out_of_phase:
                break
        return found

    def in_first_parts(self) -> SimulationResidual:
        """The first part of every training record: where an effect's own motion starts with its body's."""
        return self._of_parts([self.rings[k].parts(PERIODS, most=1)[0] for k in self.trained])

    def _of_parts(self, parts: Sequence[RingDown]) -> SimulationResidual:
        rings = tuple(replace(part, tolerance=max(part.tolerance, float(_ROUGH_TOLERANCE))) for part in parts)
        states = tuple(first_state(part, self.model) for part in rings)
        return replace(self, rings=rings, states=states, started=frozenset())


def left_over(ring: RingDown, shown: FloatArray | None) -> FloatArray:
    """Measured minus shown over the noise; far more than the motion where a simulation does not finish."""
    return ring.whitened - shown if shown is not None else _WORST * ring.whitened


def over_noise(rows: FloatArray) -> float | None:
    """Root mean square of what is left of some rows over the noise; None of none."""
    return float(np.sqrt(np.mean(rows**2))) if len(rows) else None


@dataclass(frozen=True, eq=False)
class Fit:
    """A residual at the end of a fit, and its slopes there.

    Attributes
    ----------
    residual : SimulationResidual
        With its numbers and states.
    paths : list of str
        Numbers of the first columns of the slopes.
    slopes : ndarray, shape (training rows, columns)
        Of the rows by the numbers, in their units, then by the states in their scales.
    rows : ndarray, shape (training rows,)
        What is left over of them.
    """

    residual: SimulationResidual
    paths: list[str]
    slopes: FloatArray
    rows: FloatArray


def refitted(
    residual: SimulationResidual,
    free: Mapping[str, Sequence[str]] | None = None,
    rounds: int | None = None,
) -> Fit:
    """Fit the model's numbers, those of its effects and all states.

    Parameters
    ----------
    residual : SimulationResidual
        Where the fit starts.
    free : mapping of str to sequence of str
        Names of the parameters that move, by the path of an effect; none of an effect that is not there.
    rounds : int or None
        Of slopes, at most; with 0 the numbers stay. None: as many as the residual asks for itself.

    Returns
    -------
    Fit
        Where it ends.
    """
    paths = [*residual.names, *(f"{e}.{n}" for e, names in (free or {}).items() for n in names)]
    numbers = [FittedNumber.of(path, residual.model) for path in paths]
    steps: dict[str, float] = {}

    def at(x: FloatArray) -> SimulationResidual:
        return _at(residual, numbers, x)

    latest: list[tuple[FloatArray, SimulationResidual]] = []

    def rows(x: FloatArray) -> FloatArray:
        found = at(x)
        latest[:] = [*latest[-3:], (x.copy(), found)]
        return np.asarray(_trained_rows(found))

    def slopes(x: FloatArray) -> FloatArray:
        known = next((one for place, one in latest if np.array_equal(place, x)), None)
        here = known if known is not None else at(x)
        return -slopes_of(here.model, here._simulated, numbers, steps, here.change)

    start = _start(residual, numbers)
    ends = [sorted(n.moved(np.array([n.low, n.high]))) for n in numbers]
    low, high = np.array([*ends, *[(-np.inf, np.inf)] * (len(start) - len(numbers))]).T
    rounds = residual.rounds if rounds is None else rounds
    if residual.turning:
        found = minimum_nearby(rows, start, slopes, (low, high), rounds)
    else:
        found = minimum(rows, start, slopes, (low, high), rounds, residual.little)
    most = residual.little(float(found.rows @ found.rows))
    x = on_ends_that_suit(rows, found.x, low, high, _AT_END, most)
    after = at(x)
    table = slopes(x) if found.slopes is None else found.slopes
    of_values = [number.slope(after.model.parameter(number.path).value) for number in numbers]
    slopes_there = table / [*of_values, *[1.0] * (len(x) - len(numbers))]
    return Fit(_with_held_out(after), paths, slopes_there, _trained_rows(after))


def _start(residual: SimulationResidual, numbers: Sequence[FittedNumber]) -> FloatArray:
    values = [float(n.moved(np.array(residual.model.parameter(n.path).value))) for n in numbers]
    states = [residual.states[k] / residual.rings[k].scale for k in residual.free_states]
    return np.concatenate([values, *states])


def _at(residual: SimulationResidual, numbers: Sequence[FittedNumber], x: FloatArray) -> SimulationResidual:
    values = {n.path: n.value(float(v)) for n, v in zip(numbers, x, strict=False)}
    states, first = list(residual.states), len(numbers)
    for place in residual.free_states:
        scale = residual.rings[place].scale
        states[place] = x[first : first + len(scale)] * scale
        first += len(scale)
    return replace(residual, model=residual.model.with_values(values), states=tuple(states))


def _trained_rows(residual: SimulationResidual) -> FloatArray:
    """The residual of training records; held-out ones are not simulated."""
    rings = (residual.rings[place] for place in residual.trained)
    shown = zip(rings, residual.trained_shown(), strict=True)
    return np.concatenate([left_over(ring, one) for ring, one in shown])


def _with_held_out(residual: SimulationResidual) -> SimulationResidual:
    """The same with the states of held-out records fitted anew."""
    states = list(residual.states)
    for place, ring in enumerate(residual.rings):
        if ring.hold_out and ring.file not in residual.started:
            states[place] = fitted_state(ring, residual.model)
    return replace(residual, states=tuple(states))
