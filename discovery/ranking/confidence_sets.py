"""What the courses can tell: confidence sets of exponents, and the laws that they do not tell apart.

The deviance of a law refitted at held values of an exponent is its profile. By the likelihood ratio the 95 %
confidence set holds every value with

    (deviance(n) - deviance(best)) / dispersion <= chi2_1(0.95) = 3.84,

where the dispersion, one at least, is the mean square of the whitened residuals of the best fit: what noise
and scatter do not explain widens the set. What the uncertainty of the identified model adds is combined with
the distance of each end from the best value as a root of squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import stats

from discovery.courses.fit import Fit, fit
from discovery.courses.frozen_motion import FrozenMotion
from discovery.criteria.criteria import percent
from discovery.laws.candidate import Candidate, Term, baseline, no_loosening
from discovery.laws.factors import Factor, Inner, velocity_power
from discovery.ranking.pairwise import Pair, compare_laws, not_told_apart, separation
from discovery.ranking.profile_likelihood import Curve, dispersion_of
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical

__all__ = [
    "ExponentProfile",
    "MotionProfile",
    "Pair",
    "compare_laws",
    "exponent_profile",
    "motion_profile",
    "not_told_apart",
    "separation",
]

_STEP: Numerical[float] = 0.25  # of an exponent
_MIXED_STEP: Numerical[float] = 0.5
_SAME: Numerical[float] = 0.1  # of deviances
_ROUGH: Numerical[float] = 0.05  # of an exponent

Reach = Literal["identified", "open below", "open above", "not identifiable", "no loss above noise"]


@dataclass(frozen=True, eq=False)
class ExponentProfile:
    """Profile of an exponent and its 95 % confidence set.

    Attributes
    ----------
    name : str
        Name of the exponent in the form's equation.
    values : ndarray, shape (values,)
        Held values, ascending: those asked for but for some far beyond any limit, and a few within the set.
    deviance : ndarray, shape (values,)
        Deviance above that of the best value; `delta_bic` is the same over the smallest of `values`, since
        the number of free numbers is the same at each.
    best, low, high : float
        Best value and the ends of the set; an end that the range of `values` cuts is the range's.
    reach : str
        Whether the set is bounded on both sides, on one, on none, or nothing was lost at all.
    dispersion : float
        By which deviances are divided, one at least.
    fits : bool
        Whether the best value explains the courses to within noise and scatter; where not, in the strict
        sense the set is empty.
    candidates : tuple of Candidate
        The form refitted at every value: its coefficients and tension factor.
    of_model : float
        Part of the half width that comes from the identified model.
    """

    name: str
    values: FloatArray
    deviance: FloatArray
    best: float
    low: float
    high: float
    reach: Reach
    dispersion: float
    fits: bool
    fitted: Fit = field(repr=False)
    candidates: tuple[Candidate, ...] = field(repr=False)
    of_model: float = 0.0

    @property
    def delta_bic(self) -> FloatArray:
        """Difference in BIC from the best of the held values, (values,)."""
        return np.asarray(self.deviance - self.deviance.min())

    @property
    def identifiable(self) -> bool:
        """Whether the set is bounded on both sides."""
        return self.reach == "identified"

    def holds(self, value: float) -> bool:
        """Whether a value is in the confidence set."""
        return self.reach == "no loss above noise" or self.low <= value <= self.high

    @property
    def summary(self) -> str:
        """The result in one sentence."""
        level = percent(self.fitted.criteria.ranking.confidence)
        verdict = {
            "identified": f"{self.name} = {self.best:.2f}, {level} limits {self.low:.2f} to {self.high:.2f}",
            "open below": f"{self.name} is {self.high:.2f} at most; no lower limit within the range",
            "open above": f"{self.name} is {self.low:.2f} at least; no upper limit within the range",
            "not identifiable": f"{self.name} is not identifiable: {self.low:g} to {self.high:g} all do",
            "no loss above noise": f"{self.name} is not identifiable: no loss stands out from the noise",
        }[self.reach]
        misfit = f"; but no value fits to within noise (dispersion {self.dispersion:.1f})"
        return verdict + ("" if self.fits else misfit)


@dataclass(frozen=True)
class MotionProfile:
    """Whether velocity or displacement drives the loosening: the law ``|v|^n |x|^q g(T)``.

    Attributes
    ----------
    velocity, displacement : ExponentProfile
        Of n with q refitted at every value, and of q with n refitted.
    """

    velocity: ExponentProfile
    displacement: ExponentProfile

    @property
    def driver(self) -> Literal["velocity", "displacement", "both", "undecided", "neither"]:
        """What a law without cannot do; "neither" where no product of powers fits to within noise."""
        if not (self.velocity.fits and self.displacement.fits):
            return "neither"
        without_x, without_v = self.displacement.holds(0.0), self.velocity.holds(0.0)
        if without_x and without_v:
            return "undecided"
        if without_x:
            return "velocity"
        return "displacement" if without_v else "both"

    @property
    def at_edge(self) -> tuple[ExponentProfile, ...]:
        """Sets that end next to 0 or to the end of their range: with one the driver is open."""
        return tuple(
            profile
            for profile in (self.velocity, self.displacement)
            if profile.fitted.criteria.ranking.edge_of(profile.low, profile.high, float(profile.values[-1]))
            is not None
        )

    @property
    def tests(self) -> int:
        """Tests that the law was fitted to."""
        return len(self.velocity.fitted.deviations)

    @property
    def numbers(self) -> int:
        """Free numbers of the law, both exponents among them."""
        free = {*self.velocity.fitted.free, *self.displacement.fitted.free}
        return len(free | {self.velocity.name, self.displacement.name})

    @property
    def few(self) -> bool:
        """Whether tests are too few to tell how they differ from what drives the loosening."""
        rules = self.velocity.fitted.criteria.ranking
        return self.tests < rules.tests_per_number * self.numbers

    @property
    def summary(self) -> str:
        """The result in one sentence."""
        is_open = (self.at_edge or self.few) and self.driver != "neither"
        driver = "undecided" if is_open else self.driver
        verdict = {
            "velocity": "velocity drives the loosening; displacement is not needed",
            "displacement": "displacement drives the loosening; velocity is not needed",
            "both": "velocity and displacement both act",
            "undecided": "whether velocity or displacement drives the loosening is open",
            "neither": "no product of powers of velocity and displacement explains the courses",
        }[driver]
        return f"{verdict} ({self.velocity.summary}; {self.displacement.summary})"


def exponent_profile(
    frozen: FrozenMotion,
    form: Candidate | None = None,
    values: Sequence[float] | None = None,
    jobs: int = 1,
) -> ExponentProfile:
    """Profile the exponent n of ``|v|^n`` in a law, everything else refitted at every value.

    Parameters
    ----------
    frozen : FrozenMotion
        Motion and measured courses.
    form : Candidate
        The law: the term of it that loosens most counts. Where its motion factor has no exponent n of the
        velocity, ``|v|^n`` takes the factor's place. Not given: that of He et al. (2025), Eqs. 12-13.
    values : sequence of float
        Values to hold, the range in which the set is sought; not given: that of the criteria.
    jobs : int
        Fits at the same time.

    Raises
    ------
    ValueError
        If there are fewer than three values.
    """
    rules = frozen.criteria.ranking
    held = _values(rules.least_exponent, rules.largest_exponent, _STEP) if values is None else values
    return _profile(frozen, *_velocity_form(form or baseline(), frozen), held, jobs)


def motion_profile(
    frozen: FrozenMotion,
    form: Candidate | None = None,
    values: Sequence[float] | None = None,
    jobs: int = 1,
) -> MotionProfile:
    """Profile both exponents of ``|v|^n |x|^q``, with the tension factor of the law's main term.

    Parameters
    ----------
    frozen, form, jobs
        As for ``exponent_profile``.
    values : sequence of float
        Values of q to hold; those of n go half as far again. Not given: those of the criteria.
    """
    if values is None:
        values = _values(0.0, frozen.criteria.ranking.largest_mixed, _MIXED_STEP)
    whole = form if form is not None and form.terms else baseline()
    tension = whole.terms[_main_term(whole, frozen)].tension
    law = Candidate("mixed powers", (Term(_mixed(4.0, 0.0, max(values)), tension),), (1.0,))
    displacement = _profile(frozen, law, "q", values, jobs)
    return MotionProfile(_profile(frozen, law, "n", [1.5 * value for value in values], jobs), displacement)


def _values(low: float, high: float, step: float) -> tuple[float, ...]:
    return tuple(float(value) for value in np.arange(low, high + 0.01 * step, step))


def _mixed(n: float, q: float, highest: float) -> Factor:
    inner = {"n": Inner(n, 0.0, 8.0, "1"), "q": Inner(q, 0.0, highest, "1")}
    return Factor("abs(v) ** n * abs(x) ** q", inner, (("v", "n"), ("x", "q")))


def _main_term(candidate: Candidate, frozen: FrozenMotion) -> int:
    """The term that loosens most, in the mean over the cases of its share of the tension."""
    initial = np.maximum(frozen.initial, 1e-9)
    shares = [
        np.mean(abs(c) * frozen.exposure(t.motion)[:, -1] * t.tension.of_tension(initial) / initial)
        for t, c in zip(candidate.terms, candidate.coefficients, strict=True)
    ]
    return int(np.argmax(shares))


def _velocity_form(form: Candidate, frozen: FrozenMotion) -> tuple[Candidate, str]:
    """The law with its exponent of the velocity free, and the name of that exponent."""
    whole = form if form.terms else baseline()
    place = _main_term(whole, frozen)
    term = whole.terms[place]
    if "n" in term.motion.inner:
        inner = {**term.motion.inner, "n": replace(term.motion.inner["n"], free=True)}
        motion = replace(term.motion, inner=inner)
    else:
        motion = velocity_power()
    terms = [replace(term, motion=motion) if j == place else t for j, t in enumerate(whole.terms)]
    changed = replace(whole, terms=tuple(terms))
    return changed, changed.label("n", place)


def _profile(
    frozen: FrozenMotion, form: Candidate, name: str, values: Sequence[float], jobs: int
) -> ExponentProfile:
    held = np.unique(np.asarray(values, dtype=np.float64))
    if len(held) < 3:
        raise ValueError(f"a profile needs three values of {name} at least, got {len(held)}")
    curve = Curve(frozen, form, name, (float(held[0]), float(held[-1])))
    best = curve.best(form)
    sides = curve.sides(best, held, jobs)
    lowest = min(
        (found for side in sides for _, found in side), key=lambda found: found.deviance, default=best
    )
    if lowest.deviance < best.deviance - _SAME:
        best = curve.best(lowest.candidate)
        sides = curve.sides(best, held, jobs)
    dispersion, fits_well = dispersion_of(best, frozen)
    limit = dispersion * float(stats.chi2.ppf(frozen.criteria.ranking.confidence, 1))
    curve = curve.anchored(best)
    best = fit(best.candidate, frozen, curve.anchors[-1][1], best) if curve.anchors else best
    rough = (curve.end(best, side, limit, _ROUGH) for side in sides)
    curve = curve.anchored(*(curve.at(end, best) for end in rough if np.isfinite(end)))
    low, high = (curve.end(best, side, limit) for side in sides)
    of_model, centre = curve.of_model(best), curve.value(best)
    fine = {value: curve.at(value, best) for value in _within(low, curve.value(best), high)}
    every = dict(sorted({**dict(sides[0]), **dict(sides[1]), **fine}.items()))
    return ExponentProfile(
        name=name,
        values=np.array(list(every)),
        deviance=np.array([found.deviance for found in every.values()]) - best.deviance,
        best=curve.value(best),
        low=float(held[0] if np.isnan(low) else max(centre - np.hypot(centre - low, of_model), held[0])),
        high=float(held[-1] if np.isnan(high) else min(centre + np.hypot(high - centre, of_model), held[-1])),
        reach=_reach(low, high) if _loses(best, frozen) else "no loss above noise",
        of_model=of_model,
        dispersion=dispersion,
        fits=fits_well,
        fitted=best,
        candidates=tuple(found.candidate for found in every.values()),
    )


def _within(low: float, best: float, high: float) -> list[float]:
    """Values that show the set itself, which a coarse grid may step over."""
    ends = [end for end in (low, high) if np.isfinite(end)]
    return [best, *ends, *(0.5 * (best + end) for end in ends)]


def _reach(low: float, high: float) -> Reach:
    if np.isnan(low):
        return "not identifiable" if np.isnan(high) else "open below"
    return "open above" if np.isnan(high) else "identified"


def _loses(found: Fit, frozen: FrozenMotion) -> bool:
    """Whether the courses differ from "no loosening" by more than chance."""
    gain = fit(no_loosening(), frozen).deviance - found.deviance
    return bool(gain > stats.chi2.ppf(frozen.criteria.ranking.confidence, len(found.free) + 1))
