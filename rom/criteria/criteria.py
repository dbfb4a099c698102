"""The criteria by which records are doubted and suspected, in one frozen object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

from rom.criteria.records import Records
from rom.criteria.suspicions import Suspicions

C = TypeVar("C", bound="RecordCriteria")


@dataclass(frozen=True)
class RecordCriteria:
    """Every number that decides whether a record is set aside, in groups.

    A campaign carries them; `discovery.Criteria` holds them beside all others.
    """

    records: Records = field(default_factory=Records)
    suspicions: Suspicions = field(default_factory=Suspicions)

    def changed(self: C, **groups: Mapping[str, float]) -> C:
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


RECORD_CRITERIA = RecordCriteria()
"""The defaults."""
