"""Fits of all numbers of a model of impact tests by simulation of the whole motion.

The residual of impact tests takes forces of effects along the measured motion
(`discovery.residual.output_error`). Where such a force is large, what the integration of an acceleration
leaves out of a motion, some parts in a thousand, is more of that force than noise. A simulation needs no
measured motion:

    r(theta) = S^-1/2 P (Y - Y_model(theta))

with the spectra Y of the channels, the noise S and the projection P as they are in the residual. Each test's
tension falls by its own rate meanwhile. Slopes are differences of simulations at the start; every step then
tells those along itself anew (C. G. Broyden, Math. Comput. 19, 577, 1965). The rates and the slopes are taken
anew at the end, until steps from there gain next to nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discovery.explain.motion_fit import DAMPINGS, with_effects
from discovery.residual.base import level
from discovery.residual.free_parameters import FreeParameters, is_of_effect
from discovery.residual.output_error import WhitenedResidual
from discovery.residual.trajectory import (
    MeasuredTrajectory,
    Measurements,
    falling_as,
    own_models,
    simulated_channel,
)
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.evaluation.replay import replay
from rom.identification.spectral_model import Linearised, SpectralRecord
from rom.model.model import Model
from rom.progress import Progress
from rom.signals.processing import Measurement

_ROUNDS: Numerical[int] = 6  # of slopes
_MOST: Numerical[int] = 8  # steps by the slopes of one round
_DIFFERENCE: Numerical[float] = 1e-4  # of a number's size: a mode that rings soon shows more than its slope
_OF_EFFECT: Numerical[float] = 1e-3  # of an effect's: a gap opens and closes between a simulation's steps
_LITTLE: Numerical[float] = 0.1  # gained by a step, in squares of noise: a number at its limit loses four
_ROUND: Numerical[float] = 5.0  # times that in a round
_OF_NO_USE: Numerical[float] = 1e-3  # gained by a step, of the cost of a fit that states nothing
_TOLERANCE: Numerical[float] = 1e-8  # of simulations: a stiff gap shows in a fit what 1.5e-6 leaves out
_SAME: Numerical[float] = 1e-9  # of the largest singular value


class SimulatedFit:
    """Records of a residual, simulated by its model with other numbers."""

    def __init__(
        self, residual: WhitenedResidual, measurements: Measurements, final_s: tuple[float, float]
    ) -> None:
        """Take the records of a residual, as they were measured.

        Parameters
        ----------
        residual : WhitenedResidual
            Of the model where the fit starts; its effects' numbers are free too.
        measurements : sequence
            Its records, as `read_measurements` has them.
        final_s : tuple of float
            Window of the final tension [s].
        """
        self.start = with_effects(residual)
        stored = {settings.file: one for settings, one in measurements}
        self.records = [
            (trace, stored[trace.settings.file], slice(parts[0][0].start, parts[-1][0].stop))
            for trace, parts in self.start.by_record()
        ]
        parts: dict[str, list[tuple[SpectralRecord, Linearised]]] = {}
        for trace, part, linear in self.start.parts:
            parts.setdefault(trace.settings.file, []).append((part, linear))
        self.parts = parts
        self.final_s = final_s
        self.enough = max(residual.criteria.acceptance.noise_level, level(residual))
        self.own: dict[str, Model] = {}

    def fitted(self, progress: Progress | None = None) -> WhitenedResidual | None:
        """Return what simulations leave over with the numbers that suit training records best.

        Its slopes are those of simulations on training records, as at the start on held-out ones. None where
        a simulation does not finish.

        Parameters
        ----------
        progress : callable
            Called with the number of records simulated for slopes and their total, in every round.
        """
        baseline = self.start.baseline
        for _ in range(_ROUNDS):
            self._fall_as_measured(baseline.model, hold_out=False)
            rows = self.rows(baseline)
            if not np.isfinite(rows).all():
                return None
            slopes, before = self._slopes(baseline, rows, progress), float(rows @ rows)
            baseline, rows = self._lowered(baseline, rows, slopes)
            if before - float(rows @ rows) < _ROUND * self._little(rows):
                break
        self._fall_as_measured(baseline.model, hold_out=True)
        rows += self.rows(baseline, hold_out=True)
        unseen = ~self.start.training
        slopes[unseen] = self.start.jacobian[unseen]
        if not np.isfinite(rows).all():
            return None
        return replace(self.start, baseline=baseline, residual=rows, jacobian=slopes, simulated=None)

    def rows(
        self, baseline: FreeParameters, *, hold_out: bool = False, before: FloatArray | None = None
    ) -> FloatArray:
        """What the model leaves over of records of one kind; infinite where a simulation does not finish.

        Parameters
        ----------
        baseline : FreeParameters
            The model.
        hold_out : bool
            Of which records; rows of all others are zero.
        before : ndarray, shape (rows,)
            What was left of the same records before a step. Those that most was left of come first, and
            the rest is not simulated once more is left than of all before.

        Returns
        -------
        ndarray, shape (rows,)
            Of all records.
        """
        found = np.zeros(len(self.start.residual))
        asked = [one for one in self.records if one[0].settings.hold_out is hold_out]
        left, most = 0.0, np.inf
        if before is not None:
            asked.sort(key=lambda one: -float(before[one[2]] @ before[one[2]]))
            most = float(before @ before)
        for trace, stored, here in asked:
            found[here] = self._rows_of(trace, stored.as_type(np.float64), baseline)
            left += float(found[here] @ found[here])
            if left > most:
                break
        return found

    def _fall_as_measured(self, model: Model, *, hold_out: bool) -> None:
        """Take the rates by which tensions fall as they were measured to along a model's motion."""
        seen = [stored for trace, stored, _ in self.records if trace.settings.hold_out is hold_out]
        self.own |= own_models(model, seen, self.final_s, self.start.criteria.motion)

    def _lowered(
        self, baseline: FreeParameters, rows: FloatArray, slopes: FloatArray
    ) -> tuple[FreeParameters, FloatArray]:
        """Steps along slopes, which they mend, until they gain little; where they end, and what is left."""
        units = np.maximum(np.linalg.norm(slopes, axis=0), np.finfo(float).tiny)
        for _ in range(_MOST):
            better = self._better(baseline, rows, slopes / units, units)
            if better is None:
                break
            step, baseline, left = better
            slopes += np.multiply.outer(rows - left - slopes @ (step / units), step * units / (step @ step))
            gained, rows = float(rows @ rows) - float(left @ left), left
            if gained < self._little(rows):
                break
        return baseline, rows

    def _little(self, rows: FloatArray) -> float:
        """Gain of a step that is the last, by the noise: a share of the cost can be far from its minimum.

        A share of the cost where outputs along the measured motion leave less: the fit states nothing then.
        """
        cost = float(rows @ rows)
        noise = cost / max(int(np.count_nonzero(self.start.training)), 1)
        return _LITTLE * noise if noise <= self.enough else _OF_NO_USE * cost

    def _better(
        self, baseline: FreeParameters, rows: FloatArray, slopes: FloatArray, units: FloatArray
    ) -> tuple[FloatArray, FreeParameters, FloatArray] | None:
        """A Gauss-Newton step, damped ones where it does not lower the cost; where it ends, what is left."""
        orthogonal, triangle = np.linalg.qr(slopes)
        along, none = orthogonal.T @ rows, np.zeros(len(units))
        for damping in DAMPINGS:
            stacked = np.concatenate([triangle, np.sqrt(damping) * np.eye(len(units))])
            step = np.linalg.lstsq(stacked, np.concatenate([along, none]), rcond=_SAME)[0]
            moved = baseline.stepped(dict(zip(self.start.names, (step / units).tolist(), strict=True)))
            left = self.rows(moved, before=rows)
            if left @ left < rows @ rows:
                return step, moved, left
        return None

    def _slopes(self, baseline: FreeParameters, rows: FloatArray, progress: Progress | None) -> FloatArray:
        """Slopes of what is shown by the numbers that a training record tells, (rows, numbers)."""
        found = np.zeros((len(rows), len(self.start.names)))
        steps = [_OF_EFFECT if is_of_effect(name) else _DIFFERENCE for name in self.start.names]
        moved = [baseline.stepped({name: step}) for name, step in zip(self.start.names, steps, strict=True)]
        for done, (trace, stored, here) in enumerate(self.records):
            told = np.any(self.start.jacobian[here], axis=0) & (not trace.settings.hold_out)
            measurement = stored.as_type(np.float64)
            for column in np.flatnonzero(told).tolist():
                shown = rows[here] - self._rows_of(trace, measurement, moved[column])
                found[here, column] = np.nan_to_num(shown / steps[column], posinf=0.0, neginf=0.0)
            if progress is not None:
                progress(done + 1, len(self.records))
        return found

    def _rows_of(
        self, trace: MeasuredTrajectory, measurement: Measurement, baseline: FreeParameters
    ) -> FloatArray:
        parts, own = self.parts[trace.settings.file], self.own.get(trace.settings.file)
        model = baseline.model if own is None else falling_as(baseline.model, own)
        run = replay(model, measurement, _TOLERANCE)
        if run.response.status != "ok":
            return np.full(sum(len(linear.residual) for _, linear in parts), np.inf)
        values = baseline.values(parts[0][0], trace.level)
        shown = [simulated_channel(run, body, values) for body in trace.bodies]
        return np.concatenate(
            [
                linear.projected(part.motion - np.stack([trace.lines(y, part) for y in shown], axis=1))
                for part, linear in parts
            ]
        )
