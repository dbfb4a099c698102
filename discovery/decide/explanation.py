"""What an effect explains: its cost on every record with it and without, fitted to training records alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from discovery.residual.base import Residual
from discovery.residual.course_fit import CourseFit
from rom.campaign.channels import FloatArray
from rom.effects import ModelCorrection
from rom.model.laws import Z95, Parameter

Costs = Mapping[str, float]  # -2 log likelihood, or whitened squares, by record


@dataclass(frozen=True, eq=False)
class Explanation:
    """An effect with the values that suit the training records best, everything else refitted beside it.

    Attributes
    ----------
    effect : ModelCorrection
        With its fitted parameters and their 95 % limits.
    before, after : mapping of str to float
        Cost of every record, held out or not, without and with the effect: whitened squares or
        -2 log likelihood, so that a difference of 1 is one unit of chance.
    samples : mapping of str to int
        Whitened numbers behind every record's cost.
    hold_out : frozenset of str
        Records that no number was fitted to.
    free_numbers : int
        Of the effect alone.
    at_bound : tuple of str
        Parameters that ended at an end of their range.
    beside : mapping of str to Parameter
        Numbers of the tension law that were fitted with the effect; none where the law is not at stake.
    left : float or None
        Mean square of what the training records' misfit is with the effect, 1 being noise; None where the
        cost itself tells it.
    p_value : float or None
        Chance that any effect of the catalogue explains as much of this campaign's residuals where none is
        missing (`discovery.decide.chance`); None where nothing was drawn.
    slow : CourseFit or None
        Of an effect in the courses of the tension: the fit to them.
    basis : str
        What costs are of, in words.
    residual : Residual or None
        With the effect and everything refitted beside it, where the fit made it.
    """

    effect: ModelCorrection
    before: Costs
    after: Costs
    samples: Mapping[str, int]
    hold_out: frozenset[str]
    free_numbers: int
    at_bound: tuple[str, ...] = ()
    beside: Mapping[str, Parameter] = field(default_factory=dict)
    left: float | None = None
    p_value: float | None = None
    slow: CourseFit | None = None
    basis: str = "the residual"
    residual: Residual | None = None

    def gains(self, *, hold_out: bool) -> FloatArray:
        """Cost taken away from each record of a kind, (records,)."""
        files = self._files(hold_out)
        return np.array([self.before[file] - self.after[file] for file in files])

    def cost(self, *, hold_out: bool) -> float:
        """Cost with the effect over all records of a kind."""
        return float(sum(self.after[file] for file in self._files(hold_out)))

    def share(self, *, hold_out: bool = False) -> float:
        """Share of the cost that the effect takes away."""
        files = self._files(hold_out)
        whole = sum(self.before[file] for file in files)
        return float(self.gains(hold_out=hold_out).sum() / whole) if whole > 0 else 0.0

    def of_training(self) -> Explanation:
        """The same without what it says of held-out records."""
        kept = self._files(hold_out=False)
        before, after = ({file: costs[file] for file in kept} for costs in (self.before, self.after))
        return replace(self, before=before, after=after)

    def _files(self, hold_out: bool) -> Sequence[str]:
        return [file for file in self.before if (file in self.hold_out) == hold_out]


def standard_errors(inverse: FloatArray, scores: FloatArray, spread: float = 1.0) -> FloatArray:
    """Standard errors of numbers fitted by least squares: of single rows, or of records that err as one.

    The larger of the roots of diag(A^-1) s^2 and diag(A^-1 B A^-1) n / (n - 1), with A = S'S of the slopes,
    B = sum_i g_i g_i', and g_i = S_i' r_i over the rows of record i of n (K. Liang and S. Zeger, Biometrika
    73, 13, 1986): where a form is a little wrong the rows of a record err as one.

    Parameters
    ----------
    inverse : ndarray, shape (numbers, numbers)
        A^-1.
    scores : ndarray, shape (n, numbers)
        g_i.
    spread : float
        s^2, mean square of what is left over.

    Returns
    -------
    ndarray, shape (numbers,)
        In the units of the numbers.
    """
    count = int(np.any(scores != 0, axis=1).sum())
    by_record = inverse @ (scores.T @ scores) @ inverse * (count / max(count - 1, 1))
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse) * spread, np.diag(by_record)).clip(min=0.0)))


def limited(effect: ModelCorrection, errors: Mapping[str, float]) -> ModelCorrection:
    """The effect with 95 % limits, within the ranges; of numbers without an entry, which were held, none."""
    fitted = {
        name: limited_number(p, errors[name]) for name, p in effect.parameters.items() if name in errors
    }
    held = {name: replace(p, low=None, high=None) for name, p in effect.parameters.items()}
    return replace(effect, parameters=held | fitted)


def limited_number(number: Parameter, error: float) -> Parameter:
    """The fitted number with 95 % limits from its standard error, within its range.

    Those of a frequency are of the square of its period, which a force far below it is linear in. None where
    no error is known; at an end of the range the other end, if there is one, is all that is known.
    """
    low, high = number.bounds
    half = Z95 * error
    if half > 0 and np.isfinite(half):
        least, most = number.value - half, number.value + half
        if number.unit == "Hz" and low > 0:
            share = 2 * half / number.value
            least = number.value / np.sqrt(1 + share)
            most = number.value / np.sqrt(1 - share) if share < 1 else high
        return replace(number, low=max(float(least), low), high=min(float(most), high))
    if number.value not in number.bounds:
        return replace(number, low=None, high=None)
    return replace(number, low=low if np.isfinite(low) else None, high=high if np.isfinite(high) else None)
