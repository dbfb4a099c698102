"""With which probability an effect of a strength passes the tests by which a closed loop names an effect.

Of an effect with the output s, whitened and without what the model's numbers imitate, and of noise whose
scores scatter phi times as much as those of white noise do, the fit finds the strength times 1 + d,

    d ~ N(0, phi / |s|^2),   training gain = (1 + d)^2 |s|^2,
    gain of a record that is held out = (1 + d) (2 (|s_i|^2 + s_i . n_i) - (1 + d) |s_i|^2)

with s_i . n_i ~ N(0, phi |s_i|^2), phi that of hold-out records. An effect changes the very motion along
which s is calculated, and the noise is told from few samples: |s|^2 is drawn too, times exp(e z). These pass
what `discovery.decide.acceptance` asks of an explanation, and `discovery.decide.chance`: signs of whole
records are drawn anew, with the effect in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy import special

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.acceptance import OVER_NOISE, closes, noise_by_chance
from discovery.residual.base import ProjectedResidual
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_SEED: Numerical[int] = 0  # numbers of a closure are the same on every run
_DRAWS: Numerical[int] = 400
_TINY: Numerical[float] = 1e-300


@dataclass(frozen=True, eq=False)
class Response:
    """What an effect of one strength adds to the records, beyond what the model's numbers imitate.

    Attributes
    ----------
    training, hold_out : ndarray, shape (records,)
        Squares of its whitened output by record.
    dispersion : float
        Variance of its score over that of white noise.
    changes : mapping of str to ndarray
        What it adds to each error that an effect must lower, by term of the error's mean.
    phases : mapping of str to ndarray
        Cosines of the angles between these and the errors that are there; none of noise.
    felt : float
        What it changes of motion, loss or reading [%].
    unseen_dispersion : float
        As `dispersion`, on hold-out records.
    phases_by_chance : mapping of str to ndarray
        Standard deviations of the cosines over draws of the noise; none where that has many lines.
    """

    training: FloatArray
    hold_out: FloatArray
    dispersion: float = 1.0
    changes: Mapping[str, FloatArray] = field(default_factory=dict)
    felt: float = 0.0
    phases: Mapping[str, FloatArray] = field(default_factory=dict)
    unseen_dispersion: float = 1.0
    phases_by_chance: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def square(self) -> float:
        """Square of the whitened output on training records."""
        return float(self.training.sum())

    def scaled(self, factor: float) -> Response:
        """The response to so many times the strength, where it is linear in that."""
        changes = {name: factor * change for name, change in self.changes.items()}
        return replace(
            self, training=factor**2 * self.training, hold_out=factor**2 * self.hold_out, changes=changes,
            felt=factor * self.felt,
        )  # fmt: skip

    def towards(self, other: Response, share: float) -> Response:
        """The response at a strength between two, interpolated in the logarithms."""

        def between(low: FloatArray, high: FloatArray) -> FloatArray:
            both = (np.log(np.maximum(one, _TINY)) for one in (low, high))
            return np.asarray(np.exp(next(both) * (1 - share) + next(both) * share))

        def straight(low: Mapping[str, FloatArray], high: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {name: one * (1 - share) + high[name] * share for name, one in low.items()}

        felt = between(np.array(self.felt), np.array(other.felt))
        return Response(
            between(self.training, other.training), between(self.hold_out, other.hold_out),
            self.dispersion * (1 - share) + other.dispersion * share,
            {n: between(change, other.changes[n]) for n, change in self.changes.items()}, float(felt),
            straight(self.phases, other.phases),
            self.unseen_dispersion * (1 - share) + other.unseen_dispersion * share,
            straight(self.phases_by_chance, other.phases_by_chance),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Background:
    """What the last model leaves over: what an effect must stand out from.

    Attributes
    ----------
    cost : float
        Cost of the training records.
    level : float
        Mean square of what is left of them; 1 is noise.
    errors : mapping of str to ndarray
        Terms of the means of the errors that an effect in the motion must lower; none for one in the tension.
    chance : ndarray, shape (draws,)
        Largest gain of any effect by chance; of none where none is drawn.
    by_signs : bool
        Whether signs of records are drawn, which an effect itself makes larger.
    gains : tuple of float
        Least gain on training and on hold-out records.
    by_chance : float
        Mean square that noise alone leaves of so few rows at times; 1 of many.
    noise_error : float
        Standard error of the logarithm of the noise's mean square, as it is told from the records.
    """

    cost: float
    level: float
    gains: tuple[float, float]
    errors: Mapping[str, FloatArray] = field(default_factory=dict)
    chance: FloatArray = field(default_factory=lambda: np.zeros(0))
    by_signs: bool = False
    criteria: Criteria = CRITERIA
    by_chance: float = 1.0
    noise_error: float = 0.0

    @property
    def spread(self) -> float:
        """Unit of gains: one, or what is left of the training records."""
        return max(self.level, 1.0)

    def probability(self, response: Response) -> float:
        """Probability that an effect is named, of draws of the noise."""
        test = _Test(self, response)
        passed = test.significant & test.of_size & test.held_out & test.material
        return float(np.mean(passed))


def background_of(
    residual: ProjectedResidual, errors: Mapping[str, FloatArray], chance: FloatArray | None
) -> Background:
    """What a residual in the motion leaves over.

    Parameters
    ----------
    residual : ProjectedResidual
        Of the last model.
    errors : mapping of str to ndarray
        As of `Background`.
    chance : ndarray, shape (draws,), or None
        Largest gains by chance of the last screen, of signs drawn anew; None where there was none.
    """
    rules = residual.criteria.acceptance
    cost, rows = float(np.sum(residual.residual[residual.training] ** 2)), int(residual.training.sum())
    by_chance = noise_by_chance(rows, residual.noise_freedom, residual.criteria)
    noise_error = float(np.sqrt(2 / residual.noise_freedom))
    return Background(
        cost, cost / rows, (rules.training_gain_motion, rules.hold_out_gain_motion),
        errors, np.zeros(0) if chance is None else chance, chance is not None, residual.criteria,
        by_chance, noise_error,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Test:
    """Draws of what a fit finds of an effect, and which of the tests each of them passes, (draws,)."""

    background: Background
    response: Response

    @cached_property
    def _noise(self) -> FloatArray:
        """Normal numbers, (draws, 2 + records that are held out)."""
        return _normal(2 + len(self.response.hold_out))

    @cached_property
    def shown(self) -> FloatArray:
        """Square of the output over what is predicted, in the noise as it is told."""
        of_prediction, of_noise = (
            self.background.criteria.detection.prediction_error,
            self.background.noise_error,
        )
        return np.asarray(np.exp(np.hypot(of_prediction, of_noise) * self._noise[:, 1]))

    @cached_property
    def fitted(self) -> FloatArray:
        """Fitted strength over the true one."""
        size = np.sqrt(max(self.response.square, _TINY))
        return np.asarray(np.maximum(1 + np.sqrt(self.response.dispersion) * self._noise[:, 0] / size, 0.0))

    @cached_property
    def gain(self) -> FloatArray:
        """Gain on training records."""
        return np.asarray(self.fitted**2 * self.response.square * self.shown)

    @property
    def significant(self) -> npt.NDArray[np.bool_]:
        """Whether chance would hardly give as much: `discovery.decide.chance`."""
        one, rules = self.background, self.background.criteria.chance
        if not one.chance.size:
            return np.ones(len(self.gain), dtype=bool)
        left = rules.false_alarms - (self._turned if one.by_signs else 0.0)
        if left <= 0:
            return np.zeros(len(self.gain), dtype=bool)
        place = min(int((1 - left) * len(one.chance)), len(one.chance) - 1)
        return np.asarray(self.gain > np.partition(one.chance, place)[place])

    @property
    def _turned(self) -> float:
        """Probability that with other signs of the records the effect would gain as much as with its own.

        That needs a sum of at most zero over the records that are turned, of a share m of the square:
        N(m |s|^2, phi m |s|^2); turning all others is the same.
        """
        square = max(self.response.square, _TINY)
        shares = self.response.training / square
        turned = 0.5 * (1 - np.abs(shares @ _signs(len(shares), len(self.background.chance))))
        return float(
            np.mean(special.ndtr(-np.sqrt(square * np.maximum(turned, 0.0) / self.response.dispersion)))
        )

    @property
    def of_size(self) -> npt.NDArray[np.bool_]:
        """Whether the gain on training records is large enough, and a share of the cost."""
        one, rules = self.background, self.background.criteria.acceptance
        share = self.gain / (one.cost + self.response.square * self.shown)
        return np.asarray((self.gain > one.gains[0] * one.spread) & (share > rules.material_share))

    @property
    def held_out(self) -> npt.NDArray[np.bool_]:
        """Whether hold-out records gain, in the motion at least half of them."""
        squares, a = self.response.hold_out * self.shown[:, None], self.fitted[:, None]
        if not squares.size:
            return np.ones(len(a), dtype=bool)
        spread = max(self.response.dispersion, self.response.unseen_dispersion)
        scores = squares + np.sqrt(spread * squares) * self._noise[:, 2:]
        gains = a * (2 * scores - a * squares)
        enough = gains.sum(axis=1) > self.background.gains[1] * self.background.spread
        if not self.background.errors:
            return np.asarray(enough)
        return np.asarray(enough & (2 * np.sum(gains > 0, axis=1) >= squares.shape[1]))

    @property
    def material(self) -> npt.NDArray[np.bool_]:
        """Whether an error of the motion falls by enough, or little is left of what exceeded noise."""
        one = self.background
        if not one.errors:
            return np.ones(len(self.gain), dtype=bool)
        rules = one.criteria.acceptance
        before = one.level * (1 + self.response.square * self.shown / one.cost)
        loud = max(rules.noise_level, one.by_chance)
        closing = np.array(
            [
                level > loud and closes(level, one.level, one.criteria, one.by_chance)
                for level in before.tolist()
            ]
        )
        least, root = np.where(closing, 0.0, rules.material_error), np.sqrt(self.shown)
        shares = root * (1 - self.fitted), root
        pairs = {n: [self._error(n, terms, share) for share in shares] for n, terms in one.errors.items()}
        ratios = {name: left / np.maximum(whole, _TINY) for name, (left, whole) in pairs.items()}
        falls = np.any([ratio <= 1 for name, ratio in ratios.items() if name != OVER_NOISE], axis=0)
        rise = np.where(closing & falls, rules.error_rise_closing, rules.material_error)
        each = np.stack([*ratios.values()])
        return np.asarray((each.min(axis=0) <= 1 - least) & (each.max(axis=0) <= 1 + rise))

    def _error(self, name: str, terms: FloatArray, share: FloatArray) -> FloatArray:
        """Means of errors beside a share of a change, (draws,): |e + share d|."""
        left, spread = share[:, None] * self.response.changes[name], self.response.phases_by_chance.get(name)
        phases = np.zeros(1) + self.response.phases.get(name, 0.0)
        if spread is not None:
            phases = np.clip(phases + spread * _normal(len(terms), 1), -1.0, 1.0)
        return np.asarray(np.sqrt(terms**2 + left**2 + 2 * terms * left * phases).mean(axis=1))


@lru_cache(maxsize=8)
def _normal(count: int, of: int = 0) -> FloatArray:
    """Normal numbers, (draws, count); others for each ``of``."""
    return np.random.default_rng(_SEED + of).standard_normal((_DRAWS, count))


@lru_cache(maxsize=4)
def _signs(records: int, draws: int) -> FloatArray:
    """Signs of records, (records, draws)."""
    return np.random.default_rng(_SEED).choice((-1.0, 1.0), size=(records, draws))
