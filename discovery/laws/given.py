"""Laws of one's own: any expression of dT/dt, with the numbers that a fit may move.

A law comes as an expression, as a `Law`, as a candidate of an earlier ranking, or from a file
(`discovery.laws.law_file`). Before it is fitted it is refused where it changes the tension while nothing
moves, or where its rate is not a number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from discovery.laws.candidate import Candidate
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.dimensions import RATE, dimension_of, free_names, spaced
from rom.model.expressions import is_linear_in
from rom.model.laws import Law, Parameter, free_form_law
from rom.model.units import parse_unit, unit_text

OWN_RATE = "own_rate"
_SYMBOLS = ("N", "m", "s")
TRIED_TENSIONS: Numerical[tuple[float, ...]] = (0.0, 1.0, 10.0, 100.0, 1e3, 1e4)  # [N], for a law at rest
AT_REST: Numerical[float] = 1e-12  # [N/s]
_STARTS: Numerical[int] = 27  # at most, of all numbers with a range
_PER_RANGE: Numerical[tuple[float, ...]] = (0.1, 0.5, 0.9)  # of a range, where a fit starts too


@dataclass(frozen=True)
class GivenLaw(Candidate):
    """A tension law of one's own, ``dT/dt = own_rate rate(T, x, v, F, D)``, own_rate 1 in a typical test.

    Attributes
    ----------
    rate : Law
        As it was given.
    free_names : tuple of str
        Its numbers that a fit moves.
    scales : tuple of str
        Those of them in which the rate is linear and that stay positive: a fit moves their logarithm.
    """

    rate: Law = field(kw_only=True)
    free_names: tuple[str, ...] = field(kw_only=True)
    scales: tuple[str, ...] = field(kw_only=True)

    @property
    def holds(self) -> bool:
        """Never, as far as one can tell from the expression."""
        return False

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Numbers in which the rate is linear and that stay positive."""
        return self.scales

    @property
    def equation(self) -> str:
        """The expression as it was given."""
        return self.rate.equation

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every number of the expression."""
        return dict(self.rate.parameters)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the numbers that a fit moves."""
        return self.free_names

    @property
    def key(self) -> tuple[object, ...]:
        """The expression and what is held: equal keys are one law from several starts."""
        held = ((n, p.value) for n, p in self.rate.parameters.items() if n not in self.free_names)
        return ("given", self.name, self.rate.equation, *held)

    @property
    def inner_key(self) -> tuple[object, ...]:
        """All numbers but the coefficients, as a key."""
        return tuple(p.value for name, p in self.rate.parameters.items() if name not in self.scales)

    def law(self) -> Law:
        """The law for a model's bolted link, each test's own factor in it."""
        return scattering(self.rate)

    def rated(self, factors: FloatArray) -> dict[str, FloatArray]:
        """The number that makes the whole rate so many times as fast, (cases,)."""
        return {OWN_RATE: factors}

    def with_values(self, values: Mapping[str, float]) -> GivenLaw:
        """The same law with other numbers, each within its range."""
        ranges = self.rate.parameters
        kept = {name: float(np.clip(value, *ranges[name].bounds)) for name, value in values.items()}
        return replace(self, rate=self.rate.with_values(**kept))


def scattering(law: Law) -> Law:
    """The law with a factor of its own in every test, ``own_rate``."""
    every = {**law.parameters, OWN_RATE: Parameter(1.0, "1")}
    return free_form_law(f"{law.name}, own rate", f"{OWN_RATE} * ({law.equation})", "tension rate", every)


def given_law(law: str | Law | Candidate, fixed: Sequence[str] = ()) -> Candidate:
    """Return a law of one's own as a candidate, after a look at what it does.

    Parameters
    ----------
    law : str, Law or Candidate
        An expression of dT/dt [N/s] in ``T x v F D`` and numbers that start at 1; a tension rate; a
        candidate, as ``ranking.laws[0].candidate``.
    fixed : sequence of str
        Numbers of the law that a fit leaves alone.

    Returns
    -------
    Candidate
        With ``source`` ``"given"``.

    Raises
    ------
    ValueError
        If the expression cannot be read, its unit is not N/s, it loosens while nothing moves, or its rate is
        not a number.
    """
    if isinstance(law, Candidate):
        return replace(law, source="given")
    if isinstance(law, str):
        law = _from_expression(law)
    if not isinstance(law, Law):
        raise ValueError(f"laws: found {law!r}, expected an expression, a law, or a row of a ranking")
    if law.enters != "tension rate":
        raise ValueError(f"law {law.name!r}: found a law of the {law.enters}, expected a tension rate")
    if OWN_RATE in law.parameters:
        raise ValueError(
            f"law {law.name!r}: found a parameter {OWN_RATE!r}, expected another name: every test has one"
        )
    unknown = sorted(set(fixed) - set(law.parameters))
    if unknown:
        raise ValueError(
            f"law {law.name!r}: found {', '.join(unknown)} to be fixed, expected names of its parameters"
        )
    _check_at_rest(law)
    moved = tuple(name for name in law.parameters if name not in fixed)
    return GivenLaw(law.name, (), (), "given", rate=law, free_names=moved, scales=_scales(law, moved))


def _from_expression(text: str) -> Law:
    """A law whose numbers are the names that mean nothing else, of a unit where one alone can have it."""
    names = free_names(text)
    parameters = {name: Parameter(1.0, "1") for name in names}
    if len(names) == 1:
        powers = dimension_of(text, {names[0]: (0.0, 0.0, 0.0)})
        unit = {s: own - found for s, own, found in zip(_SYMBOLS, RATE, powers, strict=True)}
        parameters = {names[0]: Parameter(1.0, unit_text(unit))}
    return free_form_law(text, spaced(text), "tension rate", parameters)


def check_units(law: Law) -> None:
    """Refuse a rate that is not in N/s by the units of its parameters.

    Raises
    ------
    ValueError
        With the unit that was found.
    """
    units = {name: parse_unit(p.unit).powers for name, p in law.parameters.items()}
    values = {name: p.value for name, p in law.parameters.items()}
    try:
        found = dimension_of(law.equation, units, values)
    except ValueError as error:
        raise ValueError(f"law {law.name!r}: {error}") from error
    if any(abs(a - b) > 1e-6 for a, b in zip(found, RATE, strict=True)):
        text = unit_text(dict(zip(_SYMBOLS, found, strict=True)))
        raise ValueError(
            f"law {law.name!r}: found a rate in {text}, expected N/s: correct the units of its parameters"
        )


def _check_at_rest(law: Law) -> None:
    still = law.rate(np.array(TRIED_TENSIONS), 0.0, 0.0, 0.0, 0.0)
    known = np.isfinite(still)
    if not known.any():
        raise ValueError(f"law {law.name!r}: its rate is not a number at rest, expected 0 N/s there")
    still = np.where(
        known, still, 0.0
    )  # whether it is a number at measured tensions is asked with the records
    if np.abs(still).max() > AT_REST:
        place = int(np.argmax(np.abs(still)))
        raise ValueError(
            f"law {law.name!r}: found {still[place]:.3g} N/s at {TRIED_TENSIONS[place]:g} N while nothing "
            "moves, expected 0: multiply by a motion (v, x, F or D)"
        )


def check_finite(law: GivenLaw, nodes: FloatArray) -> None:
    """Refuse a law whose rate is not a number somewhere along the measured motion, within its ranges.

    Parameters
    ----------
    law : GivenLaw
        Tried at its start and at both ends of every range.
    nodes : ndarray, shape (6, nodes)
        Time, x, v, F, D and T along the motion, as `FrozenMotion.nodes`.

    Raises
    ------
    ValueError
        With the place where it is not.
    """
    _, x, v, force, damping, tension = nodes
    for trial in (law.rate, *_at_ends(law)):
        with np.errstate(all="ignore"):
            rate = trial.rate(tension, x, v, force, damping)
        if not np.isfinite(rate).all():
            at = int(np.argmin(np.isfinite(rate)))
            values = ", ".join(f"{name} = {p.value:g}" for name, p in trial.parameters.items())
            raise ValueError(
                f"law {law.name!r}: its rate is not a number at T = {tension[at]:.4g} N, x = {x[at]:.3g} m, "
                f"v = {v[at]:.3g} m/s with {values}: keep poles out of the parameters' ranges (low, high)"
            )


def _at_ends(law: GivenLaw) -> Iterator[Law]:
    for name in law.free_names:
        for end in law.rate.parameters[name].bounds:
            if math.isfinite(end):
                yield law.rate.with_values(**{name: end})


def _scales(law: Law, moved: Sequence[str]) -> tuple[str, ...]:
    """Numbers in which the rate is linear, that start above zero and are not said to go below."""
    return tuple(
        name
        for name in moved
        if law.parameters[name].value > 0
        and not -math.inf < law.parameters[name].bounds[0] < 0
        and is_linear_in(law.equation, name)
    )


def starts_of(law: Candidate) -> tuple[Candidate, ...]:
    """The law from its own numbers, and from places within the ranges of those that have two ends."""
    if not isinstance(law, GivenLaw):
        return (law,)
    ranges = {
        name: law.rate.parameters[name].bounds
        for name in law.free_names
        if name not in law.scales and all(map(math.isfinite, law.rate.parameters[name].bounds))
    }
    points = product(*([low + share * (high - low) for share in _PER_RANGE] for low, high in ranges.values()))
    return (
        law,
        *(
            law.with_values(dict(zip(ranges, point, strict=True)))
            for point, _ in zip(points, range(_STARTS), strict=False)
            if ranges
        ),
    )
