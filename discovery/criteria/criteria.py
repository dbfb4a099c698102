"""All criteria in one frozen object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from discovery.criteria.acceptance import Acceptance
from discovery.criteria.at_rest import AtRest
from discovery.criteria.bootstrap import Bootstrap
from discovery.criteria.chance import Chance
from discovery.criteria.closing import Closing
from discovery.criteria.courses import Courses
from discovery.criteria.detection import Detection
from discovery.criteria.localisation import Localising
from discovery.criteria.motion import Motion
from discovery.criteria.ranking import RankingRules
from discovery.criteria.screening import Screening
from discovery.criteria.search import Search
from discovery.criteria.separating import Separating
from discovery.criteria.tension import Tension
from rom.criteria.criteria import RecordCriteria


@dataclass(frozen=True)
class Criteria(RecordCriteria):
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
    detection: Detection = field(default_factory=Detection)
    bootstrap: Bootstrap = field(default_factory=Bootstrap)
    localisation: Localising = field(default_factory=Localising)
    search: Search = field(default_factory=Search)
    courses: Courses = field(default_factory=Courses)
    ranking: RankingRules = field(default_factory=RankingRules)
    separating: Separating = field(default_factory=Separating)

    @property
    def of_records(self) -> RecordCriteria:
        """Those by which records are set aside."""
        return RecordCriteria(self.records, self.suspicions)

    @property
    def changes(self) -> dict[str, dict[str, float]]:
        """The numbers that are not the defaults, by group, as `changed` takes them."""
        found: dict[str, dict[str, float]] = {}
        for group in fields(self):
            pairs = zip(getattr(self, group.name).rows(), getattr(CRITERIA, group.name).rows(), strict=True)
            own = {name: value for (name, value, *_), (_, default, *_) in pairs if value != default}
            found |= {group.name: own} if own else {}
        return found

    @property
    def level_of_limits(self) -> str:
        """Of a law's numbers, in words: the wider of the likelihood's limits and those of resamples."""
        return " to ".join(sorted({percent(self.chance.level), percent(self.ranking.confidence)}))

    @property
    def level_of_noise(self) -> str:
        """Share of cases in which correlations of noise stay within what is printed as chance, in words."""
        return " to ".join(sorted({percent(self.chance.level), percent(1 - self.localisation.chance)}))


CRITERIA = Criteria()
"""The defaults."""


def used_in(result: Mapping[str, Any]) -> Criteria:
    """Return the criteria of a result file, which holds those that are not the defaults.

    Those of another version that are no longer there decide nothing here and are left out.
    """
    there = {
        group.name: {name for name, *_ in getattr(CRITERIA, group.name).rows()} for group in fields(CRITERIA)
    }
    held = (result.get("criteria") or {}).items()
    known = {g: {n: x for n, x in own.items() if n in there[g]} for g, own in held if g in there}
    return CRITERIA.changed(**known)


def percent(share: float) -> str:
    """Return a probability in words: ``"95 %"``."""
    return f"{100 * share:.3g} %"
