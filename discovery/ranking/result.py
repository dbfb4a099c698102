"""A ranked tension law, and the ranking of all: its numbers and the winner's model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy.typing as npt

from discovery.courses.fit import Fit
from discovery.courses.frozen_motion import freeze
from discovery.criteria.criteria import CRITERIA
from discovery.criteria.ranking import RankingRules
from discovery.laws.candidate import Candidate
from discovery.laws.names import term_form
from discovery.ranking.averaging import (
    AveragedPrediction,
    NewTests,
    Weighted,
    averaged_log_density,
    predicted,
)
from discovery.ranking.population import Bolt, Population, new_bolt
from rom.campaign.campaign import Campaign
from rom.campaign.channels import FloatArray
from rom.evaluation.error_measures import Errors
from rom.evaluation.noise_floor import NoiseFloor
from rom.model.latex import latex_of
from rom.model.laws import Law, Parameter, free_form_law
from rom.model.model import Model
from rom.result_views import HasViews
from rom.signals.tension_bins import TensionCourse


@dataclass(frozen=True, eq=False, repr=False)
class RankedLaw:
    r"""One law of a ranking: as an equation, as LaTeX, as a function, as a model that simulates and saves.

    Attributes
    ----------
    parameters : mapping of str to Parameter
        Every number of the equation, with 95 % limits where it was fitted.
    errors : mapping
        Errors by full re-simulation on ``"training"`` and ``"hold_out"`` records.
    noise_floor : mapping
        Errors that noise alone would make on these records.
    cross_validated_loss_error_percent_median : float
        Median over records of ``100 |predicted - measured loss| / |measured loss|``, their preload left out;
        of several bolts their bolt.
    known_bolt_loss_error_percent_median : float
        The same at the rate that the other tests of the bolt tell; None where there is one bolt.
    cross_validated_score : float
        Log predictive density of all records, each while its preload was left out; `scores` by record.
    delta_bic : float
        BIC minus that of the first law.
    wins_against_baseline : tuple of int
        Records with a higher score than the baseline's, and how many there are.
    p_value_against_baseline : float
        Chance that the best of so many laws, none better than the baseline, would look as good; None for the
        baseline itself.
    chosen : float
        Share of resamples of the preloads in which this law comes first.
    probability : float
        That this is the form of law that made the records, were it one of those listed: its share of the
        evidence, mean over resamples of the preloads to each of which all laws are refitted
        (`discovery.ranking.probabilities`). Those of a ranking add up to 1.
    indistinguishable : tuple of str
        Names of the laws that the records do not tell from this one, of those compared in pairs.
    look_alikes : tuple of str
        Equations of other candidates that became the same law, or that ended with a number at its bound and
        fit as well.
    same_as : tuple of str
        Names of standing laws, or of others given, that are this equation: they have no row of their own.
    identified : Model
        The identified model; `model` is the same with this law.

    Examples
    --------
    >>> row = ranking.laws[0]
    >>> print(row.latex)
    \dot{T} = -\gamma \left|v\right|^{n} T \cdot 10^{-\frac{\gamma_{i}}{1 + \mathrm{e}^{\rho T}}}
    >>> row.rate(T=100.0, x=0.0, v=0.0)
    array(-0.)
    >>> row.model.save("model.json")
    """

    rank: int
    name: str
    equation: str
    parameters: Mapping[str, Parameter]
    errors: Mapping[str, Errors]
    cross_validated_loss_error_percent_median: float
    cross_validated_score: float
    delta_bic: float
    wins_against_baseline: tuple[int, int]
    p_value_against_baseline: float | None
    source: str
    free_numbers: int
    look_alikes: tuple[str, ...]
    fit: Fit
    candidate: Candidate
    scores: FloatArray
    chosen: float = 0.0
    probability: float = 0.0
    known_bolt_loss_error_percent_median: float | None = None
    indistinguishable: tuple[str, ...] = ()
    identified: Model | None = None
    same_as: tuple[str, ...] = ()
    noise_floor: Mapping[str, NoiseFloor] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"RankedLaw({self.rank}, {self.name!r}, {self.equation!r}, source={self.source!r})"

    @property
    def fitted_to(self) -> str:
        """``"tension histories"``, or ``"losses"`` where the law cannot follow the histories."""
        return "losses" if self.fit.of_losses else "tension histories"

    @property
    def law(self) -> Law:
        """The law for a bolted link of any model."""
        return free_form_law(self.name, self.equation, "tension rate", self.parameters)

    @property
    def latex(self) -> str:
        r"""The law as LaTeX, ``\dot{T} = ...``, its numbers as letters."""
        return rf"\dot{{T}} = {latex_of(self.equation)}"

    def rate(
        self,
        T: npt.ArrayLike,
        x: npt.ArrayLike,
        v: npt.ArrayLike,
        F: npt.ArrayLike = 0.0,
        D: npt.ArrayLike = 0.0,
    ) -> FloatArray:
        """Return dT/dt [N/s]; arrays broadcast.

        Parameters
        ----------
        T : array
            Tension [N].
        x, v : array
            Relative displacement [m] and velocity [m/s] of the joint, first body minus second.
        F, D : array
            Force of the joint, and its damping part [N].

        Returns
        -------
        ndarray
            In the broadcast shape.
        """
        return self.law.rate(T, x, v, F, D)

    @property
    def model(self) -> Model:
        """The identified model with this law: it simulates, and saves itself as ``model.json``.

        Raises
        ------
        ValueError
            If the law comes without an identified model.
        """
        if self.identified is None:
            raise ValueError(
                f"law {self.name!r}: found no identified model with it, expected a law of a ranking"
            )
        return with_law(self.identified, self)


@dataclass(frozen=True, eq=False, repr=False)
class Ranking(HasViews):
    """Tension laws in the order in which the records support them.

    Attributes
    ----------
    laws : tuple of RankedLaw
        The first one first.
    considered : int
        How many candidates there were before any was left behind.
    identified : Model
        The identified model; `model` is the same with the first law.
    inclusion : mapping of str to float
        How often FROLS takes a term of a form, whatever its numbers, among its first two when records are
        drawn again. `chosen_terms` says the same of the race.
    profile, motion_profile : object
        Deviance over the exponent of the velocity; over how much of the motion's part is displacement.
    indistinguishable : tuple of str
        Laws that the records cannot tell from the first one.
    proposals : tuple
        Tests that would tell the first laws apart.
    courses : tuple of TensionCourse
        What was measured.
    population : Population
        How the rate of the first law differs from bolt to bolt, where there are several.
    scatter : tuple of float
        a and b of ln tau, tau the case-to-case scatter of the log rate: ``a + b ln(T / 100 N)``.
    signed : bool
        Whether tests may tighten: a test's rate is then 1 + u times the law's, u its deviation, not exp(u).

    Examples
    --------
    A `ranking` from ``discovery.discover(campaign)``:

    >>> ranking.laws[0].name in ranking.summary()
    True
    >>> list(ranking.to_frame()["name"]) == [law.name for law in ranking.laws]
    True
    >>> ranking.model.save("model.json")
    """

    laws: tuple[RankedLaw, ...]
    considered: int
    identified: Model
    inclusion: Mapping[str, float]
    profile: Any = None
    motion_profile: Any = None
    indistinguishable: tuple[str, ...] = ()
    proposals: tuple[Any, ...] = ()
    courses: tuple[TensionCourse, ...] = ()
    population: Population | None = None
    scatter: tuple[float, float] = (0.0, 0.0)
    signed: bool = False
    set_aside: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    rules: RankingRules = CRITERIA.ranking

    def __repr__(self) -> str:
        first = f", first: {self.laws[0].name!r}" if self.laws else ""
        return f"Ranking({len(self.laws)} laws of {self.considered} candidates{first})"

    def __getitem__(self, name: str) -> RankedLaw:
        """Return the law of this name, or that is the same as the law of this name."""
        for law in self.laws:
            if name in (law.name, *law.same_as):
                return law
        raise KeyError(f"no law {name!r} in the ranking; it has {', '.join(law.name for law in self.laws)}")

    @property
    def model(self) -> Model:
        """The identified model with the first law."""
        return with_law(self.identified, self.laws[0])

    def for_bolt(self, campaign: Campaign, law: str | None = None, jobs: int = 1) -> Bolt:
        """Return another bolt of the kind: its rate told by the few hits that it has had and the population.

        Parameters
        ----------
        campaign : Campaign
            Of the bolt; with few loosening tests, or none.
        law : str, optional
            Name of a law of the ranking; the first if not given.
        jobs : int
            Processes.

        Returns
        -------
        Bolt
            Its deviation with limits; `model` simulates and saves itself.

        Raises
        ------
        ValueError
            If the ranking is of one bolt, or the campaign is not of this kind.

        Examples
        --------
        >>> ranking.for_bolt(rom.read_campaign("ninth")).model.save("ninth.json")  # doctest: +SKIP
        """
        if self.population is None:
            raise ValueError("found a ranking of one bolt, expected one of several campaigns")
        chosen = self.laws[0] if law is None else self[law]
        return new_bolt(campaign, chosen.fit, self.identified, jobs)

    def predict(
        self,
        forces: npt.ArrayLike,
        rate_hz: float,
        initial_tension: npt.ArrayLike,
        *,
        window_s: tuple[float, float] | None = None,
        body: str | None = None,
        draws: int = 100,
        seed: int = 0,
    ) -> AveragedPrediction:
        """Final tensions of new tests, averaged over the laws by their probabilities.

        Every law's numbers are drawn within their uncertainty, and the deviation of every test's rate.

        Parameters
        ----------
        forces : array, shape (cases, samples)
            Force on ``body`` [N].
        rate_hz : float
            Sampling rate [Hz].
        initial_tension : array, shape (cases,)
            Tension before the hit [N].
        window_s : tuple of float
            Mean over this window [s] in place of the last value.
        body : str
            The body that is hit; the first one if not given.
        draws : int
            For every law and test.
        seed : int
            Of the draws.

        Returns
        -------
        AveragedPrediction
            Means, medians and 95 % limits [N].

        Examples
        --------
        >>> ranking.predict(force[None], 19200, [150.0]).low  # doctest: +SKIP
        """
        tests = NewTests.of(forces, rate_hz, initial_tension, window_s, body, self.signed)
        return predicted(self.weighted, self.identified, tests, draws, seed)

    def log_density(self, courses: Sequence[TensionCourse]) -> FloatArray:
        """Log predictive density of the tension histories of tests that no fit saw, averaged as by `predict`.

        Returns
        -------
        ndarray, shape (tests,)
            Higher is better; `discovery.ranking.averaging.log_densities` is the same under one law.
        """
        criteria = self.laws[0].fit.criteria
        model = replace(self.identified, identification=None)
        frozen = freeze(model, courses, signed=self.signed, criteria=criteria)
        return averaged_log_density(self.weighted, frozen)

    @property
    def weighted(self) -> tuple[Weighted, ...]:
        """The laws with their probabilities."""
        return tuple(Weighted(law.name, law.fit, law.probability) for law in self.laws)

    @property
    def chosen_terms(self) -> dict[str, float]:
        """How often the law that comes first in a resample of the preloads has a term of a form, by form.

        Sums over the laws listed: what comes first more rarely is in none of them.
        """
        shares: dict[str, float] = {}
        for law in self.laws:
            for form in dict.fromkeys(term_form(term) for term in law.candidate.terms):
                shares[form] = shares.get(form, 0.0) + law.chosen
        there = ((form, share) for form, share in shares.items() if share > 0)
        return dict(sorted(there, key=lambda item: -item[1]))

    @property
    def front(self) -> tuple[RankedLaw, ...]:
        """Laws that no other one of as few numbers outscores, from the simplest to the best."""
        ordered = sorted(self.laws, key=lambda law: (law.free_numbers, -law.cross_validated_score))
        kept: list[RankedLaw] = []
        for law in ordered:
            if not kept or law.cross_validated_score > kept[-1].cross_validated_score:
                kept.append(law)
        return tuple(kept)


def with_law(model: Model, law: RankedLaw) -> Model:
    """Return the model with this tension law in its bolted link."""
    fit = replace(law.fit, candidate=law.candidate)
    return replace(model.with_tension_law(law.law), rate_uncertainty=fit.rate_uncertainty)
