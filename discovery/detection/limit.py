"""The smallest strength of an effect that a campaign's records would have shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Protocol

import numpy as np
import numpy.typing as npt
from joblib import delayed

from discovery.detection.power import Background, Response
from discovery.explain.probes import scaled
from discovery.threads import side_by_side
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import Member, ModelCorrection
from rom.progress import Progress, counted

_ROUNDS: Numerical[int] = 8  # strengths of an effect whose output is not linear in them
_SETTLED: Numerical[float] = 0.05  # in the logarithm of a strength
_WIDE: Numerical[float] = 100.0  # times the usual strength, where a range has no end
_FINE: Numerical[float] = 0.02  # in the logarithm of a strength
_LEAST: Numerical[float] = 1e-12  # of the end of a range

NEVER = "not shown at any strength within its range"
UNSEEN = "its output is nothing beyond what the model's own numbers imitate"


@dataclass(frozen=True)
class DetectionLimit:
    """The smallest strength of an effect that these records would have shown.

    Attributes
    ----------
    name, enters : str
        As in the catalogue of effects; where it enters.
    parameter, unit : str
        The strength, its other numbers being the catalogue's.
    value : float or None
        With which the effect is found with the probability of the criteria; None where no strength is.
    felt_percent : float or None
        What it then changes of motion, loss or reading.
    share_of_default : float or None
        Of the catalogue's strength, at the scale of its place.
    worst_value : float or None
        The same where its other numbers are those of the catalogue's grid that show least; None where no
        strength is found then.
    reason : str
        Why there is no value; empty where there is one.
    shape : mapping of str to float
        The effect's other numbers, at which `value` holds.
    """

    name: str
    enters: str
    parameter: str
    unit: str
    value: float | None
    felt_percent: float | None
    share_of_default: float | None
    worst_value: float | None = None
    reason: str = ""
    shape: Mapping[str, float] = field(default_factory=dict)


class Meter(Protocol):
    """What effects of a kind add to the last residual of a closed loop."""

    @property
    def background(self) -> Background:
        """What they must stand out from."""

    def pairs(self) -> Iterable[tuple[Member, ModelCorrection]]:
        """Effects that the model does not hold, at the scale of their places."""

    def responses(self, effects: Sequence[ModelCorrection]) -> Sequence[Response | None]:
        """What effects at one place add; None where they cannot be simulated or evaluated."""

    def squares(self, effects: Sequence[ModelCorrection]) -> Sequence[float]:
        """Squares of what effects at one place add to training records, or to some that tell most."""

    def is_linear(self, member: Member) -> bool:
        """Whether the response is in proportion to the strength."""

    def unavailable(self, member: Member, effect: ModelCorrection) -> str:
        """Why an effect has no limit; empty where it has."""


def limits_of(meter: Meter, progress: Progress | None = None, jobs: int = 1) -> Iterator[DetectionLimit]:
    """Yield the limit of every strength of every effect that a meter knows.

    Parameters
    ----------
    meter : Meter
        Of one kind of effect.
    progress : callable
        Called with (effects done, effects in all).
    jobs : int
        Threads.
    """
    pairs = list(meter.pairs())
    found = side_by_side(jobs)(delayed(_of_effect)(meter, *pair) for pair in pairs)
    yield from chain.from_iterable(counted(found, len(pairs), progress))


def _of_effect(meter: Meter, member: Member, effect: ModelCorrection) -> list[DetectionLimit]:
    """The limits of every strength of an effect."""
    reason = meter.unavailable(member, effect)
    strengths = [name for name in member.strengths if effect.parameters[name].value]
    if reason:
        return [_without(effect, name, reason) for name in strengths]
    return [_Search(meter, member, effect, name).limit() for name in strengths]


def _without(effect: ModelCorrection, name: str, reason: str) -> DetectionLimit:
    return DetectionLimit(
        effect.name, effect.enters, name, effect.parameters[name].unit, None, None, None, None, reason
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """The strength of one effect."""

    meter: Meter
    member: Member
    effect: ModelCorrection
    name: str

    def limit(self) -> DetectionLimit:
        number, least = self.effect.parameters[self.name], _without(self.effect, self.name, NEVER)
        known = self._responses()
        if not known:
            return replace(least, reason=UNSEEN)
        curve = _interpolated(known)
        value = self._of_known(self._smallest(curve), known)
        if value is None:
            return least
        return replace(
            least, value=value, felt_percent=curve(value).felt, share_of_default=value / abs(number.value),
            worst_value=self._worst(value), reason="", shape=self._shape(value),
        )  # fmt: skip

    def _of_known(self, value: float | None, known: Sequence[tuple[float, Response]]) -> float | None:
        """A strength with a response near it; where none is near, the least with one that shows."""
        near = value is None or any(abs(np.log(one / value)) < _SETTLED for one, _ in known)
        if near or self.meter.is_linear(self.member):
            return value
        background = self.meter.background
        asked = background.criteria.detection.probability
        return next((one for one, response in known if background.probability(response) >= asked), None)

    def _shape(self, strength: float) -> dict[str, float]:
        """The effect's other numbers."""
        numbers = self._at(self.effect, strength).parameters.items()
        return {name: number.value for name, number in numbers if name not in self.member.strengths}

    @property
    def _range(self) -> tuple[float, float]:
        """The smallest plausible strength, and the end of its range."""
        number = self.effect.parameters[self.name]
        high = number.bounds[1] if np.isfinite(number.bounds[1]) else _WIDE * abs(number.value)
        probe = next(iter(self._probes), None)
        least = number.value if probe is None else probe.parameters[self.name].value
        return min(abs(least), high), high

    @cached_property
    def _probes(self) -> list[ModelCorrection]:
        """The effect over the grid of its other numbers."""
        return [one for one in self.member.probes(self.effect) if one.parameters[self.name].value]

    def _at(self, shape: ModelCorrection, strength: float) -> ModelCorrection:
        """A shape at a strength, of that alone; a slider slips where it did."""
        there = scaled(self.member, shape, strength / shape.parameters[self.name].value)
        none = dict.fromkeys(self.member.strengths, 0.0)
        return there.with_values(**{**none, self.name: strength})

    def _responses(self) -> list[tuple[float, Response]]:
        """Responses at strengths that lead to the limit; one where they are in proportion to it."""
        strength, high = self._range
        known: dict[float, Response] = {}
        for _ in range(_ROUNDS):
            (found,) = self.meter.responses([self._at(self.effect, strength)])
            if found is None:
                break
            if found.square > 0:
                known[strength] = found
            next_one = high if not known else self._smallest(_interpolated(sorted(known.items())))
            next_one = high if next_one is None else next_one
            near = abs(np.log(next_one / strength)) < _SETTLED
            if near or self.meter.is_linear(self.member) or next_one in known:
                break
            strength = next_one
        return sorted(known.items())

    def _smallest(self, curve: Callable[[float], Response]) -> float | None:
        """The strength at which the probability is reached, by halving in the logarithm."""
        background, high = self.meter.background, self._range[1]
        asked = background.criteria.detection.probability
        if background.probability(curve(high)) < asked:
            return None
        low, up = np.log(_LEAST * high), np.log(high)
        while up - low > _FINE:
            middle = 0.5 * (low + up)
            if background.probability(curve(float(np.exp(middle)))) < asked:
                low = middle
            else:
                up = middle
        return float(np.exp(up))

    def _worst(self, value: float) -> float | None:
        """The limit at the numbers of the grid that show least, by how much less they show."""
        if len(self._probes) < 2:
            return value
        strength = self._range[0] if self.meter.is_linear(self.member) else value
        usual, *others = self.meter.squares(
            [self._at(shape, strength) for shape in (self.effect, *self._probes)]
        )
        least = min(others)
        worst = value * np.sqrt(usual / least) if least > 0 else np.inf
        return None if worst > self._range[1] else max(float(worst), value)


def _interpolated(known: Sequence[tuple[float, Response]]) -> Callable[[float], Response]:
    """Responses between those of some strengths; in proportion below and above them."""
    at = np.log([strength for strength, _ in known])

    def curve(strength: float) -> Response:
        place = int(np.searchsorted(at, np.log(strength)))
        if place in (0, len(at)):
            near, response = known[min(place, len(at) - 1)]
            return response.scaled(strength / near)
        share = (np.log(strength) - at[place - 1]) / (at[place] - at[place - 1])
        return known[place - 1][1].towards(known[place][1], float(share))

    return curve


def dispersion(scores: FloatArray, square: float, level: float) -> float:
    """Variance of a score over that of white noise: of single rows, or of records that err as one.

        max(level, sum_i g_i^2 n / (n - 1) / |s|^2)

    Parameters
    ----------
    scores : ndarray, shape (records,)
        g_i, the products of output and residual summed by record.
    square : float
        |s|^2.
    level : float
        Mean square of the residual.
    """
    count = max(int(np.count_nonzero(scores)), 2)
    by_record = float(scores @ scores) * count / (count - 1) / max(square, 1e-300)
    return max(level, by_record)


def by_kind(sums: Mapping[str, float], hold_out: frozenset[str]) -> tuple[FloatArray, FloatArray]:
    """Numbers by file as those of training and of hold-out records."""
    training = np.array([one for file, one in sums.items() if file not in hold_out])
    return training, np.array([one for file, one in sums.items() if file in hold_out])


def by_piece(rows: FloatArray, pieces: npt.NDArray[np.int64]) -> FloatArray:
    """Sums of training rows, (rows,), by the blocks of the records that they are in, (blocks,)."""
    return np.asarray(np.bincount(pieces, weights=rows), dtype=np.float64)
