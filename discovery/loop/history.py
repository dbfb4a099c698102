"""The models of a closed loop, one after the other, and what is to be said of the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from discovery.decide.acceptance import (
    QUIET,
    at_noise_floor,
    is_accepted,
    is_alike,
    is_exact,
    is_material,
    penalised_gain,
)
from discovery.decide.explanation import Explanation
from discovery.localisation.lines import Profile
from discovery.localisation.localise import COURSES
from discovery.localisation.tension import tension_views
from discovery.loop.result import Screened, Verdict
from discovery.loop.state import State
from discovery.residual.course_fit import Misfit
from rom.identification.uncoupled_priors import unlikely

FAR_LESS = 0.7
"""Of a level: one that is no matter of chance."""
CLOSES = 0.2
"""Of what was beyond noise: an effect that leaves no more closes the residual."""
MODERATE = 5.0
"""Mean square of a residual that the samples of a hit may leave where sensors are quiet."""


@dataclass(frozen=True, eq=False)
class Selection:
    """The effect that explains most, and the others that do nearly as well."""

    best: Explanation
    rivals: tuple[Explanation, ...]

    @property
    def training_gain(self) -> float:
        """What the effect takes from the cost of the training records."""
        return float(self.best.gains(hold_out=False).sum())


@dataclass(frozen=True, eq=False)
class LoopHistory:
    """Models one after the other, the declared one first, and the effects that lead from each to the next."""

    states: tuple[State, ...]
    chosen: tuple[Selection, ...] = ()
    screened: tuple[Screened, ...] = ()
    tension: tuple[Misfit, ...] = ()  # of the courses, first and last

    @property
    def last(self) -> State:
        """The model so far."""
        return self.states[-1]

    @property
    def names(self) -> frozenset[str]:
        """Names and places of its effects."""
        return frozenset(one.best.effect.path for one in self.chosen)

    def longer(self, one: Selection, state: State) -> LoopHistory:
        """The trail with one more effect."""
        return replace(self, states=(*self.states, state), chosen=(*self.chosen, one))

    def ending(self, state: State) -> LoopHistory:
        """The trail with another last model of the same effects."""
        return replace(self, states=(*self.states[:-1], state))

    def without(self, place: int, state: State) -> LoopHistory:
        """The trail without one of its effects and the model that it led to; ``state`` is then the last."""
        kept = min(place + 1, len(self.chosen) - 1)
        return replace(
            self,
            states=(*self.states[:kept], *self.states[kept + 1 : -1], state),
            chosen=(*self.chosen[:place], *self.chosen[place + 1 :]),
        )

    @property
    def at_noise_floor(self) -> bool:
        """Whether noise alone is left, or next to nothing of what was beyond it."""
        return at_noise_floor(self.last.level, self.states[0].level)

    @property
    def is_explained(self) -> bool:
        """Whether no more is left of the motion than noise, or than hits are known by."""
        return self.at_noise_floor or (self.last.level < MODERATE and is_exact(self.last.errors))

    @property
    def tension_at_noise_floor(self) -> bool:
        """Whether courses of the tension differ from the law's by noise, or next to nothing more."""
        if not self.tension or self.tension[-1].is_noise:
            return True
        return at_noise_floor(self.tension[-1].level, self.tension[0].level)

    def improves(self, after: State) -> bool:
        """Whether a state is better than the last one by what matters, or leaves little beyond noise.

        None is with which a record cannot be simulated any more.
        """
        if len(after.evidence.traces) < len(self.last.evidence.traces):
            return False
        before = self.last.level
        loud = before > QUIET
        return is_material(
            self.last.errors,
            after.errors,
            settled=loud and self.at_noise_floor,
            closes=loud and after.level - 1 <= CLOSES * (before - 1),
        )

    def or_better(self, other: LoopHistory) -> LoopHistory:
        """That which leaves noise alone; where neither does, this one unless the other leaves far less.

        Next to nothing of much is still more than noise: a form that is a little wrong leaves as much as the
        right one with another knee. What leaves far less of that too is nearer the truth.
        """
        if self.at_noise_floor:
            more = self.last.level - 1
            is_better = more > QUIET - 1 and other.last.level - 1 <= CLOSES * more
        else:
            is_better = other.at_noise_floor or other.last.level < FAR_LESS * self.last.level
        return replace(other, screened=self.screened) if is_better else self

    def doubts(self) -> tuple[str, ...]:
        """Reasons to doubt that the last model is near its plant: numbers that uncoupled tests deny."""
        return unlikely(self.last.model, self.last.evidence.baseline.believed)

    def excuses(self) -> tuple[str, ...]:
        """What is said where more than noise is left of a motion that counts as explained."""
        if self.at_noise_floor or not self.is_explained:
            return ()
        error = 100 * (self.last.errors["training"]["motion_nrmse"] or 0.0)
        return (
            f"{self.last.level:.3g} times the noise is left of a motion that is simulated to {error:.2g} %: "
            "no more than the samples of a hit leave open",
        )

    def verdict(self) -> Verdict:
        """What is to be said of the declared model."""
        if not self.is_explained or not self.tension_at_noise_floor or (self.chosen and self.doubts()):
            return "unexplained"
        return "closed" if self.chosen else "no-effect"


def chosen(explanations: Sequence[Explanation]) -> Selection | None:
    """The effect that explains most beyond chance, and what is like it; None where there is none."""
    sure = [one for one in explanations if is_accepted(one)]
    if not sure:
        return None
    best = max(sure, key=penalised_gain)
    return Selection(best, alike(explanations, best))


def alike(
    explanations: Sequence[Explanation], best: Explanation, *, hold_out: bool = True
) -> tuple[Explanation, ...]:
    """The others that do nearly as well as one of them, best first; or by what training records say alone."""

    def seen(one: Explanation) -> Explanation:
        return one if hold_out else one.of_training()

    rivals = [one for one in explanations if one is not best and is_alike(seen(one), seen(best))]
    return tuple(sorted(rivals, key=lambda one: -penalised_gain(seen(one))))


def courses(misfit: Sequence[Misfit]) -> tuple[Mapping[str, float], Mapping[str, Profile]]:
    """The last misfit of the tension's courses by its name in result files, and where it is."""
    return ({COURSES: misfit[-1].level}, tension_views(misfit[-1])) if misfit else ({}, {})
