"""What a closed loop asks of a kind of campaign: fits of its models, with one effect more or one less."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

from discovery.decide.explanation import Explanation
from discovery.explain.motion import Probe
from discovery.localisation.localise import Localisation
from discovery.loop.history import LoopHistory, Selection
from discovery.loop.result import FoundEffect
from discovery.loop.state import State
from discovery.options import Options
from discovery.residual.base import Residual
from discovery.residual.course_fit import Misfit
from discovery.residual.tension import TensionResidual
from rom.effects import ModelCorrection, SensorFault

Probes = Sequence[Sequence[Probe]]


class Refits(Protocol):
    """Fits of one campaign's models to its training records.

    Impact tests, ring-downs, driven or cycled campaigns and bolts at rest each have one
    (`discovery.loop.impact_refits`, `discovery.loop.free_refits`, `discovery.loop.balance_refits`,
    `discovery.loop.rest_refits`); `discovery.loop.close_loop` runs over each.
    """

    @property
    def options(self) -> Options:
        """How the loop is run."""
        ...

    @property
    def set_aside(self) -> tuple[str, ...]:
        """Records of doubtful quality, a line each."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know of the records and the declared model."""
        ...

    def start(self) -> State:
        """The declared model, its numbers fitted to all training records."""
        ...

    def corrected(self, fault: SensorFault) -> Refits:
        """The same campaign, identified anew beside a fault of its gauge."""
        ...

    def refit_with(self, state: State, explanation: Explanation, *, renew_noise: bool = False) -> Residual:
        """What is left over with one more effect, everything refitted; ``renew_noise``: the noise too.

        Parameters
        ----------
        state : State
            The model so far.
        explanation : Explanation
            Of the effect that is added.
        renew_noise : bool
            Whether the noise is estimated anew.

        Returns
        -------
        Residual
            Of the model with the effect.
        """
        ...

    def refit_from(self, residual: Residual, effect: ModelCorrection) -> Residual | None:
        """The last model refitted from where a fit beside an effect ended; None where that cannot differ."""
        ...

    def evaluated(self, residual: Residual, *, law_is_fitted: bool = False) -> State:
        """The model of a residual with its tension law and its errors."""
        ...

    def with_present_noise(self, residual: Residual) -> Residual:
        """Refitted beside the noise as it is with the model's effects."""
        ...

    def along_law(self, state: State) -> State:
        """The state with its motion followed along a tension that falls by its present law."""
        ...

    def without(self, history: LoopHistory, place: int) -> Residual | None:
        """What the other effects leave over, refitted, where one is redundant; None where it is not."""
        ...

    def views(self, history: LoopHistory) -> Iterable[State]:
        """The last state with the slopes along which effects are screened, in the order of trial."""
        ...

    def screen(self, residual: Residual) -> Probes:
        """Probes of every effect of the catalogue, best first."""
        ...

    def explain(self, probes: Probes, residual: Residual) -> list[Explanation]:
        """Fits of the effects that a screen promises."""
        ...

    def free_forms(self, state: State) -> Sequence[Explanation]:
        """Terms without the catalogue, fitted."""
        ...

    def tension(self, state: State) -> TensionResidual | None:
        """What the model's law leaves over of the tension's histories; None without a bolt."""
        ...

    def doubts(self, history: LoopHistory) -> tuple[str, ...]:
        """Reasons to doubt that the last model is near its structure."""
        ...

    def localise(self, state: State, misfit: Sequence[Misfit]) -> Localisation:
        """Where a residual lives, and the last misfit of the tension's histories."""
        ...

    def described(self, selection: Selection, state: State) -> FoundEffect:
        """An effect that was found, with limits and what is indistinguishable from it."""
        ...
