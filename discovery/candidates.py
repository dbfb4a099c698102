"""From libraries and sparse fits to a short list of candidate laws, best first.

Every candidate is judged by the same quick measure: -2 log likelihood of the integral rows with the scatter
of the rate from case to case integrated out,

    y_i = (1 + u_i) G_i c + e_i,   u_i ~ N(0, tau^2),   e_i ~ N(0, I) after whitening by the noise,

so that the shape of a case's course counts in full and its size only as far as the scatter lets it. tau and
c are fitted for every candidate. What passes goes on to refinement by re-simulation, which decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import optimize

from discovery.factors import Factor
from discovery.libraries import Scales, TermLibrary, motion_factors, printed, tension_factors
from discovery.regression import (
    Rows,
    integrals,
    positive,
    smoothed,
    sparse_supports,
    usable,
    weighted,
    whitener,
)
from discovery.terms import Candidate, Term
from rom.channels import FloatArray

if TYPE_CHECKING:
    from discovery.fitting import Fit
    from discovery.motion import Frozen

Progress = Callable[[str, int, int], None]

_MOST = 60
_SHARED = 6  # tension factors whose libraries go through the sparse fits
_MIXED = 60  # columns of the library of the best single terms
_PAIRS = 60  # of every library, judged in full
_BOOTSTRAPS = 20
_SCATTERS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
_MIXTURES = (0.1, 0.3, 0.5, 0.7, 0.9)
_COMMON = 0.5  # scatter of the rate that pairs are first judged with, and the largest for sparse fits
_TINY = 1e-300


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
        How often each motion factor is chosen when the records are drawn again.
    dropped : tuple of str
        Columns that are zero or a multiple of another one.
    scores : tuple of float
        Quick measure of every candidate with its penalty for free numbers, as `candidates`.
    """

    candidates: tuple[Candidate, ...]
    considered: int
    inclusion: Mapping[str, float]
    dropped: tuple[str, ...] = ()
    scores: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Found:
    """A support with its coefficients in the library's units, and its deviance."""

    columns: tuple[int, ...]
    coefficients: tuple[float, ...]
    deviance: float
    source: str


def propose(
    frozen: Frozen,
    baseline_fit: Fit,
    seed: int,
    tightening: bool = False,
    jobs: int = 1,  # noqa: ARG001 - the same signature as the race
    progress: Progress | None = None,
) -> Proposals:
    """Propose tension laws: all single terms on their grids, and sparse sums of terms.

    Parameters
    ----------
    frozen : Frozen
        Motion and measured courses of the training records.
    baseline_fit : Fit
        A fitted law whose predictions smooth the measured courses and whose scatter weighs them.
    seed : int
        Seed of the ensembles and of the bootstrap over records.
    tightening : bool
        Whether terms that raise the tension are allowed beside the others.
    jobs : int
        Not used: one core is enough.
    progress : callable
        Called as ``progress(what, done, total)``.
    """
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped] # comes with scikit-learn

    with threadpool_limits(1):  # small matrices: threads only wait for each other
        return _proposed(frozen, baseline_fit, seed, tightening, progress or _silent)


def _silent(*_: object) -> None:
    return None


def _proposed(frozen: Frozen, baseline_fit: Fit, seed: int, tightening: bool, tell: Progress) -> Proposals:
    rng = np.random.default_rng(seed)
    tell("candidate laws", 0, 3)
    scales = Scales.of(frozen)
    fitted = [term.tension for term in baseline_fit.candidate.terms if term.tension.inner]
    library = TermLibrary("grid", scales, motion_factors(scales), tension_factors(*fitted))
    smooth = smoothed(baseline_fit, frozen)
    columns = integrals(library, frozen)
    plain = weighted(columns, frozen, whitener(frozen, smooth))
    singles = _singles(plain, "pysindy:grid/single term")
    tell("candidate laws", 1, 3)
    roots = whitener(frozen, smooth, np.minimum(baseline_fit.tau(frozen.initial), _COMMON))
    search = _Search(library, plain, weighted(columns, frozen, roots), singles, tightening)
    sums, dropped = search.sums(rng)
    tell("candidate laws", 2, 3)
    kept, scores = _merged(library, (*singles, *sums), plain.target.size)
    inclusion = search.inclusion(rng)
    tell("candidate laws", 3, 3)
    return Proposals(kept, len(singles) + len(sums), inclusion, dropped, scores)


def marginal_deviance(
    size: FloatArray, along: FloatArray, square: FloatArray, scatter: FloatArray | float
) -> FloatArray:
    """-2 log likelihood by case with the scatter integrated out.

    Parameters
    ----------
    size : ndarray
        ``|y|^2`` of the whitened losses of a case.
    along, square : ndarray
        ``g . y`` and ``g . g`` of the law's whitened course g of the case.
    scatter : ndarray or float
        tau.
    """
    tau2 = np.square(scatter)
    there = np.maximum(square, _TINY)
    shape = np.maximum(size - along**2 / there, 0.0)
    return np.asarray(shape + (along - square) ** 2 / (there * (1 + tau2 * square)) + np.log1p(tau2 * square))


def _singles(rows: Rows, source: str) -> list[_Found]:
    """Every column alone: coefficient and scatter by a scan over tau with Newton steps in ln c."""
    columns, target = rows.columns, rows.target
    size = (target**2).sum(axis=1)[:, None]
    along = np.einsum("cbk,cb->ck", columns, target)
    square = np.einsum("cbk,cbk->ck", columns, columns)
    start = _typical(along, square)
    best = np.full(columns.shape[2], np.inf)
    where = start.copy()
    for scatter in _SCATTERS:
        value, logs = _scaled(size, along, square, start, scatter)
        better = value < best
        best, where = np.where(better, value, best), np.where(better, logs, where)
    usable_ones = np.flatnonzero(np.isfinite(best) & (square.sum(axis=0) > 0))
    return [_Found((int(k),), (float(np.exp(where[k])),), float(best[k]), source) for k in usable_ones]


def _typical(along: FloatArray, square: FloatArray) -> FloatArray:
    """Logarithm of a column's coefficient: mean over the cases, weighted by how well it shows in each."""
    amplitude = along / np.maximum(square, _TINY)
    seen = np.where(amplitude > 0, 1 / (0.25 + 1 / np.maximum(along * amplitude, _TINY)), 0.0)
    logs = np.log(np.maximum(amplitude, _TINY))
    return np.asarray((seen * logs).sum(axis=0) / np.maximum(seen.sum(axis=0), _TINY))


def _scaled(
    size: FloatArray, along: FloatArray, square: FloatArray, start: FloatArray, scatter: float
) -> tuple[FloatArray, FloatArray]:
    """Smallest deviance of many courses over a factor each, and its logarithm, by Newton steps."""

    def deviance(logs: FloatArray) -> FloatArray:
        factor = np.exp(logs)
        return marginal_deviance(size, factor * along, factor**2 * square, scatter).sum(axis=0)

    at, step = start, 0.02
    for _ in range(6):
        here, ahead, behind = deviance(at), deviance(at + step), deviance(at - step)
        slope, bend = (ahead - behind) / (2 * step), (ahead + behind - 2 * here) / step**2
        change = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), 0.5 * np.sign(slope))
        at = at - np.clip(change, -0.7, 0.7)
    return deviance(at), at


@dataclass(frozen=True, eq=False)
class _Search:
    """Sums of terms from the sparse fits of several libraries, all parts of one grid of columns.

    ``plain`` rows are whitened by the noise alone and judge; ``damped`` ones also by the scatter and feed the
    sparse fits.
    """

    library: TermLibrary
    plain: Rows
    damped: Rows
    singles: Sequence[_Found]
    tightening: bool

    def sums(self, rng: np.random.Generator) -> tuple[list[_Found], tuple[str, ...]]:
        """Every distinct sum of terms on the paths of the sparse fits, judged; and the dropped columns."""
        names = self.library.names()
        sources: dict[frozenset[int], tuple[str, ...]] = {}
        dropped: dict[str, None] = {}
        for label, members in self._libraries().items():
            theta, target = self._stacked(members)
            kept, gone = usable(theta, [names[k] for k in members])
            dropped |= dict.fromkeys(gone)
            if not kept:
                continue
            place = [members[k] for k in kept]
            found = {
                support: tuple(f"pysindy:{label}/{optimizer}" for optimizer in optimizers)
                for support, optimizers in sparse_supports(theta[:, kept], target, rng).items()
            }
            for pair in self._pairs(place):
                found.setdefault(frozenset(pair), (f"pairs:{label}",))
            for support, texts in found.items():
                whole = frozenset(place[k] for k in support)
                sources[whole] = tuple(dict.fromkeys((*sources.get(whole, ()), *texts)))
        sums = (self._judged(support, texts) for support, texts in sources.items() if len(support) > 1)
        return [found for found in sums if found is not None], tuple(dropped)

    def inclusion(self, rng: np.random.Generator) -> dict[str, float]:
        """How often FROLS takes each motion factor among its first two when records are drawn again."""
        from pysindy import FROLS

        _, members = next(iter(self._libraries().items()))
        theta, target = self.damped.columns[:, :, members], self.damped.target
        kept, _ = usable(theta.reshape(-1, len(members)), [str(k) for k in members])
        counts: dict[str, float] = {}
        for _ in range(_BOOTSTRAPS):
            drawn = rng.integers(len(target), size=len(target))
            rows = theta[drawn][:, :, kept].reshape(-1, len(kept))
            norms = np.maximum(np.linalg.norm(rows, axis=0), _TINY)
            path = FROLS(max_iter=2, alpha=1e-6).fit(rows / norms, target[drawn].ravel()).history_
            for k in np.flatnonzero(path[-1][0]):
                name = printed(self._motion(members[kept[k]]))
                counts[name] = counts.get(name, 0.0) + 1.0 / _BOOTSTRAPS
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    def _motion(self, column: int) -> Factor:
        return self.library.motions[column // len(self.library.tensions)]

    def _libraries(self) -> dict[str, list[int]]:
        """Columns of libraries: all motions with one tension factor, several times; each motion with its best."""
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
        shared = list(dict.fromkeys((*texts.values(), *order)))[:_SHARED]
        libraries = {printed(self.library.tensions[k]): [int(j) for j in motions * width + k] for k in shared}
        own = [int(j * width + table[j].argmin()) for j in motions]
        return {**libraries, "each with its best T": own}

    def _pairs(self, members: Sequence[int]) -> list[tuple[int, int]]:
        """Places in ``members`` of the pairs of largest marginal likelihood, over a few mixtures of each pair."""
        sizes = {found.columns[0]: found.coefficients[0] for found in self.singles}
        alone = [k for k, column in enumerate(members) if column in sizes]
        columns = self.plain.columns[:, :, [members[k] for k in alone]]
        columns = columns * np.array([sizes[members[k]] for k in alone])
        gram = np.einsum("cbj,cbk->cjk", columns, columns)
        product = np.einsum("cbj,cb->cj", columns, self.plain.target)
        size = (self.plain.target**2).sum(axis=1)[:, None]
        j, k = np.triu_indices(len(alone), 1)
        best = np.full(len(j), np.inf)
        for share in _MIXTURES:
            rest = 1 - abs(share)
            along = rest * product[:, j] + share * product[:, k]
            square = rest**2 * gram[:, j, j] + share**2 * gram[:, k, k] + 2 * rest * share * gram[:, j, k]
            best = np.minimum(best, _scaled(size, along, square, _typical(along, square), _COMMON)[0])
        return [(alone[j[p]], alone[k[p]]) for p in np.argsort(best)[:_PAIRS]]

    def _stacked(self, members: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        return self.damped.columns[:, :, members].reshape(-1, len(members)), self.damped.target.ravel()

    def _judged(self, support: frozenset[int], sources: tuple[str, ...]) -> _Found | None:
        """The sum with coefficients and scatter at the largest marginal likelihood."""
        members = sorted(support)
        theta, target = self._stacked(members)
        signs, start = self._start(theta, target)
        if signs is None:
            return None
        columns = self.plain.columns[:, :, members] * (signs * start)
        gram = np.einsum("cbj,cbk->cjk", columns, columns)
        product = np.einsum("cbj,cb->cj", columns, self.plain.target)
        size = (self.plain.target**2).sum(axis=1)

        def deviance(logs: FloatArray) -> float:
            weight = np.exp(np.clip(logs[:-1], -30, 30))
            along, square = product @ weight, np.einsum("j,cjk,k->c", weight, gram, weight)
            return float(marginal_deviance(size, along, square, np.exp(np.clip(logs[-1], -5, 2))).sum())

        first = np.append(np.zeros(len(members)), np.log(0.5))
        found = optimize.minimize(deviance, first, method="L-BFGS-B")
        coefficients = signs * start * np.exp(np.clip(found.x[:-1], -30, 30))
        text = "; ".join(sources)
        return _Found(tuple(members), tuple(float(c) for c in coefficients), float(found.fun), text)

    def _start(self, theta: FloatArray, target: FloatArray) -> tuple[FloatArray | None, FloatArray]:
        """Signs and sizes of coefficients by least squares; a term that it leaves out starts small."""
        if self.tightening:
            coefficients = np.linalg.lstsq(theta, target, rcond=None)[0]
        else:
            coefficients = positive(theta, target)
        norms = np.linalg.norm(theta, axis=0)
        strength = np.abs(coefficients) * norms
        if not strength.max() > 0:
            return None, strength
        signs = np.where(coefficients < 0, -1.0, 1.0)
        return signs, np.maximum(strength, 0.03 * strength.max()) / norms


def _merged(
    library: TermLibrary, found: Iterable[_Found], rows: int
) -> tuple[tuple[Candidate, ...], tuple[float, ...]]:
    """Distinct laws, best first: equal forms are one law, with the best numbers and all its sources.

    A sum that is not better than each of its terms alone, its added numbers counted, is left out.
    """
    terms, units, price = library.terms, library.units, float(np.log(rows))
    alone: dict[int, float] = {}
    best: dict[tuple[object, ...], tuple[float, Candidate]] = {}
    for one in sorted(found, key=lambda item: (len(item.columns), item.deviance)):
        candidate = _candidate([terms[k] for k in one.columns], one, units)
        score = one.deviance + len(candidate.free) * price
        if len(one.columns) == 1:
            alone[one.columns[0]] = score
        elif score >= min(alone.get(k, np.inf) for k in one.columns):
            continue
        score, kept = best.get(candidate.key, (score, candidate))
        texts = dict.fromkeys((*kept.source.split("; "), *candidate.source.split("; ")))
        best[candidate.key] = score, replace(kept, source="; ".join(texts))
    # one of every form with a single term, then the best sums
    order = sorted(best.values(), key=lambda item: (len(item[1].terms) > 1, item[0]))[:_MOST]
    order.sort(key=lambda item: item[0])
    return tuple(c for _, c in order), tuple(s for s, _ in order)


def _candidate(terms: Sequence[Term], found: _Found, units: FloatArray) -> Candidate:
    """The law of a support; in sums the numbers of the motion are held at their grid points."""
    several = len(terms) > 1
    parts, values = [], []
    for term, column, value in zip(terms, found.columns, found.coefficients, strict=True):
        motion = term.motion
        if several:
            motion = motion.held(**{name: inner.value for name, inner in motion.inner.items()})
        parts.append(replace(term, motion=motion, sign=-1 if value > 0 else 1))
        values.append(float(abs(value) * units[column]))
    name = " + ".join(f"{printed(p.motion)} {printed(p.tension)}" if several else _family(p) for p in parts)
    return Candidate(name, tuple(parts), tuple(values), found.source)


def _family(term: Term) -> str:
    """Name of a single-term law: its form with the names of its free numbers."""
    text = f"{term.motion.text} {term.tension.text}".replace("max(T, 0)", "T")
    return text.replace(" ** ", "^").replace(" * ", " ")
