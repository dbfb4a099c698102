"""The library of candidate terms: motion factors times tension factors, built from pysindy's libraries.

    dT/dt = -sum_jk c_jk Theta_j(|v|, |x|, |F|, |D|) Phi_k(T)

All columns are without dimension: each factor is divided by its value at the campaign's scales (the median
over the tests of the largest |v|, |x|, |F|, |D|, and the median tension). So c [N/s] is the rate that a term
alone makes at these scales, and c over both factors' scales is the term's coefficient in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import groupby, product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from discovery.criteria.criteria import CRITERIA
from discovery.criteria.search import Search
from discovery.laws.candidate import Term
from discovery.laws.factors import (
    Factor,
    displacement_power,
    displacement_threshold,
    dissipated_power,
    force_power,
    tension_exponential,
    tension_logistic,
    tension_power,
    usual_unit,
    velocity_displacement,
    velocity_power,
    velocity_threshold,
)
from rom.campaign.channels import FloatArray

if TYPE_CHECKING:
    from discovery.courses.frozen_motion import FrozenMotion

_INPUTS = ("abs(v)", "abs(x)", "abs(F)", "abs(D)", "T")


@dataclass(frozen=True)
class Scales:
    """Sizes of what moves, |v| [m/s], |x| [m], |F| [N], its damping part |D| [N], and of the tension [N]."""

    velocity: float
    displacement: float
    force: float
    damping: float
    tension: float

    @classmethod
    def of(cls, frozen: FrozenMotion) -> Scales:
        """Medians over the tests of the largest values, and of the tension before the hit."""
        sizes = [np.abs(frozen.of_case(i)[1:5]).max(axis=1) for i in range(len(frozen))]
        x, v, force, damping = np.maximum(np.median(sizes, axis=0), 1e-12)
        tension = float(np.median(np.maximum(frozen.initial, min(1e-3, 1e-5 * frozen.initial.max()))))
        return cls(float(v), float(x), float(force), float(damping), tension)

    @property
    def unit(self) -> float:
        """Power of ten [N] in which the tensions are those of a usual bolt."""
        return usual_unit(self.tension)

    def of_factor(self, factor: Factor) -> float:
        """The factor's value at these scales, in its SI unit."""
        if any(base == "T" for base, _ in factor.powers):
            return float(factor.of_tension(np.array([self.tension]))[0])
        place = (np.array([s]) for s in (self.displacement, self.velocity, self.force, self.damping))
        return float(factor.of_motion(*place)[0])


@dataclass(frozen=True, eq=False)
class TermLibrary:
    """Every product of a motion factor and a tension factor as a column of a pysindy library.

    Attributes
    ----------
    name : str
        Name in the source of candidates.
    scales : Scales
        What the columns are divided by.
    motions, tensions : tuple of Factor
        The factors, with values for all inner parameters; column ``j * len(tensions) + k`` is motion j times
        tension k.
    degree : int
        Of the polynomials that come first among the motions.
    """

    name: str
    scales: Scales
    motions: tuple[Factor, ...]
    tensions: tuple[Factor, ...]
    degree: int = int(CRITERIA.search.degree)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The term of every column."""
        return tuple(Term(m, t) for m, t in product(self.motions, self.tensions))

    @property
    def units(self) -> FloatArray:
        """SI coefficient of every column's term per unit of its coefficient here, (columns,)."""
        motion = [1.0 / self.scales.of_factor(factor) for factor in self.motions]
        tension = [1.0 / self.scales.of_factor(factor) for factor in self.tensions]
        return np.multiply.outer(motion, tension).ravel()

    def inputs(self, nodes: FloatArray) -> FloatArray:
        """Rows of pysindy: |v|, |x|, |F|, |D| and T over their scales, (nodes, 5)."""
        _, x, v, force, damping, tension = nodes
        s = self.scales
        sizes = (s.velocity, s.displacement, s.force, s.damping, s.tension)
        columns = (np.abs(v), np.abs(x), np.abs(force), np.abs(damping), np.maximum(tension, 0.0))
        return np.stack([c / size for c, size in zip(columns, sizes, strict=True)], axis=1)

    def factors(self, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns of the two pysindy libraries, (nodes, motions) and (nodes, tensions)."""
        rows = self.inputs(nodes)
        motion, tension = self._libraries()
        return _transformed(motion, rows[:, :4]), _transformed(tension, rows[:, 4:])

    def transform(self, nodes: FloatArray) -> FloatArray:
        """All columns as pysindy's tensor product makes them, (nodes, motions * tensions)."""
        return _transformed(self._product(), self.inputs(nodes))

    def names(self) -> tuple[str, ...]:
        """Every column as pysindy prints it, in scaled quantities for polynomials and SI numbers inside."""
        library = self._product().fit(np.ones((2, len(_INPUTS))))
        return tuple(library.get_feature_names(list(_INPUTS)))

    def _product(self) -> Any:
        from pysindy import GeneralizedLibrary

        libraries = list(self._libraries())
        return GeneralizedLibrary(
            libraries,
            tensor_array=[[1, 1]],
            inputs_per_library=[[0, 1, 2, 3], [4]],
            exclude_libraries=[0, 1],
        )

    def _libraries(self) -> tuple[Any, Any]:
        """The motion factors, polynomials first, and the tension factors as pysindy libraries."""
        from pysindy import ConcatLibrary, CustomLibrary, GeneralizedLibrary, PolynomialLibrary

        degree = self.degree
        whole = polynomials(degree)
        parts, places = [], []
        custom = self.motions
        if [f.key for f in self.motions[: len(whole)]] == [f.key for f in whole]:
            parts.append(PolynomialLibrary(degree=degree, include_bias=False))
            places.append([0, 1])
            custom = self.motions[len(whole) :]
        if custom:
            columns = [_motion_column(factor, self.scales) for factor in custom]
            parts.append(CustomLibrary(columns, [_named(factor) for factor in custom]))
            places.append([0, 1, 2, 3])
        families = [list(family) for _, family in groupby(self.tensions, key=lambda factor: factor.text)]
        tension = [
            CustomLibrary([_tension_column(f, self.scales) for f in family], [_named(f) for f in family])
            for family in families
        ]
        return GeneralizedLibrary(parts, inputs_per_library=places), ConcatLibrary(tension)


def _transformed(library: Any, rows: FloatArray) -> FloatArray:
    return np.asarray(library.fit(rows).transform(rows), dtype=np.float64)


def _motion_column(factor: Factor, scales: Scales) -> Callable[..., FloatArray]:
    scale = scales.of_factor(factor)

    # one plain argument per input: pysindy counts them
    def column(v: FloatArray, x: FloatArray, force: FloatArray, damping: FloatArray) -> FloatArray:
        motion = (
            np.asarray(x) * scales.displacement,
            np.asarray(v) * scales.velocity,
            np.asarray(force) * scales.force,
            np.asarray(damping) * scales.damping,
        )
        return factor.of_motion(*motion) / scale

    return column


def _tension_column(factor: Factor, scales: Scales) -> Callable[..., FloatArray]:
    scale = scales.of_factor(factor)

    def column(tension: FloatArray) -> FloatArray:
        return factor.of_tension(np.asarray(tension) * scales.tension) / scale

    return column


def _named(factor: Factor) -> Callable[..., str]:
    text = printed(factor)
    return lambda *_: text


def printed(factor: Factor) -> str:
    """The factor as people read it: inner values in SI units, ``^`` for powers, T for max(T, 0)."""
    text = factor.text.replace("max(T, 0)", "T")
    for name, inner in factor.inner.items():
        text = re.sub(rf"\b{name}\b", f"{inner.value:.4g}", text)
    return text.replace(" ** ", "^").replace(" * ", " ")


def grid(factor: Factor) -> tuple[Factor, ...]:
    """The factor at every point of its inner parameters' grids."""
    axes = [inner.grid or (inner.value,) for inner in factor.inner.values()]
    return tuple(
        factor.with_values(**dict(zip(factor.inner, point, strict=True))) for point in product(*axes)
    )


def polynomials(degree: int) -> tuple[Factor, ...]:
    """``|v|^n |x|^q`` for whole n + q up to a degree, in the order of pysindy's PolynomialLibrary."""
    from pysindy import PolynomialLibrary

    library = PolynomialLibrary(degree=degree, include_bias=False).fit(np.ones((2, 2)))
    return tuple(_whole_powers(float(n), float(q)) for n, q in library.powers_)


def _whole_powers(n: float, q: float) -> Factor:
    if q == 0:
        return velocity_power(n)
    return velocity_displacement(n, q) if n else displacement_power(q)


@dataclass(frozen=True)
class Library:
    """A family of factors.

    Attributes
    ----------
    of : str
        ``"motion"`` or ``"tension"``.
    factors : callable
        From the campaign's scales and the criteria to the factors, each with values for its inner parameters.
    """

    of: Literal["motion", "tension"]
    factors: Callable[[Scales, Search], tuple[Factor, ...]]


LIBRARIES: dict[str, Library] = {
    "polynomials": Library("motion", lambda _, rules: polynomials(int(rules.degree))),
    "velocity": Library("motion", lambda *_: grid(velocity_power())),
    "displacement": Library("motion", lambda *_: grid(displacement_power())),
    "velocity and displacement": Library("motion", lambda *_: grid(velocity_displacement())),
    "dissipated power": Library("motion", lambda *_: grid(dissipated_power())),
    "force": Library("motion", lambda *_: grid(force_power())),
    "velocity above a threshold": Library(
        "motion", lambda scales, _: grid(velocity_threshold(0.1 * scales.velocity, scales.velocity))
    ),
    "displacement above a threshold": Library(
        "motion",
        lambda scales, _: grid(displacement_threshold(0.1 * scales.displacement, scales.displacement)),
    ),
    "rate-free": Library("motion", lambda *_: tuple(velocity_displacement(1.0, q) for q in (0.5, 1.5, 2.5))),
    "proportional to the tension": Library("tension", lambda *_: grid(tension_power())),
    "power of the tension": Library("tension", lambda *_: grid(tension_power(free=True))),
    "exponential in the tension": Library(
        "tension", lambda scales, _: grid(tension_exponential(300.0 * scales.unit, scales.unit))
    ),
    "logistic in the tension": Library(
        "tension", lambda scales, _: grid(tension_logistic(8.0, -0.0036 / scales.unit, scales.unit))
    ),
}
"""Name -> family of factors; every motion factor is tried with every tension factor."""


def _of_all(of: str, scales: Scales, rules: Search, names: Collection[str] | None) -> list[Factor]:
    """Factors of the named families of a kind; of all where none of this kind is named."""
    there = {name: library for name, library in LIBRARIES.items() if library.of == of}
    chosen = [library for name, library in there.items() if names is None or name in names]
    families = (library.factors(scales, rules) for library in chosen or there.values())
    return [factor for family in families for factor in family]


def motion_factors(
    scales: Scales, rules: Search = CRITERIA.search, names: Collection[str] | None = None
) -> tuple[Factor, ...]:
    """Motion factors of `LIBRARIES`, each once, in their order.

    Parameters
    ----------
    scales : Scales
        The campaign's.
    rules : Search
        The criteria of the libraries.
    names : collection of str, optional
        Families to take; all where no family of motion is named.
    """
    unique: dict[object, Factor] = {}
    for factor in _of_all("motion", scales, rules, names):
        unique.setdefault(factor.key, factor)
    return tuple(unique.values())


def tension_factors(
    scales: Scales, *fitted: Factor, rules: Search = CRITERIA.search, names: Collection[str] | None = None
) -> tuple[Factor, ...]:
    """Tension factors of `LIBRARIES`, T alone first, and those of their forms that are fitted already.

    Parameters
    ----------
    scales : Scales
        The campaign's.
    *fitted : Factor
        Come last, unless they are there.
    rules : Search
        The criteria of the libraries.
    names : collection of str, optional
        Families to take; all where no family of tension is named.

    Returns
    -------
    tuple of Factor
        Each once.
    """
    points = _of_all("tension", scales, rules, names)
    forms = {factor.text for factor in points}
    points += [factor for factor in fitted if factor.text in forms]
    proportional = tension_power(1.0, free=True).key
    unique = {factor.key: factor for factor in points if factor.key != proportional}
    return tuple(unique.values())
