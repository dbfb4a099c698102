"""The residual of a model on all records at once, whitened by the noise before the hits.

The output error of the motion is taken in the frequency domain, where neither filters nor integration enter
(`rom.identification.spectral_model`): linear parts of the model stand in its transfer function, everything
else (a tension that
falls during the test, effects) is a force along the motion that was measured. So the residual is linear in
the strength of a missing effect however large that is, and stays in phase.

The same holds for the model's own numbers. Along the measured motion Y, whatever the model,

    Z(theta + d) Y = F   <=>   Y - H(theta) F = -H(theta) (Z(theta + d) - Z(theta)) Y

so slopes along Y hold for changes d of any size, while those of H, which are along the model's own motion,
hold nearby alone. But Y has the sensors' noise in it, which a regression takes for less slope (errors in
variables; L. Ljung, System Identification, 1999, section 7.6): where noise alone is left, those of H count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.residual.base import Kind, Residual, cost, level
from discovery.residual.block_qr import triangle
from discovery.residual.effect_forces import lasting_force
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.linearised_record import Part, along_measured, linearised_parts
from discovery.residual.trajectory import MeasuredTrajectory, Measurements, trace_records
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.criteria.identification import RULES
from rom.criteria.number import Numerical
from rom.identification.identify import Identification
from rom.identification.noise_spectrum import Group, NoiseDensity, before_hit, noise_floors, quiet_seconds
from rom.identification.record_spectra import HIGHEST_HZ
from rom.identification.spectral_model import (
    CORNER,
    Linearised,
    SpectralRecord,
)
from rom.identification.uncoupled_priors import constants, of_stiffness
from rom.model.model import Model
from rom.progress import Progress

_ROUNDING: Numerical[float] = 1 + 1e-12  # of a sum in another order
_SAME: Numerical[float] = 1e-9  # of the largest singular value: directions that the slopes do not tell
MEDIAN_SQUARE: Numerical[float] = 0.4549  # of a normal number


@dataclass(frozen=True, eq=False)
class WhitenedResidual(Residual):
    """Whitened residual of a model on its records, and its slopes by the model's numbers.

    Attributes
    ----------
    residual : ndarray, shape (rows,)
        Output error over the noise, 1 in the mean square where nothing is missing.
    jacobian : ndarray, shape (rows, numbers)
        Slopes of the output by the numbers named in `names`.
    owner : ndarray of int, shape (rows,)
        Place in `traces` of every row's record; `training` tells rows that may be fitted to.
    from_afar : bool
        Whether `slopes` are those along the measured motion, right for changes of any size, or `jacobian`.
    simulated : WhitenedResidual or None
        What simulations of the whole motion leave over with the numbers that suit these best
        (`discovery.explain.simulated_fit`); None where none were fitted.
    criteria : Criteria
        The numbers that decide.
    """

    kind: ClassVar[Kind] = "output error"
    traces: tuple[MeasuredTrajectory, ...]
    baseline: FreeParameters
    floors: Mapping[Group, NoiseDensity]
    parts: tuple[tuple[MeasuredTrajectory, SpectralRecord, Linearised], ...]
    residual: FloatArray
    jacobian: FloatArray
    names: tuple[str, ...]
    owner: npt.NDArray[np.int64]
    from_afar: bool = False
    criteria: Criteria = CRITERIA
    simulated: WhitenedResidual | None = None

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes of the output by the numbers, that suit the distance from the plant; (rows, numbers)."""
        if not self.from_afar:
            return self.jacobian
        found, column = self.jacobian.copy(), {name: k for k, name in enumerate(self.names)}
        for trace, parts in self.by_record():
            for place, (rows, linear) in enumerate(parts):
                for name, slope in along_measured(trace, place, linear, self.baseline).items():
                    found[rows, column[name]] = slope
        return found

    @property
    def held_out(self) -> list[tuple[str, bool]]:
        """File of each record, and whether no number may be fitted to it."""
        return [(trace.settings.file, trace.settings.hold_out) for trace in self.traces]

    @property
    def stated(self) -> WhitenedResidual:
        """That of simulations where these follow the records to noise, or as closely as forces along them.

        A simulation has no noise of the measured motion in its forces.
        """
        most = max(self.criteria.acceptance.noise_level, level(self))
        return self if self.simulated is None or level(self.simulated) > most else self.simulated

    @property
    def searched(self) -> WhitenedResidual:
        """That in which more effects are looked for: of simulations where these leave noise alone.

        Of a missing force they show what the model's other forces make of it, which outputs along the
        measured motion do not.
        """
        return self.stated if level(self.stated) <= self.criteria.acceptance.noise_level else self

    def of_models(self, change: Callable[[Model], Model]) -> WhitenedResidual:
        """The same of models changed in what the motion does not see."""
        baseline = replace(self.baseline, model=change(self.baseline.model))
        simulated = None if self.simulated is None else self.simulated.of_models(change)
        return replace(self, baseline=baseline, simulated=simulated)

    def with_own(self, path: str, own: Mapping[str, Mapping[str, float]]) -> WhitenedResidual:
        """The same with numbers of an effect that are each record's own, by file and name."""
        traces = [
            replace(t, own={**t.own, path: own[t.settings.file]}) if t.settings.file in own else t
            for t in self.traces
        ]
        new = {id(old): trace for old, trace in zip(self.traces, traces, strict=True)}
        parts = tuple((new[id(trace)], part, linear) for trace, part, linear in self.parts)
        return replace(self, traces=tuple(traces), parts=parts)

    def at(self, baseline: FreeParameters) -> WhitenedResidual:
        """What another model leaves over along the same motion, the noise the same."""
        return whiten(self.traces, baseline, self.floors, self.criteria)

    def below(self, baseline: FreeParameters, most: float) -> WhitenedResidual | None:
        """What another model leaves over; None where training records leave ``most`` or more.

        Those that most was left of come first, held-out ones last: a step too far is given up after a few.
        """
        costs, so_far, parts = self.costs(self.residual), 0.0, {}
        for trace in sorted(self.traces, key=lambda one: (one.settings.hold_out, -costs[one.settings.file])):
            found = parts[id(trace)] = linearised_parts(trace, baseline, self.floors[trace.group])
            if not trace.settings.hold_out:
                so_far += sum(float(linear.residual @ linear.residual) for _, linear, _ in found)
            if not so_far <= _ROUNDING * most:
                return None
        in_order = [parts[id(trace)] for trace in self.traces]
        after = _joined(self.traces, in_order, baseline, self.floors, self.criteria)
        return after if cost(after) < most else None

    def of_training(self) -> WhitenedResidual:
        """The same without the records that are held out."""
        return self.of([k for k, trace in enumerate(self.traces) if not trace.settings.hold_out])

    def of(self, kept: Sequence[int]) -> WhitenedResidual:
        """The same with some of its records alone, by their places in order."""
        if len(kept) == len(self.traces):
            return self
        rows, files = np.isin(self.owner, kept), {self.traces[place].settings.file for place in kept}
        return replace(
            self,
            traces=tuple(self.traces[place] for place in kept),
            parts=tuple(one for one in self.parts if one[0].settings.file in files),
            residual=self.residual[rows],
            jacobian=self.jacobian[rows],
            owner=np.searchsorted(kept, self.owner[rows]),
        )

    @property
    def _basis(self) -> FloatArray:
        """Orthonormal basis of the slopes on training rows, and on those of the ties."""
        return self._factors[0]

    @cached_property
    def _triangle(self) -> FloatArray:
        """R of the slopes and, its last column, the residual on training rows: [J r] = Q R."""
        return triangle(np.column_stack([self.slopes, self.residual])[self.training])

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Singular vectors and values of the slopes on training rows and, below, of the ties; their units.

        In units that make all numbers' slopes one: a number that only a tie knows, its record being left out,
        counts like all others.
        """
        square = np.concatenate([self._triangle[:, :-1], self._tied[0]])
        unit = np.maximum(np.linalg.norm(square, axis=0), 1e-300)
        _, size, right = np.linalg.svd(square / unit, full_matrices=False)
        kept = int(np.sum(size > _SAME * size.max(initial=0.0)))
        size, right = size[:kept], right[:kept]
        stacked = np.concatenate([self.slopes[self.training], self._tied[0]])
        return stacked @ (right / unit).T / size, size, right, unit

    @cached_property
    def _tied(self) -> tuple[FloatArray, FloatArray]:
        """Slopes of the ties by the numbers, and what is missing to them; none at the noise floor.

        Misfit does not average out as noise does: a tie weighs as much as the share of it that may look like
        a change of the model's numbers.
        """
        values = constants(self.baseline.model)
        ties = [tie for tie in self.baseline.believed if tie.factors.keys() <= values.keys()]
        if ties:
            noise = self.criteria.acceptance.noise_level * float(self.training.sum())
            beyond = float(self._triangle[-1, -1]) ** 2 - noise
        if not ties or beyond <= 0:
            return np.zeros((0, len(self.names))), np.zeros(0)
        rows = np.array([[tie.factors.get(name, 0.0) / tie.error for name in self.names] for tie in ties])
        weight = np.sqrt(RULES.aligned * beyond)
        return weight * rows, weight * np.array([tie.offset(values) for tie in ties])

    def beyond(self, rows: FloatArray) -> FloatArray:
        """What of rows, (rows,) or (rows, n), the model's numbers cannot explain; training rows.

        Where the model lacks much, rows of its ties follow: what it would cost to leave them.
        """
        mine = rows if self.training.all() else rows[self.training]
        if len(self._tied[0]):
            mine = np.concatenate([mine, np.zeros((len(self._tied[0]), *mine.shape[1:]))])
        return np.asarray(mine - self._basis @ (self._basis.T @ mine))

    def steps(self, rows: FloatArray, damping: float = 0.0) -> dict[str, float]:
        """Changes of the model's numbers that suit training rows best, and their ties.

        Damped ones are shorter where rows tell little: by ``damping`` of the square of a number's slopes.
        """
        left, size, turned, unit = self._factors
        along = left.T @ np.concatenate([rows[self.training], self._tied[1]])
        found = turned.T @ (along * size / (size**2 + damping)) / unit
        return dict(zip(self.names, found.tolist(), strict=True))

    def left_over(self, rows: FloatArray) -> FloatArray:
        """All rows, held-out ones too, less what the numbers that suit the training rows explain."""
        steps = self.steps(rows)
        return np.asarray(rows - self.slopes @ np.array([steps[name] for name in self.names]))

    def by_record(self) -> Iterator[tuple[MeasuredTrajectory, list[tuple[slice, Linearised]]]]:
        """Every record's motion, and the rows and the linear model of each of its parts."""
        done = 0
        for _, parts in groupby(self.parts, key=lambda one: id(one[0])):
            some = list(parts)
            yield (
                some[0][0],
                [(slice(done, done := done + len(linear.residual)), linear) for _, _, linear in some],
            )


def whitened_residual_of(
    campaign: Campaign,
    baseline: FreeParameters,
    measurements: Measurements,
    floors: Mapping[Group, NoiseDensity] | None = None,
    progress: Progress | None = None,
    criteria: Criteria = CRITERIA,
) -> WhitenedResidual:
    """Follow all records of moving bodies with a model and whiten what it leaves by the noise floor.

    Parameters
    ----------
    campaign : Campaign
        Its settings.
    baseline : FreeParameters
        The model.
    measurements : sequence
        Its records, as `read_measurements` has them.
    floors : mapping
        Noise floors; None: taken from before the hits.
    progress : callable
        Called as ``progress(done, total)``.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    WhitenedResidual
        Of all records that can be followed, held out or not.
    """
    traces = trace_records(campaign, baseline, measurements, progress, criteria)
    floors = noise_of(baseline, traces, criteria) if floors is None else floors
    return whiten(traces, baseline, floors, criteria)


def starting(found: Identification, model: Model) -> FreeParameters:
    """Return the baseline of a model with the sensors' corners that its identification found."""
    linear = found.linear
    corners = {n: linear.value(n) for n in linear.names if n.startswith(CORNER)} if linear is not None else {}
    ties = of_stiffness(linear.ties) if linear is not None else ()
    return FreeParameters(replace(model, identification=None), corners, ties)


def noise_of(
    baseline: FreeParameters, traces: Sequence[MeasuredTrajectory], criteria: Criteria
) -> Mapping[Group, NoiseDensity]:
    """Floors from before the hits; a body struck alone gets what its own residual asks for, if more.

    There a hit accelerates the sensor's body at once, faster than samples follow, and no joint is seen.

    Parameters
    ----------
    baseline : FreeParameters
        The model.
    traces : sequence of MeasuredTrajectory
        Records as followed along it.
    criteria : Criteria
        The numbers that decide.
    """
    seconds = quiet_seconds([trace.measurement for trace in traces])
    highest = max([HIGHEST_HZ, *(float(part.frequency[-1]) for t in traces for part in t.parts)])
    quiet = []
    for t in traces:
        values, like = baseline.values(t.parts[0], t.level), t.parts[0]
        force = lasting_force(t, baseline.model.effects, int(seconds * t.measurement.rate_hz))
        quiet.append(before_hit(t.in_double_precision(), t.bodies, like, values, force, highest))
    floors = noise_floors(quiet)
    alone = [trace for trace in traces if trace.measurement.test == "uncoupled"]
    if not alone:
        return floors
    residual = whiten(alone, baseline, floors, criteria)
    left = residual.left_over(residual.residual)
    lift: dict[Group, float] = {}
    for place, trace in enumerate(alone):
        level = float(np.median(left[residual.owner == place] ** 2)) / MEDIAN_SQUARE
        lift[trace.group] = max(level, 1.0, lift.get(trace.group, 1.0))
    return {group: floor.raised(lift.get(group, 1.0)) for group, floor in floors.items()}


def whiten(
    traces: Sequence[MeasuredTrajectory],
    baseline: FreeParameters,
    floors: Mapping[Group, NoiseDensity],
    criteria: Criteria = CRITERIA,
) -> WhitenedResidual:
    """Return the whitened residual and its slopes at a baseline.

    Parameters
    ----------
    traces : sequence of MeasuredTrajectory
        The records.
    baseline : FreeParameters
        The model.
    floors : mapping of tuple to NoiseDensity
        By kind of test and moving bodies.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    WhitenedResidual
        Rows in the order of the records and their parts.
    """
    parts = [linearised_parts(trace, baseline, floors[trace.group]) for trace in traces]
    return _joined(traces, parts, baseline, floors, criteria)


def _joined(
    traces: Sequence[MeasuredTrajectory],
    of_records: Sequence[Sequence[Part]],
    baseline: FreeParameters,
    floors: Mapping[Group, NoiseDensity],
    criteria: Criteria,
) -> WhitenedResidual:
    """Rows of all parts, records in order."""
    parts = [(trace, *part) for trace, some in zip(traces, of_records, strict=True) for part in some]
    names = tuple(dict.fromkeys(name for *_, slopes in parts for name in slopes))
    ends = np.cumsum([0, *(len(linear.residual) for _, _, linear, _ in parts)])
    jacobian, owner = np.zeros((ends[-1], len(names))), np.zeros(ends[-1], dtype=np.int64)
    place = {name: column for column, name in enumerate(names)}
    number = {id(trace): k for k, trace in enumerate(traces)}
    for (trace, *_, slopes), first, last in zip(parts, ends, ends[1:], strict=False):
        owner[first:last] = number[id(trace)]
        for name, slope in slopes.items():
            jacobian[first:last, place[name]] = slope
    return WhitenedResidual(
        traces=tuple(traces),
        baseline=baseline,
        floors=floors,
        parts=tuple((trace, part, linear) for trace, part, linear, _ in parts),
        residual=np.concatenate([linear.residual for _, _, linear, _ in parts]),
        jacobian=jacobian,
        names=names,
        owner=owner,
        criteria=criteria,
    )
