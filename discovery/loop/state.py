"""A model on a campaign: what it leaves over, its errors, and the identification with its tension law."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from discovery.decide.acceptance import MaterialErrors
from discovery.residual.base import Residual, level
from rom.evaluation.error_measures import ErrorsByKind, summarise
from rom.evaluation.evaluate import Evaluation
from rom.identification.identify import Identification
from rom.model.model import Model


@dataclass(frozen=True, eq=False)
class State:
    """A model, what it leaves over, and its errors.

    Attributes
    ----------
    residual : Residual
        On all sound records.
    errors : mapping
        By kind of record, from free simulations.
    material : sequence of mapping of str to float or None
        The errors that an effect in the motion must lower: of the motion where hits are simulated, of the
        forces where bodies or links are driven.
    least_improvement : float
        Share by which one more effect must lower them where next to nothing is left of the residual.
    identification : Identification or None
        With the model's tension law; None without a bolt.
    evaluations : tuple of Evaluation
        Errors of single records.
    warnings : tuple of str
        What to know of the model's numbers.
    by_chance : float
        Mean square that noise alone leaves of so few rows at times; 1 of many.
    simulated_to_noise : bool
        Whether simulations of driven bodies leave noise alone, whatever balances of their forces leave.
    """

    model: Model
    residual: Residual
    errors: ErrorsByKind
    material: MaterialErrors = ()
    least_improvement: float = 0.0
    identification: Identification | None = None
    evaluations: tuple[Evaluation, ...] = ()
    warnings: tuple[str, ...] = ()
    by_chance: float = 1.0
    simulated_to_noise: bool = False

    @property
    def level(self) -> float:
        """Mean square of what the model leaves over on training records; 1 is noise.

        At the numbers that it has: those that would suit better are no excuse.
        """
        return level(self.residual.stated)


def errors_of(evaluations: Iterable[Evaluation]) -> ErrorsByKind:
    """Errors of one model over training and over hold-out records."""
    evaluations = tuple(evaluations)
    training, hold_out = (
        summarise(c for one in evaluations for c in one.comparisons if one.settings.hold_out is held)
        for held in (False, True)
    )
    return {"training": training, "hold_out": hold_out}
