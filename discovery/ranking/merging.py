"""Laws that turn out to be one: of equal predictions, or the same equation given under another name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.courses.fit import Fit, predict
from discovery.courses.frozen_motion import FrozenMotion
from discovery.laws.candidate import ALWAYS_LISTED, Candidate
from discovery.laws.names import equation_name
from discovery.laws.same_law import numbers_at_rate_of, same_law, states_of
from discovery.ranking.cross_validation import CrossValidation
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

_ROUNDED: Numerical[float] = 1e-12  # of an inner number in its unit: what a step to a bound may miss it by
_VANISHED: Numerical[float] = 1e-6  # of the noise of a course: what a term moves that is no longer there


@dataclass(frozen=True, eq=False)
class Entrant:
    """A refined law, what turned out to be the same law, and its cross-validation."""

    fit: Fit
    look_alikes: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()
    validation: CrossValidation | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, and those of standing or given laws of the same equation."""
        return (self.fit.candidate.name, *self.same_as)

    def with_another(self, found: Fit) -> Entrant:
        """The same with a law that it stands for: by name if that is always listed, or else by equation."""
        law = found.candidate
        if _listed(found):
            return replace(self, same_as=(*self.same_as, law.name))
        return replace(self, look_alikes=(*self.look_alikes, law.equation))


def same_equations(
    candidates: Sequence[Candidate], standing: Sequence[Candidate], frozen: FrozenMotion
) -> dict[str, Candidate]:
    """Return by name each standing or given law whose equation an earlier one has, and that law.

    Parameters
    ----------
    candidates : sequence of Candidate
        Of which those given count, in their order, before the standing ones.
    standing : sequence of Candidate
        Laws that are always in the race.
    frozen : FrozenMotion
        Its motion and tension are the range in which rates are compared.
    """
    given = {law.name: law for law in reversed(candidates) if law.source == "given"}
    if not given:
        return {}
    states, firsts, found = states_of(frozen.nodes), list[Candidate](), dict[str, Candidate]()
    for law in [*reversed(given.values()), *standing]:
        first = next((one for one in firsts if one.key == law.key or same_law(one, law, states)), None)
        if first is None:
            firsts.append(law)
        elif first.name != law.name:
            found[law.name] = first
    return found


def started_alike(
    starts: Sequence[Candidate], same: Mapping[str, Candidate], frozen: FrozenMotion
) -> list[Candidate]:
    """Return further starts of laws: the rates from which other laws of their equations start.

    Parameters
    ----------
    starts : sequence of Candidate
        Starts of standing laws.
    same : mapping of str to Candidate
        As `same_equations` returns it.
    frozen : FrozenMotion
        As there.
    """
    there = [(same[start.name], start) for start in starts if start.name in same]
    states = states_of(frozen.nodes)
    numbers = [(law, numbers_at_rate_of(start, law, states)) for law, start in there]
    return [law.with_values(found) for law, found in numbers if found is not None]


def merged(
    fits: Sequence[Fit], frozen: FrozenMotion, same: Mapping[str, Candidate] | None = None
) -> list[Entrant]:
    """Laws of equal predictions as one: that of the fewest numbers, the others as its look-alikes.

    Also those with a number at its bound, a threshold of zero say, or with a term that vanished, that fit as
    well as a simpler law. A law that is always listed stays, unless an earlier one of its equation
    (`same_equations`) fits as well.

    Parameters
    ----------
    fits : sequence of Fit
        Refined laws.
    frozen : FrozenMotion
        What they were fitted to.
    same : mapping of str to Candidate
        As `same_equations` returns it.
    """
    same, rules = same or {}, frozen.criteria.ranking
    noise = np.sqrt(np.diagonal(np.stack([c.covariance for c in frozen.courses]), axis1=1, axis2=2))
    turn = {name: place for place, name in enumerate(same, 1)}  # given laws before standing ones
    kept: list[tuple[Entrant, FloatArray]] = []
    for found in sorted(
        fits, key=lambda f: (not _listed(f), turn.get(f.candidate.name, 0), len(f.free), f.deviance)
    ):
        course = predict(found.candidate, frozen) + found.offsets
        reduced = without_vanished(found, frozen)
        near = rules.equal_noise * noise + rules.equal_loss * np.abs(course)
        place = next(
            (
                k
                for k, (one, other) in enumerate(kept)
                if (
                    _is_of_equation(one.fit, found, same, rules.equal_fit)
                    if _listed(found)
                    else bool((np.abs(course - other) <= near).all())
                    or _equals_at_bound(found, one.fit, rules.equal_fit)
                    or _is_without_vanished(one.fit, reduced, found.deviance + rules.equal_fit)
                )
            ),
            None,
        )
        if place is None:
            first = all(_root(one.fit, same) != _root(found, same) for one, _ in kept)
            kept.append((Entrant(found, same_as=_without_fit(found, fits, same) if first else ()), course))
        else:
            kept[place] = (kept[place][0].with_another(found), kept[place][1])
    return [one for one, _ in kept]


def _listed(found: Fit) -> bool:
    return found.candidate.source in ALWAYS_LISTED


def _root(found: Fit, same: Mapping[str, Candidate]) -> str:
    """Name of the first law of its equation, which may be its own."""
    return same.get(found.candidate.name, found.candidate).name


def _is_of_equation(one: Fit, found: Fit, same: Mapping[str, Candidate], equal: float) -> bool:
    """Whether a law has the equation of an earlier one, and that fits as well within its own ranges."""
    return _root(one, same) == _root(found, same) and one.deviance <= found.deviance + equal


def _without_fit(first: Fit, fits: Sequence[Fit], same: Mapping[str, Candidate]) -> tuple[str, ...]:
    """Names of laws of its equation that have no fit of their own: equal terms are fitted once."""
    root, there = same.get(first.candidate.name, first.candidate), {found.candidate.name for found in fits}
    names = [root.name] if root.key == first.candidate.key else []  # else its own fit failed
    names += [name for name, law in same.items() if law.name == root.name]
    return tuple(name for name in names if name not in there)


def _equals_at_bound(found: Fit, simpler: Fit, equal: float) -> bool:
    return (
        at_bound(found)
        and len(simpler.free) < len(found.free)
        and abs(simpler.deviance - found.deviance) <= equal
    )


def _is_without_vanished(one: Fit, reduced: Candidate | None, highest: float) -> bool:
    """Whether a law is what is left of another, fitted again: a needless term may have stopped that fit."""
    return reduced is not None and one.candidate.key == reduced.key and one.deviance <= highest


def at_bound(found: Fit) -> bool:
    """Whether an inner number ended at a bound of its range."""
    values = [found.candidate.parameters[name] for name in found.free]
    return any(abs(p.value - bound) <= _ROUNDED for p in values for bound in p.bounds)


def without_vanished(found: Fit, frozen: FrozenMotion) -> Candidate | None:
    """A searched law without the terms that its fit drove to nothing, as it reads then; None if all matter.

    The logarithm of a coefficient has no bound: that of a needless term falls until the term moves nothing.

    Parameters
    ----------
    found : Fit
        Of the law.
    frozen : FrozenMotion
        What it was fitted to.
    """
    law = found.candidate
    if len(law.terms) < 2 or _listed(found):
        return None
    noise = np.sqrt(np.diagonal(np.stack([c.covariance for c in frozen.courses]), axis1=1, axis2=2))
    whole = predict(law, frozen)
    kept = [
        place
        for place, name in enumerate(law.coefficient_names)
        if (np.abs(predict(law.with_values({name: 0.0}), frozen) - whole) > _VANISHED * noise).any()
    ]
    if len(kept) in (0, len(law.terms)):
        return None
    terms, coefficients = (law.terms[place] for place in kept), (law.coefficients[place] for place in kept)
    reduced = replace(law, terms=tuple(terms), coefficients=tuple(coefficients))
    return replace(reduced, name=equation_name(reduced))
