"""A term for a residual that no effect of the catalogue explains: sparse sums over the motion, by pysindy.

    F = sum_j g_j phi_j(x, v, T)

in one link; in one to the ground x and v are those of a body. The columns are the whitened outputs of the
terms, what the model's numbers can imitate taken off, so that a sparse fit of them is an output-error fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from discovery.criteria.criteria import Criteria
from discovery.criteria.tension import Tension
from discovery.decide.explanation import Explanation
from discovery.explain.effect_outputs import outputs_of
from discovery.explain.motion import explanation
from discovery.options import Options
from discovery.residual.output_error import WhitenedResidual
from discovery.search.optimizers import sparse_supports
from discovery.search.sparse_regression import usable
from rom.campaign.channels import FloatArray
from rom.effects import CATALOGUE, Effect, Member, ModelCorrection, free_form
from rom.model.laws import Parameter
from rom.model.units import unit_text

Terms = Mapping[str, tuple[float, ...]]
_TERMS: Terms = {  # expression and the powers of N, m, s in its coefficient's unit
    "x ** 2": (1, -2, 0),
    "abs(x) * x": (1, -2, 0),
    "x ** 3": (1, -3, 0),
    "x ** 5": (1, -5, 0),
    "v ** 2": (1, -2, 2),
    "abs(v) * v": (1, -2, 2),
    "v ** 3": (1, -3, 3),
    "sign(v) * sqrt(abs(v))": (1, -0.5, 0.5),
    "tanh(v / {v})": (1, 0, 0),
    "abs(x) * v": (1, -2, 1),
    "x * v": (1, -2, 1),
    "x ** 2 * v": (1, -3, 1),
    "x * v ** 2": (1, -3, 2),
    "x * abs(v)": (1, -2, 1),
    "max(x, 0)": (1, -1, 0),
    "max(v, 0)": (1, -1, 1),
    "max(abs(x) - {x}, 0) * sign(x)": (1, -1, 0),
}
_OF_TENSION: Terms = {
    "T * tanh(v / {v})": (0, 0, 0),
    "T * x": (0, -1, 0),
    "T * v": (0, -1, 1),
    "T * x ** 2": (0, -2, 0),
}


def explain(residual: WhitenedResidual, options: Options) -> tuple[Explanation, ...]:
    """Fit the best sparse sum of terms at every link, each with its costs on held-out records too.

    Parameters
    ----------
    residual : WhitenedResidual
        What the model leaves over of the motion.
    options : Options
        Seed of the ensembles of the sparse fits.
    """
    model, criteria = residual.baseline.model, options.criteria
    taken = {effect.enters for effect in model.effects if effect.name == "free-form"}
    left, found = residual.beyond(residual.residual), []
    for link in model.structure.links:
        ends = (link.first, link.second)
        if link.name in taken:
            continue
        peaks = np.array([[np.abs(m).max() for m in trace.relative(ends)] for trace in residual.traces])
        bolted = link.law == "bolted"
        terms = terms_at(*np.median(peaks, axis=0), tension=bolted, criteria=criteria.tension)
        columns = residual.beyond(outputs_of(single_terms(terms, link.name), residual))
        effect = sparse_sum(columns, left, terms, link.name, options.seed, criteria)
        if effect is not None:
            found.append(explanation(effect, member_of(effect), residual))
    return tuple(found)


def terms_at(x: float, v: float, *, tension: bool, criteria: Tension) -> Terms:
    """Return the terms with the scales of a motion in them.

    Parameters
    ----------
    x, v : float
        Largest displacement [m] and velocity [m/s].
    tension : bool
        Whether terms with the tension are among them.
    criteria : Tension
        Share of the velocity at which a sign turns.

    Returns
    -------
    mapping
        From each term, as text, to the exponents of N, m and s of its coefficient.
    """
    x, v = float(f"{x:.2g}"), float(f"{v:.2g}")
    terms = {**_TERMS, **(_OF_TENSION if tension else {})}
    turns = f"{criteria.turning_velocity * v:.3g}"
    return {text.format(v=turns, x=f"{0.5 * x:.3g}"): unit for text, unit in terms.items()}


def single_terms(terms: Terms, enters: str) -> list[Effect]:
    """Every term by itself, its coefficient one."""
    return [_sum([text], [1.0], enters, terms) for text in terms]


def sparse_sum(
    columns: FloatArray,
    left: FloatArray,
    terms: Terms,
    enters: str,
    seed: int,
    criteria: Criteria,
) -> Effect | None:
    """The sum of lowest cost with a price for every term; None where no two terms are told apart, or it gains
    far less than chance.

    Parameters
    ----------
    columns : ndarray, shape (rows, terms)
        What each term makes of the whitened rows, what the model's numbers can imitate taken off.
    left : ndarray, shape (rows,)
        The residual, the same taken off.
    terms : mapping
        As `terms_at` has them.
    enters : str
        The link.
    seed : int
        Of the ensembles.
    criteria : Criteria
        Most terms, and the price of each.

    Returns
    -------
    Effect or None
        The sum as a force on the link.
    """
    spread = max(float(left @ left) / len(left), 1.0)
    sums = sparse_sums(columns, left, seed, criteria)
    best = min(sums, key=lambda one: one.cost(spread, criteria.tension.term_price), default=None)
    least = criteria.screening.least_share * criteria.acceptance.training_gain_motion
    if best is None or float(left @ left) - best.square < least * spread:
        return None
    texts = list(terms)
    return _sum([texts[k] for k in best.support], best.values, enters, terms)


class SparseSum(NamedTuple):
    """Places of columns, their coefficients, and the square of what they leave over."""

    support: tuple[int, ...]
    values: FloatArray
    square: float

    def cost(self, spread: float, price: float) -> float:
        """Square in units of a spread, with a price for every term."""
        return self.square / spread + price * len(self.support)


def sparse_sums(
    columns: FloatArray,
    target: FloatArray,
    seed: int,
    criteria: Criteria,
    *,
    signed: bool = False,
    singles: bool = False,
) -> list[SparseSum]:
    """Fit sums of few columns on the paths of sparse fits by least squares; none of fewer than two.

    Parameters
    ----------
    columns : ndarray, shape (rows, columns)
        Whitened outputs of the terms.
    target : ndarray, shape (rows,)
        What they are to explain.
    seed : int
        Of the ensembles.
    criteria : Criteria
        Most terms of a sum, and the sparse fits.
    signed : bool
        As for `discovery.search.optimizers.sparse_supports`.
    singles : bool
        Whether every column is tried by itself too.

    Returns
    -------
    list of SparseSum
        In the order of their columns; empty with fewer than two columns that differ.
    """
    sound = [k for k in range(columns.shape[1]) if np.isfinite(columns[:, k]).all()]
    kept, _ = usable(columns[:, sound], [str(k) for k in sound])
    place = [sound[k] for k in kept]
    if len(place) < 2:
        return []
    basis, triangle = np.linalg.qr(columns[:, place])
    along = basis.T @ target
    outside = float(target @ target - along @ along)
    rng, rules = np.random.default_rng(seed), criteria.search
    supports = set(sparse_supports(triangle, along, rng, rules=rules, signed=signed))
    if singles:
        supports |= {frozenset([k]) for k in range(len(place))}
    found = []
    for support in sorted(sorted(one) for one in supports if len(one) <= criteria.tension.free_terms):
        values = np.asarray(np.linalg.lstsq(triangle[:, support], along, rcond=None)[0], dtype=np.float64)
        square = float(np.sum((along - triangle[:, support] @ values) ** 2)) + outside
        found.append(SparseSum(tuple(place[k] for k in support), values, square))
    return found


def _sum(texts: Sequence[str], values: Sequence[float] | FloatArray, enters: str, terms: Terms) -> Effect:
    """The force of a sum of terms."""
    equation = " + ".join(f"g_{j} * ({text})" for j, text in enumerate(texts, 1))
    parameters = {
        f"g_{j}": Parameter(float(value), unit_text(dict(zip(("N", "m", "s"), terms[text], strict=True))))
        for j, (text, value) in enumerate(zip(texts, values, strict=True), 1)
    }
    effect = free_form(equation, enters, parameters)
    assert isinstance(effect, Effect)
    return effect


def member_of(effect: ModelCorrection) -> Member:
    """What a fit needs to know of an effect; of a free form that all its numbers are strengths."""
    if effect.name in CATALOGUE:
        return CATALOGUE[effect.name]
    assert isinstance(effect, Effect)
    names = dict(effect.parameters)
    return Member(
        effect.name, ("joint",), effect.equation, names, {name: p.value for name, p in names.items()}, (),
        "found from the residual", effect.function,
    )  # fmt: skip
