"""What the uncoupled tests say of the links of a body without the bolt: He et al. (2025), Section 3.1."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rom.campaign.campaign import CampaignSettings, LinkSettings
from rom.criteria.identification import RULES
from rom.identification.output_error import OutputErrorFit, fit_output_error, values_of
from rom.identification.priors import PriorConstraint, pull
from rom.identification.record_spectra import UNCOUPLED, LinearNames, given_value
from rom.identification.reduce import ReducedRecord, UncoupledTest
from rom.identification.spectral_model import CORNER, SpectralRecord, key
from rom.model.description import LinkLaws
from rom.model.laws import constant_damping, constant_stiffness
from rom.model.model import Model
from rom.model.structure import GROUND


def flexure_ties(records: Sequence[ReducedRecord], settings: CampaignSettings) -> tuple[PriorConstraint, ...]:
    """Return the ties of linear links to the modes of bodies without the bolt.

        k = m (2 pi f)^2,   c = 2 zeta m 2 pi f,   k_i(bolt in) / k_i = k_j(bolt in) / k_j

    Frequency and damping ratio do not depend on a force's or sensor's gain. The last is loose: He et al.
    (2025), Section 3.2, take 1.1 and 1.2; coupled tests know the sum of the stiffnesses far better than each.
    """
    tests = {
        link.name: (record.uncoupled, record.settings.given)
        for record in records
        if record.uncoupled is not None and (link := _only_link(record.uncoupled.body, settings)) is not None
    }
    ties = [
        _beside_given(tie, given)
        for link, (test, given) in tests.items()
        for tie in _of_mode(link, test)
        if tie.error < RULES.useful_mode and given_value(given, tie.leaning[0]) is None
    ]
    return (*ties, *_stiffened_alike(tuple(tests)))


def _only_link(body: str, settings: CampaignSettings) -> LinkSettings | None:
    """Return the one link that a body alone has; None where there are several or one without a spring."""
    links = [link for link in settings.link if body in link.between and link.law != "bolted"]
    if len(links) != 1 or links[0].law != "linear" or GROUND not in links[0].between:
        return None
    return links[0]


def _of_mode(link: str, test: UncoupledTest) -> Iterator[PriorConstraint]:
    frequency, ratio = test.mode.natural_frequency, test.mode.damping_ratio
    omega, mass = 2 * np.pi * frequency.value, LinearNames.mass(test.body)
    stiffness, damping = LinearNames.stiffness(link, bolted_in=False), LinearNames.damping(link)
    yield PriorConstraint(
        {stiffness: 1.0, mass: -1.0},
        float(2 * np.log(omega)),
        float(np.hypot(2 * frequency.standard_error / frequency.value, RULES.prior_stiffness)),
        (stiffness,),
        f"{link}: stiffness without the bolt and the frequency of {test.file}",
    )
    if ratio.value > 0:
        yield PriorConstraint(
            {damping: 1.0, mass: -1.0},
            float(np.log(2 * ratio.value * omega)),
            float(np.hypot(ratio.standard_error / ratio.value, RULES.prior_damping)),
            (damping,),
            f"{link}: damping and the damping ratio of {test.file}",
        )


def _beside_given(tie: PriorConstraint, given: Mapping[str, float]) -> PriorConstraint:
    """Return the tie with what its record gives taken as known."""
    known = {name: value for name in tie.factors if (value := given_value(given, name)) is not None}
    if not known:
        return tie
    target = tie.target - sum(tie.factors[name] * float(np.log(value)) for name, value in known.items())
    return replace(tie, factors={n: f for n, f in tie.factors.items() if n not in known}, target=target)


def _stiffened_alike(links: Sequence[str]) -> Iterator[PriorConstraint]:
    for first, second in pairwise(links):
        with_bolt = tuple(LinearNames.stiffness(link) for link in (first, second))
        without = tuple(LinearNames.stiffness(link, bolted_in=False) for link in (first, second))
        factors = dict(zip((*with_bolt, *without), (1.0, -1.0, -1.0, 1.0), strict=True))
        yield PriorConstraint(
            factors,
            0.0,
            RULES.stiffened_alike,
            with_bolt,
            f"{first} and {second}: what the bolt adds to their stiffnesses",
        )


def fit_near(records: Sequence[SpectralRecord], ties: Sequence[PriorConstraint]) -> OutputErrorFit:
    """Return the fit of `fit_output_error`, with the ties where it breaks one of a stiffness and leaves more
    than noise.

    Records that the model fits know better than any tie; to them it does not count.
    """
    free = fit_output_error(records)
    values = values_of(records, free)
    ties = tuple(tie for tie in ties if tie.factors.keys() <= values.keys())
    pulled = zip(ties, pull(ties, records, free.misfits), strict=True)
    stiff = of_stiffness(ties)
    if any(
        weight > 0 and tie in stiff and abs(tie.offset(values)) > RULES.strained for tie, weight in pulled
    ):
        return fit_output_error(_restarted(records, values, ties), ties=ties)
    return replace(free, ties=ties)


def _restarted(
    records: Sequence[SpectralRecord], values: Mapping[str, float], ties: Sequence[PriorConstraint]
) -> tuple[SpectralRecord, ...]:
    """Return the records with starts that keep all ties: the modes, and one stiffening of all links.

    Bodies that a bolt ties together move nearly alike in the first mode, whose frequency tells the sum.
    """
    found = {name: value for name, value in values.items() if not name.startswith(CORNER)}
    alike = [tie.leaning for tie in ties if len(tie.leaning) > 1]
    for tie in ties:
        if len(tie.leaning) == 1:
            found[tie.leaning[0]] *= float(np.exp(tie.offset(found) * tie.error))
    with_bolt = tuple(dict.fromkeys(name for names in alike for name in names))
    if with_bolt:
        without = {name: f"{name}.{UNCOUPLED}" for name in with_bolt}
        factor = sum(found[name] for name in with_bolt) / sum(found[name] for name in without.values())
        found |= {name: factor * found[other] for name, other in without.items()}
    return tuple(
        replace(r, terms=tuple(replace(t, value=found.get(key(r, t), t.value)) for t in r.terms))
        for r in records
    )


def of_stiffness(ties: Sequence[PriorConstraint]) -> tuple[PriorConstraint, ...]:
    """Return the ties of stiffnesses alone: an effect that the model lacks may well pass for damping."""
    dampings = LinearNames.damping("")
    return tuple(tie for tie in ties if not any(name.endswith(dampings) for name in tie.factors))


def without_modes(ties: Sequence[PriorConstraint], acted_in: Collection[str]) -> tuple[PriorConstraint, ...]:
    """Return the ties but those to modes of links and bodies, ``body:NAME``, that effects act in or on."""
    masses = {
        LinearNames.mass(place.removeprefix("body:")) for place in acted_in if place.startswith("body:")
    }

    def holds(tie: PriorConstraint) -> bool:
        link, *others = {name.partition(".")[0] for name in tie.leaning}
        return bool(others) or (link not in acted_in and not masses & tie.factors.keys())

    return tuple(tie for tie in ties if holds(tie))


def constants(model: Model) -> Mapping[str, float]:
    """Return masses and the constants of links that do not see the tension, as fits name them."""
    found = {LinearNames.mass(body.name): body.mass for body in model.structure.bodies}
    for bolted_in, every in ((True, model.link_laws), (False, model.uncoupled_laws)):
        for link, laws in every.items():
            if link not in model.structure.bolted_links:
                found[LinearNames.stiffness(link, bolted_in=bolted_in)] = float(laws.stiffness(0.0))
                found[LinearNames.damping(link)] = float(laws.damping(0.0))
    return found


def as_uncoupled(model: Model, ties: Sequence[PriorConstraint]) -> Model:
    """Return a model with its linear links as the uncoupled tests tell them, with the bolt in and without.

    Frequency and damping of a body alone are right whatever the gain of its sensors, and the bolt adds little
    to its flexure: 10 to 20 % in He et al. (2025), Section 3.2.
    """
    values = constants(model)
    alone = {
        tie.leaning[0]: values[tie.leaning[0]] * float(np.exp(tie.offset(values) * tie.error))
        for tie in ties
        if len(tie.leaning) == 1 and tie.factors.keys() <= values.keys()
    }

    def laws_of(link: str, laws: LinkLaws) -> LinkLaws:
        k = alone.get(LinearNames.stiffness(link, bolted_in=False))
        c = alone.get(LinearNames.damping(link))
        return LinkLaws(
            laws.stiffness if k is None else constant_stiffness(k),
            laws.damping if c is None else constant_damping(c),
            laws.tension_rate,
        )

    return replace(
        model,
        link_laws={link: laws_of(link, laws) for link, laws in model.link_laws.items()},
        uncoupled_laws={link: laws_of(link, laws) for link, laws in model.uncoupled_laws.items()},
    )


def unlikely(model: Model, ties: Sequence[PriorConstraint]) -> tuple[str, ...]:
    """Return a line for every tie that a model's numbers break by far; none for a model near its plant.

    A stiffness may be off either way, a damping only be too large: friction, say, passes for damping in an
    uncoupled test and is none.
    """
    values, stiff = constants(model), of_stiffness(ties)
    lines = []
    for tie in ties:
        if tie.factors.keys() <= values.keys():
            offset = tie.offset(values)
            if offset < -RULES.unlikely or (offset > RULES.unlikely and tie in stiff):
                factor = float(np.exp(-offset * tie.error))
                far = f"a factor of {factor:.3g}, {abs(offset):.0f} standard errors"
                lines.append(f"{tie.statement} do not agree: {far}")
    return tuple(lines)


def unsettled(model: Model, fit: OutputErrorFit) -> tuple[str, ...]:
    """Return reasons to doubt that an identified model is near its plant: unlikely numbers, or much misfit in
    the coupled tests without an uncoupled test that would hold the links.
    """
    seen = (m for m in fit.misfits if m.systematic and m.of_motion > RULES.much_motion)
    share = max((m.share for m in seen if not m.group.startswith(UNCOUPLED)), default=0)
    lines = unlikely(model, fit.ties)
    if share > RULES.much_misfit and not of_stiffness(fit.ties):
        text = (
            f"{100 * share:.0f} % of what the linear model leaves over is no noise, and no uncoupled test "
            "tells the links by themselves: their numbers may be far from the structure's"
        )
        lines = (*lines, text)
    return lines
