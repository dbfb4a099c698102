"""The models of a closed loop, one after the other, and what is to be said of the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from discovery.criteria.criteria import CRITERIA, Criteria
from discovery.decide.acceptance import (
    at_noise_floor,
    closes,
    is_accepted,
    is_exact,
    is_indistinguishable,
    is_material,
    meets_worse,
    penalised_gain,
)
from discovery.decide.explanation import Explanation
from discovery.localisation.lines import Profile
from discovery.localisation.localise import COURSES
from discovery.localisation.tension import tension_views
from discovery.loop.result import Screened, Verdict
from discovery.loop.state import State
from discovery.residual.course_fit import Misfit
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect


@dataclass(frozen=True, eq=False)
class Selection:
    """The effect that explains most, and the others that do nearly as well."""

    best: Explanation
    rivals: tuple[Explanation, ...] = ()

    @property
    def training_gain(self) -> float:
        """What the effect takes from the cost of the training records."""
        return float(self.best.gains(hold_out=False).sum())


@dataclass(frozen=True, eq=False)
class LoopHistory:
    """Models one after the other, the declared one first, and the effects that lead from each to the next.

    Attributes
    ----------
    states : tuple of State
        One more than there are selections.
    selections : tuple of Selection
        In the order in which they were found.
    screened : tuple of Screened
        The first screen of the catalogue.
    tension : tuple of Misfit
        Of the tension's histories, the first and the last.
    chance : ndarray, shape (draws,), or None
        Largest gains of the last screen of the catalogue by chance; None where none were drawn.
    criteria : Criteria
        The numbers that decide.
    """

    states: tuple[State, ...]
    selections: tuple[Selection, ...] = ()
    screened: tuple[Screened, ...] = ()
    tension: tuple[Misfit, ...] = ()
    chance: FloatArray | None = None
    criteria: Criteria = CRITERIA

    @property
    def last(self) -> State:
        """The model so far."""
        return self.states[-1]

    @property
    def names(self) -> frozenset[str]:
        """Names and places of its effects."""
        return frozenset(selection.best.effect.path for selection in self.selections)

    def extended(self, selection: Selection, state: State) -> LoopHistory:
        """The history with one more effect."""
        return replace(self, states=(*self.states, state), selections=(*self.selections, selection))

    def ending(self, state: State) -> LoopHistory:
        """The history with another last model of the same effects."""
        return replace(self, states=(*self.states[:-1], state))

    def without(self, place: int, state: State) -> LoopHistory:
        """The history without one effect and the model that it led to; ``state`` is then the last."""
        kept = min(place + 1, len(self.selections) - 1)
        return replace(
            self,
            states=(*self.states[:kept], *self.states[kept + 1 : -1], state),
            selections=(*self.selections[:place], *self.selections[place + 1 :]),
        )

    @property
    def without_memory(self) -> LoopHistory:
        """The history before the first force with a memory; the same object where there is none."""
        remembers = [
            place
            for place, selection in enumerate(self.selections)
            if isinstance(selection.best.effect, Effect) and selection.best.effect.states
        ]
        return self.until(remembers[0]) if remembers else self

    def until(self, place: int) -> LoopHistory:
        """The history before one of its effects."""
        return replace(self, states=self.states[: place + 1], selections=self.selections[:place])

    @property
    def at_noise_floor(self) -> bool:
        """Whether noise alone is left, or next to nothing of what was beyond it."""
        return at_noise_floor(self.last.level, self.states[0].level, self.criteria, self.last.by_chance)

    @property
    def is_explained(self) -> bool:
        """Whether no more is left of the motion than noise, or than hits are known by."""
        if self.at_noise_floor or self.is_noise_in_balances:
            return True
        limit = self.criteria.closing.hit_limited_level
        return self.last.level < limit and is_exact(self.last.errors, self.criteria)

    @property
    def is_noise_in_balances(self) -> bool:
        """Whether simulations leave noise alone, and balances no more than noise of the motion makes."""
        limit = self.criteria.closing.noisy_balance_level
        return self.last.simulated_to_noise and self.last.level < limit

    @property
    def tension_at_noise_floor(self) -> bool:
        """Whether tension histories differ from the law's by noise, or next to nothing more."""
        if not self.tension or self.tension[-1].is_noise:
            return True
        return at_noise_floor(self.tension[-1].level, self.tension[0].level, self.criteria)

    def improves(self, after: State) -> bool:
        """Whether a state is better than the last one by what matters, or leaves little beyond noise.

        None is with which a record cannot be simulated any more. Where noise alone is in balances of forces,
        none is with which held-out motion is met worse.
        """
        if after.residual.record_count < self.last.residual.record_count:
            return False
        if self.is_noise_in_balances and meets_worse(self.last.errors["hold_out"], after.errors["hold_out"]):
            return False
        before = self.last.level
        loud = before > self.criteria.acceptance.noise_level
        return is_material(
            self.last.material,
            after.material,
            least=self.last.least_improvement if loud and self.at_noise_floor else None,
            closes=loud and closes(before, after.level, self.criteria, after.by_chance),
            criteria=self.criteria,
        )

    def or_better(self, other: LoopHistory) -> LoopHistory:
        """That which leaves noise alone; where neither does, this one unless the other leaves far less.

        Next to nothing of much is still more than noise: a form that is a little wrong leaves as much as the
        right one with another knee. What leaves far less of that too is nearer the truth.
        """
        rules, noise = self.criteria.closing, self.criteria.acceptance.noise_level
        if self.at_noise_floor:
            more = self.last.level - 1
            is_better = more > noise - 1 and other.last.level - 1 <= rules.closing_share * more
        else:
            is_better = other.at_noise_floor or other.last.level < rules.far_less * self.last.level
        return replace(other, screened=self.screened) if is_better else self

    def remarks(self) -> tuple[str, ...]:
        """What is said where more than noise is left of a motion that counts as explained."""
        if self.at_noise_floor or not self.is_explained:
            return ()
        error = 100 * (self.last.errors["training"]["motion_nrmse"] or 0.0)
        if self.is_noise_in_balances:
            return (
                f"simulations leave noise alone of the motion, balances of forces {self.last.level:.3g} "
                "times theirs: noise of the motion makes the numbers that balance them best too small",
            )
        return (
            f"{self.last.level:.3g} times the noise is left of a motion that is simulated to {error:.2g} %: "
            "no more than the samples of a hit leave open",
        )

    def verdict(self, doubts: Sequence[str] = ()) -> Verdict:
        """What is to be said of the declared model; ``doubts`` are reasons to mistrust the last one."""
        if not self.is_explained or not self.tension_at_noise_floor or (self.selections and doubts):
            return "unexplained"
        return "closed" if self.selections else "no-effect"


def best_explanation(explanations: Sequence[Explanation], criteria: Criteria = CRITERIA) -> Selection | None:
    """The effect that explains most beyond chance, and what is like it; None where there is none."""
    accepted = [explanation for explanation in explanations if is_accepted(explanation, criteria)]
    if not accepted:
        return None
    best = simplest(accepted, max(accepted, key=penalised_gain), criteria=criteria)
    return Selection(best, indistinguishable(explanations, best, criteria=criteria))


def simplest(
    explanations: Sequence[Explanation],
    best: Explanation,
    *,
    hold_out: bool = True,
    criteria: Criteria = CRITERIA,
) -> Explanation:
    """A special case of an effect in its place, where it serves for now; else the effect itself.

    What else is missing may lend a wider form its further numbers. So they are asked for once the special
    case is in the model: it does for now where it leaves little more, and drops out where the wider form
    makes it redundant. An effect that is nothing without a further number gives way only where
    records do not tell the two apart.

    Parameters
    ----------
    explanations : sequence of Explanation
        Of one residual.
    best : Explanation
        One of them.
    hold_out : bool
        Whether hold-out records count, or what training records say alone.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    Explanation
        One of them.
    """
    member, closing = CATALOGUE.get(best.effect.name), criteria.closing
    special, needs = (member.contains, member.needs) if member else ((), ())
    if needs:
        rivals = indistinguishable(explanations, best, hold_out=hold_out, criteria=criteria)
        least = best.share() - (1 / closing.far_less - 1) * (1 - best.share())
    else:
        rivals = tuple(one for one in explanations if is_accepted(one, criteria))
        least = closing.special_case_share * best.share()
    there = (one for one in rivals if one.effect.enters == best.effect.enters)
    alike = (one for one in there if one.effect.name in special and one.share() >= least)
    return next(alike, best)


def indistinguishable(
    explanations: Sequence[Explanation],
    best: Explanation,
    *,
    hold_out: bool = True,
    criteria: Criteria = CRITERIA,
) -> tuple[Explanation, ...]:
    """The others that do nearly as well as one of them, best first.

    Parameters
    ----------
    explanations : sequence of Explanation
        Of one residual.
    best : Explanation
        One of them.
    hold_out : bool
        Whether hold-out records count, or what training records say alone.
    criteria : Criteria
        The numbers that decide.

    Returns
    -------
    tuple of Explanation
        Without the best; empty where it has no rival.
    """

    def of_kind(explanation: Explanation) -> Explanation:
        return explanation if hold_out else explanation.of_training()

    rivals = [
        other
        for other in explanations
        if other is not best and is_indistinguishable(of_kind(other), of_kind(best), criteria)
    ]
    return tuple(sorted(rivals, key=lambda other: -penalised_gain(of_kind(other))))


def misfit_views(misfit: Sequence[Misfit]) -> tuple[Mapping[str, float], Mapping[str, Profile]]:
    """The last misfit of the tension's histories by its name in result files, and where it is."""
    return ({COURSES: misfit[-1].level}, tension_views(misfit[-1])) if misfit else ({}, {})
