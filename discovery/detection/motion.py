"""What effects in the motion of impact tests add to its residual, and to the errors of simulations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from discovery.detection.limit import by_kind, dispersion
from discovery.detection.power import Background, Response
from discovery.explain.effect_outputs import outputs_of
from discovery.explain.motion import candidates_in_motion, telling
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.trajectory import MeasuredTrajectory
from rom.campaign.channels import FloatArray
from rom.effects import Member, ModelCorrection
from rom.evaluation.evaluate import Evaluation
from rom.evaluation.replay import displacements, replay
from rom.identification.small_matrices import inverse, product
from rom.identification.spectral_model import ComplexArray
from rom.signals.filters import INTEGRATIONS
from rom.signals.per_record_parameters import per_record_names

BEFORE_HITS = "it has numbers of each record's own and shows before the impacts; its limit is not calculated"
_MOTION, _RELATIVE = "motion_nrmse", "relative_motion_nrmse"


@dataclass(frozen=True, eq=False)
class MotionMeter:
    """Effects in the motion of impact tests.

    Attributes
    ----------
    residual : WhitenedResidual
        Of the last model.
    evaluations : sequence of Evaluation
        Errors of its simulations.
    chance : ndarray, shape (draws,), or None
        Largest gains by chance of the last screen.
    """

    residual: WhitenedResidual
    evaluations: Sequence[Evaluation]
    chance: FloatArray | None = None

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Effects of the catalogue in the motion."""
        return candidates_in_motion(self.residual)

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:
        """Those that show before the impacts are told otherwise."""
        return BEFORE_HITS if member.by_record or per_record_names(effect) else ""

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""
        return member.linear

    @cached_property
    def _few(self) -> WhitenedResidual:
        """Some training records, those of a rough screen."""
        training = self.residual.of_training()
        return training.of(telling(training))

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects at one place add to some training records."""
        few = self._few
        return [float(one) for one in np.sum(few.beyond(outputs_of(effects, few)) ** 2, axis=0)]

    @cached_property
    def unexplained(self) -> FloatArray:
        """What is left, the model's numbers at their best, (rows,)."""
        return self.residual.left_over(self.residual.residual)

    @cached_property
    def _judged(self) -> bool:
        """Whether errors are compared on held-out records."""
        return any(one.settings.hold_out for one in self.evaluations if one.comparisons)

    @cached_property
    def _terms(self) -> Mapping[str, Mapping[tuple[str, str], float]]:
        """Errors of the simulated motion by name, and by file and body."""
        found: dict[str, dict[tuple[str, str], float]] = {_MOTION: {}, _RELATIVE: {}}
        for one in self.evaluations:
            if not one.comparisons or one.settings.hold_out is not self._judged:
                continue
            shown = one.comparisons[0]
            found[_MOTION] |= {(one.settings.file, body): e for body, e in shown.motion_nrmse.items()}
            found[_RELATIVE][one.settings.file, ""] = shown.relative_motion_nrmse
        finite = {
            name: {key: value for key, value in terms.items() if np.isfinite(value)}
            for name, terms in found.items()
        }
        return {name: terms for name, terms in finite.items() if terms}

    @cached_property
    def background(self) -> Background:
        """What is left of the motion, and the errors of its simulations."""
        residual, criteria = self.residual, self.residual.criteria
        trained, _ = by_kind(residual.costs(self.unexplained), residual.hold_out)
        cost, rules = float(trained.sum()), criteria.acceptance
        chance = np.zeros(0) if self.chance is None else self.chance
        least = (rules.training_gain_motion, rules.hold_out_gain_motion)
        return Background(
            cost, cost / float(residual.training.sum()), least,
            {name: np.array(list(terms.values())) for name, terms in self._terms.items()},
            chance, self.chance is not None, criteria,
        )  # fmt: skip

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response | None]:
        """What effects at one place add."""
        return [self._response(output) for output in outputs_of(effects, self.residual).T]

    def _response(self, output: FloatArray) -> Response | None:
        residual = self.residual
        beyond = residual.left_over(output)
        if not np.isfinite(beyond).all():
            return None
        trained, unseen = by_kind(residual.costs(beyond), residual.hold_out)
        scores, others = by_kind(residual.sums(beyond * self.unexplained), residual.hold_out)
        shares = self._shares(beyond, {file for terms in self._terms.values() for file, _ in terms})
        changes, phases = (
            {
                n: np.array([shares.get(key, (0.0, 0.0))[k] for key in terms])
                for n, terms in self._terms.items()
            }
            for k in (0, 1)
        )
        return Response(
            trained, unseen, dispersion(scores, float(trained.sum()), self.background.level), changes,
            100 * _largest(self._shares(output, {file for file, _ in self._few.held_out})), phases,
            dispersion(others, float(unseen.sum()), 1.0),
        )  # fmt: skip

    @cached_property
    def _shown(self) -> list[tuple[MeasuredTrajectory, list[_Shown]]]:
        """Displacements of every record's parts."""
        found = []
        for trace, parts in self.residual.by_record():
            judged = trace.settings.hold_out is self._judged
            errors = self._errors(trace) if judged else None
            shown = [
                _Shown(
                    rows, inverse(linear.whitener), _displacement(trace, place, trace.parts[place].motion),
                    None if errors is None else _lines(errors, trace, place),
                )
                for place, (rows, linear) in enumerate(parts)
            ]  # fmt: skip
            found.append((trace, shown))
        return found

    def _errors(self, trace: MeasuredTrajectory) -> FloatArray | None:
        """Measured minus simulated displacement of a record's bodies [m]; None where it does not finish."""
        model = self.residual.baseline.model
        measurement = trace.in_double_precision().with_cutoff(model.filter_cutoff_hz)
        run = replay(model.without_effects_of("sensor fault"), measurement)
        if run.response.status != "ok":
            return None
        (simulated,) = displacements([run])
        return np.stack([measurement.displacement(body) - simulated[body] for body in trace.bodies], axis=1)

    def _shares(self, rows: FloatArray, files: Set[str]) -> dict[tuple[str, str], tuple[float, float]]:
        """Whitened rows as displacements, by file and body, of some files.

        RMS over the measured one, and the cosine of the angle to the simulation's error. The relative
        displacement of two bodies has no body's name.
        """
        found = {}
        for trace, parts in self._shown:
            if trace.settings.file not in files:
                continue
            sums: dict[str, FloatArray] = {}
            for place, part in enumerate(parts):
                change = _displacement(trace, place, _unwhitened(rows[part.rows], part.colour))
                for body, some in _by_body(trace, change, part):
                    sums[body] = sums.get(body, np.zeros(4)) + some
            for body, (changed, whole, error, along) in sums.items():
                cosine = along / np.sqrt(max(changed * error, 1e-300))
                found[trace.settings.file, body] = (float(np.sqrt(changed / whole)) if whole else 0.0, cosine)
        return found


@dataclass(frozen=True, eq=False)
class _Shown:
    """A part of a record: its rows, inverse whitener, displacements, and errors of the simulation."""

    rows: slice
    colour: ComplexArray
    measured: ComplexArray
    errors: ComplexArray | None


def _largest(shares: Mapping[tuple[str, str], tuple[float, float]]) -> float:
    """The largest mean over records of any body, or of the relative motion."""
    bodies = {body for _, body in shares}
    means = (
        float(np.mean([share for (_, of), (share, _) in shares.items() if of == body])) for body in bodies
    )
    return max(means, default=0.0)


def _lines(samples: FloatArray, trace: MeasuredTrajectory, place: int) -> ComplexArray:
    """Spectra of samples, (samples, bodies), at the lines of a part."""
    part, rate = trace.parts[place], trace.measurement.rate_hz
    first, last = part.samples
    whole = np.fft.rfft(samples[first:last], axis=0) / rate
    at = np.rint(part.frequency * (last - first) / rate).astype(int)
    passed = part.frequency >= trace.measurement.chain.cutoff_hz
    return np.asarray(np.where(passed[:, None], whole[at], 0.0))


def _unwhitened(rows: FloatArray, colour: ComplexArray) -> ComplexArray:
    """Whitened rows as lines of the channels, (lines, channels)."""
    lines, channels = colour.shape[0], colour.shape[1]
    half = lines * channels
    white = (rows[:half] + 1j * rows[half : 2 * half]).reshape(lines, channels, 1)
    return np.asarray(product(colour, white)[:, :, 0])


def _displacement(trace: MeasuredTrajectory, place: int, lines: ComplexArray) -> ComplexArray:
    """Lines of the channels as displacements, those below the filter's cutoff zero."""
    frequency = trace.parts[place].frequency
    motion = trace.measurement.motion
    orders = np.array([INTEGRATIONS[motion[body].kind] for body in trace.bodies])
    passed = frequency >= trace.measurement.chain.cutoff_hz
    s = np.where(passed, 2j * np.pi * np.maximum(frequency, 1e-9), np.inf)
    return np.asarray(np.where(passed[:, None], lines, 0.0) / s[:, None] ** np.where(orders, orders, 0.0))


def _by_body(
    trace: MeasuredTrajectory, change: ComplexArray, part: _Shown
) -> Iterator[tuple[str, FloatArray]]:
    """Sums of squares of a change, of the measured motion and of the error, and of what both have in common.

    Of every body, and of the first two's relative motion.
    """
    errors = np.zeros_like(change) if part.errors is None else part.errors
    every = np.stack([change, part.measured, errors])
    for place, body in enumerate(trace.bodies):
        yield body, _sums(*every[:, :, place])
    if len(trace.bodies) > 1:
        yield "", _sums(*(every[:, :, 0] - every[:, :, 1]))


def _sums(change: ComplexArray, measured: ComplexArray, error: ComplexArray) -> FloatArray:
    squares = [float(np.vdot(one, one).real) for one in (change, measured, error)]
    return np.array([*squares, float(np.vdot(change, error).real)])
