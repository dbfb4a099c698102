"""How an effect that was found is told: its numbers, its look-alikes, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from scipy import stats

from discovery.decide.acceptance import ALIKE, NEAR, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.motion import Probe, explanation, motion_channels
from discovery.loop.result import FoundEffect, LookAlike, Screened
from discovery.loop.state import State, residual_without, with_effects
from discovery.residual.output_error import WhitenedResidual
from discovery.separating_tests.effects import separating_tests
from discovery.separating_tests.law_changes import separating_hits
from rom.effects import CATALOGUE, Effect, ModelCorrection, candidates


def found_effect(best: Explanation, rivals: Sequence[Explanation], state: State) -> FoundEffect:
    """An effect with its numbers as the state's model has them, what is like it, and how sure it is."""
    effect = next(
        (e for e in state.model.effects if (e.name, e.enters) == (best.effect.name, best.effect.enters)),
        best.effect,
    )
    tests = separating_tests(effect, [one.effect for one in rivals], state.evidence, ALIKE, NEAR)
    tests = [test or separating_hits(best.slow, one.slow) for test, one in zip(tests, rivals, strict=True)]
    gains = best.gains(hold_out=True)
    costs = best.cost(hold_out=True)
    return FoundEffect(
        effect=_limited(effect, best.effect, state.evidence),
        look_alikes=tuple(
            LookAlike(
                one.effect.name, one.effect.enters, one.cost(hold_out=True) / costs if costs else 1.0, test
            )
            for one, test in zip(rivals, tests, strict=True)
        ),
        source="catalogue" if best.effect.name in CATALOGUE else "free-form",
        share=best.share(),
        p_value=_nominal(best, state) if best.p_value is None else best.p_value,
        wins=(int((gains > 0).sum()), len(gains)),
        basis=best.basis,
        chance="likelihood ratio" if best.p_value is None else "drawn",
    )


def _limited(effect: ModelCorrection, fitted: ModelCorrection, evidence: WhitenedResidual) -> ModelCorrection:
    """With 95 % limits: of a force of the catalogue about the last model, else by the fit that found it."""
    if isinstance(effect, Effect) and effect.name in CATALOGUE:
        return explanation(
            effect, CATALOGUE[effect.name], with_effects(residual_without(evidence, effect))
        ).effect
    limited = {
        name: replace(p, low=_moved(old.low, p.value - old.value), high=_moved(old.high, p.value - old.value))
        for (name, p), old in zip(effect.parameters.items(), fitted.parameters.values(), strict=True)
    }
    return replace(effect, parameters=limited)


def _nominal(best: Explanation, state: State) -> float:
    """Chance of a gain by the likelihood ratio, times the number of effects that were tried."""
    gained = float(best.gains(hold_out=False).sum())
    tried = len(candidates(state.model, (*motion_channels(state.evidence), "tension")))
    return min(1.0, tried * float(stats.chi2.sf(gained / spread_of(best), max(best.free_numbers, 1))))


def _moved(limit: float | None, shift: float) -> float | None:
    return None if limit is None else limit + shift


def label_of(effect: ModelCorrection) -> str:
    """Name and place of an effect."""
    return f"{effect.name} ({effect.enters})"


def screened(probes: Iterable[Sequence[Probe]], evidence: WhitenedResidual) -> tuple[Screened, ...]:
    """The best probe of every effect, and the share of the residual that it could explain."""
    left = evidence.beyond(evidence.residual)
    cost = float(left @ left)
    found = []
    for best, *_ in probes:
        strength = next(iter(best.member.strengths))
        value = best.effect.parameters[strength].value * best.amplitude
        found.append(Screened(best.effect.name, best.effect.enters, best.gain / cost, value))
    return tuple(found)
