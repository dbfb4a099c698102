"""Fits of a law along one of its exponents, and where the deviance rises beyond a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from joblib import Parallel, delayed
from scipy import optimize, stats

from discovery.courses.fit import Fit, correction, fit, predict, refine, resimulate, within_bolts
from discovery.courses.frozen_motion import NUISANCE_DIRECTIONS, FrozenMotion
from discovery.laws.candidate import Candidate
from discovery.laws.factors import Factor, Inner
from discovery.ranking.cross_validation import estimate
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.model.model import Model

_CLOSE: Numerical[float] = 0.005  # of an exponent
_FAR: Numerical[float] = 100.0  # no value is worth a fit beyond this deviance

Side = list[tuple[float, Fit]]


@dataclass(frozen=True, eq=False)
class Curve:
    """Fits of a form along one of its exponents; offsets to full re-simulation are linear between anchors."""

    frozen: FrozenMotion
    form: Candidate
    name: str
    ends: tuple[float, float]
    anchors: tuple[tuple[float, FloatArray], ...] = ()

    def value(self, found: Fit) -> float:
        """The exponent of a fit."""
        return found.candidate.parameters[self.name].value

    def _with_exponent(self, candidate: Candidate, change: Callable[[Inner], Inner]) -> Candidate:
        """The candidate with its exponent changed; the coefficient keeps the loss that it makes."""
        terms, coefficients = list(candidate.terms), list(candidate.coefficients)
        for j, term in enumerate(candidate.terms):
            inner = {
                name: change(old) if candidate.label(name, j) == self.name else old
                for name, old in term.motion.inner.items()
            }
            motion = replace(term.motion, inner=inner)
            if motion != term.motion:
                coefficients[j] *= self._exposed(term.motion) / self._exposed(motion)
                terms[j] = replace(term, motion=motion)
        return replace(candidate, terms=tuple(terms), coefficients=tuple(coefficients))

    def _exposed(self, factor: Factor) -> float:
        last = self.frozen.exposure(factor)[:, -1]
        some = last[last > 0]
        return float(np.exp(np.mean(np.log(some)))) if some.size else 1.0

    def best(self, candidate: Candidate) -> Fit:
        """Fit with the exponent free within the ends, fully re-simulated."""
        low, high = self.ends
        free = self._with_exponent(
            candidate,
            lambda old: replace(
                old, value=float(np.clip(old.value, low, high)), low=low, high=high, free=True
            ),
        )
        return refine(free, self.frozen)

    def at(self, value: float, near: Fit) -> Fit:
        """Fit with the exponent held, from a fit nearby."""
        low, high = self.ends
        held = self._with_exponent(
            near.candidate, lambda old: replace(old, value=value, low=low, high=high, free=False)
        )
        return fit(held, self.frozen, self._offsets(value, near), near)

    def _offsets(self, value: float, near: Fit) -> FloatArray:
        if not self.anchors:
            return near.offsets
        places, sizes = zip(*sorted(self.anchors, key=lambda anchor: anchor[0]), strict=True)
        weights = (np.interp(value, places, row) for row in np.eye(len(places)))
        return np.asarray(sum(weight * size for weight, size in zip(weights, sizes, strict=True)))

    def anchored(self, *fits: Fit) -> Curve:
        """The same curve, with the offsets of more full re-simulations."""
        found = []
        for one in fits:
            offsets = correction(one, self.frozen)
            if np.isfinite(offsets).all():
                found.append((self.value(one), offsets))
        return replace(self, anchors=(*self.anchors, *found))

    def sides(self, best: Fit, values: FloatArray, jobs: int) -> tuple[Side, Side]:
        """Fits at the values below the best and above, outwards, each from its neighbour.

        Parameters
        ----------
        best : Fit
            With the exponent free.
        values : ndarray, shape (values,)
            Exponents, increasing.
        jobs : int
            Processes; two are of use.

        Returns
        -------
        below, above : list of (float, Fit)
            Exponents and fits, the nearest first; a side ends where the deviance is far beyond any limit.
        """
        centre = self.value(best)
        below, above = values[values <= centre][::-1], values[values > centre]
        bare = replace(self, frozen=self.frozen.without_cache()) if jobs > 1 else self
        left, right = Parallel(n_jobs=min(jobs, 2))(delayed(bare.side)(best, s) for s in (below, above))
        return left, right

    def side(self, best: Fit, values: FloatArray) -> Side:
        """Fits at values, each from the one before, until the deviance is far beyond any limit."""
        near, found = best, []
        for value in values:
            near = self.at(float(value), near)
            found.append((float(value), near))
            if near.deviance - best.deviance > _FAR * dispersion_of(best, self.frozen)[0]:
                break
        return found

    def of_model(self, best: Fit) -> float:
        """Shift of the exponent with the identified model, half width of its 95 % limits."""
        return float(shifts_with_model(best, self.frozen)[best.free.index(self.name)])

    def end(self, best: Fit, side: Side, threshold: float, close: float = _CLOSE) -> float:
        """Where the deviance crosses the threshold for the last time on a side; nan where the values end.

        Parameters
        ----------
        best : Fit
            With the exponent free.
        side : list of (float, Fit)
            One of `sides`.
        threshold : float
            Deviance above the best.
        close : float
            Tolerance of the exponent.

        Returns
        -------
        float
            The exponent.
        """
        known = [(self.value(best), best)] + [pair for pair in side if pair[0] != self.value(best)]
        above = [found.deviance - best.deviance - threshold for _, found in known]
        last = max(place for place, size in enumerate(above) if size <= 0)
        if last == len(known) - 1:
            return float("nan")
        (inner, near), (outer, _) = known[last], known[last + 1]

        @cache
        def excess(value: float) -> float:
            rise = max(self.at(value, near).deviance - best.deviance, 0.0) if value != inner else 0.0
            return float(np.sqrt(rise) - np.sqrt(threshold))  # nearly straight in the exponent

        return float(optimize.brentq(excess, inner, outer, xtol=close)) if excess(outer) > 0 else outer


def shifts_with_model(best: Fit, frozen: FrozenMotion) -> FloatArray:
    """Shifts of a law's numbers with the identified model, half widths of 95 % limits, (numbers,).

    Root of the sum of squares over the model's numbers that have limits, each moved to its upper one and the
    law fitted again. Of ln coefficients and inner numbers, as `estimate`.
    """
    here, total = estimate(best), np.zeros(len(best.free))
    plain = resimulate(best.candidate, frozen, best.deviations)
    for path, parameter in frozen.model.parameters.items():
        if parameter.high is None or ".tension_rate." in path:
            continue
        other = frozen.with_models(partial(_at_high, path=path))
        change = resimulate(best.candidate, other, best.deviations) - plain
        if np.isfinite(change).all():
            total += (estimate(fit(best.candidate, frozen, best.offsets + change, best)) - here) ** 2
    return np.asarray(np.sqrt(total))


def _at_high(model: Model, path: str) -> Model:
    """The model with one number at its upper limit."""
    high = model.parameters[path].high
    return model if high is None else model.with_values({path: high})


def dispersion_of(found: Fit, frozen: FrozenMotion) -> tuple[float, bool]:
    """Mean square of the whitened residuals, one at least, and whether chance allows it."""
    residual = frozen.change - (predict(found.candidate, frozen, found.deviations) + found.offsets)
    solved = np.linalg.solve(frozen.covariance, residual[..., None])[..., 0]
    own = within_bolts(found, frozen) / found.tau(frozen.initial)
    square = float((residual * solved).sum() + (own**2).sum())
    freedom = max(residual.size - NUISANCE_DIRECTIONS * len(frozen) - len(found.free), 1)
    return max(square / freedom, 1.0), bool(
        stats.chi2.sf(square, freedom) > frozen.criteria.ranking.misfit_chance
    )
