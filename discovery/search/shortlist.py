"""From libraries and sparse fits to a short list of candidate laws, best first.

A first round finds a guide: the single term that suits the courses best, fitted with its scatter. Along
the tension that the guide predicts for every case all terms are integrated. Every single term and every sum
of terms on the paths of the sparse fits is then judged by the same quick measure
(``discovery.search.quick_likelihood``).
What passes goes on to refinement by re-simulation, which decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discovery.criteria.criteria import Criteria
from discovery.criteria.search import Search
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import Factor, tension_exponential, tension_logistic, tension_power
from discovery.laws.names import term_form
from discovery.search.libraries import Scales, TermLibrary, motion_factors, printed, tension_factors
from discovery.search.optimizers import sparse_supports
from discovery.search.quick_likelihood import Found, assumed_variability, best_pairs, fitted_sum, single_terms
from discovery.search.sparse_regression import (
    Rows,
    along,
    forward,
    integrals,
    least_squares,
    smoothed,
    usable,
    weighted,
    whitener,
)
from rom.campaign.channels import FloatArray

if TYPE_CHECKING:
    from discovery.courses.fit import Fit
    from discovery.courses.frozen_motion import FrozenMotion

Progress = Callable[[int, int], None]

_SINGLE = "pysindy:grid/single term"


@dataclass(frozen=True)
class Proposals:
    """Candidate laws, best first, and how they were found.

    Attributes
    ----------
    candidates : tuple of Candidate
        Distinct laws, best first, with starting values.
    considered : int
        Laws that were fitted and judged: distinct points of the grids and distinct sums of terms.
    inclusion : mapping of str to float
        How often FROLS takes a term of each form among its first two when the records are drawn again.
    dropped : tuple of str
        Columns that are zero or a multiple of another one.
    scores : tuple of float
        Quick measure of every candidate with its price for free numbers, as `candidates`.
    """

    candidates: tuple[Candidate, ...]
    considered: int
    inclusion: Mapping[str, float]
    dropped: tuple[str, ...] = ()
    scores: tuple[float, ...] = ()


def propose(
    frozen: FrozenMotion,
    baseline_fit: Fit,
    seed: int,
    tightening: bool = False,
    jobs: int = 1,  # noqa: ARG001 - the same signature as the race
    progress: Progress | None = None,
) -> Proposals:
    """Propose tension laws: all single terms on their grids, and sparse sums of terms.

    Parameters
    ----------
    frozen : FrozenMotion
        Motion and measured courses of the training records.
    baseline_fit : Fit
        A fitted law; it smooths the measured courses until a better guide is found.
    seed : int
        Seed of the ensembles and of the bootstrap over records.
    tightening : bool
        Whether terms that raise the tension are allowed beside the others.
    jobs : int
        Not used: one core is enough.
    progress : callable
        Called as ``progress(done, total)``.
    """
    return _proposed(frozen, baseline_fit, seed, tightening, progress or _silent)


def _silent(done: int, total: int) -> None:  # noqa: ARG001 - the signature of progress
    return None


def _proposed(
    frozen: FrozenMotion, baseline_fit: Fit, seed: int, tightening: bool, tell: Progress
) -> Proposals:
    rng = np.random.default_rng(seed)
    tell(0, 4)
    scales, rules = Scales.of(frozen), frozen.criteria.search
    motions = motion_factors(scales, rules)
    guide = _guide(frozen, baseline_fit, scales, motions)
    tell(1, 4)
    followed = along(guide, frozen)
    fitted = [t.tension for f in (baseline_fit, guide) for t in f.candidate.terms if t.tension.inner]
    library = TermLibrary(
        "grid", scales, motions, tension_factors(scales, *fitted, rules=rules), int(rules.degree)
    )
    columns, smooth = integrals(library, followed), smoothed(guide, followed)
    plain = weighted(columns, followed, whitener(followed, smooth))
    scatter = np.minimum(guide.tau(frozen.initial), assumed_variability(tightening, frozen.criteria.courses))
    damped = weighted(columns, followed, whitener(followed, smooth, scatter))
    singles = single_terms(plain, _SINGLE, signed=tightening)
    tell(2, 4)
    search = _Search(library, plain, damped, singles, tightening, frozen.criteria)
    sums, dropped = search.sums(rng)
    tell(3, 4)
    kept, scores = _merged(library, (*singles, *sums), plain.target.size, rules)
    inclusion = search.inclusion(rng)
    tell(4, 4)
    return Proposals(kept, len(singles) + len(sums), inclusion, dropped, scores)


def _guide(frozen: FrozenMotion, baseline_fit: Fit, scales: Scales, motions: tuple[Factor, ...]) -> Fit:
    """The best of a few single-term laws of different motion and the baseline, fitted."""
    from discovery.courses.fit import fit, refine

    tensions = (tension_power(), tension_exponential(2 * scales.tension), tension_logistic())
    library = TermLibrary("first", scales, motions, tensions, int(frozen.criteria.search.degree))
    roots = whitener(frozen, smoothed(baseline_fit, frozen))
    rows = weighted(integrals(library, frozen), frozen, roots)
    terms, units = library.terms, library.units
    forms: dict[str, Candidate] = {}
    for found in sorted(single_terms(rows, _SINGLE), key=lambda item: item.deviance):
        term = terms[found.columns[0]]
        forms.setdefault(term.motion.text, _candidate([term], found, units))
    fits = [
        fit(candidate, frozen) for candidate in list(forms.values())[: int(frozen.criteria.search.guides)]
    ]
    best = min((baseline_fit, *fits), key=lambda item: item.deviance)
    refined = best if best is baseline_fit else refine(best.candidate, frozen, rounds=1)
    return refined if refined.converged else best


@dataclass(frozen=True, eq=False)
class _Search:
    """Sums of terms from the sparse fits of several libraries, all parts of one grid of columns.

    ``plain`` rows are whitened by the noise alone and judge; ``damped`` ones also by the scatter and feed the
    sparse fits.
    """

    library: TermLibrary
    plain: Rows
    damped: Rows
    singles: Sequence[Found]
    tightening: bool
    criteria: Criteria

    def sums(self, rng: np.random.Generator) -> tuple[list[Found], tuple[str, ...]]:
        """Every distinct sum on the paths of the sparse fits, and the best pairs; and dropped columns."""
        names = self.library.names()
        sources: dict[frozenset[int], tuple[str, ...]] = {}
        dropped: dict[str, None] = {}
        for label, members in self._libraries().items():
            theta, target = self._stacked(members)
            kept, gone = usable(theta, [names[k] for k in members])
            dropped |= dict.fromkeys(gone)
            if len(kept) < 2:
                continue
            place = [members[k] for k in kept]
            found = {
                support: tuple(f"pysindy:{label}/{optimizer}" for optimizer in optimizers)
                for support, optimizers in sparse_supports(
                    theta[:, kept], target, rng, self.tightening, self.criteria.search
                ).items()
            }
            for pair in self._pairs(place):
                found[frozenset(pair)] = (*found.get(frozenset(pair), ()), f"pysindy:{label}/best pairs")
            for support, texts in found.items():
                whole = frozenset(place[k] for k in support)
                sources[whole] = tuple(dict.fromkeys((*sources.get(whole, ()), *texts)))
        sums = [self._fitted(support, texts) for support, texts in sources.items() if len(support) > 1]
        return sums, tuple(dropped)

    def inclusion(self, rng: np.random.Generator) -> dict[str, float]:
        """How often FROLS takes a term of each form among its first two when records are drawn again.

        All terms have one tension factor, the best; points of a grid that differ in numbers are one form.
        """
        members = next(iter(self._libraries().values()))
        theta, target = self.damped.columns[:, :, members], self.damped.target
        kept, _ = usable(theta.reshape(-1, len(members)), [str(k) for k in members])
        terms = self.library.terms
        forms = [term_form(terms[members[k]]) for k in kept]
        counts: dict[str, int] = {}
        rules = self.criteria.search
        draws = int(rules.bootstraps)
        for _ in range(draws):
            drawn = rng.integers(len(target), size=len(target))
            rows = theta[drawn][:, :, kept].reshape(-1, len(kept))
            for form in {
                forms[k]: None
                for k in forward(rows, target[drawn].ravel(), int(rules.first_terms), rules.ridge)
            }:
                counts[form] = counts.get(form, 0) + 1
        shares = {form: count / draws for form, count in counts.items()}
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def _libraries(self) -> dict[str, list[int]]:
        """Columns of libraries: all motions with one tension factor, several times; each with its best."""
        width = len(self.library.tensions)
        motions = np.arange(len(self.library.motions))
        deviance = np.full(len(motions) * width, np.inf)
        for found in self.singles:
            deviance[found.columns[0]] = found.deviance
        table = deviance.reshape(-1, width)
        order = [int(k) for k in np.argsort(table.min(axis=0))]
        texts: dict[str, int] = {}
        for k in order:
            texts.setdefault(self.library.tensions[k].text, k)
        shared = list(dict.fromkeys((*texts.values(), *order)))[: int(self.criteria.search.shared)]
        libraries = {printed(self.library.tensions[k]): [int(j) for j in motions * width + k] for k in shared}
        return {**libraries, "each with its best T": [int(j * width + table[j].argmin()) for j in motions]}

    def _stacked(self, members: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        return self.damped.columns[:, :, members].reshape(-1, len(members)), self.damped.target.ravel()

    def _pairs(self, members: Sequence[int]) -> list[tuple[int, int]]:
        """Places in ``members`` of the best pairs."""
        sizes = {found.columns[0]: found.coefficients[0] for found in self.singles}
        alone = [k for k, column in enumerate(members) if column in sizes]
        chosen = [members[k] for k in alone]
        rows = Rows(self.plain.columns[:, :, chosen], self.plain.target)
        values, count = np.array([sizes[k] for k in chosen]), int(self.criteria.search.pairs)
        pairs = best_pairs(rows, values, count, self.tightening, self.criteria.courses)
        return [(alone[j], alone[k]) for j, k in pairs]

    def _fitted(self, support: frozenset[int], sources: tuple[str, ...]) -> Found:
        members = sorted(support)
        start = least_squares(*self._stacked(members), signed=self.tightening)
        return fitted_sum(self.plain, members, start, sources, self.criteria.courses)


def _merged(
    library: TermLibrary, found: Iterable[Found], rows: int, rules: Search
) -> tuple[tuple[Candidate, ...], tuple[float, ...]]:
    """Distinct laws, best first: equal forms are one law, with the best numbers and all its sources.

    Sums come in two guises: with free powers of the motion, once for every form, and with whole powers that
    are held, a few of every form, so that no form crowds out the others. Of the sums that are not better than
    every single term, their added numbers counted, a few are kept.
    """
    terms, units, price = library.terms, library.units, float(np.log(rows))
    best: dict[tuple[object, ...], tuple[float, Candidate]] = {}
    whole: dict[tuple[object, ...], int] = {}
    for one in sorted(found, key=lambda item: item.deviance):
        free = _candidate([terms[k] for k in one.columns], one, units)
        guises = [free]
        if len(free.terms) > 1 and all(_is_whole(term.motion) for term in free.terms):
            held = _held(free)
            count = whole.get(free.key, 0) + (held.key not in best)
            guises += [held] if count <= rules.whole_powers else []
            whole[free.key] = min(count, int(rules.whole_powers))
        # what was picked from a grid is a number too, whether a later fit moves it or not
        score = one.deviance + price * sum(1 + len(term.inner) for term in free.terms)
        for guise in guises:
            value, kept = best.get(guise.key, (score, replace(guise, source="")))
            texts = dict.fromkeys((*filter(None, kept.source.split("; ")), *one.sources))
            best[guise.key] = value, replace(kept, source="; ".join(texts))
    ranked = sorted(best.values(), key=lambda item: item[0])
    singles = [item for item in ranked if len(item[1].terms) == 1]
    least = singles[0][0] if singles else np.inf
    sums = [item for item in ranked if len(item[1].terms) > 1]
    worth = [item for item in sums if item[0] < least]
    chosen = [*singles, *worth, *sums[len(worth) : len(worth) + int(rules.beaten)]][: int(rules.shortlist)]
    chosen.sort(key=lambda item: item[0])
    return tuple(c for _, c in chosen), tuple(s for s, _ in chosen)


def _candidate(terms: Sequence[Term], found: Found, units: FloatArray) -> Candidate:
    """The law of a support, its inner numbers free and starting at the grid point."""
    signs = [-1 if value > 0 else 1 for value in found.coefficients]
    pairs = zip(found.columns, found.coefficients, strict=True)
    values = tuple(float(abs(value) * units[column]) for column, value in pairs)
    parts = tuple(replace(term, sign=sign) for term, sign in zip(terms, signs, strict=True))
    name = " + ".join(_form(term) for term in parts)
    return Candidate(name, parts, values, "; ".join(found.sources))


def _is_whole(motion: Factor) -> bool:
    return all(inner.value == round(inner.value) for inner in motion.inner.values())


def _held(law: Candidate) -> Candidate:
    """The law with the numbers of its motion held."""
    parts = tuple(
        replace(term, motion=term.motion.held(**{n: i.value for n, i in term.motion.inner.items()}))
        for term in law.terms
    )
    name = " + ".join(f"{printed(term.motion)} {_text(term.tension)}" for term in parts)
    return replace(law, terms=parts, name=name)


def _form(term: Term) -> str:
    """The form of a term with the names of its free numbers."""
    return f"{_text(term.motion)} {_text(term.tension)}"


def _text(factor: Factor) -> str:
    return factor.text.replace("max(T, 0)", "T").replace(" ** ", "^").replace(" * ", " ")
