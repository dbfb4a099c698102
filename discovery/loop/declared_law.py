"""A closed loop that starts from the tension law of a model that was found before."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from discovery.courses.tension_likelihood import changes_of, names_of
from rom.campaign.campaign import Campaign
from rom.effects import LawChange
from rom.model.law_change import change_law
from rom.model.laws import Law, Parameter, free_form_law
from rom.model.model import Model


def declared_law(model: Model, campaign: Campaign) -> Law:
    """Return a model's tension law, its changes in it, for a campaign of the same structure.

    Raises
    ------
    ValueError
        If the campaign has no impact tests of one bolt, or the model other bodies or links.
    """
    settings = campaign.settings
    bolts = [link.name for link in settings.link if link.law == "bolted"]
    if len(bolts) != 1 or not campaign.select("loosening", hold_out=False):
        found = f"{len(bolts)} bolted links" if len(bolts) != 1 else "no loosening record to fit"
        raise ValueError(
            f"{campaign.path}: found {found}, expected one bolt and its loosening records: "
            "the tension law of a model starts nothing else"
        )
    here = _structure(
        (body.name for body in settings.body), ((x.name, *x.between, x.law) for x in settings.link)
    )
    structure = model.structure
    there = _structure(
        (body.name for body in structure.bodies),
        ((x.name, x.first, x.second, x.law) for x in structure.links),
    )
    if here != there:
        raise ValueError(
            f"model: found {there}, expected the structure of {campaign.path}: {here}; its law starts only "
            "campaigns of the structure that it was found on"
        )
    law = model.link_laws[bolts[0]].tension_rate
    assert law is not None  # a bolted link has one
    whole = change_law(law, model.effects_of("law change"))[0]
    return _renamed(whole, set(whole.parameters) - set(law.parameters))


def _renamed(law: Law, names: set[str]) -> Law:
    """The law with other names for some of its numbers: the same change may be found in it once more."""
    if not names:
        return law
    new = {name: f"was_{name}" if name in names else name for name in law.parameters}
    equation = re.sub(r"\b[A-Za-z_]\w*\b", lambda word: new.get(word[0], word[0]), law.equation)
    return free_form_law(law.name, equation, "tension rate", {new[n]: p for n, p in law.parameters.items()})


def _structure(bodies: Iterable[str], links: Iterable[tuple[str, str, str, str]]) -> str:
    """Bodies and links in words, in an order of their own."""
    listed = (f"{name} ({law}, {first} to {second})" for name, first, second, law in sorted(links))
    return f"bodies {', '.join(sorted(bodies))} and links {', '.join(listed)}"


def tension_law_of(model: Model) -> Law:
    """The law of a model's bolt, without what changes it."""
    law = model.link_laws[model.structure.bolted_links[0]].tension_rate
    assert law is not None
    return law


def with_law_numbers(model: Model, numbers: Mapping[str, Parameter]) -> Model:
    """The model with other numbers in its tension law and in what changes it, by their names in a fit."""
    if not numbers:
        return model
    law = tension_law_of(model)
    own = {name: numbers.get(name, number) for name, number in law.parameters.items()}
    model = model.with_tension_law(replace(law, parameters=own))
    changed = {change.path: _with_numbers(change, numbers) for change in changes_of(model, None)}
    return replace(model, effects=tuple(changed.get(effect.path, effect) for effect in model.effects))


def _with_numbers(change: LawChange, numbers: Mapping[str, Parameter]) -> LawChange:
    own = {name: numbers.get(long, change.parameters[name]) for name, long in names_of(change).items()}
    return replace(change, parameters=own)


def with_law_of(model: Model, other: Model) -> Model:
    """The model with the tension law of another one of its structure, and what is known of its scale."""
    if not model.structure.bolted_links:
        return model
    return replace(model.with_tension_law(tension_law_of(other)), rate_uncertainty=other.rate_uncertainty)
