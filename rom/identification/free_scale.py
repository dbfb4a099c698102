"""What fixes the common factor of masses, stiffnesses and dampings, which free decay does not tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass

from rom.campaign.campaign import CampaignSettings, LinkSettings
from rom.model.structure import GROUND


@dataclass(frozen=True, eq=False)
class Scale:
    """Which numbers a fit may move, by path; all others are held at their value.

    `known` tells whether a given number fixes the common factor, `lines` what to say of it.
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    lines: tuple[str, ...]
    known: bool


def mass_of(body: str) -> str:
    """Path of a mass."""
    return f"body.{body}.mass"


def scale_of(settings: CampaignSettings, of_records: Iterable[Mapping[str, float]] = ()) -> Scale:
    """Fix the common factor of each part of the structure by what is given there, if in one record alone."""
    in_records = {path for given in of_records for path in given}
    free = [mass_of(b.name) for b in settings.body if b.mass_kg is None]
    lines, held, known = [], set[str](), True
    for part in _parts(settings):
        if any(b.mass_kg is not None for b in settings.body if b.name in part):
            continue
        if in_records & _paths(settings, part):
            continue
        names = ", ".join(sorted(part))
        given = _given_stiffness(settings, part)
        if given is not None:
            held.add(f"{given.name}.stiffness.k")
            lines.append(
                f"{names}: no force acts and no mass is given; all numbers go with the given stiffness of "
                f"link {given.name}, {given.stiffness_n_per_m:.4g} N/m"
            )
            continue
        first = next(b.name for b in settings.body if b.name in part)
        free.remove(mass_of(first))
        known = False
        lines.append(
            f"{names}: no force acts and neither a mass nor a stiffness is given; free decay tells only "
            f"the ratios of all numbers to the mass of {first}, for which 1 kg stands in"
        )
    for link in settings.link:
        free += [f"{link.name}.damping.c"]
        if link.law != "dashpot" and f"{link.name}.stiffness.k" not in held:
            free.append(f"{link.name}.stiffness.k")
    return Scale(_given(settings), tuple(free), tuple(lines), known)


def _paths(settings: CampaignSettings, part: Set[str]) -> set[str]:
    """Paths of masses and stiffnesses at some bodies."""
    links = (link for link in settings.link if set(link.between) & part)
    return {mass_of(body) for body in part} | {f"{link.name}.stiffness.k" for link in links}


def _given(settings: CampaignSettings) -> dict[str, float]:
    """What the campaign gives, 1 kg for other masses and zero for other stiffnesses and dampings."""
    values = {mass_of(b.name): b.mass_kg or 1.0 for b in settings.body}
    for link in settings.link:
        values[f"{link.name}.stiffness.k"] = link.stiffness_n_per_m or 0.0
        values[f"{link.name}.damping.c"] = link.damping_ns_per_m or 0.0
    return values


def _given_stiffness(settings: CampaignSettings, part: Set[str]) -> LinkSettings | None:
    """The first link at some bodies whose stiffness is given."""
    there = (x for x in settings.link if set(x.between) & part and x.law != "dashpot")
    return next((x for x in there if x.stiffness_n_per_m), None)


def _parts(settings: CampaignSettings) -> list[set[str]]:
    """Bodies that links join to one another, the ground left out."""
    parts = [{body.name} for body in settings.body]
    for link in settings.link:
        ends = set(link.between) - {GROUND}
        joined = [part for part in parts if part & ends]
        parts = [part for part in parts if not part & ends] + [set().union(*joined)]
    return parts
