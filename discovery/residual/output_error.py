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

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from discovery.decide.acceptance import QUIET
from discovery.residual.free_parameters import FreeParameters
from discovery.residual.trajectory import MeasuredTrajectory, Measurements, Progress, trace_records
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.effects import Effect, ModelCorrection
from rom.identification.identify import Identification
from rom.identification.noise_spectrum import Group, NoiseFloor, before_hit, noise_floors, quiet_seconds
from rom.identification.priors import ALIGNED
from rom.identification.spectral_model import (
    CORNER,
    STRUCTURAL,
    ComplexArray,
    Linearised,
    SpectralRecord,
    Term,
    key,
    linearise,
    step_unit,
)
from rom.identification.uncoupled_priors import constants, of_stiffness
from rom.kernels.prescribed import force_of_effects
from rom.model.model import Model
from rom.signals.per_record_parameters import per_record_names

_SUBSTEPS = 2
_SAME = 1e-9  # of the largest singular value: directions that the slopes do not tell
_MEDIAN_SQUARE = 0.4549  # of a normal number


Change = Callable[[MeasuredTrajectory, SpectralRecord, Linearised], ComplexArray | None]


@dataclass(frozen=True, eq=False)
class WhitenedResidual:
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
    """

    traces: tuple[MeasuredTrajectory, ...]
    baseline: FreeParameters
    floors: Mapping[Group, NoiseFloor]
    parts: tuple[tuple[MeasuredTrajectory, SpectralRecord, Linearised], ...]
    residual: FloatArray
    jacobian: FloatArray
    names: tuple[str, ...]
    owner: npt.NDArray[np.int64]
    from_afar: bool = False

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes of the output by the numbers, that suit the distance from the plant; (rows, numbers)."""
        if not self.from_afar:
            return self.jacobian
        found, place, done = self.jacobian.copy(), {name: k for k, name in enumerate(self.names)}, 0
        for trace, part, linear in self.parts:
            rows = slice(done, done := done + len(linear.residual))
            for name, slope in _along_measured(trace, part, linear, self.baseline).items():
                found[rows, place[name]] = slope
        return found

    @cached_property
    def training(self) -> npt.NDArray[np.bool_]:
        """Rows of records that are not held out."""
        return ~np.array([trace.settings.hold_out for trace in self.traces])[self.owner]

    def with_own(self, path: str, own: Mapping[str, Mapping[str, float]]) -> WhitenedResidual:
        """The same with numbers of an effect that are each record's own, by file and name."""
        traces = [
            replace(t, own={**t.own, path: own[t.settings.file]}) if t.settings.file in own else t
            for t in self.traces
        ]
        new = {id(old): trace for old, trace in zip(self.traces, traces, strict=True)}
        parts = tuple((new[id(trace)], part, linear) for trace, part, linear in self.parts)
        return replace(self, traces=tuple(traces), parts=parts)

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
    def _factors(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Singular vectors and values of the slopes on training rows and, below, of the ties; their units.

        In units that make all numbers' slopes one: a number that only a tie knows, its record being left out,
        counts like all others.
        """
        stacked = np.concatenate([self.slopes[self.training], self._tied[0]])
        unit = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
        stacked /= unit
        left, size, right = np.linalg.svd(stacked, full_matrices=False)
        kept = int(np.sum(size > _SAME * size.max(initial=0.0)))
        return left[:, :kept], size[:kept], right[:kept], unit

    @cached_property
    def _tied(self) -> tuple[FloatArray, FloatArray]:
        """Slopes of the ties by the numbers, and what is missing to them; none at the noise floor.

        Misfit does not average out as noise does: a tie weighs as much as the share of it that may look like
        a change of the model's numbers.
        """
        values = constants(self.baseline.model)
        ties = [tie for tie in self.baseline.believed if tie.factors.keys() <= values.keys()]
        mine = self.residual[self.training]
        if ties:
            slopes = self.slopes[self.training]
            slopes /= np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
            told = np.linalg.lstsq(slopes, mine, rcond=_SAME)[0]
            beyond = float(np.sum((mine - slopes @ told) ** 2)) - QUIET * len(mine)
        if not ties or beyond <= 0:
            return np.zeros((0, len(self.names))), np.zeros(0)
        rows = np.array([[tie.factors.get(name, 0.0) / tie.error for name in self.names] for tie in ties])
        weight = np.sqrt(ALIGNED * beyond)
        return weight * rows, weight * np.array([tie.offset(values) for tie in ties])

    def beyond(self, rows: FloatArray) -> FloatArray:
        """What of rows, (rows,) or (rows, n), the model's numbers cannot explain; training rows.

        Where the model lacks much, rows of its ties follow: what it would cost to leave them.
        """
        mine = rows[self.training]
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

    def costs(self, rows: FloatArray) -> dict[str, float]:
        """Squares of whitened rows by record."""
        sums = np.bincount(self.owner, weights=rows**2, minlength=len(self.traces))
        return {t.settings.file: float(value) for t, value in zip(self.traces, sums, strict=True)}

    @cached_property
    def samples(self) -> dict[str, int]:
        """Whitened numbers by record."""
        counts = np.bincount(self.owner, minlength=len(self.traces))
        return {t.settings.file: int(n) for t, n in zip(self.traces, counts, strict=True)}

    def output(self, change: Change) -> FloatArray:
        """Whitened rows of a change of the output that is told for every part of every record."""
        rows = []
        for trace, part, linear in self.parts:
            found = change(trace, part, linear)
            rows.append(np.zeros(len(linear.residual)) if found is None else linear.projected(found))
        return np.concatenate(rows)


def whitened_residual_of(
    campaign: Campaign,
    baseline: FreeParameters,
    measurements: Measurements,
    floors: Mapping[Group, NoiseFloor] | None = None,
    progress: Progress | None = None,
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
    """
    traces = trace_records(campaign, baseline, measurements, progress)
    return whiten(traces, baseline, noise_of(baseline, traces) if floors is None else floors)


def starting(found: Identification, model: Model) -> FreeParameters:
    """Return the baseline of a model with the sensors' corners that its identification found."""
    linear = found.linear
    corners = {n: linear.value(n) for n in linear.names if n.startswith(CORNER)} if linear is not None else {}
    ties = of_stiffness(linear.ties) if linear is not None else ()
    return FreeParameters(replace(model, identification=None), corners, ties)


def noise_of(baseline: FreeParameters, traces: Sequence[MeasuredTrajectory]) -> Mapping[Group, NoiseFloor]:
    """Floors from before the hits; a body struck alone gets what its own residual asks for, if more.

    There a hit accelerates the sensor's body at once, faster than samples follow, and no joint is seen.
    """
    seconds = quiet_seconds([trace.measurement for trace in traces])
    quiet = []
    for t in traces:
        force = lasting_force(t, baseline.model.effects, int(seconds * t.measurement.rate_hz))
        quiet.append(before_hit(t.seen(), t.bodies, t.parts[0], baseline.values(t.parts[0], t.level), force))
    floors = noise_floors(quiet)
    alone = [trace for trace in traces if trace.measurement.test == "uncoupled"]
    if not alone:
        return floors
    evidence = whiten(alone, baseline, floors)
    left = evidence.left_over(evidence.residual)
    lift: dict[Group, float] = {}
    for place, trace in enumerate(alone):
        level = float(np.median(left[evidence.owner == place] ** 2)) / _MEDIAN_SQUARE
        lift[trace.group] = max(level, 1.0, lift.get(trace.group, 1.0))
    return {group: floor.raised(lift.get(group, 1.0)) for group, floor in floors.items()}


def whiten(
    traces: Sequence[MeasuredTrajectory], baseline: FreeParameters, floors: Mapping[Group, NoiseFloor]
) -> WhitenedResidual:
    """Return the whitened residual and its slopes at a baseline."""
    parts, columns = [], []
    for trace in traces:
        forces = _beyond_linear(trace, baseline.model)
        for part in trace.parts:
            values = baseline.values(part, trace.level)
            driven = replace(part, force=part.force + sum(trace.forces(*one, part) for one in forces))
            first, last = part.samples
            seconds = (last - first) / trace.measurement.rate_hz
            linear = linearise(driven, values, floors[trace.group].whitener(part, values, seconds))
            terms = zip(linear.columns, linear.jacobian.T, strict=True)
            columns.append(_by_number(terms, baseline, trace.level))
            parts.append((trace, driven, linear.thin()))
    names = tuple(dict.fromkeys(name for slopes in columns for name in slopes))
    places = {id(trace): place for place, trace in enumerate(traces)}
    return WhitenedResidual(
        traces=tuple(traces),
        baseline=baseline,
        floors=floors,
        parts=tuple(parts),
        residual=np.concatenate([linear.residual for _, _, linear in parts]),
        jacobian=np.concatenate(
            [
                np.stack([slopes.get(n, np.zeros(len(linear.residual))) for n in names], axis=1)
                for (_, _, linear), slopes in zip(parts, columns, strict=True)
            ]
        ),
        names=names,
        owner=np.concatenate(
            [np.full(len(linear.residual), places[id(trace)]) for trace, _, linear in parts]
        ),
    )


def _along_measured(
    trace: MeasuredTrajectory, part: SpectralRecord, linear: Linearised, baseline: FreeParameters
) -> dict[str, FloatArray]:
    """Slopes along the motion that was measured, by the numbers of springs, dashpots and masses."""
    values = baseline.values(part, trace.level)
    moved = [
        np.stack([trace.lines(motion[body], part, trace.stride) for body in trace.bodies], axis=1)
        for motion in (trace.displacement, trace.velocity)
    ]
    motions = [*moved, 2j * np.pi * part.frequency[:, None] * moved[1]]  # but for the ends, projected out

    def change(term: Term) -> FloatArray:
        along = (motions[term.power] @ term.direction)[:, None]
        return linear.projected(-(linear.gain @ term.direction) * along)

    terms = [term for term in part.terms if term.free and term.matrix in STRUCTURAL]
    names = [key(part, term) for term in terms]
    units = [step_unit(term.name, values[name]) for term, name in zip(terms, names, strict=True)]
    slopes = (change(term) * unit for term, unit in zip(terms, units, strict=True))
    return _by_number(zip(names, slopes, strict=True), baseline, trace.level)


def _by_number(
    terms: Iterable[tuple[str, FloatArray]], baseline: FreeParameters, level: float
) -> dict[str, FloatArray]:
    """Slopes by the model's numbers of slopes by a record's coefficients."""
    found: dict[str, FloatArray] = {}
    for term, along in terms:
        for number, slope in baseline.slopes(term, level).items():
            found[number] = found.get(number, 0.0) + slope * along
    return found


def _beyond_linear(trace: MeasuredTrajectory, model: Model) -> list[tuple[FloatArray, tuple[str, str]]]:
    """Forces of the model that are not in its linear part, each with the ends of its link."""
    found = []
    for link in model.structure.links:
        ends = (link.first, link.second)
        if link.law == "bolted" and trace.measurement.test != "uncoupled" and np.ptp(trace.tension) > 0:
            x, v = trace.relative(ends)
            laws = model.link_laws[link.name]
            stiffness = np.asarray(laws.stiffness(trace.tension)) - float(laws.stiffness(trace.level))
            damping = np.asarray(laws.damping(trace.tension)) - float(laws.damping(trace.level))
            found.append((stiffness * x + damping * v, ends))
    for effect in model.effects:
        if isinstance(effect, Effect):
            force = effect_force(trace, effect, model)
            if force is not None:
                found.append(force)
    return found


def effect_force(
    trace: MeasuredTrajectory, effect: Effect, model: Model
) -> tuple[FloatArray, tuple[str, str]] | None:
    """Force of an effect along a record's motion and the ends it acts between; None where it cannot act."""
    link = next((one for one in model.structure.links if one.name == effect.enters), None)
    ends = (link.first, link.second) if link is not None else (effect.enters.partition(":")[2], "ground")
    if not set(ends) & set(trace.bodies):
        return None
    if link is not None and link.law == "bolted" and trace.measurement.test == "uncoupled":
        return None
    effect = effect.with_values(**trace.own.get(effect.path, {}))
    x, v = trace.relative(ends)
    stiffness = damping = np.zeros_like(x)
    if link is not None:
        laws = model.link_laws[link.name]
        stiffness, damping = (
            np.array(np.broadcast_to(law(trace.tension), x.shape), dtype=np.float64)
            for law in (laws.stiffness, laws.damping)
        )
    table, start = np.array([[effect.address, 0, 0]]), np.zeros(effect.states + 1)
    motion = np.stack([x, v, trace.tension, stiffness, damping])
    force = force_of_effects(table, effect.values, motion, 1 / trace.rate_hz, _SUBSTEPS, start, 0.0)
    return np.asarray(force), ends


def lasting_force(trace: MeasuredTrajectory, effects: Sequence[ModelCorrection], samples: int) -> FloatArray:
    """Force [N] of a record's first samples on its bodies that acts all the time, (samples, bodies).

    That of effects with numbers of each record's own; others wait for the hit.
    """
    out = np.zeros((samples, len(trace.bodies)))
    for effect in effects:
        body = effect.enters.partition(":")[2]
        if isinstance(effect, Effect) and per_record_names(effect) and body in trace.bodies:
            own = effect.with_values(**trace.own.get(effect.path, {}))
            table, still = np.array([[own.address, 0, 0]]), np.zeros((5, samples))
            step_s = 1 / trace.measurement.rate_hz
            force = force_of_effects(table, own.values, still, step_s, 1, np.zeros(own.states + 1), 0.0)
            out[:, trace.bodies.index(body)] -= np.asarray(force)
    return out
