"""Candidate tension laws: sums of terms, in a canonical form, as equations and as laws of a model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from discovery.laws.factors import Factor, Inner, tension_logistic, tension_power, velocity_power
from rom.campaign.channels import FloatArray
from rom.model.laws import Law, Parameter, free_form_law
from rom.model.units import unit_text

BASELINE = "gamma(T) baseline"
NO_LOOSENING = "no loosening"
ALWAYS_LISTED = ("baseline", "given")
"""Sources of laws that stay in a ranking, however they do: standing rivals and laws of one's own."""
CONSTANT_QUADRATIC = "constant gamma, quadratic"
CONSTANT_QUARTIC = "constant gamma, quartic"


@dataclass(frozen=True)
class Term:
    """``sign coefficient motion tension`` of dT/dt; sign 0: a coefficient of either sign."""

    motion: Factor
    tension: Factor
    sign: int = -1

    @property
    def inner(self) -> dict[str, Inner]:
        """Inner parameters of both factors."""
        return {**self.motion.inner, **self.tension.inner}

    @property
    def structure(self) -> tuple[object, ...]:
        """What the term is apart from its free numbers."""
        fixed = tuple((name, i.value) for name, i in self.inner.items() if not i.free)
        return self.sign, self.motion.text, self.tension.text, fixed

    def with_values(self, values: Mapping[str, float]) -> Term:
        """The same term with other inner values."""
        if not values:
            return self
        motion = self.motion.with_values(**{n: v for n, v in values.items() if n in self.motion.inner})
        tension = self.tension.with_values(**{n: v for n, v in values.items() if n in self.tension.inner})
        return replace(self, motion=motion, tension=tension)

    @property
    def coefficient_unit(self) -> str:
        """Unit of the coefficient: N/s over the units of both factors."""
        exponents = {"N": 1.0, "s": -1.0, "m": 0.0}
        for factor in (self.motion, self.tension):
            for unit, power in factor.dimension.items():
                exponents[unit] -= power
        return unit_text(exponents)


@dataclass(frozen=True)
class Candidate:
    """``dT/dt = sum_j sign_j coefficient_j motion_j(x, v, F, D) tension_j(T)`` [N/s].

    Attributes
    ----------
    name : str
        Name for people.
    terms : tuple of Term
        None for a bolt that holds.
    coefficients : tuple of float
        In SI units, positive but for terms of sign 0.
    source : str
        Where it came from.
    """

    name: str
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    source: str = ""

    def __post_init__(self) -> None:
        if len(self.terms) != len(self.coefficients):
            raise ValueError(f"need {len(self.terms)} coefficients, got {len(self.coefficients)}")

    @property
    def holds(self) -> bool:
        """Whether the tension never changes: a bolt that holds."""
        return not self.terms

    def label(self, name: str, term: int) -> str:
        """Name of a term's parameter in the whole equation: numbered where there are several terms."""
        return name if len(self.terms) == 1 else f"{name}_{term + 1}"

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the coefficients, term by term."""
        return tuple(self.label("gamma", j) for j in range(len(self.terms)))

    def rated(self, factors: FloatArray) -> dict[str, FloatArray]:
        """Numbers that make the whole rate so many times as fast, by name, each (cases,)."""
        pairs = zip(self.coefficient_names, self.coefficients, strict=True)
        return {name: value * factors for name, value in pairs}

    @property
    def equation(self) -> str:
        """The whole rate as an expression."""
        parts = []
        for j, term in enumerate(self.terms):
            text = f"{term.motion.text} * {term.tension.text}"
            for name in term.inner:
                text = re.sub(rf"\b{name}\b", self.label(name, j), text)
            parts.append(f"{'-' if term.sign < 0 else '+'} {self.label('gamma', j)} * {text}")
        whole = " ".join(parts) or "0"
        return "-" + whole[2:] if whole.startswith("- ") else whole.removeprefix("+ ")

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every number of the equation with its unit, in the order of the terms."""
        found: dict[str, Parameter] = {}
        for j, (term, value) in enumerate(zip(self.terms, self.coefficients, strict=True)):
            found[self.label("gamma", j)] = Parameter(value, term.coefficient_unit)
            for factor in (term.motion, term.tension):
                found |= {self.label(n, j): p for n, p in factor.parameters.items()}
        return found

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the numbers that a fit moves."""
        return tuple(
            self.label(name, j)
            for j, term in enumerate(self.terms)
            for name in ("gamma", *(n for n, inner in term.inner.items() if inner.free))
        )

    @property
    def key(self) -> tuple[object, ...]:
        """Canonical form without free numbers: equal keys are one law."""
        return tuple(sorted((term.structure for term in self.terms), key=repr))

    @property
    def inner_key(self) -> tuple[object, ...]:
        """All numbers but the coefficients, as a key."""
        return tuple((term.motion.key, term.tension.key) for term in self.terms)

    def law(self) -> Law:
        """The law for a model's bolted link."""
        return free_form_law(self.name, self.equation, "tension rate", self.parameters)

    def with_values(self, values: Mapping[str, float]) -> Candidate:
        """The same candidate with other numbers, by the names of ``parameters``."""
        terms, coefficients = [], []
        for j, (term, value) in enumerate(zip(self.terms, self.coefficients, strict=True)):
            inner = {n: values[self.label(n, j)] for n in term.inner if self.label(n, j) in values}
            terms.append(term.with_values(inner))
            coefficients.append(float(values.get(self.label("gamma", j), value)))
        return replace(self, terms=tuple(terms), coefficients=tuple(coefficients))


def baseline(unit: float = 1.0) -> Candidate:
    """Return He et al. (2025), Eqs. 12-13: ``-gamma(T) |v|^4 T`` with the logistic exponent, T in a unit."""
    logistic = tension_logistic(8.0, -0.0036 / unit, unit)
    return Candidate(BASELINE, (Term(velocity_power().held(n=4.0), logistic),), (6.2e11,), "baseline")


def constant_power(exponent: float, name: str) -> Candidate:
    """Return ``-gamma |v|^exponent T`` with constant gamma and a given exponent."""
    return Candidate(
        name,
        (Term(velocity_power().held(n=exponent), tension_power()),),
        (1e3 ** (exponent - 1),),
        "baseline",
    )


def no_loosening() -> Candidate:
    """Return ``dT/dt = 0``: what every law must beat."""
    return Candidate(NO_LOOSENING, (), (), "baseline")


def rivals_always_in_the_race(unit: float = 1.0) -> Sequence[Candidate]:
    """Return what every ranking holds: baseline, constant gamma with powers 2 and 4, no loosening."""
    return (
        baseline(unit),
        constant_power(2.0, CONSTANT_QUADRATIC),
        constant_power(4.0, CONSTANT_QUARTIC),
        no_loosening(),
    )
