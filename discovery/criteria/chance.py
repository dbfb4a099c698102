"""The null distribution that is drawn from a campaign's own residuals."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Chance(Group):
    """The null distribution that is drawn from a campaign's own residuals."""
