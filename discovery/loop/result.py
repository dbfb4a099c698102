"""What a closed loop returns: a verdict, the effects found, errors before and after, and what remains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from discovery.criteria.criteria import CRITERIA, Criteria
from rom.evaluation.error_measures import ErrorsByKind, Kind
from rom.evaluation.noise_floor import NoiseFloor
from rom.result_views import HasViews

if TYPE_CHECKING:
    from discovery.detection.limit import DetectionLimit
    from discovery.localisation.localise import Localisation
    from rom.effects import ModelCorrection
    from rom.model.laws import Parameter
    from rom.model.model import Model

Verdict = Literal["closed", "no-effect", "unexplained"]


@dataclass(frozen=True)
class LookAlike:
    """Another effect that these records cannot tell from the one named.

    Attributes
    ----------
    name, enters : str
        As in the catalogue of effects; where it enters.
    hold_out_cost : float
        Its cost on held-out records over that of the effect named: 1 is as good.
    test : str
        A test that would separate the two, in words; empty where none is known.
    """

    name: str
    enters: str
    hold_out_cost: float
    test: str = ""


@dataclass(frozen=True, eq=False)
class FoundEffect:
    """An effect that the declared model lacked.

    Attributes
    ----------
    effect : ModelCorrection
        With its parameters and their 95 % limits.
    look_alikes : tuple of LookAlike
        The nearest first.
    source : {"catalogue", "free-form"}
        Where its form came from.
    share : float
        Share of the whitened square of its `basis` that it took away on training records.
    p_value : float
        Chance that any effect of the catalogue explains as much of this campaign's residuals by chance
        (`discovery.decide.chance`; 0.001 at least): the signs of records drawn anew in the motion, noise and
        scatter
        in the tension. Of what shows before the hits, in the gauge's fast part, and for few records: by the
        likelihood ratio were all noise normal, times the effects tried.
    wins : tuple of int
        Held-out records that it explains better than the model without it, and how many there are.
    basis : str
        What it explains, in words: the residual; of what shows before the hits what they show.
    chance : {"drawn", "likelihood ratio"}
        Where `p_value` comes from. The latter takes rows as independent, which a misfit is not.
    """

    effect: ModelCorrection
    look_alikes: tuple[LookAlike, ...]
    source: Literal["catalogue", "free-form"]
    share: float
    p_value: float
    wins: tuple[int, int]
    basis: str = "the residual"
    chance: Literal["drawn", "likelihood ratio"] = "drawn"

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Fitted parameters that lie at an end of their range."""
        return tuple(name for name, number in self.effect.parameters.items() if number.at_bound)


@dataclass(frozen=True)
class Step:
    """The errors after one more effect; `added` is empty for the declared model."""

    added: str
    errors: ErrorsByKind


@dataclass(frozen=True)
class Screened:
    """One effect of the catalogue at one place, and how much of the residual it could explain."""

    name: str
    enters: str
    share: float
    strength: float


@dataclass(frozen=True, eq=False)
class Closure(HasViews):
    """Residual, effect, refined model, errors before and after.

    Attributes
    ----------
    verdict : {"closed", "no-effect", "unexplained"}
        Whether the effects bring the residual to what noise explains, nothing beats the declared model, or
        significant residual is left.
    effects : tuple of FoundEffect
        In the order in which they were found.
    model : Model
        The refined model.
    steps : tuple of Step
        Errors of the declared model first, then after every effect.
    residual_before, residual_after : Localisation
        Where the residual lives.
    screened : tuple of Screened
        The best of the catalogue in the first round, best first.
    set_aside, warnings : tuple of str
        Records of doubtful quality; what to know.
    detection_limits : tuple of DetectionLimit
        The smallest strength of every effect that these records would have shown.
    criteria : Criteria
        The numbers that decided.
    declared : Model or None
        The declared model, identified, before any effect.
    noise_floor : mapping
        Errors that noise alone would make on ``"training"`` and ``"hold_out"`` records.
    refitted : mapping of str to Parameter
        Of impact tests the numbers of links and bodies that were fitted, with 95 % limits, by path.

    Examples
    --------
    A `closure` from ``discovery.close_loop(campaign)``:

    >>> closure.verdict
    'closed'
    >>> print(closure.summary().splitlines()[0])
    What was missing: coulomb-friction in the link flexure_lo.
    >>> sorted(closure.to_frame()["set"].unique())
    ['hold_out', 'training']
    """

    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    model: Model
    steps: tuple[Step, ...]
    residual_before: Localisation
    residual_after: Localisation
    screened: tuple[Screened, ...] = ()
    set_aside: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    detection_limits: tuple[DetectionLimit, ...] = ()
    criteria: Criteria = CRITERIA
    declared: Model | None = None
    noise_floor: Mapping[Kind, NoiseFloor] = field(default_factory=dict)
    refitted: Mapping[str, Parameter] = field(default_factory=dict)

    def __repr__(self) -> str:
        found = ", ".join(f"{one.effect.name} in {one.effect.enters}" for one in self.effects)
        return f"Closure({self.verdict!r}, effects: {found or 'none'})"

    @property
    def before(self) -> ErrorsByKind:
        """Errors of the declared model."""
        return self.steps[0].errors

    @property
    def after(self) -> ErrorsByKind:
        """Errors of the refined model."""
        return self.steps[-1].errors
