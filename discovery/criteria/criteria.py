"""All criteria of `discovery` in one frozen object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from discovery.criteria.acceptance import Acceptance
from discovery.criteria.at_rest import AtRest
from discovery.criteria.chance import Chance
from discovery.criteria.closing import Closing
from discovery.criteria.courses import Courses
from discovery.criteria.localisation import Localising
from discovery.criteria.motion import Motion
from discovery.criteria.ranking import RankingRules
from discovery.criteria.screening import Screening
from discovery.criteria.search import Search
from discovery.criteria.separating import Separating
from discovery.criteria.tension import Tension


@dataclass(frozen=True)
class Criteria:
    """Every number that decides, in groups; `discovery.discover` and `discovery.close_loop` take another.

    Examples
    --------
    >>> from discovery import Criteria
    >>> strict = Criteria().changed(chance={"false_alarms": 0.01})
    >>> strict.chance.false_alarms
    0.01
    """

    acceptance: Acceptance = field(default_factory=Acceptance)
    chance: Chance = field(default_factory=Chance)
    closing: Closing = field(default_factory=Closing)
    screening: Screening = field(default_factory=Screening)
    motion: Motion = field(default_factory=Motion)
    tension: Tension = field(default_factory=Tension)
    at_rest: AtRest = field(default_factory=AtRest)
    localisation: Localising = field(default_factory=Localising)
    search: Search = field(default_factory=Search)
    courses: Courses = field(default_factory=Courses)
    ranking: RankingRules = field(default_factory=RankingRules)
    separating: Separating = field(default_factory=Separating)

    def changed(self, **groups: Mapping[str, float]) -> Criteria:
        """The same with other numbers.

        Parameters
        ----------
        **groups : mapping of str to float
            For each group, the numbers to change by name.

        Raises
        ------
        ValueError
            If there is no such group or number, or a value is none.
        """
        known = {one.name: getattr(self, one.name) for one in fields(self)}
        new: dict[str, Any] = {}
        for name, numbers in groups.items():
            if name not in known:
                raise ValueError(f"criteria: expected a group of {', '.join(known)}, got {name!r}")
            there = [one.name for one in fields(known[name])]
            wrong = [key for key in numbers if key not in there]
            if wrong:
                raise ValueError(
                    f"criteria.{name}: expected numbers of {', '.join(there)}, got {', '.join(wrong)}"
                )
            new[name] = replace(known[name], **numbers)
        return replace(self, **new)

    def rows(self) -> Iterator[tuple[str, str, float, str, str, str]]:
        """Yield group, name, value, unit, meaning and origin of every number."""
        for group in fields(self):
            held = getattr(self, group.name)
            for one in fields(held):
                told = one.metadata
                yield (
                    group.name,
                    one.name,
                    getattr(held, one.name),
                    told["unit"],
                    told["meaning"],
                    told["measured"],
                )


CRITERIA = Criteria()
"""The defaults."""
