"""Which effects of the catalogue are worth a fit."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Screening(Group):
    """Which effects of the catalogue are worth a fit."""
