"""A term for a tension rate that no effect of the catalogue explains: sparse sums, by pysindy.

    dT/dt = rate - sum_j g_j phi_j(x, v, T)

A column is the change of the whitened courses per unit of a term: its integral along frozen motion and the
tension of each test's own simulation, so that nothing is made linear about a law that may be far astray. What
the law itself does in each test is projected off, whatever its rate there. The sums that suit best are
proposed: their numbers are those of the linear fit, to be fitted by the likelihood itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.prediction import bin_edges
from discovery.courses.tension_likelihood import law_candidate
from discovery.criteria.criteria import Criteria
from discovery.decide.acceptance import is_accepted, spread_of
from discovery.decide.explanation import Explanation
from discovery.explain.free_form import sparse_sums
from discovery.explain.tension import compared
from discovery.explain.tension_gain import Pair
from discovery.options import Options
from discovery.residual.tension import TensionResidual
from discovery.residual.tension_data import TensionData
from discovery.search.sparse_regression import whitener
from rom.campaign.channels import FloatArray
from rom.effects import LawChange, Member, free_form
from rom.effects.free_form import FREE_FORM
from rom.model.laws import Parameter
from rom.model.model import Model

_MOTIONS = (
    "1",
    "sqrt(abs(v) / 0.05)",
    "abs(v) / 0.05",
    "(v / 0.05) ** 2",
    "(abs(v) / 0.05) ** 3",
    "(v / 0.05) ** 6",
    "tanh(abs(v) / {v})",
    "(max(v, 0) / 0.05) ** 2",
    "abs(x) / 1e-4",
    "(x / 1e-4) ** 2",
    "(x / 1e-4) ** 4",
    "(max(x, 0) / 1e-4) ** 2",
    "abs(x * v) / 5e-6",
)
_TENSIONS = {  # and the unit of the coefficient
    "max(T, 0) * follow": "1/s",
    "max(T, 0)": "1/s",
    "max(T, 0) ** 2 / 100": "1/s",
    "sign(max(T, 0))": "N/s",
}


def explain(residual: TensionResidual, options: Options) -> tuple[Explanation, ...]:
    """Return what the best sum of terms beside a model's tension law explains: a form found from the courses.

    Parameters
    ----------
    residual : TensionResidual
        The measured tension, and the model.
    options : Options
        Threads, the seed of the ensembles of the sparse fits, progress.

    Returns
    -------
    tuple of Explanation
        One at most: of the sums that explain more than chance, on held-out records too, the one of lowest
        cost with a price for every term. None where the courses are at noise, or the model has a free form
        in its tension already.
    """
    criteria = options.criteria
    price = criteria.tension.term_price
    taken = any(e.name == FREE_FORM for e in residual.model.effects_of("law change"))
    if residual.data is None or residual.misfit.is_noise or taken:
        return ()
    fitted = compared(residual, free_rates(residual.data, options.seed), (), options).explanations
    sure = [one for one in fitted if _predicts(one, criteria)]
    spread = min((spread_of(one) for one in sure), default=1.0)
    sure.sort(key=lambda one: one.cost(hold_out=False) / spread + price * one.free_numbers)
    return tuple(sure[:1])


def _predicts(one: Explanation, criteria: Criteria) -> bool:
    """Whether held-out records ask for a sum too: of so many sums one suits training records by chance."""
    unseen, price = one.gains(hold_out=True), criteria.tension.term_price
    predicted = not unseen.size or float(unseen.sum()) / spread_of(one) > price
    return is_accepted(one, criteria) and predicted


def free_rates(data: TensionData, seed: int = 0) -> tuple[Pair, ...]:
    """Return sparse sums of terms that promise to explain what the law leaves over of the training courses.

    Parameters
    ----------
    data : TensionData
        The courses, and the model with the law that leaves something over.
    seed : int
        Of the ensembles of the sparse fits.

    Returns
    -------
    tuple of (Member, LawChange)
        As the catalogue's candidates; what promises most first. None where a gauge that follows the size of
        the motion, so much per m or m/s, would explain as much.
    """
    frozen, texts, price = data.part(hold_out=False), _texts(data), data.criteria.term_price
    law, terms = _rates(data.model, frozen, texts)
    roots = whitener(frozen, frozen.change)
    beyond = _BeyondLaw(roots, roots @ _courses(frozen, law))
    target = beyond.rows(frozen.change[:, :, None])[:, 0]
    by_gauge = _best_single(beyond.rows(_means(frozen, np.abs(frozen.nodes[1:3]).T)), target)
    rows = beyond.rows(_courses(frozen, terms))
    sums = sparse_sums(rows, target, seed, frozen.criteria, signed=True, singles=True)
    cosine = data.criteria.parallel_terms
    found = [one for one in sums if not _parallel(rows[:, list(one.support)], cosine)]
    spread = max(min((one.square for one in found), default=0.0) / len(target), 1.0)
    found.sort(key=lambda one: one.cost(spread, price))
    if not found or by_gauge / spread <= found[0].cost(spread, price) - price:
        return ()
    # by straight lines a further term may seem to be worth its price: the best of every length is tried
    first = {len(one.support): one for one in reversed(found)}
    rest = [one for one in found if one is not first[len(one.support)]]
    best = [*first.values(), *rest[: int(data.criteria.proposed_sums) - len(first)]]
    names = [(factor, text) for factor in _TENSIONS for text in texts]
    return tuple(_pair([names[k] for k in one.support], one.values) for one in best)


class _BeyondLaw(NamedTuple):
    """Units of noise, and what the law does in them, (cases, bins, 1): of any rate in any case."""

    roots: FloatArray
    law: FloatArray

    def rows(self, columns: FloatArray) -> FloatArray:
        """Columns, (cases, bins, columns), in units of noise without what the law does: a row a bin."""
        unit = self.law / np.maximum(np.linalg.norm(self.law, axis=1, keepdims=True), 1e-300)
        white = self.roots @ columns
        white = white - unit * np.sum(unit * white, axis=1, keepdims=True)
        return np.asarray(white.reshape(-1, columns.shape[2]))


def _texts(data: TensionData) -> tuple[str, ...]:
    """Factors of the motion with its scale in them."""
    loosening = np.flatnonzero(data.struck[: data.training])
    peaks = [np.abs(data.nodes(int(case))[2]).max() for case in loosening]
    scale = f"{data.criteria.turning_velocity * float(np.median(peaks)):.2g}"
    return tuple(text.format(v=scale) for text in _MOTIONS)


def _rates(model: Model, frozen: FrozenMotion, texts: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Rates of the law itself, (nodes, 1), and of every term per unit, (nodes, terms) [N/s]."""
    first = model.link_laws[frozen.link].tension_rate
    assert first is not None
    _, x, v, force, damping, tension = frozen.nodes
    seen = (tension, x, v, force, damping)
    names = [f"g_{j}" for j in range(1, len(texts) + 1)]
    total = " + ".join(f"{name} * {text}" for name, text in zip(names, texts, strict=True))
    found = [law_candidate(model, None, ()).acting.rate(*seen)]
    for factor, unit in _TENSIONS.items():
        numbers = dict.fromkeys(names, Parameter(0.0, unit))
        law = LawChange("terms", "tension", f"-{factor} * ({total})", numbers).changed(first, "_")
        found += [law.with_values(**{f"_{name}": 1.0}).rate(*seen) for name in names]
    return np.stack(found[:1], axis=1), np.stack(found[1:], axis=1)


def _courses(frozen: FrozenMotion, rates: FloatArray) -> FloatArray:
    """Changes of the means over bins that rates at the nodes make, (cases, bins, rates) [N]."""
    parts = [_integral(rates[a:b], frozen.nodes[0, a:b]) for a, b in pairwise(frozen.starts)]
    return _means(frozen, np.concatenate(parts))


def _means(frozen: FrozenMotion, values: FloatArray) -> FloatArray:
    """Means over bins of what is given at the nodes, (cases, bins, columns)."""
    edges = bin_edges(frozen)
    found = np.empty((len(frozen), len(edges) - 1, values.shape[1]))
    for case, (a, b) in enumerate(pairwise(frozen.starts)):
        time = frozen.nodes[0, a:b]
        area = [np.interp(edges, time, column) for column in _integral(values[a:b], time).T]
        found[case] = (np.diff(area, axis=1) / np.diff(edges)).T
    return found


def _integral(values: FloatArray, time: FloatArray) -> FloatArray:
    """Integral from the first node on, by trapezoids."""
    steps = 0.5 * np.diff(time)[:, None] * (values[1:] + values[:-1])
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])


def _best_single(rows: FloatArray, target: FloatArray) -> float:
    """What the best single column leaves over."""
    along = (rows.T @ target) ** 2 / np.maximum((rows**2).sum(axis=0), 1e-300)
    return float(target @ target - along.max())


def _parallel(columns: FloatArray, cosine: float) -> bool:
    """Whether two columns are so much alike that what frozen motion gets wrong tells them apart."""
    unit = columns / np.linalg.norm(columns, axis=0)
    return bool(np.any(np.abs(np.triu(unit.T @ unit, 1)) > cosine))


def _pair(terms: Sequence[tuple[str, str]], values: FloatArray) -> Pair:
    """A sum of terms as a change of the law; all its numbers are strengths."""
    parts = [f"g_{j} * {factor} * {text}".removesuffix(" * 1") for j, (factor, text) in enumerate(terms, 1)]
    numbers = {
        f"g_{j}": Parameter(float(value), _TENSIONS[factor])
        for j, ((factor, _), value) in enumerate(zip(terms, values, strict=True), 1)
    }
    change = free_form(f"rate - ({' + '.join(parts)})", "tension", numbers)
    strengths = {name: p.value for name, p in numbers.items()}
    member = Member(
        change.name, ("tension",), change.equation, numbers, strengths, (), "found from the courses"
    )
    return member, change
