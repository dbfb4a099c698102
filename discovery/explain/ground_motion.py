"""Forces that act all the time, such as that of a ground that moves: told before the hits, judged after them.

    a_i = argmin |r_i - G P(f) a|^2 before the hit of record i,   gain = sum_i |R_i|^2 - |R_i - S(f) a_i|^2

r: the whitened motion before the hit, end states projected out (`rom.identification.noise_spectrum`), so
that a mode that
rings by itself is none; P: the force of strength one; R, S: the same of what follows. The numbers a_i are
each record's own, the frequency f is that of all. The noise floor comes from before the hits too and holds
the disturbance, so that gains come out too small.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from joblib import delayed
from scipy import optimize

from discovery.criteria.tension import Tension
from discovery.decide.explanation import Explanation
from discovery.explain.motion import explanation, motion_channels, unusual_scales
from discovery.explain.scales import OF_GROUND, rescaled
from discovery.options import Options
from discovery.residual.effect_forces import lasting_force, lasting_lines, lines_from_start
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.trajectory import MeasuredTrajectory
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Effect, Member, candidates_of
from rom.identification.noise_spectrum import quiet_seconds, segment_before_hit
from rom.identification.spectral_model import Linearised, SpectralRecord, linearise
from rom.signals.per_record_parameters import per_record_names

_STEPS_PER_LINE: Numerical[int] = 4  # of a spectrum before the hits
_SINGULAR: Numerical[float] = 1e-13  # share of the largest eigenvalue that counts as none
_REACH_HZ: Numerical[float] = 1.0  # of the finer grid about the best line
_STEP_HZ: Numerical[float] = 0.1


def explain(residual: WhitenedResidual, options: Options) -> tuple[Explanation, ...]:
    """Return what every lasting force explains that has numbers of each record's own.

    Parameters
    ----------
    residual : WhitenedResidual
        Traces of all records; disturbances that its model holds are known.
    options : Options
        Threads, criteria.
    """
    seconds = quiet_seconds([trace.measurement for trace in residual.traces])
    if seconds == 0:
        return ()
    unusual = unusual_scales(residual)
    tasks = (
        delayed(_explained)(
            member,
            rescaled(effect, unusual[effect.enters], OF_GROUND) if effect.enters in unusual else effect,
            residual,
            seconds,
            options.criteria.tension,
        )
        for member, effect in candidates_of(Effect, residual.baseline.model, motion_channels(residual))
        if _lasts(member, effect)
    )
    return tuple(found for found in side_by_side(options.jobs)(tasks) if found is not None)


def _explained(
    member: Member, effect: Effect, residual: WhitenedResidual, seconds: float, criteria: Tension
) -> Explanation | None:
    found = _Disturbance(member, effect, residual, seconds, criteria.disturbance_band)
    return found.explained(criteria.disturbance)


def _lasts(member: Member, effect: Effect) -> bool:
    """Whether a force on a body has numbers of each record's own, and a frequency that all share."""
    return bool(per_record_names(effect)) and len(member.inner) == 1 and effect.enters.startswith("body:")


class _Disturbance:
    """One effect at one place, and the motion before the hits of all records that it moves."""

    def __init__(
        self, member: Member, effect: Effect, residual: WhitenedResidual, seconds: float, band: float
    ) -> None:
        self.member, self.residual, self.seconds = member, residual, seconds
        self.names = per_record_names(effect)
        self.effect = effect.with_values(**dict.fromkeys(self.names, 0.0))
        (self.inner,) = member.inner
        bounds = [effect.parameters[name].bounds for name in self.names]
        self.range = np.array(bounds).T
        highest = band * effect.parameters[self.inner].bounds[1]
        self.body = effect.enters.partition(":")[2]
        self.rest = [
            (trace, *_at_rest(residual, trace, seconds, highest))
            for trace in residual.traces
            if self.body in trace.bodies
        ]

    def explained(self, least: float) -> Explanation | None:
        """The effect at its best frequency; None where no gain before the hits is so many times noise's."""
        low, high = self.effect.parameters[self.inner].bounds
        low = max(low, 1 / self.seconds)  # less than a period is like a level and its slope
        grid = np.arange(low, high, 1 / (_STEPS_PER_LINE * self.seconds))
        chance = len(self.names) * sum(not t.settings.hold_out for t, _, _ in self.rest)
        seen = all(len(segment.frequency) for _, segment, _ in self.rest)
        if not (chance and seen and len(grid)):  # so fast a structure shows nothing of it
            return None
        gains = self._before(grid)[1]
        if gains.max() < least * chance:
            return None
        rough = float(grid[int(np.argmax(gains))])
        usual = self.member.parameters[self.inner].bounds[1]
        reach_hz, step_hz = _REACH_HZ * high / usual, _STEP_HZ * high / usual
        near = np.arange(rough - reach_hz, rough + reach_hz, step_hz)
        near = near[(near >= low) & (near <= high)]
        best = float(near[int(np.argmax(self._after(near)))])
        reach = (max(best - step_hz, low), min(best + step_hz, high))
        at = optimize.minimize_scalar(
            lambda hz: -float(self._after(np.array([hz]))[0]), bounds=reach, method="bounded"
        ).x
        sizes = {file: numbers[0] for file, numbers in self._before(np.array([at]))[0].items()}
        own = {file: dict(zip(self.names, size.tolist(), strict=True)) for file, size in sizes.items()}
        mean = np.sqrt((np.array(list(sizes.values())) ** 2).mean(axis=0))
        typical = dict(zip(self.names, mean.tolist(), strict=True))
        effect = self.effect.with_values(**typical, **{self.inner: float(at)})
        return explanation(effect, self.member, self.residual.with_own(effect.path, own))

    def _units(self, at: FloatArray) -> list[Effect]:
        """Forces of strength one, which may be beyond their range, by frequency and number."""
        free = {
            name: replace(number, bounds=(-np.inf, np.inf)) for name, number in self.effect.parameters.items()
        }
        unit = replace(self.effect, parameters=free)
        return [unit.with_values(**{name: 1.0, self.inner: hz}) for hz in at for name in self.names]

    def _before(self, at: FloatArray) -> tuple[dict[str, FloatArray], FloatArray]:
        """Numbers by what precedes the hits, (frequencies, numbers), of each file; gains on training records.

        Parameters
        ----------
        at : ndarray, shape (frequencies,)
            Frequencies [Hz].
        """
        own, gain, units = {}, np.zeros(len(at)), self._units(at)
        for trace, segment, linear in self.rest:
            place = trace.bodies.index(self.body)
            lines = lines_from_start(trace, units, segment)
            rows = linear.projected_forces(np.eye(len(trace.bodies))[place], -lines)
            tables = rows.T.reshape(len(at), len(self.names), -1)
            gram = np.linalg.pinv(tables @ tables.swapaxes(1, 2), rcond=_SINGULAR, hermitian=True)
            found = np.einsum("fn,fnm->fm", tables @ linear.residual, gram)
            numbers = own[trace.settings.file] = np.clip(found, *self.range)
            if not trace.settings.hold_out:
                out = np.einsum("fn,fnr->fr", numbers, tables)
                gain += 2 * out @ linear.residual - np.sum(out**2, axis=1)
        return own, gain

    def _after(self, at: FloatArray) -> FloatArray:
        """What the numbers from before the hits take from the training cost after them, (frequencies,)."""
        (own, _), units, training = self._before(at), self._units(at), self.residual.of_training()
        gain = np.zeros(len(at))
        for trace, parts in training.by_record():
            if self.body not in trace.bodies:
                continue
            numbers, direction = own[trace.settings.file], trace.direction((self.body, "ground"))
            for (rows, linear), lines in zip(parts, lasting_lines(trace, units), strict=True):
                sums = (lines.reshape(len(lines), *numbers.shape) * numbers).sum(axis=2)
                out = linear.projected_forces(direction, sums)
                gain += 2 * training.residual[rows] @ out - np.sum(out**2, axis=0)
        return gain


def _at_rest(
    residual: WhitenedResidual, trace: MeasuredTrajectory, seconds: float, highest_hz: float
) -> tuple[SpectralRecord, Linearised]:
    """Spectra of a record before its hit, and what is left of them, whitened."""
    model, seen = residual.baseline.model, trace.in_double_precision()
    count = int(seconds * seen.rate_hz)
    known = lasting_force(trace, model.effects, count)
    segment = segment_before_hit(seen, trace.bodies, trace.parts[0], known, highest_hz)
    values = residual.baseline.values(trace.parts[0], trace.level)
    whitener = residual.floors[trace.group].whitener(segment, values, count / seen.rate_hz)
    return segment, linearise(segment, values, whitener)
