"""Names of candidate laws and terms for people: their equations in symbols."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from discovery.laws.candidate import ALWAYS_LISTED, NO_LOOSENING, Candidate, Term
from discovery.laws.factors import Factor, tension_logistic
from discovery.laws.given import GivenLaw
from rom.criteria.number import Numerical

_DIGITS: Numerical[int] = 3
_LOGISTIC = tension_logistic().text


def names_of(candidates: Sequence[Candidate]) -> list[str]:
    """Names for people, each its own: the equation with its numbers, but for coefficients.

    What is always in the race keeps its name. Where two laws read the same, digits are added, then a number.
    """
    names: list[str] = []
    for candidate in candidates:
        known = candidate.source in ALWAYS_LISTED or isinstance(candidate, GivenLaw)
        spelt = [candidate.name] if known else [equation_name(candidate, d) for d in (_DIGITS, 4, 5, 6)]
        spelt += [f"{spelt[0]} ({k})" for k in range(2, len(candidates) + 2)]
        names.append(next(name for name in spelt if name not in names))
    return names


def equation_name(candidate: Candidate, digits: int = _DIGITS) -> str:
    """Return ``"|v|^3.98 T gamma(T)"``: the terms with their numbers, but for coefficients."""
    parts = [("" if term.sign < 0 else "- ") + term_name(term, digits) for term in candidate.terms]
    return " + ".join(parts).replace("+ - ", "- ") or NO_LOOSENING


def term_name(term: Term, digits: int | None = _DIGITS) -> str:
    """Return a term in symbols; without `digits` its inner numbers stay letters."""
    tension = "T gamma(T)" if term.tension.text == _LOGISTIC else _spelt(term.tension, digits)
    return f"{_spelt(term.motion, digits)} {tension}".strip()


def term_form(term: Term) -> str:
    """Return ``"|v|^n T gamma(T)"``: a term with letters for its numbers, held ones too."""
    return term_name(
        replace(term, motion=_with_free_numbers(term.motion), tension=_with_free_numbers(term.tension)), None
    )


def _with_free_numbers(factor: Factor) -> Factor:
    return replace(factor, inner={name: replace(inner, free=True) for name, inner in factor.inner.items()})


def _spelt(factor: Factor, digits: int | None) -> str:
    text = factor.text
    for name, inner in factor.inner.items():
        if digits is not None or not inner.free:
            free = f"{inner.value:#.{digits or _DIGITS}g}".rstrip(".")
            shown = free if inner.free and inner.value else f"{inner.value:.3g}"
            text = re.sub(rf"\b{name}\b", shown, text)
    return in_symbols(text)


def in_symbols(text: str) -> str:
    """Return an expression with ``|v|`` for abs(v), ``^`` for powers, and T for max(T, 0)."""
    text = text.replace("max(T, 0)", "T")
    text = re.sub(r"abs\(([^()]*)\)", lambda found: f"|{found[1]}|", text)
    return text.replace(" ** ", "^").replace(" * ", " ").replace(" / ", "/")
