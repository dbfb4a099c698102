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
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from discovery.criteria.search import Search
from discovery.laws.candidate import Candidate, Term
from discovery.laws.factors import Factor, tension_exponential, tension_logistic, tension_power
from discovery.laws.names import term_form
from discovery.search.libraries import Scales, TermLibrary, motion_factors, printed, tension_factors
from discovery.search.pysindy_libraries import read_library
from discovery.search.quick_likelihood import Found, assumed_variability, single_terms
from discovery.search.selection import EVERYTHING, Selection
from discovery.search.sparse_regression import (
    Rows,
    along,
    forward,
    integrals,
    smoothed,
    usable,
    weighted,
    whitener,
)
from discovery.search.sums import Sums
from rom.campaign.channels import FloatArray
from rom.progress import Progress

if TYPE_CHECKING:
    from discovery.courses.fit import Fit
    from discovery.courses.frozen_motion import FrozenMotion

Law = TypeVar("Law", bound=Candidate)

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
    notes : tuple of str
        What of the libraries and optimizers did not take part, a line each.
    """

    candidates: tuple[Candidate, ...]
    considered: int
    inclusion: Mapping[str, float]
    dropped: tuple[str, ...] = ()
    scores: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def propose(
    frozen: FrozenMotion,
    baseline_fit: Fit,
    seed: int,
    tightening: bool = False,
    jobs: int = 1,  # noqa: ARG001 - the same signature as the race
    progress: Progress | None = None,
    selection: Selection = EVERYTHING,
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
    selection : Selection
        Libraries and optimizers; all of ours if not given.
    """
    return _proposed(frozen, baseline_fit, seed, tightening, progress or _silent, selection)


def _silent(done: int, total: int) -> None:  # noqa: ARG001 - the signature of progress
    return None


def _proposed(
    frozen: FrozenMotion, baseline_fit: Fit, seed: int, tightening: bool, tell: Progress, selection: Selection
) -> Proposals:
    rng = np.random.default_rng(seed)
    tell(0, 4)
    scales = Scales.of(frozen)
    guide = _guide(frozen, baseline_fit, scales)
    tell(1, 4)
    at = _Guided.by(guide, frozen, tightening, selection)
    parts = [] if selection.families == () else [_of_grid(at, baseline_fit, scales, rng)]
    tell(2, 4)
    parts += [_of_own(at, name, library, rng) for name, library in selection.own.items()]
    tell(3, 4)
    proposals = _together(parts, selection, int(frozen.criteria.search.largest_support))
    tell(4, 4)
    return proposals


@dataclass(frozen=True, eq=False)
class _Guided:
    """Motion along the tension that a fitted law predicts, and what whitens rows of integrals there."""

    guide: Fit
    frozen: FrozenMotion
    tightening: bool
    selection: Selection
    plain: FloatArray
    damped: FloatArray

    @classmethod
    def by(cls, guide: Fit, frozen: FrozenMotion, tightening: bool, selection: Selection) -> _Guided:
        followed = along(guide, frozen)
        smooth = smoothed(guide, followed)
        assumed = assumed_variability(tightening, frozen.criteria.courses)
        scatter = np.minimum(np.hypot(guide.tau(frozen.initial), guide.sigma), assumed)
        roots = whitener(followed, smooth), whitener(followed, smooth, scatter)
        return cls(guide, followed, tightening, selection, *roots)

    def rows(self, columns: FloatArray) -> tuple[Rows, Rows]:
        """Rows whitened by the noise alone, and also by the scatter."""
        return weighted(columns, self.frozen, self.plain), weighted(columns, self.frozen, self.damped)

    def sums(self, rows: tuple[Rows, Rows], singles: Sequence[Found], *, credited: bool) -> Sums:
        """What finds sums among the columns of these rows."""
        criteria, optimizers = self.frozen.criteria, self.selection.optimizers
        return Sums(*rows, singles, self.tightening, criteria, optimizers, credited)


def _of_grid(at: _Guided, baseline_fit: Fit, scales: Scales, rng: np.random.Generator) -> Proposals:
    """Return laws of our own families of factors."""
    rules, names = at.frozen.criteria.search, at.selection.families
    fitted = [t.tension for f in (baseline_fit, at.guide) for t in f.candidate.terms if t.tension.inner]
    tensions = tension_factors(scales, *fitted, rules=rules, names=names)
    library = TermLibrary("grid", scales, motion_factors(scales, rules, names), tensions, int(rules.degree))
    plain, damped = at.rows(integrals(library, at.frozen))
    singles = single_terms(plain, _SINGLE, signed=at.tightening)
    groups = _groups(library, singles, int(rules.shared))
    search = at.sums((plain, damped), singles, credited=at.selection.optimizers is not None)
    found, dropped = search.distinct(library.names(), groups, rng)
    kept, scores = _merged(library, found, plain.target.size, rules)
    inclusion = _inclusion(library, next(iter(groups.values())), damped, rules, rng)
    return Proposals(kept, len(found), inclusion, dropped, scores)


def _of_own(at: _Guided, name: str, given: object, rng: np.random.Generator) -> Proposals:
    """Return laws of a library of one's own: every column alone, and sums of columns."""
    library, rules = read_library(given, name, at.frozen, signed=at.tightening), at.frozen.criteria.search
    rows = at.rows(library.integrals)
    singles = single_terms(rows[0], f"pysindy:{name}/single term", signed=at.tightening)
    members = {name: range(len(library.texts))}
    found, dropped = at.sums(rows, singles, credited=True).distinct(library.texts, members, rng)
    price = float(np.log(rows[0].target.size))
    scored = [(one.deviance + price * len(one.columns), library.law(one)) for one in found]
    kept, scores = _shortened(scored, lambda law: len(law.scales), rules)
    notes = (library.note,) if library.note else ()
    return Proposals(kept, len(scored), {}, dropped, scores, notes)


def _together(parts: Sequence[Proposals], selection: Selection, most: int) -> Proposals:
    """Return the laws of several libraries, best first, a law that two of them propose once."""
    pairs = [pair for part in parts for pair in zip(part.scores, part.candidates, strict=True)]
    best: dict[tuple[object, ...], tuple[float, Candidate]] = {}
    for score, law in sorted(pairs, key=lambda item: item[0]):
        value, kept = best.get(law.key, (score, replace(law, source="")))
        texts = dict.fromkeys((*filter(None, kept.source.split("; ")), *law.source.split("; ")))
        best[law.key] = value, replace(kept, source="; ".join(texts))
    found = set().union(*(law.source.split("; ") for _, law in best.values()))
    idle = [
        f"optimizer {name}: selected no law of 1 to {most} terms that goes on"
        for name in selection.optimizers or ()
        if not any(source.endswith(f"/{name}") for source in found)
    ]
    return Proposals(
        candidates=tuple(law for _, law in best.values()),
        considered=sum(part.considered for part in parts),
        inclusion=parts[0].inclusion if parts else {},
        dropped=tuple(dict.fromkeys(name for part in parts for name in part.dropped)),
        scores=tuple(score for score, _ in best.values()),
        notes=(*(note for part in parts for note in part.notes), *idle),
    )


def _guide(frozen: FrozenMotion, baseline_fit: Fit, scales: Scales) -> Fit:
    """The best of a few single-term laws of different motion and the baseline, fitted.

    It smooths the measured tension, whatever is sought, and so comes from all of our families of motion.
    """
    from discovery.courses.fit import fit, refine

    motions = motion_factors(scales, frozen.criteria.search)
    unit = scales.unit
    exponential, logistic = (
        tension_exponential(2 * scales.tension, unit),
        tension_logistic(8, -0.0036 / unit, unit),
    )
    tensions = (tension_power(), exponential, logistic)
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


def _inclusion(
    library: TermLibrary, members: Sequence[int], damped: Rows, rules: Search, rng: np.random.Generator
) -> dict[str, float]:
    """How often FROLS takes a term of each form among its first two when records are drawn again.

    All terms have one tension factor, the best; points of a grid that differ in numbers are one form.
    """
    theta, target = damped.columns[:, :, members], damped.target
    kept, _ = usable(theta.reshape(-1, len(members)), [str(k) for k in members])
    terms = library.terms
    forms = [term_form(terms[members[k]]) for k in kept]
    counts: dict[str, int] = {}
    draws = int(rules.bootstraps)
    for _ in range(draws):
        drawn = rng.integers(len(target), size=len(target))
        rows = theta[drawn][:, :, kept].reshape(-1, len(kept))
        first = forward(rows, target[drawn].ravel(), int(rules.first_terms), rules.ridge)
        for form in {forms[k]: None for k in first}:
            counts[form] = counts.get(form, 0) + 1
    shares = {form: count / draws for form, count in counts.items()}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def _groups(library: TermLibrary, singles: Sequence[Found], shared: int) -> dict[str, list[int]]:
    """Columns of libraries: all motions with one tension factor, several times; each with its best."""
    width = len(library.tensions)
    motions = np.arange(len(library.motions))
    deviance = np.full(len(motions) * width, np.inf)
    for found in singles:
        deviance[found.columns[0]] = found.deviance
    table = deviance.reshape(-1, width)
    order = [int(k) for k in np.argsort(table.min(axis=0))]
    texts: dict[str, int] = {}
    for k in order:
        texts.setdefault(library.tensions[k].text, k)
    chosen = list(dict.fromkeys((*texts.values(), *order)))[:shared]
    groups = {printed(library.tensions[k]): [int(j) for j in motions * width + k] for k in chosen}
    return {**groups, "each with its best T": [int(j * width + table[j].argmin()) for j in motions]}


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
    return _shortened(list(best.values()), lambda law: len(law.terms), rules)


def _shortened(
    scored: Sequence[tuple[float, Law]], terms: Callable[[Law], int], rules: Search
) -> tuple[tuple[Law, ...], tuple[float, ...]]:
    """The best laws and their scores; of sums no better than the best single term a few."""
    ranked = sorted(scored, key=lambda item: item[0])
    singles = [item for item in ranked if terms(item[1]) == 1]
    least = singles[0][0] if singles else np.inf
    sums = [item for item in ranked if terms(item[1]) > 1]
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
