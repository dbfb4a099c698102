"""Tension laws of installed packages: entry points of the group ``boltlaw.laws``.

An entry point names a `Law` of the tension rate, an expression of dT/dt, or a list of these.
"""

from __future__ import annotations

from collections.abc import Sequence

from discovery.laws.candidate import Candidate, rivals_always_in_the_race
from discovery.laws.given import GivenLaw, check_finite, check_units, given_law
from rom.campaign.channels import FloatArray
from rom.model.laws import Law
from rom.plug_ins import LAWS, members_of, plug_ins


def plug_in_laws(given: Sequence[Candidate] = ()) -> tuple[Candidate, ...]:
    """Return the laws of installed packages, ready for a race in which others are given.

    Raises
    ------
    ValueError
        If one has the name of another's, of a standing law, or of one that is given.
    """
    owners = {law.name: "boltlaw" for law in rivals_always_in_the_race()}
    owners |= {law.name: "laws.toml" for law in given}
    found: list[Candidate] = []
    for package, laws in plug_ins(LAWS, _read):
        for law in laws:
            owner = owners.setdefault(law.name, package)
            if owner != package or law.name in [other.name for other in found]:
                raise ValueError(
                    f"plug-in {package!r}: found a law {law.name!r}, which {owner!r} has too, expected "
                    "another name"
                )
            found.append(law)
    return tuple(found)


def usable(laws: Sequence[Candidate], nodes: FloatArray) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """Divide laws of plug-ins into those that are numbers along a motion, and a line for each other one.

    Parameters
    ----------
    laws : sequence of Candidate
        As `plug_in_laws` returns them.
    nodes : ndarray, shape (6, nodes)
        As `FrozenMotion.nodes`.

    Returns
    -------
    tuple
        Laws, and lines.
    """
    kept, lines = [], []
    for law in laws:
        try:
            if isinstance(law, GivenLaw):
                check_finite(law, nodes)
            kept.append(law)
        except ValueError as error:
            lines.append(f"plug-in: {error}; it is left out")
    return tuple(kept), tuple(lines)


def _read(found: object) -> tuple[Candidate, ...]:
    laws: tuple[Law | str, ...] = members_of(found, (Law, str))
    for law in laws:
        if isinstance(law, Law):
            check_units(law)
    return tuple(given_law(law) for law in laws)
