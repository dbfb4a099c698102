"""What effects add to the simulated motion of ring-downs and driven records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from discovery.decide.acceptance import OVER_NOISE
from discovery.detection.limit import by_kind, by_piece, dispersion
from discovery.detection.power import Background, Response, background_of
from discovery.explain.probes import LARGEST
from discovery.explain.simulation import candidates_in_decays, moved_little
from discovery.residual.simulation import SimulationResidual, over_noise
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Member, ModelCorrection
from rom.identification.ring_down import RingDown
from rom.signals.filters import displacement

_MOTION = "motion_nrmse"


@dataclass(frozen=True, eq=False)
class DecayMeter:
    """Effects in simulated records: of held-out ones what neither the state of their own imitates, nor the
    model's numbers as they suit the training records.

    Attributes
    ----------
    residual : SimulationResidual
        Of the last model.
    errors : mapping of str to mapping of str to float
        Errors of the last model's displacements, by file and channel: what an effect must lower.
    chance : ndarray, shape (draws,), or None
        Largest gains by chance of the last screen.
    """

    residual: SimulationResidual
    errors: Mapping[str, Mapping[str, float]]
    chance: FloatArray | None = None

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Core forces at the scales of their places."""
        return (pair for pair in candidates_in_decays(self.residual) if pair[0].core)

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:  # noqa: ARG002
        """All have a limit."""
        return ""

    def is_linear(self, member: Member) -> bool:  # noqa: ARG002
        """Whether the response is in proportion to the strength: hardly, where a phase runs away."""
        return False

    @cached_property
    def _judged(self) -> list[int]:
        """Places of the records whose errors must fall: those that are held out, where there are any."""
        rings, followed = self.residual.rings, [shown is not None for shown in self.residual.shown]
        known = [
            k
            for k, ring in enumerate(rings)
            if followed[k] and set(ring.channels) <= set(self.errors[ring.file])
        ]
        return [place for place in known if rings[place].hold_out] or known

    @cached_property
    def background(self) -> Background:
        """What is left of the motion."""
        rings = [self.residual.rings[k] for k in self._judged]
        errors = [np.array([self.errors[ring.file][channel] for channel in ring.channels]) for ring in rings]
        left = np.array([over_noise(self.residual.residual[self._held_out])])
        return background_of(self.residual, {_MOTION: np.concatenate(errors), OVER_NOISE: left}, self.chance)

    @cached_property
    def _held_out(self) -> npt.NDArray[np.bool_]:
        """Rows of the records whose errors must fall."""
        return np.isin(self.residual.owner, self._judged)

    def squares(self, effects: Sequence[ModelCorrection]) -> list[float]:
        """Squares of what effects add to training rows."""
        found = (self._output(effect) for effect in effects)
        return [
            0.0 if one is None else one[2] ** 2 * float(np.sum(self.residual.beyond(one[1]) ** 2))
            for one in found
        ]

    def responses(self, effects: Sequence[ModelCorrection]) -> list[Response | None]:
        """What effects at one place add."""
        return [self._response(effect) for effect in effects]

    def _response(self, effect: ModelCorrection) -> Response | None:
        found = self._output(effect)
        if found is None:
            return None
        tried, output, factor = found
        rows = self._beyond(tried, output)
        return None if rows is None else self._of_rows(output, rows).scaled(factor)

    def _output(self, effect: ModelCorrection) -> tuple[ModelCorrection, FloatArray, float] | None:
        """The effect as it is tried, its output, (rows,), and how many times that it is; None if lost."""
        residual, member, factor = self.residual, CATALOGUE[effect.name], 1.0
        if member.linear:
            small = moved_little(member, effect, residual)
            if small is None:
                return None
            name = next(name for name in member.strengths if effect.parameters[name].value)
            factor = effect.parameters[name].value / small[0].parameters[name].value
            effect, output = small
        else:
            whole = residual.output_of(effect)
            if whole is None:
                return None
            output = whole
        return (effect, output, factor) if np.abs(output).max(initial=0.0) < LARGEST else None

    def _beyond(self, effect: ModelCorrection, output: FloatArray) -> FloatArray | None:
        """What no number and no state imitates, (rows,); None where a held-out record does not finish."""
        residual, found = self.residual, np.zeros(len(output))
        found[residual.training] = residual.beyond(output)
        numbers = self._imitating @ output[residual.training]
        places = {file: place for place, (file, _) in enumerate(residual.held_out)}
        for one in residual.unseen:
            rows = one.beyond(residual.model, effect, numbers)
            if rows is None:
                return None
            found[residual.owner == places[one.record.ring.file]] = rows
        return found

    @cached_property
    def _imitating(self) -> FloatArray:
        """What numbers of the model imitate training rows best: (numbers, training rows)."""
        columns = self.residual.slopes
        size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        inverse = np.linalg.pinv(columns / size, rcond=1e-10) / size[:, None]
        return np.asarray(inverse[: len(self.residual.names)])

    def _of_rows(self, output: FloatArray, rows: FloatArray) -> Response:
        residual, mine = self.residual, self.residual.training
        trained = by_piece(rows[mine] ** 2, residual.pieces)
        scores = by_piece(rows[mine] * residual.unexplained, residual.pieces)
        _, unseen = by_kind(residual.costs(rows), frozenset(file for file, held in residual.held_out if held))
        pairs = [
            _shares(residual.rings[k], rows[at], residual.residual[at])
            for k in self._judged
            for at in [residual.owner == k]
        ]
        changes, phases = (np.concatenate(one) for one in zip(*pairs, strict=True))
        change = np.array([over_noise(rows[self._held_out])])
        whole = np.linalg.norm(np.concatenate([residual.rings[k].whitened for k in residual.trained]))
        return Response(
            trained, unseen, dispersion(scores, float(trained.sum()), self.background.level),
            {_MOTION: changes, OVER_NOISE: change}, 100 * float(np.linalg.norm(output[mine]) / whole),
            phases_by_chance={_MOTION: phases, OVER_NOISE: np.array([self._held_out.sum() ** -0.5])},
        )  # fmt: skip


def _shares(ring: RingDown, rows: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What rows over the noise are of the displacement of each channel, as errors are judged, (channels,).

    And the cosine of the angle between these and what is ``left`` of the record, as it scatters by chance.
    Of rows that are whitened by other noise than their own: of all channels alike.
    """
    channels = len(ring.channels)
    if ring.beside is not None:
        share = np.linalg.norm(rows) / np.linalg.norm(ring.whitened)
        return np.full(channels, share), np.full(channels, _scatter(rows, left))
    own, error = (one.reshape(channels, -1) * ring.noise[:, None] for one in (rows, left))
    chain, rate_hz = ring.measurement.chain, ring.row_rate_hz
    shares, phases = [], []
    for kind, *courses in zip(ring.kinds, own, ring.measured, error, strict=True):
        change, whole, noise = (displacement(kind, one, rate_hz, chain) for one in courses)
        shares.append(np.linalg.norm(change) / max(np.linalg.norm(whole), np.finfo(float).tiny))
        phases.append(_scatter(change, noise))
    return np.array(shares), np.array(phases)


def _scatter(change: FloatArray, noise: FloatArray) -> float:
    """Standard deviation of the cosine of the angle between courses whose lines have phases by chance.

    sqrt(1/2 sum |c|^2 |n|^2 / (sum |c|^2 sum |n|^2))
    """
    squares = [np.abs(np.fft.rfft(one)) ** 2 for one in (change, noise)]
    whole = float(np.prod([one.sum() for one in squares]))
    return float(np.sqrt(0.5 * (squares[0] @ squares[1]) / max(whole, np.finfo(float).tiny)))
