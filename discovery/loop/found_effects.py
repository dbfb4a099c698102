"""How an effect that was found is described: its numbers, its rivals, and how significant it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from joblib import delayed
from scipy import stats

from discovery.decide.acceptance import spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.probes import Probe
from discovery.loop.history import Selection
from discovery.loop.result import FoundEffect, LookAlike, Screened
from discovery.loop.state import State
from discovery.residual.base import Residual
from discovery.separating_tests.law_changes import separating_hits
from discovery.threads import side_by_side
from rom.effects import CATALOGUE, ModelCorrection, candidates


def describe(
    selection: Selection,
    state: State,
    effect: ModelCorrection,
    tests: Sequence[str],
    channels: Sequence[str],
    jobs: int = 1,
) -> FoundEffect:
    """An effect with its numbers as the last model has them, its rivals, and how significant it is.

    Parameters
    ----------
    selection : Selection
        The effect, and what is indistinguishable from it.
    state : State
        The last model.
    effect : ModelCorrection
        As the last model has it, with 95 % limits.
    tests : sequence of str
        For each rival the test that would tell it apart, in words.
    channels : sequence of str
        Whose sensors may be at fault: so many more effects were tried.
    jobs : int
        Threads.

    Returns
    -------
    FoundEffect
        As it stands in the result.
    """
    best, rivals = selection.best, selection.rivals
    each = zip(tests, rivals, strict=True)
    tests = list(side_by_side(jobs)(delayed(_told_apart)(test, best, rival) for test, rival in each))
    gains, cost = best.gains(hold_out=True), best.cost(hold_out=True)
    return FoundEffect(
        effect=effect,
        look_alikes=tuple(
            LookAlike(
                rival.effect.name, rival.effect.enters,
                rival.cost(hold_out=True) / cost if cost else 1.0, test,
            )
            for rival, test in zip(rivals, tests, strict=True)
        ),
        source="catalogue" if best.effect.name in CATALOGUE else "free-form",
        share=best.share(),
        p_value=_nominal_p(best, state, channels) if best.p_value is None else best.p_value,
        wins=(int((gains > 0).sum()), len(gains)),
        basis=best.basis,
        chance="likelihood ratio" if best.p_value is None else "drawn",
    )  # fmt: skip


def _told_apart(test: str, best: Explanation, rival: Explanation) -> str:
    """The test that is known, else the hits that tell two laws apart."""
    return test or separating_hits(best.slow, rival.slow)


def as_first_fitted(effect: ModelCorrection, fitted: ModelCorrection) -> ModelCorrection:
    """An effect with the limits of the fit that found it, moved with its values."""
    limits = {
        name: replace(
            number,
            low=_shifted(old.low, number.value - old.value),
            high=_shifted(old.high, number.value - old.value),
        )
        for (name, number), old in zip(effect.parameters.items(), fitted.parameters.values(), strict=True)
    }
    return replace(effect, parameters=limits)


def _shifted(limit: float | None, shift: float) -> float | None:
    return None if limit is None else limit + shift


def _nominal_p(best: Explanation, state: State, channels: Sequence[str]) -> float:
    """Chance of a gain by the likelihood ratio, times the number of effects that were tried."""
    gain = float(best.gains(hold_out=False).sum())
    tried = len(candidates(state.model, channels))
    return min(1.0, tried * float(stats.chi2.sf(gain / spread_of(best), max(best.free_numbers, 1))))


def label_of(effect: ModelCorrection) -> str:
    """Name and place of an effect."""
    return f"{effect.name} ({effect.enters})"


def screened(probes: Sequence[Sequence[Probe]], residual: Residual) -> tuple[Screened, ...]:
    """The best probe of every effect, and the share of the residual that it could explain."""
    remainder = residual.beyond(residual.residual)
    cost = float(remainder @ remainder)
    found = []
    for best, *_ in probes:
        name = next((n for n in best.member.strengths if best.effect.parameters[n].value), None)
        strength = best.effect.parameters[name or next(iter(best.member.strengths))].value * best.amplitude
        share = max(best.gain, 0.0) / cost if cost else 0.0
        found.append(Screened(best.effect.name, best.effect.enters, share, strength))
    return tuple(found)
