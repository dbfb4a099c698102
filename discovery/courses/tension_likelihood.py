"""The likelihood of any tension law, and of a gauge's slow readings, along frozen motion.

    y_i = mean over bins of T_i + reading,   dT_i/dt = exp(u_i) law(T_i, x, v, F, D),   u_i ~ N(0, tau_i^2)

A general law has no exposures: every case is followed node by node. The rest, u integrated out and the
steps, is that of ``discovery.courses.marginal_likelihood``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from discovery.courses.frozen_motion import FrozenMotion
from discovery.courses.marginal_likelihood import Problem
from discovery.courses.prediction import bin_edges, followed, simulated_means
from discovery.laws.candidate import Candidate
from discovery.laws.given import OWN_RATE, scattering
from rom.campaign.channels import FloatArray
from rom.criteria.number import Numerical
from rom.effects import LawChange, ModelCorrection, Reading, SensorFault
from rom.model.law_change import prefix_of
from rom.model.laws import Law, Parameter
from rom.model.model import Model
from rom.model.rate_uncertainty import RateUncertainty

_NEVER: Numerical[float] = 1e6  # stands for a course that is lost, in newton
_PER_BIN: Numerical[int] = 24


@dataclass(frozen=True)
class LawCandidate(Candidate):
    """Any law of the tension, and what the gauge adds to it, with the numbers that a fit moves.

    Attributes
    ----------
    rate : Law
        With the number ``own_rate`` that multiplies it.
    effect : ModelCorrection or None
        A reading or a fault of the gauge, linear in time or not; what changes the law is in the law.
    moved : tuple of str
        Names in the law, and those in the effect.
    sharing : int or None
        As for `law_candidate`.
    """

    rate: Law | None = None
    effect: ModelCorrection | None = None
    moved: tuple[str, ...] = ()
    sharing: int | None = None

    @property
    def acting(self) -> Law:
        """The law, own rates in it."""
        assert self.rate is not None
        return self.rate

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Numbers of the law and of the effect."""
        own = dict(self.effect.parameters) if self.effect is not None else {}
        return {**self.acting.parameters, **own}

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the numbers that a fit moves."""
        return self.moved

    def law(self) -> Law:
        """The law for a model's bolted link."""
        return self.acting

    def rated(self, factors: FloatArray) -> dict[str, FloatArray]:
        """Numbers that make what scatters of the rate so many times as fast, by name, each (cases,)."""
        return {OWN_RATE: factors}

    def with_values(self, values: Mapping[str, float]) -> LawCandidate:
        """The same candidate with other numbers, each within its range."""
        ranges = self.parameters
        values = {name: float(np.clip(value, *ranges[name].bounds)) for name, value in values.items()}
        of_law = {name: value for name, value in values.items() if name in self.acting.parameters}
        of_effect = {name: value for name, value in values.items() if name not in of_law}
        effect = self.effect
        if effect is not None and of_effect:
            effect = effect.with_values(**of_effect)
        return replace(self, rate=self.acting.with_values(**of_law), effect=effect)


def law_candidate(
    model: Model, effect: ModelCorrection | None, baseline: tuple[str, ...], sharing: int | None = None
) -> LawCandidate:
    """Return a model's tension law, with one more effect, the numbers of both free.

    Parameters
    ----------
    model : Model
        The current model, what it holds already in it.
    effect : ModelCorrection or None
        A change of the law, a reading or a fault.
    baseline : tuple of str
        Numbers of the model's own law that are free.
    sharing : int or None
        How many of the changes, in order, share the law's scatter from test to test; those after them are
        the same in every test. None: all of them.
    """
    first = model.link_laws[model.structure.bolted_links[0]].tension_rate
    assert first is not None
    changes = changes_of(model, effect)
    law = first
    for place, change in enumerate(changes):
        law = scattering(law) if place == sharing else law
        law = change.changed(law, prefix_of(change), first)
    rate = law if OWN_RATE in law.parameters else scattering(law)
    own = tuple(n for n in rate.parameters if n != OWN_RATE and (n in baseline or n not in first.parameters))
    beside = None if effect is None or effect.kind == "law change" else effect
    added = tuple(beside.parameters) if beside is not None else ()
    return LawCandidate(rate.name, (), (), rate=rate, effect=beside, moved=(*own, *added), sharing=sharing)


def changes_of(model: Model, effect: ModelCorrection | None) -> tuple[LawChange, ...]:
    """Changes of a model's tension law in order, with one more effect."""
    return tuple(one for one in (*model.effects, effect) if isinstance(one, LawChange))


def names_of(effect: ModelCorrection) -> Mapping[str, str]:
    """Names of an effect's numbers among a candidate's, by their names in the effect."""
    if effect.kind != "law change":
        return {name: name for name in effect.parameters}
    return {name: prefix_of(effect) + name for name in effect.parameters}


def rate_uncertainty_of(model: Model, known: RateUncertainty) -> RateUncertainty:
    """What a fit of a model's law and its changes says of the model's rate: changes' numbers by their paths.

    Parameters
    ----------
    model : Model
        Whose law was fitted (``law_candidate`` without an effect).
    known : RateUncertainty
        With the names of the candidate's numbers; those of readings do not count.
    """
    law = model.link_laws[model.structure.bolted_links[0]].tension_rate
    assert law is not None
    names = {name: name for name in law.parameters}
    for change in changes_of(model, None):
        names |= {long: f"{change.path}.{name}" for name, long in names_of(change).items()}
    kept = [place for place, name in enumerate(known.parameters) if name in names]
    covariance = np.reshape(known.covariance, (len(known.parameters),) * 2)[np.ix_(kept, kept)]
    return replace(
        known,
        parameters=tuple(names[known.parameters[place]] for place in kept),
        covariance=tuple(map(tuple, covariance.tolist())),
    )


def law_problem(candidate: Candidate, frozen: FrozenMotion, offsets: FloatArray) -> Problem:
    """The fit of one general law: the course is followed along the nodes.

    Parameters
    ----------
    candidate : LawCandidate
        Its numbers are the start.
    frozen : FrozenMotion
        Motion and measured courses.
    offsets : ndarray, shape (cases, bins)
        Corrections to every predicted course [N].
    """
    return Problem(candidate, frozen, offsets, course)


def course(candidate: Candidate, frozen: FrozenMotion, u: FloatArray) -> FloatArray:
    """Changes of the measured tension [N] in every bin along the frozen motion, (cases, bins).

    Parameters
    ----------
    candidate : LawCandidate
        The law, and what the gauge adds.
    frozen : FrozenMotion
        Motion along which it is followed.
    u : ndarray, shape (cases,)
        Logarithm of every case's own rate.

    Returns
    -------
    ndarray, shape (cases, bins)
        Mean reading in the bin less the tension before the hit [N].
    """
    assert isinstance(candidate, LawCandidate)
    rates = np.exp(np.clip(u, -50.0, 50.0))
    true = _before(candidate.effect, frozen)
    means = followed(candidate.acting, OWN_RATE, frozen, rates, true, bin_edges(frozen))
    return _shown(candidate.effect, np.nan_to_num(means, nan=_NEVER), frozen)


def _before(effect: ModelCorrection | None, frozen: FrozenMotion) -> FloatArray:
    """Tension before the hit [N], (cases,), a fault of the gauge taken out."""
    return effect.remove(frozen.initial, 1.0) if isinstance(effect, SensorFault) else frozen.initial


def _shown(effect: ModelCorrection | None, means: FloatArray, frozen: FrozenMotion) -> FloatArray:
    """What the gauge shows of mean tensions less what it showed before the hit [N], (cases, bins)."""
    if isinstance(effect, SensorFault):
        return np.asarray(effect.apply(means, 1.0) - frozen.initial[:, None])
    added = slow_reading(effect, bin_edges(frozen))
    return np.asarray(means - np.maximum(frozen.initial, 0.0)[:, None] + added)


def slow_reading(effect: ModelCorrection | None, edges: FloatArray) -> FloatArray:
    """What a reading adds to the mean of every bin while nothing moves [N], (bins,); no other effect does."""
    if not isinstance(effect, Reading):
        return np.zeros(len(edges) - 1)
    share = (np.arange(_PER_BIN) + 0.5) / _PER_BIN
    time = (edges[:-1, None] + np.diff(edges)[:, None] * share).ravel()
    return np.asarray(effect.at_rest(time).reshape(-1, _PER_BIN).mean(axis=1))


def acts_at_rest(effect: ModelCorrection) -> bool:
    """Whether an effect is a reading that adds anything while nothing moves."""
    return bool(np.any(slow_reading(effect, np.array([0.0, 0.1, 1.0]))))


def resimulated(candidate: LawCandidate, frozen: FrozenMotion, u: FloatArray, model: Model) -> FloatArray:
    """Changes of the measured tension [N] by full simulation, (cases, bins); nan where it diverged.

    Parameters
    ----------
    candidate : LawCandidate
        The law, and what the gauge adds.
    frozen : FrozenMotion
        Forces and bins of all cases.
    u : ndarray, shape (cases,)
        Logarithm of every case's own rate.
    model : Model
        Its forces act; its own tension law and what its gauge adds do not.

    Returns
    -------
    ndarray, shape (cases, bins)
        Mean reading in the bin less the tension before the hit [N].
    """
    own = model.without_effects_of("law change", "reading", "sensor fault")
    own, rates = own.with_tension_law(candidate.acting, frozen.link), np.exp(np.clip(u, -50.0, 50.0))
    initial = np.maximum(_before(candidate.effect, frozen), 0.0)
    means = simulated_means(own, frozen, initial, {OWN_RATE: rates})
    return _shown(candidate.effect, means, frozen)
